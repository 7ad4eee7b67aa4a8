"""Other numbers than the world's: gravity, masses, lengths, stiffness, coefficients of contacts, of deformables.

A period that is off by a factor is a wrong length or stiffness before it is anything else. A pendulum's length acts
through gravity over length alone where its angle was recorded, so that it is varied as such.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.estimation.linkage import is_held
from polyworld.gap.candidate import Candidate, Variant, by_value, of_path, one_start
from polyworld.gap.conditions import conditions
from polyworld.world import World
from polyworld.world.materials import Form, material_of
from polyworld.world.parameters import object_mass, read_parameter
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
    return tuple(_mass_of(world, o) for o in (linked[1:] if len(linked) <= 2 else linked))


def _mass_of(world: World, item: RigidObject) -> Variant:
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


MOST_GROUPS = 4  # different values among bodies that are fitted independently; more would be a refit, not an effect
OTHERS = (0.4, 2.5)  # times a friction that fits begin at, too
ORDINARY_RESTITUTION = 0.5  # by which it may be off: lead from ivory
ORDINARY_FRICTION = 1.0  # likewise: rubber from ice
ORDINARY_ROLLING = 0.3  # likewise, of the radius: a wheel in sand from one on a rail
ROUND = ("sphere", "cylinder", "capsule")


def _surface(world: World, field: str, sized: Callable[[float], Mapping[str, float]]) -> list[Variant]:
    """Return ways in which a coefficient of contacts may be wrong: that of the bodies, or that of one of the
    statics."""
    of_bodies = by_value(world, [f"objects.{o.name}.{field}" for o in world.objects], field, sized)
    made: list[Variant] = []
    if 0 < len(of_bodies) <= MOST_GROUPS:
        several = len(world.statics) > 1 or len(of_bodies) > 1
        made.append(one_start(world, of_bodies, "of the bodies" if several else ""))
    if len(world.statics) < 2 and len(of_bodies) < 2:
        return made  # one body's coefficient and one floor's act through their product alone
    for static in world.statics:
        path = f"statics.{static.name}.{field}"
        value = read_parameter(world, path)
        if value is None and len(of_bodies) > 1:
            continue  # it takes each body's own: no one value of its own leaves the motion as it is
        start = of_bodies[0].start if value is None else value
        made.append(one_start(world, (of_path(world, (path,), field, start, **sized(start)),), f"of {static.name}"))
    return made


def _restitution(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not found.impacts:
        return ()
    return tuple(_surface(world, "restitution", lambda _: {"typical": 0.1, "plausible": ORDINARY_RESTITUTION}))


def _size_of_friction(value: float) -> Mapping[str, float]:
    return {"typical": max(0.3 * value, 0.05), "plausible": ORDINARY_FRICTION}


def _friction(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    plane = world.environment.motion_plane.friction
    made: list[Variant] = []
    if found.supported and plane is not None:
        path = ("environment.motion_plane.friction",)
        unknown = of_path(world, path, "friction", plane, **_size_of_friction(plane))
        made.append(one_start(world, (unknown,), "of the plane"))
    if found.impacts or found.slides:
        made += _surface(world, "friction", _size_of_friction)
    return tuple(_other_frictions(v) for v in made)


def _other_frictions(variant: Variant) -> Variant:
    """Return the variant that also starts at much less and much more: where an impact or a roll grips, the slope by
    friction is zero."""
    more = tuple(
        {u.name: float(np.clip(times * u.start, u.lower, u.upper)) for u in variant.unknowns} for times in OTHERS
    )
    return replace(variant, starts=(*variant.starts, *more))


def _rolling(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    bodies = [o.name for o in world.objects if o.shape.kind in ROUND and o.representation == "rigid_spatial"]
    if not bodies or not found.slides:
        return ()

    def sized(value: float) -> Mapping[str, float]:
        return {"typical": max(0.3 * value, 0.01 * found.radius), "plausible": ORDINARY_ROLLING * found.radius}

    unknowns = by_value(world, [f"objects.{n}.rolling_resistance" for n in bodies], "rolling_resistance", sized)
    return (one_start(world, unknowns),) if len(unknowns) <= MOST_GROUPS else ()


ROPES: frozenset[Form] = frozenset({"line"})
CLOTH: frozenset[Form] = frozenset({"sheet"})
SOFT: frozenset[Form] = frozenset({"solid"})
FLUIDS: frozenset[Form] = frozenset({"liquid"})
FACTOR = 100.0  # by which a value may be wrong either way


@dataclass(frozen=True)
class Field:
    """A field of materials of some forms. floor: an ordinary change where the value is zero."""

    field: str
    forms: frozenset[Form]
    floor: float
    label: str = ""


def _variants(world: World, fields: Sequence[Field]) -> tuple[Variant, ...]:
    """Return a variant for each field; objects of equal value share one unknown."""
    owners = [[d.name for d in world.deformables if material_of(d).form in f.forms] for f in fields]
    several = sum(map(bool, owners)) > 1
    made: list[Variant] = []
    for field, names in zip(fields, owners, strict=True):
        unknowns = by_value(world, [f"objects.{n}.{field.field}" for n in names], field.field, _sized(field.floor))
        if unknowns:
            made.append(one_start(world, unknowns, field.label if several else ""))
    return tuple(made)


def _sized(floor: float) -> Callable[[float], Mapping[str, float]]:
    def sized(value: float) -> Mapping[str, float]:
        typical, most = (0.3 * value, FACTOR * value) if value > 0.0 else (floor, FACTOR * floor)
        return {"typical": typical, "lower": value / FACTOR, "upper": most}

    return sized


def _of_fields(*fields: Field) -> Callable[[World, Recording], tuple[Variant, ...]]:
    return lambda world, _: _variants(world, fields)


def _bending(world: World, recording: Recording) -> tuple[Variant, ...]:
    """Return where nothing bends stiffly yet: what bends a rope's own weight back over a tenth of its length."""
    del recording
    weights = [0.0]
    g = float(np.linalg.norm(world.environment.gravity)) or 9.81
    for rope in world.of_form("line"):
        length = float(np.linalg.norm(np.diff(np.asarray(rope.points), axis=0), axis=1).sum())
        weights.append(float(rope.linear_density) * g * (0.1 * length) ** 3)
    return _variants(
        world,
        (
            Field("bending_stiffness", ROPES, max(weights) or 1e-4, "of ropes"),
            Field("bending_stiffness", CLOTH, 1e-5, "of cloth"),
        ),
    )


