"""What nobody sees: a ball, fixed or free, and a wall or a table, a plane of any direction that paths turn back at.

Changes of course of all runs together give a wall: their places lie on it, their jumps point away from it, and the
ratio of velocities across it is the restitution.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polyworld.data.recording import Recording
from polyworld.effects.absence import coordinates
from polyworld.effects.conditions import Conditions
from polyworld.estimation.unknown import Unknown
from polyworld.gap.candidate import Candidate, Variant, free_name, of_path, with_parts
from polyworld.gap.conditions import conditions, reach, tracks
from polyworld.gap.kinks import Kink, kinks
from polyworld.screening.statics import plane_normal
from polyworld.world import StaticObject, World, geometry
from polyworld.world.parameters import object_mass
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Plane, Sphere

Array = NDArray[np.float64]

MOST_STARTS = 6
HEAVIEST = 20.0  # times the mass of what struck it
MOST_TURN = 1.0  # [rad] from its axis: beyond pi / 4 it is another axis' wall, whose offset says where it stands
MOST_HITS = 24  # the sharpest
PAIRED = 6  # of which each two may show a wall
BEYOND = 0.5  # of a body's radius that paths may reach behind a wall before it cannot stand there
SKEW = 0.15  # error of a wall's direction that noise may make [rad]
FRICTION = 0.5  # whose cone bends jumps off the normal, as between dry surfaces
NEARBY = 0.5  # of a body's radius, within which two hits are too near to show how a wall runs
SAME_FACE = 0.05  # angle [rad], and share of a body's radius, within which two walls are one
DIRECTIONS = 16  # of planes at the edges of what was visited
OUTERMOST = 0.005  # share of places that noise may have put beyond them
GUESS = 0.7  # restitution where no change of course shows it
SURFACE_SPEED = 3.0  # [m/s] of a ball's surface by a spin that nobody measured, as a hand or a racket gives


def _body(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    if not world.objects or len(found.axes) < 2:
        return ()
    made: list[Variant] = []
    for kind in ("rigid_planar", "rigid_spatial"):
        struck = [k for k in kinks(world, recording) if world.object(k.name).representation == kind]
        floor = _floor(world) if kind == "rigid_spatial" else None
        low = [k for k in struck if floor is not None and _lies(world, k, floor)]
        high = [k for k in struck if kind == "rigid_spatial" and not any(k is x for x in low)]
        if kind == "rigid_planar" and struck:
            made.append(_free_body(world, found, struck, None))
        if low:
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
        normal = plane_normal(static)
        if normal is not None and normal[2] > 1.0 - 1e-9:
            return float(static.position[2] + getattr(static.shape, "offset", 0.0))
    return None


def _lies(world: World, kink: Kink, floor: float) -> bool:
    """Return whether what was struck may have lain on the floor: as large as the body itself, and beside or below
    it."""
    radius = reach(world, world.object(kink.name))
    return bool(kink.place[2] - floor < 3.0 * radius and kink.direction[2] > -0.3)


def _where(world: World, kink: Kink, radius: float) -> Array:
    """Centre (3,) of a ball that the body struck, from the direction in which it was thrown back."""
    centre: Array = kink.place - kink.direction * (reach(world, world.object(kink.name)) + radius)
    return centre


def _free_body(world: World, found: Conditions, struck: Sequence[Kink], floor: float | None) -> Variant:
    """Return a ball at rest, as large as what struck it, that is free to move."""
    item = world.object(struck[0].name)
    radius, mass = reach(world, item), object_mass(item)
    places = [_where(world, k, radius) for k in struck[:MOST_STARTS]]
    axes = list(found.axes) if floor is None else [0, 1]
    for place in places:
        if floor is not None:
            place[2] = floor + radius
        elif world.planar:
            across = [a for a in range(3) if a not in axes]
            place[across] = np.asarray(item.position)[across]
    name = _free_name(world)
    kept = item.model_dump(exclude={"orientation", "velocity", "angular_velocity"})
    own = {"name": name, "shape": Sphere(radius=radius), "position": tuple(places[0]), "mass": mass}
    child = with_parts(world, objects=(*world.objects, RigidObject.model_validate(kept | own)))
    unknowns = (
        *_placed(child, f"objects.{name}.position", axes, places[0], found),
        of_path(
            child, (f"objects.{name}.mass",), "mass", mass, 0.5 * mass, lower=mass / HEAVIEST, upper=mass * HEAVIEST
        ),
    )
    starts = tuple(
        coordinates("", place, axes) | {"mass": _struck_mass(world, kink, object_mass(world.object(kink.name)))}
        for kink, place in zip(struck, places, strict=False)
    )
    return Variant(child, unknowns, starts, "free")


def _fixed_body(world: World, found: Conditions, struck: Sequence[Kink]) -> Variant:
    """Return a ball that does not move, as large as what struck it."""
    radius = reach(world, world.object(struck[0].name))
    places = [_where(world, k, radius) for k in struck[:MOST_STARTS]]
    x, y, z = (float(c) for c in places[0])
    body = StaticObject(name=_free_name(world), shape=Sphere(radius=radius), position=(x, y, z))
    child = with_parts(world, statics=(*world.statics, body))
    unknowns = _placed(child, f"statics.{body.name}.position", found.axes, places[0], found)
    return Variant(child, tuple(unknowns), tuple(coordinates("", p, found.axes) for p in places), "fixed")


def _free_name(world: World) -> str:
    return free_name("hidden_body", [*world.moving_names, *(s.name for s in world.statics)])


def _placed(child: World, head: str, axes: Sequence[int], place: Array, found: Conditions) -> list[Unknown]:
    """Return coordinates of a body as unknowns, up to the size of the region visited beyond it."""
    made = []
    for a in axes:
        low, high = float(found.lower[a]) - found.size, float(found.upper[a]) + found.size
        path = f"{head}.{'xyz'[a]}"
        made.append(of_path(child, (path,), "xyz"[a], float(place[a]), 0.1 * found.spread, lower=low, upper=high))
    return made


def _struck_mass(world: World, kink: Kink, mass: float) -> float:
    """Return the mass of a body at rest that throws another back as seen: m u (1 + e) / (m + M) = jump / M."""
    approach = float(-kink.before @ kink.direction)
    restitution = world.object(kink.name).restitution
    share = float(np.linalg.norm(kink.jump)) / max((1.0 + restitution) * approach, 1e-9)
    return float(np.clip(mass * share / max(1.0 - share, 1e-3), mass / HEAVIEST, mass * HEAVIEST))


@dataclass(frozen=True)
class _Face:
    """A plane: unit normal (3,), offset [m] along it, restitution, and how many hits lie on it."""

    normal: Array
    offset: float
    restitution: float
    hits: int


def _wall(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    axes = list(found.axes)
    oblique = world.planar and np.abs(geometry.plane_axes(world.environment.motion_plane)[2]).max() < 1.0 - 1e-9
    if len(axes) < 2 or not world.objects or oblique:
        return ()
    faces = _walls(world, recording, axes)
    made = []
    # A wall is described by where it crosses one axis, the one that it is most across, and by how it is turned.
    for axis, side in itertools.product(axes, (1.0, -1.0)):
        own = [
            w for w in faces if axis == max(axes, key=lambda a: abs(float(w.normal[a]))) and side * w.normal[axis] > 0.0
        ]
        if own:
            made += [_variant(world, recording, found, axes, own, axis, side, rough) for rough in (False, True)]
    return tuple(v for v in made if v is not None)


def _variant(
    world: World,
    recording: Recording,
    found: Conditions,
    axes: Sequence[int],
    faces: Sequence[_Face],
    axis: int,
    side: float,
    rough: bool,
) -> Variant | None:
    """Return a smooth wall, or a rough one at which balls spin as nobody measured."""
    spins = _spins(world, recording) if rough else ()
    if rough and not any(o.friction for o in world.objects):
        return None
    first = side * np.eye(3)[axis]
    name = free_name("hidden_wall", [*world.moving_names, *(s.name for s in world.statics)])
    wall = StaticObject(
        name=name,
        shape=Plane(normal=(float(first[0]), float(first[1]), float(first[2]))),
        restitution=faces[0].restitution,
        friction=FRICTION if rough else 0.0,
        dominant=True,
    )
    child = with_parts(world, statics=(*world.statics, wall))
    # Of each unknown: its field, an ordinary change, bounds and its start by face.
    rows = {
        "offset": (f"position.{'xyz'[axis]}", 0.1 * found.spread, np.inf, [f.offset / f.normal[axis] for f in faces])
    }
    for k in (k for k in range(3) if k != axis and (len(axes) == 3 or k not in axes)):
        turns = [_turn(f.normal, first)[k] for f in faces]
        rows[f"turn_{'xyz'[k]}"] = f"rotation.{'xyz'[k]}", 0.1, MOST_TURN, turns
    rows["restitution"] = "restitution", 0.2, np.inf, [f.restitution for f in faces]
    if rough:
        rows["friction"] = "friction", 0.2, np.inf, [FRICTION] * len(faces)
    starts = tuple({label: float(row[-1][i]) for label, row in rows.items()} for i in range(len(faces)))
    unknowns = [
        of_path(child, (f"statics.{name}.{field}",), label, starts[0][label], typical, lower=-most, upper=most)
        for label, (field, typical, most, _) in rows.items()
    ]
    label = f"across {'xyz'[axis]}, facing {'-+'[side > 0]}{'xyz'[axis]}"
    return Variant(child, (*unknowns, *spins), starts, label + (", rough" if rough else ""))


def _spins(world: World, recording: Recording) -> tuple[Unknown, ...]:
    """Return the initial spins of balls in each run that did not measure them."""
    made = []
    for run in recording.runs:
        for column, name in enumerate(run.names):
            item = next((o for o in world.objects if o.name == name), None)
            measured = (
                np.isfinite(run.angular_velocities[:, column]).any() or np.isfinite(run.orientations[:, column]).any()
            )
            if item is None or world.planar or measured or not isinstance(item.shape, Sphere):
                continue
            most = SURFACE_SPEED / item.shape.radius
            made += [
                Unknown(f"spin_{a} of {name} in {run.name}", (f"objects.{name}.angular_velocity.{a}",), "rad/s", 0.0,
                        -10.0 * most, 10.0 * most, 0.05 * most, run=run.name, plausible=most)
                for a in "xyz"
            ]  # fmt: skip
    return tuple(made)


def _turn(normal: Array, first: Array) -> Array:
    """Return the rotation vector (3,) that turns one unit vector (3,), `first`, to another."""
    across = np.cross(first, normal)
    size = float(np.linalg.norm(across))
    if size < 1e-12:
        return np.zeros(3)
    found: Array = across / size * np.arctan2(size, float(first @ normal))
    return found


def _walls(world: World, recording: Recording, axes: Sequence[int]) -> list[_Face]:
    """Return planes that paths turn round at and never pass, those of most hits first."""
    points, radii = [], []
    for track in tracks(world, recording):
        seen = np.all(np.isfinite(track.places[:, list(axes)]), axis=1)
        points.append(np.where(np.isfinite(track.places[seen]), track.places[seen], 0.0))
        radii.append(np.full(int(seen.sum()), reach(world, world.object(track.object)) - 4.0 * track.noise.max()))
    everywhere, radius = np.concatenate(points), np.concatenate(radii)
    hits = kinks(world, recording)[:MOST_HITS]
    found: list[_Face] = []
    for normal, kink in _normals(world, hits, axes):
        own = reach(world, world.object(kink.name))
        touched = float(kink.place @ normal) - own
        if kink.before @ normal > 0.0:
            continue  # it was pushed on, not turned back
        beside = (everywhere - kink.place)[:, list(axes)]
        along = np.linalg.norm(beside - np.outer(beside @ normal[list(axes)], normal[list(axes)]), axis=1)
        if np.any(everywhere @ normal - radius < touched - BEYOND * own - SKEW * along):
            continue
        near = [h for h in hits if abs(float(h.place @ normal) - reach(world, world.object(h.name)) - touched) < own]
        near = [h for h in near if h.before @ normal < 0.0 < h.after @ normal]
        ratios = [float(-(h.after @ normal) / (h.before @ normal)) for h in near]
        face = _Face(normal, touched, float(np.clip(np.median(ratios), 0.05, 1.0)) if ratios else 0.5, len(near))
        if all(n.normal @ normal < np.cos(SAME_FACE) or abs(n.offset - touched) > SAME_FACE * own for n in found):
            found.append(face)
    return [*sorted(found, key=lambda f: -f.hits)[:MOST_STARTS], *_edges(world, everywhere, radius, axes)]


def _edges(world: World, places: Array, radius: Array, axes: Sequence[int]) -> list[_Face]:
    """Return upright planes at the edges of what was visited, in every direction: noise may hide changes of course, and
    which of these planes describe the data is seen by trying."""
    gravity = np.abs(np.asarray(world.environment.gravity, dtype=float))
    level = [a for a in axes if world.planar or not gravity.any() or a != int(np.argmax(gravity))]
    if len(level) < 2 or world.joints:
        return []
    found = []
    for angle in np.arange(DIRECTIONS) * (2.0 * np.pi / DIRECTIONS):
        normal = np.zeros(3)
        normal[level[0]], normal[level[1]] = np.cos(angle), np.sin(angle)
        found.append(_Face(normal, float(np.quantile(places @ normal - np.maximum(radius, 0.0), OUTERMOST)), GUESS, 0))
    return found


def _normals(world: World, hits: Sequence[Kink], axes: Sequence[int]) -> list[tuple[Array, Kink]]:
    """Return normals (3,) that walls may have, and a hit that shows where each stands.

    Through all hits whose jumps point the same way, robustly; then through each two, the farthest apart first; then of
    single hits, along the jump of the velocity, or bent from it by friction by up to the angle of the friction cone.
    """
    inside = np.isin(np.arange(3), axes).astype(float)
    cone, sharpest = np.arctan(FRICTION) + SKEW, hits[:PAIRED]
    alike = [[h for h in hits if h.name == k.name and h.direction @ k.direction > np.cos(2.0 * cone)] for k in sharpest]
    pairs = [list(p) for p in itertools.combinations(sharpest, 2) if p[0].name == p[1].name]  # places are of centres
    planes: list[tuple[int, float, Array, Kink]] = []
    for group in [*(g for g in alike if len(g) > 2), *pairs]:
        normal, extent = _through(group, inside)
        if normal is None or extent <= NEARBY * reach(world, world.object(group[0].name)):
            continue
        if len(group) > 2:
            offsets = [float(h.place @ normal) for h in group]
            planes.append((0, 0.0, normal, group[int(np.argsort(offsets)[len(group) // 2])]))
        elif all(k.direction @ normal > np.cos(cone) for k in group):
            planes.append((1, -extent, normal, group[0]))
    faces: list[tuple[Array, Kink]] = []
    for two, _, normal, kink in sorted(planes, key=lambda p: p[:2]):
        ways = (normal, *_upright(world, normal))
        faces += [(way, kink) for way in (ways[::-1] if two else ways)]
    for kink in sharpest:
        jump = kink.jump * inside
        size, bend = float(np.linalg.norm(jump)), np.cross(jump, kink.before * inside)
        turning, angle = float(np.linalg.norm(bend)), float(np.arctan(FRICTION))
        for turn in () if not size else (0.0, angle, -angle) if turning > 1e-9 else (0.0,):
            faces.append((Rotation.from_rotvec(bend / max(turning, 1e-12) * turn).apply(jump / size), kink))
    return faces


def _upright(world: World, normal: Array) -> list[Array]:
    """Return a normal (3,) made level, where it nearly is, or upright: most walls stand so and most tables lie so, and
    friction against a fall or a spin bends jumps off them."""
    gravity = np.asarray(world.environment.gravity, dtype=float)
    if world.planar or not gravity.any():
        return []
    up = -gravity / np.linalg.norm(gravity)
    level = normal - (normal @ up) * up
    size = float(np.linalg.norm(level))
    if size > np.cos(2.0 * SKEW):
        return [level / size]
    return [up] if normal @ up > np.cos(2.0 * SKEW) else []


def _through(hits: Sequence[Kink], inside: Array) -> tuple[Array | None, float]:
    """Return the normal (3,) of the plane through the places of hits that is nearest to their jumps, and their spread
    [m]."""
    places = np.array([k.place for k in hits]) * inside
    about = places - np.median(places, axis=0) if len(hits) > 3 else places - places.mean(axis=0)
    _, size, ways = np.linalg.svd(about, full_matrices=False)
    along = ways[: min(int(inside.sum()) - 1, len(hits) - 1)]
    jump = np.sum([k.direction * inside for k in hits], axis=0)
    normal = jump - along.T @ (along @ jump)
    length = float(np.linalg.norm(normal))
    return (normal / length if length > 1e-9 else None), float(size[len(along) - 1])


CANDIDATES = (
    Candidate(
        "hidden_body", "structure", "a ball, as large as what strikes it, at rest until it is struck", _body, local=True
    ),
    Candidate("hidden_wall", "structure", "a plane that bodies rebound from", _wall, local=True),
)
