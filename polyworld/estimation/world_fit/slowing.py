"""Where a fit starts for friction and drag: the deceleration of free motion, regressed on the laws that slow it.

Between contacts an object that slides on the plane slows down by mu g + c v + k v^2, with v its speed. Short
windows of a track give deceleration and speed with their errors; a linear regression with the unknowns' own
start and width as prior gives better ones. It chooses a start, not a result: the fit decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.initial_states import InitialState
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.unknown import Unknown
from polyworld.world import World
from polyworld.world.parameters import object_mass, read_parameter

Array = NDArray[np.float64]

WINDOW = 9  # samples of one estimate
MISFIT = 2.5  # mean squared residual, in noise variances, of a window in which something touched the object
SLOW = 0.15  # [m/s]; slower than this, an object may come to rest within the window
CAUTION = 2.0  # factor on the regression's standard deviations: spinning and light touches are in the windows too


def slowing(tracks: ObservedTracks, name: str, noise: float, seconds_per_frame: float) -> Array:
    """Estimate speed [m/s], deceleration [m/s^2] and its standard deviation (n, 3) of an object.

    From windows of `WINDOW` consecutive samples that a quadratic in time describes. noise [m]: of its positions.
    """
    found = []
    column = tracks.index(name)
    rows = np.flatnonzero(tracks.confidence[:, column] > 0.0)
    for begin in range(0, len(rows) - WINDOW + 1, WINDOW):
        own = rows[begin : begin + WINDOW]
        times = (tracks.frames[own] - tracks.frames[own].mean()) * seconds_per_frame
        design = np.vander(times, 3, increasing=True)
        points = tracks.positions[own, column]
        path, *_ = np.linalg.lstsq(design, points, rcond=None)
        misfit = np.mean(((design @ path - points) / noise) ** 2) * WINDOW / (WINDOW - 3)
        speed = float(np.linalg.norm(path[1]))
        if speed >= SLOW and misfit <= MISFIT:
            sd = 2.0 * noise * np.sqrt(np.linalg.inv(design.T @ design)[2, 2])
            found.append((speed, -2.0 * path[2] @ path[1] / speed, sd))
    return np.reshape(found, (-1, 3))


def started_from_slowing(
    world: World, tracks: ObservedTracks, states: dict[str, InitialState], unknowns: Sequence[Unknown]
) -> list[Unknown]:
    """Set start and width of the unknowns of friction and drag from the regression.

    Planar worlds only, and only where all that moves is rigid: what a rope or a fluid does to an object is no law of
    its speed.
    """
    started = list(unknowns)
    if not world.planar or world.deformables:
        return started
    responses: list[dict[str, float]] = []
    windows: list[Array] = []
    for name in [n for n in states if n in world.moving_names]:
        windows.append(slowing(tracks, name, states[name].noise, world.time.seconds_per_frame))
        responses += [_responses(world, name, float(speed)) for speed in windows[-1][:, 0]]
    if not responses:
        return started
    laws = {path for found in responses for path in found}
    fitted = [i for i, u in enumerate(unknowns) if u.scale == "linear" and laws & set(u.paths)]
    free = {path for i in fitted for path in unknowns[i].paths}
    rows = np.array([[sum(r.get(path, 0.0) for path in unknowns[i].paths) for i in fitted] for r in responses])
    # What the world has and the fit does not vary.
    known = [sum((read_parameter(world, p) or 0.0) * v for p, v in r.items() if p not in free) for r in responses]
    measured = np.concatenate(windows)[:, 1] - np.array(known)
    sd = np.concatenate(windows)[:, 2]
    mean = np.array([unknowns[i].start for i in fitted])
    prior = np.array([unknowns[i].typical for i in fitted])
    covariance = np.linalg.inv((rows / sd[:, None] ** 2).T @ rows + np.diag(prior**-2.0))
    best = covariance @ ((rows / sd[:, None] ** 2).T @ measured + mean / prior**2)
    # What the laws leave unexplained widens the errors.
    misfit = np.sqrt(max(1.0, float(np.mean(((measured - rows @ best) / sd) ** 2))))
    spread = CAUTION * misfit * np.sqrt(np.diag(covariance))
    for i, value, width in zip(fitted, best, spread, strict=True):
        u = unknowns[i]
        started[i] = replace(u, start=float(np.clip(value, u.lower, u.upper)), typical=float(min(width, u.typical)))
    return started


def _responses(world: World, name: str, speed: float) -> dict[str, float]:
    """Parameter path -> deceleration of an object per unit of it at a speed."""
    head = f"objects.{name}"
    plane = world.environment.motion_plane
    normal = np.asarray(plane.normal) / np.linalg.norm(plane.normal)
    # A plane with a coefficient of its own: the pair's is the geometric mean, not linear in the object's.
    own = plane.supports and plane.friction is None
    pressed = max(0.0, -float(normal @ np.asarray(world.environment.gravity))) if own else 0.0
    found = {f"{head}.friction": pressed, f"{head}.linear_damping": speed}
    mass = object_mass(world.object(name))
    for effect in world.effects:
        if not effect.enabled or (effect.objects is not None and name not in effect.objects):
            continue
        drag = f"effects.{effect.name}"
        if effect.kind == "quadratic_damping":
            found[f"{drag}.rate"] = speed**2
        elif effect.kind in ("quadratic_drag", "linear_drag"):
            found[f"{drag}.coefficient"] = (speed**2 if effect.kind == "quadratic_drag" else speed) / mass
    return found
