"""Compute what the data allow of a rollout: quantiles of coordinates over the members of an ensemble of its world."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from atw_mcp.probing.ensembles import KIND, members_of
from atw_mcp.viewer.document import Spread
from atw_mcp.viewer.packing import Blocks
from evidence_store import EvidenceStore

QUANTILES = (0.05, 0.95)
MOST = 500  # moments: one for every second pixel of a plot


def spread_view(store: EvidenceStore, world: str, names: Sequence[str], blocks: Blocks) -> Spread | None:
    """Return the spread of the ensemble of a world that was rolled out last; None where there is none.

    names: objects, in the order of the rollout's columns. Raises the errors of the store for one that is damaged.
    """
    content = store.rollouts.latest(KIND, "world", world)
    if content is None:
        return None
    runs = [member.trajectory for member in members_of(content)]
    times = max((run.times for run in runs), key=len)
    rows = np.unique(np.linspace(0, len(times) - 1, min(len(times), MOST)).astype(np.int64))
    places = np.full((len(runs), len(rows), len(names), 3), np.nan)
    for own, run in zip(places, runs, strict=True):
        within = rows[rows < len(run.times)]  # of one that ended early, what there is
        columns = [run.names.index(name) for name in names]
        there = run.active[within][:, columns, None].astype(bool)
        own[: len(within)] = np.where(there, run.positions[within][:, columns], np.nan)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # where no member has the object, the quantiles are NaN
        low, high = np.nanquantile(places, QUANTILES, axis=0)
    return Spread(members=len(runs), times=blocks.floats(times[rows]), low=blocks.floats(low), high=blocks.floats(high))
