"""Things that may stand unseen in the way: a wall, a second body."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.estimation.candidate import Candidate, Variant
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue.adding import RIGID, free_name, of_path, with_parts
from polyworld.gap.conditions import Conditions, conditions, reach, tracks
from polyworld.gap.places import Kink, kinks
from polyworld.parameters import object_mass
from polyworld.recording import Recording
from polyworld.shapes import Plane, Sphere
from polyworld.world import StaticObject, World

Array = NDArray[np.float64]

MOST_STARTS = 6
MOST_HITS = 6  # the sharpest
BEYOND = 0.5  # of a body's radius that paths may reach behind a wall before it cannot stand there
SKEW = 0.15  # error of a wall's direction that noise may make [rad]
NEARBY = 0.5  # of a body's radius, within which two hits are too near to tell how a wall runs
WIDEST = 1.4  # angle of a jump to a wall's normal [rad]
SAME_FACE = 0.05  # angle [rad], and share of a body's radius, within which two walls are one
HEAVIEST = 20.0  # times the mass of what struck it


def _wall(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    turning = _turning_axis(world, found)
    if turning is None or not world.objects:
        return ()
    flat = [a for a in range(3) if a != turning]
    walls = _walls(world, recording, flat)
    restitutions = [o.restitution for o in world.objects]
    restitution = float(np.median(restitutions))
    made = []
    # A wall is told by where it crosses one axis and by its turn: the axis that it is most across.
    for i, axis in enumerate(flat):
        own = [w for w in walls if abs(w[0][axis]) >= abs(w[0][flat[1 - i]])]
        if not own:
            continue
        name = free_name("hidden_wall", [*world.moving_names, *(s.name for s in world.statics)])
        normal = (float(axis == 0), float(axis == 1), float(axis == 2))
        wall = StaticObject(name=name, shape=Plane(normal=normal), restitution=restitution, dominant=True)
        child = with_parts(world, statics=(*world.statics, wall))
        head = f"statics.{name}"
        unknowns = (
            of_path(
                child,
                (f"{head}.position.{'xyz'[axis]}",),
                "offset",
                float(own[0][1] / own[0][0][axis]),
                0.1 * found.spread,
            ),
            of_path(child, (f"{head}.rotation.{'xyz'[turning]}",), "turn", _turn(own[0][0], axis, turning), 0.1),
            of_path(child, (f"{head}.restitution",), "restitution", restitution, 0.2),
        )
        starts = tuple(
            {
                "offset": float(offset / n[axis]),
                "turn": _turn(n, axis, turning),
                "restitution": restitution,
            }
            for n, offset in own
        )
        made.append(Variant(child, unknowns, starts, f"across {'xyz'[axis]}"))
    return tuple(made)


def _turning_axis(world: World, found: Conditions) -> int | None:
    """The axis that walls stand along: gravity's, or the normal of the plane of motion; None where it is oblique."""
    if world.planar:
        along = geometry.plane_axes(world.environment.motion_plane)[2]
    else:
        along = np.asarray(world.environment.gravity, dtype=float)
        if not along.any():
            along = np.array([0.0, 0.0, 1.0])
    along = np.abs(along) / np.linalg.norm(along)
    axis = int(np.argmax(along))
    if along[axis] < 1.0 - 1e-9 or not {a for a in range(3) if a != axis} <= set(found.axes):
        return None
    return axis


def _turn(normal: Array, axis: int, turning: int) -> float:
    """Angle about the axis `turning` from the unit vector of `axis` to a normal (3,)."""
    first = np.eye(3)[axis]
    second = np.cross(np.eye(3)[turning], first)
    return float(np.arctan2(normal @ second, normal @ first))


def _walls(world: World, recording: Recording, flat: Sequence[int]) -> list[tuple[Array, float]]:
    """Upright planes, unit normal (3,) and offset [m], that paths turn round at and never pass, the surest first.

    Two hits tell where a wall runs. One tells only a place of it: friction bends the jump away from the normal, by an
    angle up to that of the friction cone.
    """
    points, radii = [], []
    for track in tracks(world, recording):
        seen = np.all(np.isfinite(track.places[:, flat]), axis=1)
        points.append(np.where(np.isfinite(track.places[seen]), track.places[seen], 0.0))
        radii.append(np.full(int(seen.sum()), reach(world, world.object(track.name)) - 4.0 * track.noise))
    everywhere, radius = np.concatenate(points), np.concatenate(radii)
    found: list[tuple[Array, float]] = []
    for normal, kink in _faces(world, [k for k in kinks(world, recording) if _level(k, flat)][:MOST_HITS], flat):
        if kink.before @ normal > 0.0:
            continue  # it was pushed on, not turned back
        own = reach(world, world.object(kink.name))
        touched = float(kink.place @ normal) - own
        along = np.linalg.norm(
            (everywhere - kink.place)[:, flat] - np.outer((everywhere - kink.place) @ normal, normal[flat]), axis=1
        )
        slack = BEYOND * own + SKEW * along
        if np.any(everywhere @ normal - radius < touched - slack):
            continue
        if any(n @ normal > np.cos(SAME_FACE) and abs(o - touched) < SAME_FACE * own for n, o in found):
            continue
        found.append((normal, touched))
        if len(found) == MOST_STARTS:
            break
    return found


