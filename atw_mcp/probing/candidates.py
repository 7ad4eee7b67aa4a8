"""Several candidate worlds of a case as one ensemble, weighted by how well each predicted what its fit left out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from numpy.typing import NDArray

from atw_mcp.calls.app import App
from atw_mcp.fitting.verdict import predicted_errors, verdict_of
from atw_mcp.probing.ensembles import Ensemble, lineage
from evidence_store import Case
from polyworld.world import World

Array = NDArray[np.float64]


def weights(app: App, case: Case, worlds: Sequence[World]) -> Array:
    """Return the weight (n,) of each world, in sum 1, from its errors on the frames left out of its fit.

    The stretch that was left out is one observation of each body, a place in two or three coordinates d whose errors
    have an unknown scale (Jeffreys prior), so that the likelihood of an error e beside noise s goes as
    (e^2 + s^2)^(-d/2). Bodies that not every world predicts are not compared. Raises ToolError where none is left.
    """
    if len(worlds) == 1:
        return np.ones(1)
    verdicts = [verdict_of(app, lineage(app, case, world).fitted) for world in worlds]
    rows = [{} if verdict is None else predicted_errors(verdict["bodies"]) for verdict in verdicts]
    for world, own in zip(worlds, rows, strict=True):
        if not own:
            raise ToolError(
                f"{world.id} cannot be weighed: its fit left no frames out, or is not kept. Next: "
                f"FitWorld(case={case.id!r}, world=...) with enough frames, or Ask of one world at a time"
            )
    common = sorted(set.intersection(*(set(own) for own in rows)))
    if not common:
        raise ToolError(
            f"no body is predicted by all of {', '.join(world.id for world in worlds)}: Ask of one world at a time"
        )
    components = [2 if world.planar else 3 for world in worlds]
    scores = np.array([sum(-min(components) * np.log(own[name]) for name in common) for own in rows])
    found: Array = np.exp(scores - scores.max())
    found /= found.sum()
    return found


def counts(shares: Array, total: int) -> list[int]:
    """Return how many of `total` members each share gets, by largest remainders; the sum is `total`."""
    wanted = shares * total
    found = np.floor(wanted).astype(int)
    for k in np.argsort(found - wanted, kind="stable")[: total - int(found.sum())]:
        found[k] += 1
    return [int(n) for n in found]


def mixture(ensembles: Sequence[Ensemble], shares: Sequence[float], sizes: Sequence[int]) -> Ensemble:
    """Return the first members of several ensembles, `sizes` of each, as one, with the parameters that all have."""
    if len(ensembles) == 1:
        return ensembles[0]
    common = [name for name in ensembles[0].parameters if all(name in e.parameters for e in ensembles)]
    total = sum(shares)
    return Ensemble(
        worlds=tuple(world for e, n in zip(ensembles, sizes, strict=True) for world in e.worlds[:n]),
        rollouts=tuple(rollout for e, n in zip(ensembles, sizes, strict=True) for rollout in e.rollouts[:n]),
        parameters={
            name: np.concatenate([e.parameters[name][:n] for e, n in zip(ensembles, sizes, strict=True)])
            for name in common
        },
        units={name: ensembles[0].units[name] for name in common},
        wrong=sum(share * e.wrong for share, e in zip(shares, ensembles, strict=True)) / total,
        why=max(ensembles, key=lambda e: e.wrong).why,
        fitted_until=min(e.fitted_until for e in ensembles),
    )
