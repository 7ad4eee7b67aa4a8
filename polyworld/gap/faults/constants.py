"""Another gravity, mass, length of a pendulum or stiffness of a spring than the world's.

A period that is off by a factor is a wrong length or stiffness before it is anything else. A pendulum's length acts
through gravity over length alone where its angle was recorded, so that it is varied as such.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.estimation.linkage import is_held
from polyworld.gap.candidate import Candidate, Variant, of_path, one_start
from polyworld.gap.conditions import conditions
from polyworld.world import World
from polyworld.world.parameters import object_mass
from polyworld.world.representations.joint import Hinge, Spring
from polyworld.world.representations.rigid import RigidObject

Array = NDArray[np.float64]


def _gravity(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    size = float(np.linalg.norm(found.gravity))
    moved = [a for a in found.axes if abs(found.gravity[a]) > 1e-6 * size]
    if not moved:
        return ()  # none, or only across a motion plane, where it acts through friction alone
    unknowns = [
        of_path(
            world,
            (f"environment.gravity.{'xyz'[a]}",),
            "gravity" if len(moved) == 1 else f"gravity_{'xyz'[a]}",
            float(found.gravity[a]),
            0.05 * size,
            lower=float(found.gravity[a]) - 2.0 * size,
            upper=float(found.gravity[a]) + 2.0 * size,
            plausible=size,  # that of the Moon, or of a table without a tilt, is off by about as much
        )
        for a in moved
    ]
    same = ("buoyancy", "observer_clock") + (() if found.touches else ("observer_scale",))
    return (one_start(world, unknowns, same_as=same),)


RATIO = 30.0  # by which a mass may be wrong either way


def _mass(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    pairs = [*found.meetings, *((j.object, j.other) for j in world.joints if j.other is not None)]
    linked = [o for o in world.objects if any(o.name in pair for pair in pairs)]
    # Only ratios of masses show; where there are two, the second's stands for theirs.
    return tuple(_of(world, o) for o in (linked[1:] if len(linked) <= 2 else linked))


def _of(world: World, item: RigidObject) -> Variant:
    mass = object_mass(item)
    path = f"objects.{item.name}.mass"
    unknown = of_path(world, (path,), "mass", mass, 0.3 * mass, lower=mass / RATIO, upper=mass * RATIO)
    return one_start(world, (unknown,), f"of {item.name}")


RATIOS = np.geomspace(1.0 / 32.0, 32.0, 31)  # of the squared frequency: one start for each 12% of the period
WIDEST = 100.0


def _length(world: World, recording: Recording) -> tuple[Variant, ...]:
    """Return a factor on gravity over length, where all that moves hangs on hinges."""
    names = {n.split("#", 1)[0] for run in recording.runs for n in run.names}
    hinged = any(isinstance(j, Hinge) for j in world.joints) and all(is_held(world, n) for n in names)
    gravity = np.asarray(world.environment.gravity, dtype=float)
    if world.planar or not hinged or np.count_nonzero(gravity) != 1:
        return ()
    axis = int(np.argmax(np.abs(gravity)))
    size = float(gravity[axis])
    limits = sorted((size / WIDEST, size * WIDEST))
    unknown = of_path(
        world, (f"environment.gravity.{'xyz'[axis]}",), "gravity_for_this_length", size, 0.02 * abs(size),
        lower=limits[0], upper=limits[1],
    )  # fmt: skip
    starts = tuple({unknown.name: size * float(r)} for r in (1.0, *RATIOS))
    return (Variant(world, (unknown,), starts, "as gravity over length"),)


def _stiffness(world: World, recording: Recording) -> tuple[Variant, ...]:
    """Return a stiffness of each spring."""
    del recording
    made = []
    for joint in world.joints:
        if not isinstance(joint, Spring) or not joint.stiffness > 0.0:
            continue
        unknown = of_path(
            world, (f"joints.{joint.name}.stiffness",), "stiffness", joint.stiffness, 0.02 * joint.stiffness,
            lower=joint.stiffness / WIDEST, upper=joint.stiffness * WIDEST,
        )  # fmt: skip
        starts = tuple({"stiffness": joint.stiffness * float(r)} for r in (1.0, *RATIOS))
        made.append(Variant(world, (unknown,), starts, f"of {joint.name}"))
    return tuple(made)


CANDIDATES = (
    Candidate(
        name="gravity_error",
        group="base",
        law="a = g', another gravity than the world's",
        variants=_gravity,
        plain=True,
    ),
    Candidate(
        name="mass_error",
        group="base",
        law="m' of one body, where masses share momentum",
        variants=_mass,
    ),
    Candidate(
        name="length_error",
        group="base",
        law="T = 2 pi sqrt(L / g) of small swings, another length L than the world's",
        variants=_length,
        plain=True,
    ),
    Candidate(
        name="stiffness_error",
        group="base",
        law="T = 2 pi sqrt(m / k), another stiffness k than the world's",
        variants=_stiffness,
        plain=True,
    ),
)
