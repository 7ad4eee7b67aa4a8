"""What may be the same motion as the best hypothesis by another name, and laws that it contains: fitted with care."""

from __future__ import annotations

import numpy as np

from polyworld.estimation import profile
from polyworld.estimation.hypothesis import Hypothesis, extended, without_part
from polyworld.estimation.mending import searched
from polyworld.gap.predicted_gains import identity
from polyworld.gap.search import ALIKE_FIT, MARGIN, ROUGH_ITERATIONS, Search

ALIKE = 0.01  # of the gain promised, within which two effects may be names for the same motion


def fit_twins(search: Search, effects: int) -> None:
    """Fit with care what promised the same as the best hypothesis: it may be the same motion by another name; and
    laws that it contains, from its values."""
    _fit_contained(search, effects)
    best = search.best(effects)
    told = None if best is None else search.promised.get(identity(best.hypothesis))
    if best is None or told is None:
        return
    level, own = told
    if own.chi2 > (1.0 - ALIKE) * level:
        return  # nothing was foretold of it, as of much else
    states = profile.start_states(search.bench.design)
    for key, (before, lead) in list(search.promised.items()):
        known = search.trials.get(key)
        if before != level or abs(lead.chi2 - own.chi2) > ALIKE * (level - own.chi2):
            continue
        if known is None or known.chi2 > best.chi2 + ALIKE_FIT:
            horizons = profile.horizons_for(search.bench.design)
            again = search.bench.fit(lead.hypothesis, lead.values, states, horizons=horizons)
            trial = searched(again, best.ebic + search.settings.credible)
            search.tell("twin", trial.figures())
            search.take(trial)


def _fit_contained(search: Search, effects: int) -> None:
    """Start simpler laws from the best: those whose unknowns, by name and unit, are among those of one effect."""
    best = search.best(effects)
    if best is None:
        return
    base = Hypothesis(search.bench.design.world, best.hypothesis.base)
    for index, part in enumerate(best.hypothesis.parts):
        theirs = {(u.name, u.unit) for u in part.variant.unknowns}
        less = without_part(base, best.hypothesis, index, best.values, search.bench.design.recording)
        if less is None:
            continue
        told = best.hypothesis.of_part(index, best.values)
        for candidate in search.candidates:
            for simpler in extended(less[0], candidate, search.bench.design.recording):
                own = simpler.parts[-1].variant.unknowns
                if {(u.name, u.unit) for u in own} < theirs:
                    values = np.concatenate([less[1], [told[u.name] for u in own]])
                    level = best.chi2 + MARGIN
                    like = simpler.stepped(best.hypothesis.world.time.substep)
                    trial = search.bench.fit(like, values, best.fit.states, iterations=ROUGH_ITERATIONS, target=level)
                    search.tell("contained", trial.figures())
                    search.take(trial)
