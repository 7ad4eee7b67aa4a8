"""Simpler effects in the place of one among several that together explain the data.

A rich law beside another passes for a simple one: a centre of force far away for a tilt, wind for drag. Where the
simple one came far behind by itself, nothing has been tried on top of it.
"""

from __future__ import annotations

from polyworld.estimation.hypothesis import Hypothesis, extended, without_part
from polyworld.estimation.score_test import leads
from polyworld.estimation.trial import Start
from polyworld.gap.predicted_gains import identity
from polyworld.gap.search import MARGIN, ROUGH_ITERATIONS, Search

MOST = 3  # that are fitted in the place of each effect


def put_simpler(search: Search, effects: int) -> None:
    """Where the best of several effects passes the gate: fit, in the place of each, effects with fewer unknowns.

    The score test foretells them from the best's own initial states, with the effect left out.
    """
    best = search.best(effects)
    if best is None or effects < 2 or not best.passes:
        return
    recording = search.bench.design.recording
    base = Hypothesis(search.bench.design.world, best.hypothesis.base)
    for index, part in enumerate(best.hypothesis.parts):
        less = without_part(base, best.hypothesis, index, best.values, recording)
        if less is None:
            continue
        without = less[0].stepped(best.hypothesis.world.time.substep)
        ways = [h for candidate in search.candidates for h in extended(without, candidate, recording)]
        fewer = [h for h in ways if len(h.parts[-1].variant.unknowns) < len(part.variant.unknowns)]
        near = {key for key, t in search.trials.items() if t.ebic <= best.ebic + search.settings.credible}
        fewer = [h for h in fewer if identity(h) not in near]
        if not fewer:
            continue
        off = search.bench.fit(without, less[1], best.fit.states, iterations=0)
        for lead in leads(search.bench, off, fewer, 1)[:MOST]:
            starts = [Start(lead.values, best.fit.states)]
            if lead.states is not None:
                starts.append(Start(lead.values, lead.states))
            start = search.bench.nearest(lead.hypothesis, starts)
            trial = search.bench.fit(
                lead.hypothesis, start.values, start.states, iterations=ROUGH_ITERATIONS, target=best.chi2 + MARGIN
            )
            search.tell("simpler", trial.figures())
            search.take(trial)
