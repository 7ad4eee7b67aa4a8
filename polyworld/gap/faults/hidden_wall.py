"""A wall that nobody sees: a plane of any direction that paths turn back at."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polyworld.data.recording import Recording
from polyworld.effects.conditions import Conditions
from polyworld.estimation.candidate import Candidate, Variant
from polyworld.gap.adding import free_name, of_path, with_parts
from polyworld.gap.conditions import conditions, reach, tracks
from polyworld.gap.kinks import Kink, kinks
from polyworld.world import StaticObject, World, geometry
from polyworld.world.shapes import Plane

Array = NDArray[np.float64]

MOST_STARTS = 6
MOST_HITS = 6  # the sharpest
BEYOND = 0.5  # of a body's radius that paths may reach behind a wall before it cannot stand there
SKEW = 0.15  # error of a wall's direction that noise may make [rad]
NEARBY = 0.5  # of a body's radius, within which two hits are too near to show how a wall runs
SAME_FACE = 0.05  # angle [rad], and share of a body's radius, within which two walls are one


def _wall(world: World, recording: Recording) -> tuple[Variant, ...]:
    found = conditions(world, recording)
    axes = _axes(world, found)
    if len(axes) < 2 or not world.objects:
        return ()
    walls = _walls(world, recording, axes)
    restitution = float(np.median([o.restitution for o in world.objects]))
    friction = float(np.median([o.friction for o in world.objects]))
    made = []
    # A wall is described by where it crosses one axis, the one that it is most across, and by how it is turned.
    for axis, side in itertools.product(axes, (1.0, -1.0)):
        own = [w for w in walls if axis == max(axes, key=lambda a: abs(float(w[0][a]))) and side * w[0][axis] > 0.0]
        if not own:
            continue
        first = side * np.eye(3)[axis]
        turned = [k for k in range(3) if k != axis and (len(axes) == 3 or k not in axes)]
        name = free_name("hidden_wall", [*world.moving_names, *(s.name for s in world.statics)])
        known = {"restitution": restitution} | ({"friction": friction} if friction else {})
        wall = StaticObject(
            name=name,
            shape=Plane(normal=(float(first[0]), float(first[1]), float(first[2]))),
            restitution=restitution,
            friction=friction if friction else None,
            dominant=True,
        )
        child = with_parts(world, statics=(*world.statics, wall))
        # Where friction is enough to grip, more or less of it changes nothing: fits begin without any, too.
        rough = [known, known | {"friction": 0.0}] if friction else [known]
        starts = tuple(
            {"offset": float(offset / n[axis])}
            | {f"turn_{'xyz'[k]}": float(_turn(n, first)[k]) for k in turned}
            | own_coefficients
            for n, offset in own
            for own_coefficients in rough
        )
        sizes = {"offset": (f"position.{'xyz'[axis]}", 0.1 * found.spread)}
        sizes |= {f"turn_{'xyz'[k]}": (f"rotation.{'xyz'[k]}", 0.1) for k in turned}
        sizes |= {label: (label, 0.2) for label in known}
        unknowns = tuple(
            of_path(child, (f"statics.{name}.{field}",), label, starts[0][label], typical)
            for label, (field, typical) in sizes.items()
        )
        made.append(Variant(child, unknowns, starts, f"across {'xyz'[axis]}, facing {'-+'[side > 0]}{'xyz'[axis]}"))
    return tuple(made)


def _axes(world: World, found: Conditions) -> list[int]:
    """Return the world axes along which walls may be seen to turn paths back; none on a plane of motion that is
    oblique."""
    if not world.planar:
        return list(found.axes)
    normal = np.abs(geometry.plane_axes(world.environment.motion_plane)[2])
    return list(found.axes) if normal.max() > 1.0 - 1e-9 else []


def _turn(normal: Array, first: Array) -> Array:
    """Return the rotation vector (3,) that turns one unit vector (3,), `first`, to another."""
    across = np.cross(first, normal)
    size = float(np.linalg.norm(across))
    if size < 1e-12:
        return np.zeros(3)
    found: Array = across / size * np.arctan2(size, float(first @ normal))
    return found


def _walls(world: World, recording: Recording, axes: Sequence[int]) -> list[tuple[Array, float]]:
    """Return planes, unit normal (3,) and offset [m], that paths turn round at and never pass, the surest first."""
    points, radii = [], []
    for track in tracks(world, recording):
        seen = np.all(np.isfinite(track.places[:, list(axes)]), axis=1)
        points.append(np.where(np.isfinite(track.places[seen]), track.places[seen], 0.0))
        radii.append(np.full(int(seen.sum()), reach(world, world.object(track.name)) - 4.0 * track.noise))
    everywhere, radius = np.concatenate(points), np.concatenate(radii)
    found: list[tuple[Array, float]] = []
    for normal, kink in _faces(world, kinks(world, recording)[:MOST_HITS], axes):
        if kink.before @ normal > 0.0:
            continue  # it was pushed on, not turned back
        own = reach(world, world.object(kink.name))
        touched = float(kink.place @ normal) - own
        beside = (everywhere - kink.place)[:, list(axes)]
        along = np.linalg.norm(beside - np.outer(beside @ normal[list(axes)], normal[list(axes)]), axis=1)
        if np.any(everywhere @ normal - radius < touched - BEYOND * own - SKEW * along):
            continue
        if any(n @ normal > np.cos(SAME_FACE) and abs(o - touched) < SAME_FACE * own for n, o in found):
            continue
        found.append((normal, touched))
        if len(found) == MOST_STARTS:
            break
    return found


def _faces(world: World, hits: Sequence[Kink], axes: Sequence[int]) -> list[tuple[Array, Kink]]:
    """Return normals (3,) that walls may have, and a hit that shows where each stands.

    Places of several hits lie on the wall: through all of them, then through each two, the farthest apart first; then
    of single hits, along the jump of the velocity, or bent from it by friction, which acts against the motion along
    the wall, by up to the angle of the friction cone.
    """
    inside = np.zeros(3)
    inside[list(axes)] = 1.0
    found: list[tuple[float, Array, Kink]] = []
    for count in range(len(hits), 1, -1):
        for group in itertools.combinations(hits, count) if count in (2, len(hits)) else ():
            if len({k.name for k in group}) > 1:
                continue  # places are those of centres
            normal, extent = _through(group, inside)
            cone = np.arctan(world.object(group[0].name).friction) + SKEW
            separated = extent > NEARBY * reach(world, world.object(group[0].name))
            if normal is not None and separated and all(k.direction @ normal > np.cos(cone) for k in group):
                found.append((extent + (1e3 if count > 2 else 0.0), normal, group[0]))
    faces: list[tuple[Array, Kink]] = []
    for _, normal, kink in sorted(found, key=lambda f: -f[0]):
        faces += [(way, kink) for way in (*_upright(world, normal), normal)]
    for kink in hits:
        jump = kink.jump * inside
        size = float(np.linalg.norm(jump))
        if not size:
            continue
        bend = np.cross(jump, kink.before * inside)
        turning = float(np.linalg.norm(bend))
        angle = float(np.arctan(world.object(kink.name).friction))
        for turn in (0.0, angle, -angle) if turning > 1e-9 else (0.0,):
            by = Rotation.from_rotvec(bend / max(turning, 1e-12) * turn)
            faces.append((by.apply(jump / size), kink))
    return faces


def _upright(world: World, normal: Array) -> list[Array]:
    """Return a normal (3,) made level, where it nearly is: most walls stand upright, and friction against a fall or a
    spin bends jumps off them upwards."""
    gravity = np.asarray(world.environment.gravity, dtype=float)
    if world.planar or not gravity.any():
        return []
    down = gravity / np.linalg.norm(gravity)
    level = normal - (normal @ down) * down
    size = float(np.linalg.norm(level))
    return [level / size] if size > np.cos(2.0 * SKEW) else []


def _through(hits: Sequence[Kink], inside: Array) -> tuple[Array | None, float]:
    """Return the normal (3,) of the plane through the places of hits that is nearest to their jumps, and their spread
    [m]."""
    places = np.array([k.place for k in hits]) * inside
    about = places - places.mean(axis=0)
    _, size, ways = np.linalg.svd(about, full_matrices=False)
    along = ways[: min(int(inside.sum()) - 1, len(hits) - 1)]
    jump = np.sum([k.direction * inside for k in hits], axis=0)
    normal = jump - along.T @ (along @ jump)
    length = float(np.linalg.norm(normal))
    return (normal / length if length > 1e-9 else None), float(size[len(along) - 1])


CANDIDATES = (
    Candidate(
        name="hidden_wall",
        group="structure",
        law="a plane that bodies rebound from",
        signature="paths that turn back at one plane where nothing is seen",
        reference="Newton's law of impact at a fixed plane",
        variants=_wall,
        local=True,
        confused_with={
            "hidden_body": "hits at several places: a wall turns all back along one line",
            "tether": "the sharpness of the turn, and its shape: a tether's is a circle",
        },
    ),
)
