"""Count distinct courses: runs that follow the same path at the same speeds repeat one course."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.screening.finding import Finding
from polyworld.screening.settings import ScreenSettings
from polyworld.screening.tracks import Subject, Track

Array = NDArray[np.float64]

POINTS = 256  # instants at which the longest run is compared, a dozen for each of twenty oscillations
LEAST = 1e-300  # [m^2] keeps a quotient of zeros finite


def courses(data: Subject) -> tuple[int, ...]:
    """Return the number of each run's course, counted from 0 in the order in which courses first occur.

    A run belongs to the first course whose first run has the same objects and, after the best shift in time, paths of
    the same shape, which differ by less than the noise or by less than a hand makes in repeating a launch, at nearly
    the same place: an offset that is small beside the path hardly separates place from speed. Distances are from the
    first run, so that launches that change little by little do not form a single course.
    """
    runs = [r.name for r in data.recording.runs]
    step = float(max((t.times[-1] - t.times[0] for t in data.tracks), default=0.0)) / (POINTS - 1)
    if not step > 0.0:
        return tuple(range(len(runs)))
    origin: dict[str, Array] = {}  # sums of squares keep their digits where positions are counted from a near point
    paths: dict[str, dict[str, _Path]] = {name: {} for name in runs}
    for track in data.tracks:
        start = origin.setdefault(track.object, np.nan_to_num(track.places[0]))
        paths[track.run][track.object] = _Path(track, step, start, data.settings.shift)
    leaders: list[str] = []
    found = []
    for name in runs:
        same = (k for k, leader in enumerate(leaders) if _alike(paths[name], paths[leader], data.settings))
        course = next(same, len(leaders))
        leaders += [name] * (course == len(leaders))
        found.append(course)
    return tuple(found)


def one_course(course_of: Sequence[int]) -> Iterator[Finding]:
    """Caution where all runs follow one course."""
    count = {1: "The only run is a single course", 2: "Both runs follow one course"}
    if len(set(course_of)) == 1:
        yield Finding(
            "one_course",
            f"{count.get(len(course_of), f'All {len(course_of)} runs follow one course')}, along which place, time and "
            "speed of each object go together, so that effects that depend on different ones of them may be "
            "indistinguishable from these data: add runs from other places, at other speeds or in other directions.",
        )


class _Path:
    """A track at equal steps from its start, as it is (3, n) and in windows at every shift (3, shifts, n).

    Zero where it is not known.
    """

    def __init__(self, track: Track, step: float, origin: Array, shift: float) -> None:
        self.count = min(int((track.times[-1] - track.times[0]) / step + 1e-9) + 1, POINTS)
        grid = track.times[0] + step * np.arange(self.count)
        self.noise = track.noise
        self.values, self.known = np.zeros((3, POINTS)), np.zeros((3, POINTS))
        for axis, column in enumerate(track.places.T):
            rows = np.isfinite(column)
            if np.count_nonzero(rows) >= 2:
                t = track.times[rows]
                inside = (grid >= t[0] - 1e-9 * step) & (grid <= t[-1] + 1e-6 * step)
                self.values[axis, : self.count] = inside * np.interp(grid, t, column[rows] - origin[axis])
                self.known[axis, : self.count] = inside
        seen = np.maximum(self.known.sum(axis=1), 1.0)
        mean = self.values.sum(axis=1) / seen
        squares = (((self.values - mean[:, None]) * self.known) ** 2).sum(axis=1)
        self.extent = float(np.sqrt((squares / seen).sum()))  # root mean square about the mean [m]
        most = int(shift * POINTS)
        self.shifted = [
            np.lib.stride_tricks.sliding_window_view(np.pad(v, ((0, 0), (most, most))), POINTS, axis=1)
            for v in (self.values, self.values**2, self.known)
        ]
        self.shifts = np.abs(np.arange(2 * most + 1) - most)


def _alike(mine: dict[str, _Path], theirs: dict[str, _Path], settings: ScreenSettings) -> bool:
    """Whether the paths of two runs agree in all objects at one shift."""
    if not mine or mine.keys() != theirs.keys():
        return False
    scale = min(max(p.extent for p in run.values()) for run in (mine, theirs))
    worst = np.max([_ratios(path, theirs[name], scale, settings) for name, path in mine.items()], axis=0)
    return float(worst.min()) <= 1.0


def _ratios(mine: _Path, other: _Path, scale: float, settings: ScreenSettings) -> Array:
    """Mean squared distance (S,) of two paths at S shifts, in units of what counts as the same."""
    values, squares, known = (np.einsum("asn,an->as", w, mine.known) for w in other.shifted)
    own = np.einsum("asn,an->as", other.shifted[2], mine.values)
    total = squares + np.einsum("asn,an->as", other.shifted[2], mine.values**2)
    total -= 2.0 * np.einsum("asn,an->as", other.shifted[0], mine.values)
    common = np.maximum(known, 1.0)
    offset = (values - own) / common
    variance = mine.noise**2 + other.noise**2
    distance = np.where(known > 0.0, total / common - offset**2 - variance[:, None], 0.0).sum(axis=0)
    distance = np.maximum(_between_steps(distance), 0.0)
    allowed = max(settings.same_course * scale, float(np.sqrt(variance.max() / 2.0)))
    away = max(settings.same_place * scale, allowed)
    ratio = np.maximum(distance / max(allowed**2, LEAST), (offset**2).sum(axis=0) / max(away**2, LEAST))
    shorter = min(mine.count, other.count)
    compared = (known.max(axis=0) >= settings.overlap * shorter) & (other.shifts <= settings.shift * shorter)
    result: Array = np.where(compared, ratio, np.inf)
    return result


def _between_steps(distance: Array) -> Array:
    """Lower each local minimum over shifts to that of the parabola through it and its neighbours."""
    left, middle, right = distance[:-2], distance[1:-1], distance[2:]
    bend = left + right - 2.0 * middle
    lowest = (middle <= left) & (middle <= right) & (bend > 0.0)
    drop = np.where(lowest, (right - left) ** 2 / (8.0 * np.where(lowest, bend, 1.0)), 0.0)
    found: Array = distance - np.pad(drop, 1)
    return found
