"""How probable a member's answer is, given that predictions beyond the last fitted frame are off by more than members.

Members differ by what the data leave open in the parameters of one model, which is not quite right itself
(`polyworld.estimation.accuracy`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atw_mcp.probing.ensembles import Ensemble
from polyworld.estimation.accuracy import travelled, travelled_by_axis, with_model_error
from polyworld.estimation.fit_settings import ModelSettings
from polyworld.probing.margins import state_margin
from polyworld.probing.predicates import AtRest, ComesToRest, Moving, Predicate, names_in
from polyworld.probing.query import QueryResult
from polyworld.trajectory import Rollout
from polyworld.world import geometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PredictionErrorSettings:
    """Errors of predictions, chosen on yes/no questions about rendered clips.

    other: probability that an answer without a margin (contact, order) is as good as chance there. notable: difference
    of a probability from the share of members that is worth a reason: less is not printed.
    """

    other: float = 0.05
    notable: float = 0.01


SETTINGS = PredictionErrorSettings()


def chances(ensemble: Ensemble, members: Sequence[int], results: Sequence[QueryResult], statement: Predicate) -> Array:
    """Return the probability (n,) of a statement in each member, 0 or 1 where it is decided within the fitted frames.

    members: their numbers. results: their answers, all decided.
    With a margin m [m] and an error of half width s, a share of the distance travelled since the last fitted frame, the
    probability is 1/2 + arctan(m / s) / pi (Cauchy). Of speeds and of coming to rest it is the share of
    `paces` at which the statement holds.
    """
    found = np.array([float(bool(result.value)) for result in results])
    for row, (member, result) in enumerate(zip(members, results, strict=True)):
        decided_at = _decided_at(result)
        if decided_at <= ensemble.fitted_until:
            continue
        if isinstance(statement, AtRest | Moving):
            found[row] = _of_speed(ensemble, member, statement, result.covered or (0.0, decided_at))
            continue
        if isinstance(statement, ComesToRest) and result.value and result.covered is not None:
            times = happening(np.array([decided_at]), ensemble.fitted_until)
            found[row] = np.mean((times >= result.covered[0]) & (times <= result.covered[1]))
            continue
        if result.margin is None or result.margin_unit != "m" or (result.margin == 0.0 and result.value):
            found[row] = (1.0 - SETTINGS.other) * found[row] + 0.5 * SETTINGS.other
            continue
        width = ModelSettings().path * distance(
            ensemble.rollouts[member], names_in(statement), ensemble.fitted_until, decided_at
        )
        if width > 0.0:
            found[row] = 0.5 + np.arctan(result.margin / width) / np.pi
    return found


def paces(times: Array, since: float) -> tuple[Array, Array]:
    """Return equally probable factors (P, T) by which the world goes faster than a member after the last fitted frame,
    and when (P, T) a member is where the world is at some times (T,) [s].

    The distance travelled is then off by the share that places are off by: the same error, along the path. A body slows
    down that much later or earlier, and one that came to rest long ago is at rest.
    """
    factors = np.where(times > since, np.exp(with_model_error(np.zeros(1), np.ones(1)))[:, None], 1.0)
    return factors, np.where(times > since, since + (times - since) * factors, times)


def happening(times: Array, since: float) -> Array:
    """Return when (P, T) [s], at equally probable paces, the world does what a member does at some times (T,)."""
    factors, _ = paces(times, since)
    found: Array = np.where(times > since, since + (times - since) / factors, times)
    return found


def speeds(ensemble: Ensemble, member: int, name: str, time: float) -> Array:
    """Return the speed (P,) [m/s] of an object's centre at a time, at equally probable paces."""
    trajectory = ensemble.rollouts[member].trajectory
    factors, at = paces(np.array([time]), ensemble.fitted_until)
    own = trajectory.velocities[:, trajectory.index(name)].T
    read = np.array([np.interp(at[:, 0], trajectory.times, column) for column in own])
    found: Array = factors[:, 0] * np.linalg.norm(read, axis=0)
    return found


def _of_speed(ensemble: Ensemble, member: int, statement: AtRest | Moving, covered: tuple[float, float]) -> float:
    """Return the share of paces at which a statement about a speed holds at some time."""
    trajectory = ensemble.rollouts[member].trajectory
    margin = state_margin(trajectory, ensemble.worlds[member], statement).margin
    inner = (trajectory.times > covered[0]) & (trajectory.times < covered[1])
    grid = np.concatenate([[covered[0]], trajectory.times[inner], [covered[1]]])
    factors, at = paces(grid, ensemble.fitted_until)
    short = margin if isinstance(statement, AtRest) else -margin  # threshold less speed
    short = factors * np.interp(at, trajectory.times, short) + (1.0 - factors) * statement.speed
    holds = short > 0.0 if isinstance(statement, AtRest) else short < 0.0
    return float(holds.any(axis=1).mean())


def distance(rollout: Rollout, names: Sequence[str], start: float, end: float) -> float:
    """Return the root of summed squares of the distances [m] that objects travel between two times [s]."""
    trajectory = rollout.trajectory
    squares = 0.0
    for name in names:
        if name in trajectory.names:
            path = travelled(trajectory.positions[:, trajectory.index(name)])
            squares += float(np.diff(np.interp([start, end], trajectory.times, path))[0]) ** 2
    return float(np.sqrt(squares))


def travelled_since(ensemble: Ensemble, member: int, name: str, times: Array) -> Array:
    """Return the distances (T, 3) [m] with which errors of an object's places go by axis, from the last fitted frame to
    each of some times; 0 before it."""
    world, trajectory = ensemble.worlds[member], ensemble.rollouts[member].trajectory
    normal = geometry.plane_axes(world.environment.motion_plane)[2] if world.planar else None
    turning = next((j for j in world.joints if j.kind == "hinge" and j.object == name and j.other is None), None)
    if turning is not None:  # it goes around the axis
        normal = np.asarray(turning.axis) / np.linalg.norm(turning.axis)
    path = travelled_by_axis(trajectory.positions[:, trajectory.index(name)], normal)
    at = np.stack([np.maximum(times, ensemble.fitted_until), np.full(len(times), ensemble.fitted_until)])
    read = np.stack([np.interp(at, trajectory.times, path[:, axis]) for axis in range(3)], axis=-1)
    found: Array = read[0] - read[1]
    return found


def _decided_at(result: QueryResult) -> float:
    """Return when an answer is decided [s]: at its margin, else its first interval, else the end of what is asked."""
    if result.margin_at is not None and np.isfinite(result.margin_at):
        return result.margin_at
    if result.value and result.intervals:
        return result.intervals[0][0]
    return result.covered[1] if result.covered is not None else np.inf
