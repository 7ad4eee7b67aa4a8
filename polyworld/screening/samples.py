"""Check that there are samples enough: for initial states, for intervals, and to follow the motion between contacts."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from polyworld.screening.finding import Finding, length, listed, runs_listed
from polyworld.screening.statics import clearance, inner_radius, plane_normal
from polyworld.screening.tracks import Subject, Track

Array = NDArray[np.float64]

STATES = 2  # per measured component: position and velocity at the start
TURNING = 3  # components of a rotation


def sample_findings(data: Subject, *, scaled: bool) -> list[Finding]:
    """Return findings on the number of runs and samples, and on sampling too coarse for the motion.

    scaled: whether lengths and times are those of the world, so that gravity shows how long a bounce lasts.
    """
    none = list(_too_few(data))
    if none:
        return none
    coarse = [*_jumping(data)] or [*(_hopping(data) if scaled else ())] or [*_noisy(data)]
    return [*_short(data), *_single(data), *coarse]


def _too_few(data: Subject) -> Iterator[Finding]:
    turns = [int(np.isfinite(t.orientations).all(axis=1).sum()) for t in data.tracks]
    measured = sum(int(np.isfinite(t.places).sum()) for t in data.tracks) + TURNING * sum(turns)
    states = STATES * sum(len(t.axes) + TURNING * (n > 0) for t, n in zip(data.tracks, turns, strict=True))
    if measured <= states:
        yield Finding(
            "few_samples",
            f"The recording holds {measured} measured numbers, no more than the {states} unknown positions and "
            "velocities at the starts of its runs, so that nothing is left to test an effect with: add samples.",
            "refuse",
        )


def _short(data: Subject) -> Iterator[Finding]:
    fewest = data.settings.few_samples
    short = [t for t in data.tracks if len(t.times) < fewest and t.moves(data.settings.moved)]
    if short:
        yield Finding(
            "few_samples",
            f"There are fewer than {fewest} samples of {listed(t.object for t in short)} in "
            f"{runs_listed(t.run for t in short)} (the least: {min(len(t.times) for t in short)}), of which the start "
            "takes up two per axis, so that noise and motion can hardly be separated there: sample faster or longer.",
        )


def _single(data: Subject) -> Iterator[Finding]:
    if len(data.recording.runs) == 1:
        yield Finding(
            "single_run",
            f"There is a single run, {data.recording.runs[0].name}, so that no result can be tested on a run that was "
            "not fitted: add at least one more, better several from different starts.",
        )


def _noisy(data: Subject) -> Iterator[Finding]:
    """Caution where all runs together hardly show the acceleration of the motion itself.

    The standard error of the acceleration of n samples over T seconds is about sigma sqrt(720 / n) / T^2.
    """
    gravity = 0.0 if data.world.planar else float(np.linalg.norm(data.world.environment.gravity))
    information, ordinary = 0.0, []
    for track in (t for t in data.tracks if len(t.times) >= 4 and t.axes):
        square = float(track.times[-1] - track.times[0]) ** 2
        error = float(track.noise[track.axes].max()) * np.sqrt(720.0 / len(track.times)) / square
        ordinary.append(max(float(np.linalg.norm(track.range)) / square, gravity if 2 in track.axes else 0.0))
        information += error**-2 if error > 0.0 else np.inf
    usual = float(np.median(ordinary)) if ordinary else 0.0
    error = float(max(information, 1e-300) ** -0.5)
    if error > data.settings.weakest * usual > 0.0:
        yield Finding(
            "noisy",
            f"All runs together give an acceleration only to within {error:.2g} m/s^2 (standard error), "
            f"{100.0 * min(error / usual, 99.0):.0f}% of what bodies have, so that ordinary effects cannot be seen: "
            "record longer runs, more of them, or with less noise.",
        )


def _jumping(data: Subject) -> Iterator[Finding]:
    """Caution where successive positions look independent of each other."""
    jumping = [t for t in data.tracks if _independent(data, t)]
    if jumping:
        yield Finding(
            "coarse_sampling",
            f"Positions of {listed(t.object for t in jumping)} in {runs_listed(t.run for t in jumping)} jump from "
            "sample to sample over much of their whole range: sample faster, or, if the object rests there, correct "
            "tracks that are this noisy.",
        )


def _independent(data: Subject, track: Track) -> bool:
    """Whether the mean squared step is as large as of independent positions (von Neumann 1941), on the widest axis."""
    axis, item = int(np.argmax(track.range)), data.body(track)
    values = track.places[np.isfinite(track.places[:, axis]), axis]
    if item is None or len(values) < data.settings.few_samples:
        return False
    resting = np.ptp(values) <= 2.0 * inner_radius(data.world, item)
    return not resting and float(np.mean(np.diff(values) ** 2) / np.var(values)) > data.settings.unresolved


def _hopping(data: Subject) -> Iterator[Finding]:
    """Caution where bounces are shorter than the time between samples."""
    most = [max(data.settings.hop_share * len(t.times), data.settings.hops - 1) for t in data.tracks]
    hopping = [t for t, m in zip(data.tracks, most, strict=True) if _hops(data, t) > m]
    if hopping:
        interval = float(np.median([t.interval for t in hopping]))
        height = float(np.linalg.norm(data.world.environment.gravity)) * interval**2 / 8.0
        yield Finding(
            "coarse_sampling",
            f"In {runs_listed(t.run for t in hopping)} bounces of {listed(t.object for t in hopping)} are shorter than "
            f"the {interval:.3g} s between samples (heights below {length(height)}), so that contacts are missed: "
            "sample faster, or end the runs before.",
        )


def _hops(data: Subject, track: Track) -> int:
    """Number of samples in stretches where a body leaves a floor for less than the time between samples."""
    world, count, item = data.world, data.settings.hops, data.body(track)
    gravity = np.asarray(world.environment.gravity, dtype=float)
    size = float(np.linalg.norm(gravity))
    noise = data.settings.significant * float(track.noise.max()) + float(track.quantum.max())
    highest = size * track.interval**2 / 8.0  # of a flight that lasts as long as the interval
    if world.planar or item is None or highest <= noise or len(track.times) < count:
        return 0
    most = 0
    for static in world.statics:
        normal = plane_normal(static)
        if normal is not None and -float(normal @ gravity) >= data.settings.oblique * size:
            gap = clearance(world, item, static, track)
            assert gap is not None
            windows = np.lib.stride_tricks.sliding_window_view(gap, count)
            short = (windows.max(axis=1) < highest) & (np.ptp(windows, axis=1) > noise)
            most = max(most, int(np.convolve(short, np.ones(count)).astype(bool).sum()))
    return most
