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
from polyworld.estimation.accuracy import travelled, travelled_by_axis
from polyworld.estimation.fit_settings import ModelSettings
from polyworld.probing.query import QueryResult
from polyworld.trajectory import Rollout
from polyworld.world import geometry

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PredictionErrorSettings:
    """Errors of predictions, chosen on questions of `tests.benchmarks.foresight` about clips of seeds 101 and 103.

    other: probability that an answer without a margin (contact, order) is as good as chance there. notable: difference
    of a probability from the share of members that is worth a reason: less is not printed.
    """

    other: float = 0.05
    notable: float = 0.01


SETTINGS = PredictionErrorSettings()


def chances(ensemble: Ensemble, members: Sequence[int], results: Sequence[QueryResult], names: Sequence[str]) -> Array:
    """Return the probability (n,) of a statement in each member, 0 or 1 where it is decided within the fitted frames.

    members: their numbers. results: their answers, all decided. names: of the objects that the statement is about.
    With a margin m and an error of half width s the probability is 1/2 + arctan(m / s) / pi (Cauchy): a share of the
    distance travelled since the last fitted frame for a margin [m], of the mean speed since then for one [m/s].
    """
    found = np.array([float(bool(result.value)) for result in results])
    for row, (member, result) in enumerate(zip(members, results, strict=True)):
        decided_at = _decided_at(result)
        if decided_at <= ensemble.fitted_until:
            continue
        fast = result.margin_unit == "m/s"
        if result.margin is None or not (fast or result.margin_unit == "m") or (result.margin == 0.0 and result.value):
            found[row] = (1.0 - SETTINGS.other) * found[row] + 0.5 * SETTINGS.other
            continue
        rollout = ensemble.rollouts[member]
        width = ModelSettings().path * distance(rollout, names, ensemble.fitted_until, decided_at)
        if fast:
            width /= min(decided_at, float(rollout.trajectory.times[-1])) - ensemble.fitted_until
        if width > 0.0:
            found[row] = 0.5 + np.arctan(result.margin / width) / np.pi
    return found


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
