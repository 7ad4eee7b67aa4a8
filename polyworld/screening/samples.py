"""Check that there are samples enough: for initial states, for intervals, and to follow the motion between contacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.screening.clearance import clearance, inner_radius, plane_normal
from polyworld.screening.finding import Finding, length, listed, runs_listed
from polyworld.screening.settings import ScreenSettings
from polyworld.screening.tracks import Track
from polyworld.world import World

Array = NDArray[np.float64]

STATES = 2  # per measured component: position and velocity at the start
TURNING = 3  # components of a rotation


def sample_findings(
    world: World, recording: Recording, tracks: Sequence[Track], settings: ScreenSettings, *, scaled: bool
) -> list[Finding]:
    """Return findings on the number of runs and samples, and on sampling too coarse for the motion.

    scaled: whether lengths and times are those of the world, so that gravity shows how long a bounce lasts.
    """
    found = []
    names = tuple(r.name for r in recording.runs)
    measured = sum(int(np.isfinite(t.places).sum()) + TURNING * _turns(t) for t in tracks)
    states = sum(STATES * (len(t.axes) + (TURNING if _turns(t) else 0)) for t in tracks)
    if measured <= states:
        sentence = (
            f"The recording holds {measured} measured numbers, no more than the {states} unknown positions and "
            "velocities at the starts of its runs, so that nothing is left to test an effect with: add samples."
        )
        return [Finding("few_samples", "refuse", sentence)]
    short = [t for t in tracks if len(t.times) < settings.few_samples and t.moves(settings.moved)]
    if short:
        least = min(len(t.times) for t in short)
        sentence = (
            f"There are fewer than {settings.few_samples} samples of {listed(t.object for t in short)} in "
            f"{runs_listed(t.run for t in short)} (the least: {least}), of which the start takes up two per axis, so "
            "that noise and motion can hardly be separated there: sample faster or longer."
        )
        found.append(Finding("few_samples", "caution", sentence))
    if len(names) == 1:
        sentence = (
            f"There is a single run, {names[0]}, so that no result can be tested on a run that was not fitted: add "
            "at least one more, better several from different starts."
        )
        found.append(Finding("single_run", "caution", sentence))
    coarse = _jumping(world, tracks, settings) or (_hopping(world, tracks, settings) if scaled else [])
    return found + (coarse or _weak(world, tracks, settings))


def _turns(track: Track) -> int:
    return int(np.isfinite(track.orientations).all(axis=1).sum())


def _weak(world: World, tracks: Sequence[Track], settings: ScreenSettings) -> list[Finding]:
    """Caution where all runs together hardly show the acceleration of the motion itself.

    The standard error of the acceleration of n samples over T seconds is about sigma sqrt(720 / n) / T^2.
    """
    gravity = float(np.linalg.norm(world.environment.gravity)) if not world.planar else 0.0
    information, ordinary = 0.0, []
    for track in tracks:
        span, axes = float(track.times[-1] - track.times[0]), list(track.axes)
        if len(track.times) < 4 or not axes:
            continue
        error = float(track.noise[axes].max()) * np.sqrt(720.0 / len(track.times)) / span**2
        motion = float(np.linalg.norm(track.range)) / span**2
        ordinary.append(max(motion, gravity if gravity and 2 in axes else 0.0))
        information += error**-2 if error > 0.0 else np.inf
    if not ordinary:
        return []
    usual = float(np.median(ordinary))
    error = float(information**-0.5)
    if not error > settings.weakest * usual > 0.0:
        return []
    sentence = (
        f"All runs together give an acceleration only to within {error:.2g} m/s^2 (standard error), "
        f"{100.0 * min(error / usual, 99.0):.0f}% of what bodies have, so that ordinary effects cannot be seen: record "
        "longer runs, more of them, or with less noise."
    )
    return [Finding("noisy", "caution", sentence)]


def _jumping(world: World, tracks: Sequence[Track], settings: ScreenSettings) -> list[Finding]:
    """Caution where successive positions look independent of each other."""
    jumping = [t for t in tracks if _independent(world, t, settings)]
    if not jumping:
        return []
    sentence = (
        f"Positions of {listed(t.object for t in jumping)} in {runs_listed(t.run for t in jumping)} jump from sample "
        "to sample over much of their whole range: sample faster, or, if the object rests there, correct tracks that "
        "are this noisy."
    )
    return [Finding("coarse_sampling", "caution", sentence)]


def _hopping(world: World, tracks: Sequence[Track], settings: ScreenSettings) -> list[Finding]:
    """Caution where bounces are shorter than the time between samples."""
    hopping = [
        (t, count)
        for t in tracks
        if (count := _hops(world, t, settings)) > max(settings.hop_share * len(t.times), settings.hops - 1)
    ]
    if not hopping:
        return []
    interval = float(np.median([t.interval for t, _ in hopping]))
    height = float(np.linalg.norm(world.environment.gravity)) * interval**2 / 8.0
    sentence = (
        f"In {runs_listed(t.run for t, _ in hopping)} bounces of {listed(t.object for t, _ in hopping)} are "
        f"shorter than the {interval:.3g} s between samples (heights below {length(height)}), so that contacts "
        "are missed: sample faster, or end the runs before."
    )
    return [Finding("coarse_sampling", "caution", sentence)]


def _independent(world: World, track: Track, settings: ScreenSettings) -> bool:
    """Whether the mean squared step is as large as of independent positions (von Neumann 1941), on the widest axis."""
    axis = int(np.argmax(track.range))
    values = track.places[np.isfinite(track.places[:, axis]), axis]
    if len(values) < settings.few_samples or track.object not in {o.name for o in world.objects}:
        return False
    if np.ptp(values) <= 2.0 * inner_radius(world, world.object(track.object)):
        return False
    return float(np.mean(np.diff(values) ** 2) / np.var(values)) > settings.unresolved


def _hops(world: World, track: Track, settings: ScreenSettings) -> int:
    """Number of samples in stretches where a body leaves a floor for less than the time between samples."""
    gravity = np.asarray(world.environment.gravity, dtype=float)
    size = float(np.linalg.norm(gravity))
    if world.planar or not size > 0.0 or track.object not in {o.name for o in world.objects}:
        return 0
    noise = settings.significant * float(track.noise.max()) + float(track.quantum.max())
    highest = size * track.interval**2 / 8.0  # of a flight that lasts as long as the interval
    if highest <= noise or len(track.times) < settings.hops:
        return 0
    most = 0
    for static in world.statics:
        normal = plane_normal(static)
        if normal is None or -float(normal @ gravity) < settings.oblique * size:
            continue
        gap = clearance(world, world.object(track.object), static, track)
        if gap is None:
            continue
        windows = np.lib.stride_tricks.sliding_window_view(gap, settings.hops)
        top = windows.max(axis=1)
        short = (top < highest) & (np.ptp(windows, axis=1) > noise)
        inside = np.zeros(len(gap), dtype=bool)
        for k in range(settings.hops):
            inside[k : k + len(short)] |= short
        most = max(most, int(inside.sum()))
    return most
