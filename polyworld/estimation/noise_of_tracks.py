"""Measurement noise of tracks, read off the data before any fit and never changed by one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import NOISE_FLOOR, track_noise
from polyworld.data.tracks import ObservedTracks

Array = NDArray[np.float64]

FREEDOM = 3.0  # third differences for each that is independent, of white noise
ERRORS = 2.0  # standard errors of the scatter within which a stated noise may be below it
SMOOTH = 3.0  # times the scatter that a stated noise is believed: the rest of it drifts slowly, as masks' errors do


def track_sigma(tracks: ObservedTracks) -> Array:
    """Return standard deviations (n,) [m] of the positions of each track.

    By third differences: smooth motion has none, and of white noise they have 20 times its variance. A stated noise is
    taken where it is no smaller than that, beyond the error that so few samples leave, and no larger than three times;
    short tracks have what is stated.
    Third differences of all tracks together bound that of each from below, since a few samples say little.
    """
    stated, scatter = np.zeros(len(tracks.names)), np.full(len(tracks.names), np.nan)
    error = np.zeros(len(tracks.names))
    for column in range(len(tracks.names)):
        seen = tracks.confidence[:, column] > 0.0
        if not seen.any():
            continue
        stated[column] = float(np.median(tracks.position_sigma[seen, column]))
        own = track_noise(tracks.positions[seen, column])
        if np.isfinite(own).any():
            own = own[own >= 0.1 * np.nanmax(own)]  # heights taken from the floor carry no noise
            scatter[column] = float(np.sqrt(np.mean(own**2)))
            error[column] = np.sqrt(FREEDOM / (2.0 * len(own) * (np.count_nonzero(seen) - 3)))
    known = np.isfinite(scatter)
    common = float(np.median(scatter[known])) if known.any() else 0.0
    scatter = np.where(known, np.maximum(scatter, 0.5 * common), stated)
    sigma = np.where(
        stated > 0.0,
        np.clip(stated, scatter / (1.0 + ERRORS * error), SMOOTH * np.maximum(scatter, NOISE_FLOOR)),
        scatter,
    )
    found: Array = np.maximum(sigma, NOISE_FLOOR)
    return found
