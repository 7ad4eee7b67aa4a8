"""Another period of an oscillation than the world's: the length of a pendulum, the stiffness of a spring.

A period that is off by a factor is a wrong length or stiffness before it is anything else. A pendulum's length acts
through gravity over length alone where its angle was recorded, so that it is varied as such.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.estimation.linkage import is_held
from polyworld.gap.adding import of_path
from polyworld.gap.candidate import Candidate, Variant
from polyworld.world import World
from polyworld.world.representations.joint import Hinge, Spring

Array = NDArray[np.float64]

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
