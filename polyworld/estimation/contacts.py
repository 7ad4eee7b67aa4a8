"""Find which objects the tracks bring close enough to touch, and when: only these show contact parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.world import World, geometry
from polyworld.world.distances import distance_to_static
from polyworld.world.representations.rigid import RigidObject

Array = NDArray[np.float64]


def possible_contacts(world: World, tracks: ObservedTracks, margin: float = 0.05) -> dict[tuple[str, str], float]:
    """Find pairs whose circumscribed balls (planar worlds: circles) come within `margin` [m], in the order of time.

    Between samples too: a ball that bounces may be seen above the floor before and after. Two names, alphabetical ->
    the first time [s] at which they do. Pairs of objects, and objects with statics. A pair observed too seldom, or
    never both at once, is not listed, nor are objects that a joint lets pass through each other. A planar world's
    supporting plane is not a static and makes no contact here.
    """
    found: dict[tuple[str, str], float] = {}
    times: Array = tracks.frames.astype(np.float64) * world.time.seconds_per_frame
    names = [o.name for o in world.objects if o.name in tracks.names]
    seen = {n: tracks.confidence[:, tracks.index(n)] > 0.0 for n in names}
    place = {n: tracks.positions[:, tracks.index(n)] for n in names}
    reach = {n: _reach(world, world.object(n)) for n in names}
    joined = {frozenset((j.object, j.other)) for j in world.joints if j.kind != "spring"}
    for i, a in enumerate(names):
        near = {
            b: _near(
                np.linalg.norm(place[a] - place[b], axis=1) - reach[a] - reach[b], seen[a] & seen[b], times, margin
            )
            for b in names[i + 1 :]
            if frozenset((a, b)) not in joined
        }
        for static in world.statics:
            near[static.name] = _near(distance_to_static(static, place[a]) - reach[a], seen[a], times, margin)
        for b, rows in near.items():
            if rows.any():
                found[min(a, b), max(a, b)] = float(times[np.argmax(rows)])
    return dict(sorted(found.items(), key=lambda item: (item[1], item[0])))


def _near(gaps: Array, seen: NDArray[np.bool_], times: Array, margin: float) -> NDArray[np.bool_]:
    """Return at which samples (T,) a gap (T,) [m] is, or just before may have been, within a margin.

    Something that approaches at a speed v, and leaves no faster, may have touched between two samples where their gaps
    add up to no more than v times the time between them, each up to the margin.
    """
    near: NDArray[np.bool_] = seen & (gaps <= margin)
    rows = np.flatnonzero(seen)
    if len(rows) >= 3:
        gap, time = gaps[rows], times[rows]
        approach = (gap[:-2] - gap[1:-1]) / (time[1:-1] - time[:-2])
        met = gap[1:-1] + gap[2:] <= approach * (time[2:] - time[1:-1]) + 2.0 * margin
        near[rows[2:]] |= met & (approach > 0.0)
    return near


def _reach(world: World, item: RigidObject) -> float:
    if not world.planar:
        return geometry.circumscribed_radius(item.shape)
    rotation = geometry.quaternion_matrix(np.asarray(item.orientation))
    axes = geometry.plane_axes(world.environment.motion_plane)
    outline, disc = geometry.planar_outline(item.shape, rotation, axes)
    return float(np.linalg.norm(outline, axis=1).max() + disc)
