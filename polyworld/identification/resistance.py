"""Where a fit begins for friction and drag: the deceleration of free motion, regressed on the laws that slow it.

Between contacts an object that slides on the plane slows down by mu g + c v + k v^2, with v its speed. Short
windows of a track give deceleration and speed with their errors; a linear regression with the parameters' own
opening (mean, sd) as prior gives better ones. It chooses a beginning, not a result: the fit decides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.identification.free_parameters import FitParameter
from polyworld.initial_states import InitialState
from polyworld.parameters import object_mass, read_parameter
from polyworld.tracks import ObservedTracks
from polyworld.world import World

Array = NDArray[np.float64]

WINDOW = 9  # samples of one estimate
MISFIT = 2.5  # mean squared residual, in noise variances, of a window in which something touched the object
SLOW = 0.15  # [m/s]; slower than this, an object may come to rest within the window
CAUTION = 2.0  # factor on the regression's standard deviations: spinning and light touches are in the windows too


@dataclass(frozen=True)
class Slowing:
    """One estimate: an object's speed [m/s] and deceleration [m/s^2] with its standard deviation."""

    name: str
    speed: float
    deceleration: float
    sd: float


def slowing(tracks: ObservedTracks, states: dict[str, InitialState], seconds_per_frame: float) -> list[Slowing]:
    """Decelerations in windows of `WINDOW` consecutive samples that a quadratic in time describes."""
    found: list[Slowing] = []
    for name, state in states.items():
        column = tracks.index(name)
        rows = np.flatnonzero(tracks.confidence[:, column] > 0.0)
        for begin in range(0, len(rows) - WINDOW + 1, WINDOW):
            own = rows[begin : begin + WINDOW]
            times = (tracks.frames[own] - tracks.frames[own].mean()) * seconds_per_frame
            design = np.vander(times, 3, increasing=True)
            points = tracks.positions[own, column]
            path, *_ = np.linalg.lstsq(design, points, rcond=None)
            residual = (design @ path - points) / state.noise
            speed = float(np.linalg.norm(path[1]))
            if speed < SLOW or np.mean(residual**2) * WINDOW / (WINDOW - 3) > MISFIT:
                continue
            sd = 2.0 * state.noise * float(np.sqrt(np.linalg.inv(design.T @ design)[2, 2]))
            found.append(Slowing(name, speed, float(-2.0 * path[2] @ path[1] / speed), sd))
    return found


def begun_from_slowing(
    world: World, tracks: ObservedTracks, states: dict[str, InitialState], parameters: Sequence[FitParameter]
) -> list[FitParameter]:
    """The parameters, those of friction and drag with mean and sd from the regression. Planar worlds only, and only
    where all that moves is rigid: what a rope or a fluid does to an object is no law of its speed."""
    if not world.planar or world.deformables:
        return list(parameters)
    estimates = slowing(tracks, states, world.time.seconds_per_frame)
    fitted = [i for i, p in enumerate(parameters) if p.scale == "linear" and any(_slows(world, q) for q in p.paths)]
    if not estimates or not fitted:
        return list(parameters)
    rows = np.array([[_response(world, parameters[i].paths, e) for i in fitted] for e in estimates])
    free = {path for i in fitted for path in parameters[i].paths}
    known = np.array([_fixed(world, free, e) for e in estimates])
    measured = np.array([e.deceleration for e in estimates]) - known
    sd = np.array([e.sd for e in estimates])
    mean = np.array([parameters[i].mean for i in fitted])
    prior = np.array([parameters[i].sd for i in fitted])
    information = (rows / sd[:, None] ** 2).T @ rows + np.diag(prior**-2.0)
    covariance = np.linalg.inv(information)
    best = covariance @ ((rows / sd[:, None] ** 2).T @ measured + mean / prior**2)
    # What the laws leave unexplained widens the errors.
    misfit = np.sqrt(max(1.0, float(np.mean(((measured - rows @ best) / sd) ** 2))))
    spread = CAUTION * misfit * np.sqrt(np.diag(covariance))
    begun = list(parameters)
    for i, value, width in zip(fitted, best, spread, strict=True):
        p = parameters[i]
        begun[i] = replace(p, mean=float(np.clip(value, p.lower, p.upper)), sd=float(min(width, p.sd)))
    return begun


def _slows(world: World, path: str) -> bool:
    parts = path.split(".")
    if parts[0] == "objects":
        return parts[2] in ("friction", "linear_damping")
    if parts[0] == "effects":
        kind = next(e.kind for e in world.effects if e.name == parts[1])
        return kind in ("quadratic_damping", "quadratic_drag", "linear_drag")
    return False


def _response(world: World, paths: tuple[str, ...], estimate: Slowing) -> float:
    """Deceleration per unit of a parameter at the estimate's speed."""
    return sum(_law(world, path, estimate) for path in paths)


def _law(world: World, path: str, estimate: Slowing) -> float:
    parts = path.split(".")
    if parts[0] == "objects":
        if parts[1] != estimate.name:
            return 0.0
        if parts[2] == "friction":
            plane = world.environment.motion_plane
            normal = np.asarray(plane.normal) / np.linalg.norm(plane.normal)
            # A plane with a coefficient of its own: the pair's is the geometric mean, not linear in the object's.
            own = plane.supports and plane.friction is None
            return max(0.0, -float(normal @ np.asarray(world.environment.gravity))) if own else 0.0
        return estimate.speed if parts[2] == "linear_damping" else 0.0
    effect = next(e for e in world.effects if e.name == parts[1])
    if not effect.enabled or (effect.objects is not None and estimate.name not in effect.objects):
        return 0.0
    mass = object_mass(world.object(estimate.name))
    return {
        "quadratic_damping": estimate.speed**2,
        "quadratic_drag": estimate.speed**2 / mass,
        "linear_drag": estimate.speed / mass,
    }.get(effect.kind, 0.0)


def _fixed(world: World, free: set[str], estimate: Slowing) -> float:
    """Deceleration by what the world has and the fit does not vary."""
    paths = [f"objects.{estimate.name}.{field}" for field in ("friction", "linear_damping")]
    for effect in world.effects:
        if effect.kind in ("quadratic_damping", "quadratic_drag", "linear_drag"):
            key = "rate" if effect.kind == "quadratic_damping" else "coefficient"
            paths.append(f"effects.{effect.name}.{key}")
    return sum((read_parameter(world, p) or 0.0) * _law(world, p, estimate) for p in paths if p not in free)
