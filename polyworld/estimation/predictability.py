"""Estimate how long a run can be predicted from its start: bodies that swing on each other soon forget it.

What two starts that hardly differ come to differ by grows exponentially there, so that a fit of a whole run has a
minimum for every few turns, and valleys too narrow and bent to follow (Baake et al. 1992, Phys. Rev. A 45, 5524, whose
remedy is multiple shooting; here without its conditions of continuity).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import Design, design
from polyworld.estimation.forward import Forward, Settings
from polyworld.world import World

Array = NDArray[np.float64]

SMALL = 1e-6  # of an ordinary change of a start
AROUND = 0.2  # ordinary changes, by which the first samples may mislead
GROWN = 4.0  # times the extent of the motion, that an ordinary change would come to if it grew on as a small one does


def swings_on_others(world: World) -> bool:
    """Return whether bodies turn or slide on each other, as those of a double pendulum."""
    return any(j.other is not None and j.kind not in ("spring", "fixed") for j in world.joints)


def predictable_instants(world: World, run: Run, extent: float) -> int:
    """Count the instants of a run over which a small change of its initial state stays small, by the motion's
    `extent`.

    Looked at from the start that the first samples suggest and from others around it, of which the least is taken.
    """
    plan = design(world, Recording((run,)))
    own = plan.runs[0]
    n = own.count
    if not n:
        return len(run.times)
    about = AROUND * np.diag(own.typical)
    starts = own.start + np.concatenate([np.zeros((1, n)), about, -about])
    changes = np.concatenate([np.zeros((1, n)), SMALL * np.diag(own.typical)])
    states = (starts[:, None] + changes).reshape(-1, n)
    (moved,) = Forward(plan, world, ()).residuals([Settings(0, np.zeros((len(states), 0)), states)])
    moved = moved.reshape(len(starts), 1 + n, -1)
    grown = np.sqrt(_by_instant(plan, ((moved[:, 1:] - moved[:, :1]) / SMALL) ** 2))
    beyond = np.flatnonzero(~np.all(grown <= GROWN * extent, axis=0))
    return int(beyond[0]) if len(beyond) else len(run.times)


def extent_of(run: Run) -> float:
    """Return how far a run's positions spread [m]; a radian where none was measured."""
    seen = run.positions.reshape(len(run.times), -1)
    seen = seen[:, np.isfinite(seen).any(axis=0)]
    return float(np.sqrt(np.nanvar(seen, axis=0).sum())) if seen.shape[1] else 1.0


def _by_instant(plan: Design, squares: Array) -> Array:
    """Return sums (K, T) of squares (K, N, m) of all starts' coordinates and all positions at each instant; of
    rotations where no positions were measured."""
    total = np.zeros((len(squares), len(plan.runs[0].times)))
    kind = "position" if any(s.kind == "position" for s in plan.series) else "rotation"
    for series in plan.series:
        if series.kind == kind:
            total[:, series.rows] += squares[:, :, series.where].sum(axis=1)
    return total
