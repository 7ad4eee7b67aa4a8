"""What seemed far behind the best on whole runs, and was not elsewhere: a fit that went astray is no evidence."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.mending import begun, mended, refused, searched
from polyworld.estimation.profiled import touchy
from polyworld.estimation.trial import FittedHypothesis
from polyworld.gap.predicted_gains import identity
from polyworld.gap.search import CLOSE, Search
from polyworld.gap.window_search import WindowSearch

Array = NDArray[np.float64]

SCARCE = 2000.0  # measurements below which all that was offered is fitted beside the best
MANY = 40  # of these at most
BEHIND = 50.0  # chi2 by which all windows may be behind the best's


def fit_rivals(search: Search, effects: int) -> None:
    """Fit from the best's initial states what windows hardly tell from it, and whole runs seemed to."""
    best = search.best(effects)
    if best is None or search.on_windows is None:
        return
    alike = [t for t in search.on_windows.trials.values() if len(t.hypothesis.parts) == effects]
    level = min((t.ebic for t in alike), default=np.inf)
    asked = [(t.hypothesis, t.values) for t in alike if t.ebic <= level + CLOSE]
    if search.bench.observations < SCARCE:  # so few data tell little, and slopes at a wrong fit foretell even less
        others = sorted((lead for _, lead in search.promised.values()), key=lambda lead: lead.chi2)
        there = {identity(h) for h, _ in asked}
        named = [x for x in others if len(x.hypothesis.parts) == effects and identity(x.hypothesis) not in there]
        asked += [(x.hypothesis, x.values) for x in named[:MANY]]
    coupled = profile.collide(search.bench.design) and not touchy(search.bench.design)
    horizons = profile.FINE_HORIZONS if coupled else (1.0,)
    for hypothesis, values in asked:
        known = search.trials.get(identity(hypothesis))
        if known is not None and known.ebic <= best.ebic + search.settings.credible:
            continue
        if identity(hypothesis) in search.run_by_run:
            continue  # every run was looked for
        again = best.bench.fit(hypothesis, values, best.fit.states, horizons=horizons)
        if not touchy(search.bench.design):
            again = searched(again, best.ebic + search.settings.credible)
        elif not (refused(again, best) or _refused_by_windows(search.on_windows, best, hypothesis, values)):
            starts = [best.fit.states, profile.start_states(search.bench.design)]
            again = searched(begun(best.bench, hypothesis, values, starts))
        search.tell("rival", again.figures())
        search.take(again)


def _refused_by_windows(search: WindowSearch, best: FittedHypothesis, hypothesis: Hypothesis, values: Array) -> bool:
    """Whether a hypothesis is far behind the best on windows too, where fewer collisions lead astray: then no run that
    is lost is what speaks against it."""
    told = search.trials.get(identity(best.hypothesis))
    if told is None or not search.cut.holds(hypothesis):
        return False
    own = search.trials.get(identity(hypothesis))
    own = own or mended(search.cut.bench.fit(hypothesis, values, told.fit.states))
    return own.chi2 > told.chi2 + BEHIND