def _level(kink: Kink, flat: Sequence[int]) -> bool:
    """Whether a jump is not up or down, as an upright wall's cannot be."""
    return float(np.linalg.norm(kink.jump[flat])) >= 0.7 * float(np.linalg.norm(kink.jump))


def _faces(world: World, hits: Sequence[Kink], flat: Sequence[int]) -> list[tuple[Array, Kink]]:
    """Normals (3,) that walls may have, and a hit that tells where each stands: through two hits, the farthest apart
    first; then of single hits, as the jump has it, or bent by friction to either side."""
    through: list[tuple[float, Array, Kink]] = []
    for i, one in enumerate(hits):
        for other in hits[i + 1 :]:
            if one.name != other.name:
                continue  # places are those of centres
            run = (other.place - one.place)[flat]
            apart = float(np.linalg.norm(run))
            if apart < NEARBY * reach(world, world.object(one.name)):
                continue  # noise would turn it
            normal = np.zeros(3)
            normal[flat] = np.array([-run[1], run[0]]) / apart
            normal *= np.sign(normal @ one.jump)
            cone = min(np.arctan(world.object(one.name).friction) + SKEW, WIDEST)
            if all(normal @ k.jump > np.cos(cone) * np.linalg.norm(k.jump[flat]) for k in (one, other)):
                through.append((apart, normal, one))
    found = [(normal, kink) for _, normal, kink in sorted(through, key=lambda t: -t[0])]
    for kink in hits:
        angle = float(np.arctan(world.object(kink.name).friction))
        x, y = kink.jump[flat] / np.linalg.norm(kink.jump[flat])
        for turn in (0.0, angle, -angle):
            normal = np.zeros(3)
            normal[flat] = np.cos(turn) * x - np.sin(turn) * y, np.sin(turn) * x + np.cos(turn) * y
            found.append((normal, kink))
    return found


