"""Objects that overlap where they start: the solver pushes them apart, as no real pair would part."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from polyworld.model import mesh_of
from polyworld.probing.closest_approach import ConvexSet, place_of, same_height
from polyworld.probing.point_approach import distance_to
from polyworld.trajectory import Rollout, Trajectory
from polyworld.world import World, geometry

Array = NDArray[np.float64]

SHARE = 0.01  # of the smaller object's size: a shallower overlap is within what places are measured to
DIRECTIONS = 128  # of a push apart that are tried, before the best is refined
FINEST = 1e-3  # angle to which it is [rad]


@dataclass(frozen=True)
class Overlap:
    """Two objects, or an object and a static, that overlap when the later of them starts.

    depth: the shortest way to push them apart [m], at most a few percent too long; of ropes, cloth and soft bodies how
    far their deepest node is inside. time [s].
    """

    a: str
    b: str
    depth: float
    time: float

    def in_words(self) -> str:
        """Return the overlap as a clause."""
        return f"{self.a!r} and {self.b!r} overlap by {self.depth:.3g} m at {self.time:.4g} s"


def overlaps(world: World, rollout: Rollout) -> tuple[Overlap, ...]:
    """Find what overlaps at its start by more than SHARE of the smaller one's size, deepest first.

    Pairs that pass through each other are left out: joined bodies, planar ones at different heights, what is fastened,
    and fluids, which no body starts in. So are triangle meshes, and pairs of deformable objects.
    """
    trajectory = rollout.trajectory
    joined = {frozenset((j.object, j.other)) for j in world.joints if j.other is not None and j.kind != "spring"}
    bodies = [o.name for o in world.objects]
    pairs = [*combinations(bodies, 2), *((name, s.name) for name in bodies for s in world.statics)]
    pieces = _Pieces(world, trajectory)
    found = [
        _of_bodies(pieces, a, b, _start(trajectory, a, b))
        for a, b in pairs
        if frozenset((a, b)) not in joined and (not world.planar or same_height(world, a, b))
    ]
    fastened = {frozenset((a.object, a.to)) for a in world.attachments if a.to is not None}
    fastened |= {frozenset((p.rope, p.object)) for p in world.pulleys if p.object is not None}
    for item in world.of_form("line", "sheet", "solid"):
        for other in (*bodies, *(s.name for s in world.statics)):
            if frozenset((item.name, other)) not in fastened:
                found.append(_of_nodes(world, trajectory, item.name, other, _start(trajectory, item.name, other)))
    return tuple(sorted((o for o in found if o is not None), key=lambda o: (-o.depth, o.a, o.b)))


class _Pieces:
    """The convex pieces of bodies and statics at the times asked for, each found once."""

    def __init__(self, world: World, trajectory: Trajectory) -> None:
        self.trajectory = trajectory
        self._world = world
        self._found: dict[tuple[str, float], list[ConvexSet]] = {}

    def at(self, name: str, time: float) -> list[ConvexSet]:
        """Return the pieces of a body; none of a triangle mesh."""
        if (name, time) not in self._found:
            place = place_of(self._world, self.trajectory, name)
            self._found[name, time] = [] if place is None else place(time)
        return self._found[name, time]


def _start(trajectory: Trajectory, a: str, b: str) -> int | None:
    """Return the first sample at which both take part; a static always does."""
    there = np.ones(len(trajectory.times), dtype=bool)
    for name in {a, b} & set(trajectory.names):
        there &= trajectory.active[:, trajectory.index(name)]
    return int(np.argmax(there)) if there.any() else None


def _of_bodies(pieces: _Pieces, a: str, b: str, row: int | None) -> Overlap | None:
    if row is None:
        return None
    time = float(pieces.trajectory.times[row])
    ours, theirs = pieces.at(a, time), pieces.at(b, time)
    if not (ours and theirs):
        return None
    least = SHARE * min(max(p.bound for p in ours), max(q.bound for q in theirs))
    depth = max(_depth(p, q, least) for p in ours for q in theirs)
    return Overlap(a, b, depth, time) if depth > least else None


def _depth(a: ConvexSet, b: ConvexSet, least: float) -> float:
    """Return how far two convex sets overlap [m]; any number below `least` where they overlap less."""
    if b.half_space is not None:
        normal, offset = b.half_space
        return offset + a.sweep - float(normal @ a.support(-normal))
    between = b.centre - a.centre
    apart = float(np.linalg.norm(between))
    if a.bound + b.bound - apart <= least:
        return 0.0

    def along(direction: Array) -> float:
        return float((a.support(direction) - b.support(-direction)) @ direction) + a.sweep + b.sweep

    best, depth = None, np.inf
    for direction in _directions(between / apart if apart > 0.0 else None, len(between)):
        here = along(direction)
        if here < depth:
            best, depth = direction, here
        if depth <= least:
            return depth
    assert best is not None
    step = 0.3
    while step > FINEST:
        tried = [best + sign * step * axis for axis in np.eye(len(best)) for sign in (1.0, -1.0)]
        tried = [direction / np.linalg.norm(direction) for direction in tried]
        values = [along(direction) for direction in tried]
        nearest = int(np.argmin(values))
        if values[nearest] < depth:
            best, depth = tried[nearest], values[nearest]
        else:
            step *= 0.5
    return depth


def _directions(first: Array | None, axes: int) -> Array:
    """Unit vectors spread over a circle or a ball (Fibonacci lattice), after the axes and `first`."""
    k = np.arange(DIRECTIONS) + 0.5
    if axes == 2:
        turns = 2.0 * np.pi * k / DIRECTIONS
        spread = np.stack([np.cos(turns), np.sin(turns)], axis=1)
    else:
        z, turns = 1.0 - 2.0 * k / DIRECTIONS, np.pi * (1.0 + np.sqrt(5.0)) * k
        r = np.sqrt(1.0 - z**2)
        spread = np.stack([r * np.cos(turns), r * np.sin(turns), z], axis=1)
    own = [] if first is None else [first[None]]
    return np.concatenate([*own, np.eye(axes), -np.eye(axes), spread])


def _of_nodes(world: World, trajectory: Trajectory, name: str, other: str, row: int | None) -> Overlap | None:
    if row is None:
        return None
    static = next((s for s in world.statics if s.name == other), None)
    if static is not None:
        shape: object = static.shape
        position, orientation = np.asarray(static.position), np.asarray(static.orientation)
    else:
        column = trajectory.index(other)
        shape, position = world.object(other).shape, trajectory.positions[row, column]
        orientation = trajectory.orientations[row, column]
    mesh = mesh_of(world, world.deformable(name))
    points = trajectory.deformables[name].points[row]
    distance = distance_to(shape, (points - position) @ geometry.quaternion_matrix(orientation))
    if distance is None:
        return None
    depth = float((mesh.radius - distance).max())
    size = float(np.ptp(points, axis=0).max()) / 2.0
    least = max(SHARE * size, float(mesh.radius.max()))  # a node at rest on a surface is half its thickness above it
    return Overlap(name, other, depth, float(trajectory.times[row])) if depth > least else None
