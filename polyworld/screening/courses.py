"""Count distinct courses: runs that follow the same path at the same speeds repeat one course."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.screening.finding import Finding
from polyworld.screening.settings import ScreenSettings
from polyworld.screening.tracks import Track

Array = NDArray[np.float64]

POINTS = 256  # instants at which the longest run is compared, a dozen for each of twenty oscillations
LEAST = 1e-300  # [m^2] keeps a quotient of zeros finite


def courses(runs: Sequence[str], tracks: Sequence[Track], settings: ScreenSettings) -> tuple[int, ...]:
    """Return the number of each run's course, counted from 0 in the order in which courses first occur.

    A run belongs to the first course whose first run has the same objects and, after the best shift in time, paths of
    the same shape, which differ by less than the noise or by less than a hand makes in repeating a launch, at nearly
    the same place: an offset that is small beside the path hardly separates place from speed. Distances are from the
    first run, so that launches that change little by little do not form a single course.
    """
    step = float(max((t.times[-1] - t.times[0] for t in tracks), default=0.0)) / (POINTS - 1)
    if not step > 0.0:
        return tuple(range(len(runs)))
    origin: dict[str, Array] = {}  # sums of squares keep their digits where positions are counted from a near point
    paths: dict[str, dict[str, _Path]] = {name: {} for name in runs}
    for track in tracks:
        start = origin.setdefault(track.object, np.nan_to_num(track.places[0]))
        paths[track.run][track.object] = _Path(track, step, start)
    leaders: list[str] = []
    found = []
    for name in runs:
        same = [k for k, other in enumerate(leaders) if paths[other].keys() == paths[name].keys()]
        if paths[name] and same:
            alike = _alike(paths[name], [paths[leaders[k]] for k in same], settings)
            same = [same[k] for k in alike]
        if not same:
            same = [len(leaders)]
            leaders.append(name)
        found.append(same[0])
    return tuple(found)


def course_findings(runs: Sequence[str], course_of: Sequence[int]) -> list[Finding]:
    """Caution where all runs follow one course."""
    if len(set(course_of)) > 1:
        return []
    count = {1: "The only run is a single course", 2: "Both runs follow one course"}
    sentence = (
        f"{count.get(len(runs), f'All {len(runs)} runs follow one course')}, along which place, time and speed of each "
        "object go together, so that effects that depend on different ones of them may be indistinguishable from these "
        "data: add runs from other places, at other speeds or in other directions."
    )
    return [Finding("one_course", "caution", sentence)]


class _Path:
    """A track at equal steps from its start, with the transforms that comparisons at all shifts need."""

    def __init__(self, track: Track, step: float, origin: Array) -> None:
        self.count = min(int((track.times[-1] - track.times[0]) / step + 1e-9) + 1, POINTS)
        grid = track.times[0] + step * np.arange(self.count)
        self.noise = track.noise
        self.values = np.zeros((3, POINTS))
        self.known = np.zeros((3, POINTS))
        for axis in range(3):
            rows = np.isfinite(track.places[:, axis])
            if np.count_nonzero(rows) < 2:
                continue
            t = track.times[rows]
            inside = (grid >= t[0] - 1e-9 * step) & (grid <= t[-1] + 1e-6 * step)
            path = np.interp(grid, t, track.places[rows, axis] - origin[axis])
            self.values[axis, : self.count] = np.where(inside, path, 0.0)
            self.known[axis, : self.count] = inside
        seen = np.maximum(self.known.sum(axis=1), 1.0)
        mean = self.values.sum(axis=1) / seen
        squares = (((self.values - mean[:, None]) * self.known) ** 2).sum(axis=1)
        self.extent = float(np.sqrt((squares / seen).sum()))  # root mean square about the mean [m]
        self.of_values = np.fft.rfft(self.values, 2 * POINTS)
        self.of_squares = np.fft.rfft(self.values**2, 2 * POINTS)
        self.of_known = np.fft.rfft(self.known, 2 * POINTS)


def _alike(paths: dict[str, _Path], others: Sequence[dict[str, _Path]], settings: ScreenSettings) -> list[int]:
    """Indices of the others whose paths agree with the given ones in all objects at one shift."""
    left = list(range(len(others)))
    extent = max(p.extent for p in paths.values())
    worst = np.zeros((len(others), 2 * POINTS))
    for name in sorted(paths, key=lambda n: -paths[n].extent):
        scale = np.minimum(extent, [max(p.extent for p in others[k].values()) for k in left])
        worst[left] = np.maximum(worst[left], _ratios(paths[name], [others[k][name] for k in left], scale, settings))
        left = [k for k in left if worst[k].min() <= 1.0]
        if not left:
            break
    return left


def _ratios(mine: _Path, theirs: Sequence[_Path], scale: Array, settings: ScreenSettings) -> Array:
    """Mean squared distance (k, S) of a path from k others at S shifts, in units of what counts as the same."""
    size = 2 * POINTS
    values = np.stack([p.of_values for p in theirs])
    squares = np.stack([p.of_squares for p in theirs])
    known = np.stack([p.of_known for p in theirs])
    common = np.fft.irfft(np.conj(mine.of_known) * known, size)
    total = np.fft.irfft(
        np.conj(mine.of_squares) * known + np.conj(mine.of_known) * squares - 2.0 * np.conj(mine.of_values) * values,
        size,
    )
    offset = np.fft.irfft(np.conj(mine.of_known) * values - np.conj(mine.of_values) * known, size)
    seen = common > 0.5
    variance = np.stack([mine.noise**2 + p.noise**2 for p in theirs])[:, :, None]
    common = np.maximum(common, 0.5)
    offset = np.where(seen, offset / common, 0.0)
    distance = np.where(seen, total / common - offset**2 - variance, 0.0).sum(axis=1)
    distance = np.maximum(_between_steps(distance), 0.0)
    noise = np.sqrt(variance[:, :, 0].max(axis=1) / 2.0)
    allowed = np.maximum(settings.same_course * scale, noise)
    away = np.maximum(settings.same_place * scale, allowed)
    ratio = np.maximum(
        distance / np.maximum(allowed**2, LEAST)[:, None],
        (offset**2).sum(axis=1) / np.maximum(away**2, LEAST)[:, None],
    )
    shift = np.minimum(np.arange(size), size - np.arange(size))
    shorter = np.array([min(mine.count, p.count) for p in theirs])[:, None]
    compared = (common.max(axis=1) >= settings.overlap * shorter) & (shift <= settings.shift * shorter)
    result: Array = np.where(compared, ratio, np.inf)
    return result


def _between_steps(distance: Array) -> Array:
    """Lower each local minimum over shifts to that of the parabola through it and its neighbours."""
    left, right = np.roll(distance, 1, axis=1), np.roll(distance, -1, axis=1)
    bend = left + right - 2.0 * distance
    lowest = (distance <= left) & (distance <= right) & (bend > 0.0)
    drop = (right - left) ** 2 / (8.0 * np.where(lowest, bend, 1.0))
    return np.where(lowest, distance - drop, distance)
