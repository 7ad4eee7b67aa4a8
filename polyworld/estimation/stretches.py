"""Cut runs into stretches at collisions, with free initial states and soft links between them.

No rigid impact model reproduces a collision exactly, and one that must would bend friction and damping to make up for
it. Here the state after a collision is free, and bound to what the model predicts by a standard deviation of its own.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d

from polyworld.data.initial_states import initial_states, with_initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.fit_settings import LinkSettings
from polyworld.world import World, geometry

Array = NDArray[np.float64]

ALONE = ("quadratic_damping", "air_drag", "collision_slack")  # effects that act on every body by itself
NEAR = 4.0  # standard deviations of the noise by which bodies may be nearer than their tracks
FEWEST = 4  # samples before a jump: a quadratic has three coefficients
LAST = 2  # samples after it


@dataclass(frozen=True)
class Link:
    """Bond of a stretch's end to the next one's start.

    time [s]: of the next one's start, counted from that of this one. place [m], velocity [m/s]: standard deviations by
    object; those of turn and spin are the same at its `radius` [m]. who: takes part in the collision. turns: objects
    that look the same at one angle alone.
    """

    time: float
    place: dict[str, float]
    velocity: dict[str, float]
    radius: dict[str, float]
    who: tuple[str, ...] = ()
    turns: frozenset[str] = frozenset()

    def deviations(self) -> Array:
        """Return standard deviations (n, 4) of place, velocity, turn and spin of every object."""
        own = [
            (self.place[n], self.velocity[n], self.place[n] / r, self.velocity[n] / r) for n, r in self.radius.items()
        ]
        return np.array(own)


@dataclass(frozen=True)
class Stretch:
    """Part of a run without a collision inside that links others.

    run: index. begin [s]: when it begins, in the run's time. world: in which objects start as the tracks begin. tracks:
    with frames counted from that start. link: to the next stretch; None for the last. carried: whether one precedes.
    groups: bodies that may act on one another until the next stretch begins, by where tracks have them; () if all may.
    """

    run: int
    begin: float
    world: World
    tracks: ObservedTracks
    link: Link | None
    carried: bool = False
    groups: tuple[frozenset[str], ...] = ()


def velocity_jump(times: Array, points: Array, row: int, settings: LinkSettings) -> float:
    """Return by how much chi-square two quadratics, before and after an instant, beat one cubic about it.

    times (T,) [s]; points (T, 3) in standard deviations of the noise, NaN where not seen. Zero where too few samples
    are near on either side.
    """
    seen = np.flatnonzero(np.isfinite(points).all(axis=1))
    left, right = seen[seen < row][-settings.window :], seen[seen >= row][: settings.window]
    if len(left) < FEWEST or len(right) < LAST:
        return 0.0
    both, centred = np.concatenate([left, right]), times - times[row]
    one = _misfit(centred[both], points[both], 3)
    return one - sum(_misfit(centred[side], points[side], min(2, len(side) - 1)) for side in (left, right))


def _misfit(times: Array, points: Array, degree: int) -> float:
    design = np.vander(times, degree + 1)
    return float(((points - design @ np.linalg.lstsq(design, points, rcond=None)[0]) ** 2).sum())


def collisions(
    world: World, tracks: ObservedTracks, noise: Array, settings: LinkSettings
) -> list[tuple[range, tuple[str, ...]]]:
    """Return rows of the first frames after the contacts of collisions of two bodies or more, and who takes part.

    A collision is where two bodies come nearest, so near that they may touch, and the velocities of both jump: before
    the frame at which they are nearest, or after it.
    """
    bodies = [i for i, name in enumerate(tracks.names) if world.is_rigid(name)]
    times = tracks.moments * world.time.seconds_per_frame
    points = np.where((tracks.confidence > 0.0)[..., None], tracks.positions, np.nan)
    cuts: list[tuple[int, tuple[str, str]]] = []
    for a, b in itertools.combinations(bodies, 2):
        apart = np.nan_to_num(np.linalg.norm(points[:, a] - points[:, b], axis=1), nan=np.inf)
        nearest = np.flatnonzero(apart <= minimum_filter1d(apart, 2 * settings.again + 1))
        for row in nearest.tolist():
            around, both = np.arange(max(row - 2, 0), min(row + 3, len(times))), (tracks.names[a], tracks.names[b])
            if _near(world, tracks, noise, around, *both):
                split = [[velocity_jump(times, points[:, i] / noise[i], r, settings) for i in (a, b)]
                         for r in (row, row + 1)]  # fmt: skip
                first = int(np.argmax(np.sum(split, axis=1)))
                if sum(split[first]) > settings.gain:
                    cuts.append((row + first, both))
    found: list[tuple[range, tuple[str, ...]]] = []
    for row, who in sorted(cuts):
        last = found[-1] if found else None
        if last and row - last[0].stop <= (settings.again if set(who) & set(last[1]) else LAST):
            found[-1] = range(last[0].start, row + 1), tuple(dict.fromkeys((*last[1], *who)))
        else:
            found.append((range(row, row + 1), who))
    return found


def stretches(
    index: int, world: World, tracks: ObservedTracks, noise: Array, settings: LinkSettings, *, cut: bool = True
) -> tuple[Stretch, ...]:
    """Cut one run at its collisions of two or more bodies; a run without any, or not to be `cut`, is one stretch.

    A frame at the collision itself belongs to neither side, since it may lie before or after.
    """
    step = world.time.seconds_per_frame
    cuts = collisions(world, tracks, noise, settings) if cut and not world.coupled else []
    found: list[Stretch] = []
    first = 0
    for rows_met, who in [*cuts, (range(0), ())]:
        rows = slice(first, max(rows_met.start - 1, first + 1)) if who else slice(first, len(tracks.frames))
        frames = tracks.frames[rows]
        part = tracks.window(int(frames[0]), int(frames[-1]))
        begin = 0.0 if first == 0 else float(part.moments[0])
        if first:
            clock = None if part.clock is None else part.clock - begin
            part = replace(part, frames=part.frames - int(frames[0]), clock=clock)
        time = world.time.model_copy(update={"origin": world.time.origin + begin * step})
        own = with_initial_states(world.model_copy(update={"time": time}), part)
        if found:
            own = _carried_on(found[-1], own, part, begin * step - found[-1].begin)
        found.append(Stretch(index, begin * step, own, part, None, bool(found)))
        if who:
            first = min(rows_met.stop, len(tracks.frames) - 2)
    for i, (_, who) in enumerate(cuts):
        here, later = found[i], found[i + 1]
        jump = max(
            float(np.linalg.norm(np.subtract(later.world.object(n).velocity, here.world.object(n).velocity)))
            for n in who
        )
        shared = [o.name for o in world.objects if here.world.object(o.name).start_time < later.begin - here.begin]
        place = {n: settings.place if n in who else settings.close for n in shared}
        velocity = {n: max(settings.jump * jump, settings.near) if n in who else settings.near for n in shared}
        radius = {n: geometry.circumscribed_radius(world.object(n).shape) for n in shared}
        turns = frozenset(n for n, order in zip(tracks.names, tracks.symmetry, strict=True) if order == 1)
        found[i] = replace(here, link=Link(later.begin - here.begin, place, velocity, radius, who, turns))
    ends = [*(s.begin for s in found[1:]), np.inf]
    return tuple(
        replace(s, groups=together(world, tracks, noise, s.begin, end)) for s, end in zip(found, ends, strict=True)
    )


def together(
    world: World, tracks: ObservedTracks, noise: Array, begin: float, end: float
) -> tuple[frozenset[str], ...]:
    """Partition rigid bodies by who may touch whom between two times [s], as their tracks have it.

    () where joints, effects or bodies without a track may tie them, or other than rigid ones move.
    """
    bodies = [o.name for o in world.objects]
    if world.coupled or world.joints or world.deformables or any(e.kind not in ALONE for e in world.effects):
        return ()
    if not set(bodies) <= set(tracks.names):
        return ()
    step = world.time.seconds_per_frame
    rows = np.flatnonzero((tracks.moments * step >= begin - 1e-9) & (tracks.moments * step <= end + 1e-9))
    groups = [frozenset([n]) for n in bodies]
    for i, a in enumerate(bodies):
        for b in bodies[:i]:
            unseen = not np.isfinite(tracks.positions[rows][:, [tracks.index(a), tracks.index(b)]]).all()
            if unseen or _near(world, tracks, noise, rows, a, b):
                both = [g for g in groups if a in g or b in g]
                groups = [*(g for g in groups if g not in both), frozenset().union(*both)]
    return tuple(groups)


def _near(world: World, tracks: ObservedTracks, noise: Array, rows: NDArray[np.int64], a: str, b: str) -> bool:
    """Return whether two bodies come so near in some rows that they may touch between them."""
    apart = tracks.positions[rows, tracks.index(a)] - tracks.positions[rows, tracks.index(b)]
    seen = apart[np.isfinite(apart).all(axis=1)]
    moved = float(np.linalg.norm(np.diff(seen, axis=0), axis=1).max(initial=0.0))
    reach = sum(geometry.circumscribed_radius(world.object(n).shape) for n in (a, b))
    nearest = float(np.linalg.norm(seen, axis=1).min(initial=np.inf))
    return nearest < reach + moved + NEAR * float(noise.max())


def _carried_on(before: Stretch, world: World, part: ObservedTracks, time: float) -> World:
    """Place objects that are not observed in a stretch where the one before leads them, unless they never were."""
    states = initial_states(part, seconds_per_frame=world.time.seconds_per_frame)
    moved = {}
    for item in world.objects:
        if item.name in states or item.name not in before.tracks.names:
            continue
        earlier = before.world.object(item.name)
        place = np.asarray(earlier.position) + time * np.asarray(earlier.velocity)
        moved[item.name] = {
            "position": tuple(float(v) for v in place),
            "velocity": earlier.velocity,
            "start_time": 0.0,
        }
    objects = tuple(o.model_copy(update=moved.get(o.name, {})) for o in world.objects)
    return world.model_copy(update={"objects": objects})
