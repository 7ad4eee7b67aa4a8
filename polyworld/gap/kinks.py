"""Kinks of the paths that nothing known explains: sudden changes of a velocity where nothing seen is in reach."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.estimation.linkage import is_held
from polyworld.gap.conditions import conditions, reach, touching, tracks
from polyworld.screening.tracks import Track
from polyworld.world import World

Array = NDArray[np.float64]

WINDOWS = (4, 6, 8, 12, 16)  # samples on either side of a kink from which velocities are taken
SURE = 6.0  # standard deviations that a jump of the velocity has to have
JUMP = 0.15  # of the typical speed that it has to have


@dataclass(frozen=True)
class Kink:
    """A sudden change of a body's velocity [m/s] at a time [s] and place (3,) [m], where nothing known is in reach.
    sigma [m/s]: noise of a component of the change."""

    run: str
    name: str
    time: float
    place: Array
    before: Array
    after: Array
    sigma: float

    @property
    def jump(self) -> Array:
        """Change of the velocity (3,) [m/s]."""
        return self.after - self.before

    @property
    def sigmas(self) -> float:
        """Size of the change in standard deviations of its noise."""
        return float(np.linalg.norm(self.jump)) / max(self.sigma, 1e-300)

    @property
    def direction(self) -> Array:
        """Unit vector (3,) of the change: away from what was struck."""
        jump = self.jump
        unit: Array = jump / np.linalg.norm(jump)
        return unit


def kinks(world: World, recording: Recording) -> tuple[Kink, ...]:
    """Return kinks of all paths that no static, supporting plane or other body seen explains, the sharpest first.

    Velocities before and after are those of straight lines through a few samples, gravity taken out; a kink is where
    they differ by SURE standard deviations and by JUMP of the typical speed. Bodies on joints have none; along an axis
    that was never measured nothing changes.
    """
    speed = conditions(world, recording).speed
    everything = tracks(world, recording)
    found: list[Kink] = []
    for track in everything:
        if is_held(world, track.object):
            continue
        others = [t for t in everything if t.run == track.run and t.object != track.object]
        unobserved = ~np.isfinite(track.places).any(axis=0)
        found += _kinks_of(world, replace(track, places=np.where(unobserved, 0.0, track.places)), others, speed)
    return tuple(sorted(found, key=lambda k: -float(np.linalg.norm(k.jump))))


def _kinks_of(world: World, track: Track, others: Sequence[Track], speed: float) -> list[Kink]:
    step, level = track.interval, float(track.noise.max())
    window = next((w for w in WINDOWS if SURE * _jump_noise(level, w, step) < JUMP * speed), WINDOWS[-1])
    count = len(track.times) - 2 * window + 1
    if count < 1:
        return []
    slope = (np.arange(window) - (window - 1) / 2) / (window * (window**2 - 1) / 12) / step
    blocks = np.lib.stride_tricks.sliding_window_view(track.places, window, axis=0)  # (T - w + 1, 3, w)
    velocity, mean = blocks @ slope, blocks.mean(axis=-1)
    free = np.zeros(3) if world.planar else np.asarray(world.environment.gravity, dtype=float)
    free = np.where(np.ptp(np.nan_to_num(track.places), axis=0) > 0.0, free, 0.0)  # of what was measured
    before, after = velocity[:count] + free * window * step / 2, velocity[window:] - free * window * step / 2
    size = np.linalg.norm(after - before, axis=1)
    size[~np.isfinite(size)] = 0.0
    if count > 2 * window:  # a steady force changes the velocity as much before and after
        sides = np.full((2, count), np.inf)
        sides[0, window:], sides[1, :-window] = size[:-window], size[window:]
        size = size - sides.min(axis=0)
    taken, whole = track.times[2 * window - 1 :] - track.times[:count], (2 * window - 1) * step
    size[np.abs(taken - whole) >= 0.5 * step] = 0.0  # samples that are not evenly spaced
    noise = _jump_noise(level, window, step)
    limit = max(SURE * noise, JUMP * speed)
    explained = touching(world, track, margin=speed * step) | _near_others(world, track, others, speed * step)
    found: list[Kink] = []
    while size.max(initial=0.0) > limit:
        k = int(np.argmax(size))
        around = slice(max(0, k - window), k + window + 1)
        size_here = size[k]
        size[around] = 0.0
        middle = k + window  # the first sample after the kink
        if explained[max(0, middle - window // 2 - 1) : middle + window // 2 + 1].any() or size_here <= limit:
            continue
        # Where the two lines meet: mean places half a window away, carried on with the velocities.
        half = (window / 2) * step
        place = (mean[k] + half * velocity[k] + mean[k + window] - half * velocity[k + window]) / 2
        time = float(track.times[middle] - step / 2)
        found.append(Kink(track.run, track.object, time, place, before[k], after[k], noise))
    return found


def _jump_noise(noise: float, window: int, step: float) -> float:
    """Return the standard deviation of the difference of two slopes over as many samples."""
    return float(noise * np.sqrt(2.0 * 12.0 / (window * (window**2 - 1))) / step)


def _near_others(world: World, track: Track, others: Sequence[Track], margin: float) -> NDArray[np.bool_]:
    near = np.zeros(len(track.times), dtype=bool)
    own = reach(world, world.object(track.object))
    for other in others:
        limit = 1.25 * (own + reach(world, world.object(other.object))) + margin
        rows = np.searchsorted(other.times, track.times).clip(0, len(other.times) - 1)
        distance = np.linalg.norm(track.places - other.places[rows], axis=1)
        near |= np.isfinite(distance) & (distance <= limit)
    return near
