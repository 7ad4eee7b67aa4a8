"""One coordinate of one run: along it, time, place and speed are functions of each other.

A law of one of them can then be written as a law of another, and a law with a place or a rhythm of its own fits what
several plain ones leave together. How much better the data like one form than another says little there; so more of
those that explain the data stand side by side, pairs of plain effects among them.
"""

from __future__ import annotations

from polyworld.estimation import profile
from polyworld.estimation.design import Design
from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.hypothesis import extended
from polyworld.gap import ebic
from polyworld.gap.search import Search

SINGLE = 1  # unknowns of an effect that is tried as one of two


def is_single_coordinate(plan: Design) -> bool:
    """Return whether nothing but one coordinate of one run was measured, be it in parts."""
    return len({(plan.runs[s.run].run.part_of or s.run, s.name, s.kind, s.axis) for s in plan.series}) == 1


def competitors(search: Search, ground: FittedHypothesis, best: FittedHypothesis) -> list[FittedHypothesis]:
    """Return pairs of plain effects with no more unknowns than a single effect has, fitted under its noise."""
    recording = best.context.design.recording
    if len(best.hypothesis.parts) != 1 or best.hypothesis.extra < 2 * SINGLE:
        return []
    horizons = profile.horizons_for(best.context.design)
    states, iterations = profile.start_states(best.context.design), search.settings.care // 3

    def plain(onto: FittedHypothesis) -> list[FittedHypothesis]:
        return [
            best.context.fit(way, way.starts(onto.values)[0], states, horizons=horizons, iterations=iterations)
            for candidate in search.candidates
            for way in extended(onto.hypothesis, candidate, recording)
            if way.extra == onto.hypothesis.extra + SINGLE
        ]

    firsts = ebic.ranked_by_title(plain(ground))[: search.settings.firsts]
    for pair in (p for first in firsts for p in plain(first)):
        search.whole.take(best.context.refit(pair))
    return [t for t in search.ranked(2) if t.hypothesis.extra <= best.hypothesis.extra]