def _source(world: World, recording: Recording) -> tuple[Variant, ...]:
    del recording
    unknowns = by_value(world, [f"emitters.{e.name}.rate" for e in world.emitters], "rate", _sized(1e-5))
    return (one_start(world, unknowns),) if unknowns else ()


CANDIDATES = (
    Candidate("gravity_error", "base", "a = g', another gravity than the world's", _gravity, plain=True),
    Candidate("mass_error", "base", "m' of one body, where masses share momentum", _mass),
    Candidate(
        "length_error",
        "base",
        "T = 2 pi sqrt(L / g) of small swings, another length L than the world's",
        _length,
        plain=True,
    ),
    Candidate(
        "stiffness_error", "base", "T = 2 pi sqrt(m / k), another stiffness k than the world's", _stiffness, plain=True
    ),
    Candidate(
        "restitution_error", "base", "v_n' = -e' v_n at impacts, another e' than the world's", _restitution, plain=True
    ),
    Candidate("friction_error", "base", "|F_t| <= mu' F_n, another mu' than the world's", _friction, plain=True),
    Candidate("rolling_resistance", "base", "M = b F_n against rolling", _rolling, plain=True),
    Candidate(
        "material_damping",
        "material",
        "stress = C (strain + tau strain rate)",
        _of_fields(
            Field("stretch_damping", ROPES | CLOTH, 0.01, "of stretching"),
            Field("bending_damping", ROPES | CLOTH, 0.01, "of bending"),
            Field("damping", SOFT, 0.01, "of soft bodies"),
        ),
    ),
    Candidate(
        "air_drag",
        "material",
        "dv/dt = -c v of ropes and soft bodies; rho C_n v_n^2 / 2 per area of cloth",
        _of_fields(
            Field("linear_damping", ROPES, 0.1, "of ropes"),
            Field("linear_damping", SOFT, 0.1, "of soft bodies"),
            Field("drag_normal", CLOTH, 1.0, "across the sheet"),
            Field("drag_tangential", CLOTH, 0.05, "along the sheet"),
        ),
    ),
    Candidate("bending_stiffness", "material", "moment = EI curvature; D curvature per width of a sheet", _bending),
    Candidate(
        "stretch_stiffness",
        "material",
        "tension = EA strain; stress = E strain",
        _of_fields(
            Field("stretch_stiffness", ROPES, 1e3, "of ropes"),
            Field("stretch_stiffness", CLOTH, 100.0, "of cloth"),
            Field("youngs_modulus", SOFT, 1e4, "of soft bodies"),
        ),
    ),
    Candidate("viscosity", "material", "stress = mu (grad v + grad v^T)", _of_fields(Field("viscosity", FLUIDS, 1e-3))),
    Candidate(
        "surface_tension",
        "material",
        "pressure jump = sigma curvature",
        _of_fields(Field("surface_tension", FLUIDS, 0.02)),
    ),
    Candidate("source_rate", "material", "volume per time of emitters", _source),
)