def _body(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not world.objects or len(found.axes) < 2:
        return ()
    made: list[Variant] = []
    whole = all(run.part_of is None for run in recording.runs)  # else each part would find a struck body back at rest
    for kind in ("rigid_planar", "rigid_spatial"):
        struck = [k for k in kinks(world, recording) if world.object(k.name).representation == kind]
        floor = _floor(world) if kind == "rigid_spatial" else None
        low = [k for k in struck if floor is not None and _lies(world, k, floor)]
        high = [k for k in struck if kind == "rigid_spatial" and not any(k is x for x in low)]
        if kind == "rigid_planar" and struck and whole:
            made.append(_free_body(world, found, struck, None))
        if low and whole:
            made.append(_free_body(world, found, low, floor))
        if high:
            made.append(_fixed_body(world, found, high))
    return tuple(made)


def _floor(world: World) -> float | None:
    """Height of a level floor that gravity presses on."""
    gravity = np.asarray(world.environment.gravity)
    if not (gravity[2] < 0.0 and abs(gravity[0]) + abs(gravity[1]) < 1e-9):
        return None
    for static in world.statics:
        shape = static.shape
        if isinstance(shape, Plane) and geometry.quaternion_matrix(np.asarray(static.orientation))[2] @ np.asarray(
            shape.normal
        ) > (1.0 - 1e-9) * float(np.linalg.norm(shape.normal)):
            return float(static.position[2] + shape.offset)
    return None


def _lies(world: World, kink: Kink, floor: float) -> bool:
    """Whether what was struck may have lain on the floor: as large as the body itself, and beside or below it."""
    radius = reach(world, world.object(kink.name))
    return bool(kink.place[2] - floor < 3.0 * radius and kink.direction[2] > -0.3)


def _where(world: World, kink: Kink, radius: float) -> Array:
    """Centre (3,) of a ball that the body struck, from the direction in which it was thrown back."""
    centre: Array = kink.place - kink.direction * (reach(world, world.object(kink.name)) + radius)
    return centre


def _free_body(world: World, found: Conditions, struck: Sequence[Kink], floor: float | None) -> Variant:
    """A ball at rest, as large as what struck it, that is free to move."""
    item = world.object(struck[0].name)
    radius = reach(world, item)
    taken = [*world.moving_names, *(s.name for s in world.statics)]
    name = free_name("hidden_body", taken)
    places = [_where(world, k, radius) for k in struck[:MOST_STARTS]]
    axes = list(found.axes)
    if floor is not None:
        axes = [0, 1]
        places = [np.array([p[0], p[1], floor + radius]) for p in places]
    elif world.planar:
        for p in places:
            p[[a for a in range(3) if a not in axes]] = np.asarray(item.position)[
                [a for a in range(3) if a not in axes]
            ]
    mass = object_mass(item)
    still = (0.0, 0.0, 0.0)
    body = item.model_copy(
        update={
            "name": name,
            "shape": Sphere(radius=radius),
            "position": _point(places[0]),
            "orientation": (1.0, 0.0, 0.0, 0.0),
            "velocity": still,
            "angular_velocity": still,
            "mass": mass,
        }
    )
    child = with_parts(world, objects=(*world.objects, body))
    head = f"objects.{name}"
    unknowns = (
        *_placed(child, f"{head}.position", axes, places[0], found),
        of_path(child, (f"{head}.mass",), "mass", mass, 0.5 * mass, lower=mass / HEAVIEST, upper=mass * HEAVIEST),
    )
    starts = []
    for kink, place in zip(struck, places, strict=False):
        own = object_mass(world.object(kink.name))
        starts.append({"xyz"[a]: float(place[a]) for a in axes} | {"mass": _struck_mass(world, kink, own)})
    return Variant(child, unknowns, tuple(starts), "free")


def _placed(child: World, head: str, axes: Sequence[int], place: Array, found: Conditions) -> list[Unknown]:
    return [
        of_path(
            child,
            (f"{head}.{'xyz'[a]}",),
            "xyz"[a],
            float(place[a]),
            0.1 * found.spread,
            lower=float(found.lower[a]) - found.size,
            upper=float(found.upper[a]) + found.size,
        )
        for a in axes
    ]


def _point(place: Array) -> tuple[float, float, float]:
    return float(place[0]), float(place[1]), float(place[2])


def _struck_mass(world: World, kink: Kink, mass: float) -> float:
    """Mass of a body at rest that throws another back as seen: m u (1 + e) / (m + M) = jump / M."""
    approach = float(-kink.before @ kink.direction)
    restitution = world.object(kink.name).restitution
    share = float(np.linalg.norm(kink.jump)) / max((1.0 + restitution) * approach, 1e-9)
    return float(np.clip(mass * share / max(1.0 - share, 1e-3), mass / HEAVIEST, mass * HEAVIEST))


def _fixed_body(world: World, found: Conditions, struck: Sequence[Kink]) -> Variant:
    """A ball that does not move, as large as what struck it."""
    radius = reach(world, world.object(struck[0].name))
    name = free_name("hidden_body", [*world.moving_names, *(s.name for s in world.statics)])
    places = [_where(world, k, radius) for k in struck[:MOST_STARTS]]
    body = StaticObject(name=name, shape=Sphere(radius=radius), position=_point(places[0]))
    child = with_parts(world, statics=(*world.statics, body))
    unknowns = tuple(_placed(child, f"statics.{name}.position", found.axes, places[0], found))
    starts = tuple({"xyz"[a]: float(place[a]) for a in found.axes} for place in places)
    return Variant(child, unknowns, starts, "fixed")


CANDIDATES = (
    Candidate(
        name="hidden_wall",
        group="structure",
        law="a plane that bodies rebound from",
        representations=RIGID,
        signature="paths that turn back along one straight line where nothing is seen",
        reference="Newton's law of impact at a fixed plane",
        variants=_wall,
        confused_with={
            "hidden_body": "hits at several places: a wall turns all back along one line",
            "tether": "the sharpness of the turn, and its shape: a tether's is a circle",
        },
    ),
    Candidate(
        name="hidden_body",
        group="structure",
        law="a ball, as large as what strikes it, at rest until it is struck",
        representations=RIGID,
        signature="a sudden change of one body's velocity where nothing is seen",
        reference="Newton's law of impact between two bodies",
        variants=_body,
        confused_with={
            "hidden_wall": "hits at several places",
            "fan": "the sharpness of the change",
        },
    ),
)
