"""A wall that nobody sees."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.effects.conditions import Conditions
from polyworld.estimation.candidate import Candidate, Variant
from polyworld.gap.adding import free_name, of_path, with_parts
from polyworld.gap.conditions import conditions, reach, tracks
from polyworld.gap.kinks import Kink, kinks
from polyworld.recording import Recording
from polyworld.shapes import Plane
from polyworld.world import StaticObject, World

Array = NDArray[np.float64]

MOST_STARTS = 6
MOST_HITS = 6  # the sharpest
BEYOND = 0.5  # of a body's radius that paths may reach behind a wall before it cannot stand there
SKEW = 0.15  # error of a wall's direction that noise may make [rad]
NEARBY = 0.5  # of a body's radius, within which two hits are too near to tell how a wall runs
WIDEST = 1.4  # angle of a jump to a wall's normal [rad]
SAME_FACE = 0.05  # angle [rad], and share of a body's radius, within which two walls are one


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
        starts = tuple(
            {"offset": float(offset / n[axis]), "turn": _turn(n, axis, turning), "restitution": restitution}
            for n, offset in own
        )
        sizes = {
            "offset": (f"position.{'xyz'[axis]}", 0.1 * found.spread),
            "turn": (f"rotation.{'xyz'[turning]}", 0.1),
            "restitution": ("restitution", 0.2),
        }
        unknowns = tuple(
            of_path(child, (f"statics.{name}.{field}",), label, starts[0][label], typical)
            for label, (field, typical) in sizes.items()
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


CANDIDATES = (
    Candidate(
        name="hidden_wall",
        group="structure",
        law="a plane that bodies rebound from",
        signature="paths that turn back along one straight line where nothing is seen",
        reference="Newton's law of impact at a fixed plane",
        variants=_wall,
        confused_with={
            "hidden_body": "hits at several places: a wall turns all back along one line",
            "tether": "the sharpness of the turn, and its shape: a tether's is a circle",
        },
    ),
)
