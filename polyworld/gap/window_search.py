"""The search for one more effect on windows of the runs, where a model that lacks something stays near the data."""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from polyworld.estimation import profile
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.mending import mended, searched
from polyworld.estimation.profiled import ILL, profiled
from polyworld.estimation.score_test import ScoreTestStart, leads
from polyworld.estimation.trial import FittedHypothesis, Start
from polyworld.gap.predicted_gains import identity, in_turn, labels, shares
from polyworld.gap.strength_map import mapped
from polyworld.gap.windows import Windows
from polyworld.gap.zoom import closer

ITERATIONS = 3  # of every contender, and once more of those worth it
HOPELESS = 0.5  # share of the leader's gain below which a contender is left after its first iterations
LITTLE = 0.1  # share of what a fit lacks, beyond the noise, below which there is hardly more to gain
FAILED = 2.0  # chi2 per measurement, at a fit that has converged, that no better start mends
SETTLED = 1.05  # chi2 per measurement above which effects with a place are looked for in closer places
FEW_LOST = 1.0 / 16.0  # share of the windows that may be such as nothing explains
CLOSER, TRIED = 6, 4  # iterations from each of so many of these
SEEN = 12  # starts of an effect at contacts at which chi2 is looked at
BESIDE = 10.0  # EBIC behind the best within which a contender is kept, however little there is to gain
FEW = 3  # contenders that are fitted on, however little they gain
ONWARD = 0.01  # of chi2 that a fit has to gain to be thought under way


@dataclass
class WindowSearch:
    """Hypotheses ranked and fitted on windows. starts: of each that are tried. tell: the figures of every step.

    trials: the last of each hypothesis. settled: chi2 per measurement of the best with so many effects, where it was
    fitted to the end.
    """

    cut: Windows
    starts: int
    tell: Callable[[str, dict[str, Any]], None]
    trials: dict[tuple[str, ...], FittedHypothesis] = field(default_factory=dict)
    settled: dict[int, float] = field(default_factory=dict)
    _led: dict[tuple[str, ...], list[tuple[FittedHypothesis, ScoreTestStart]]] = field(default_factory=dict)

    def leads(
        self, parent: FittedHypothesis, more: Callable[[FittedHypothesis], list[Hypothesis]]
    ) -> list[tuple[FittedHypothesis, ScoreTestStart]]:
        """What the hypotheses that one more effect makes of a parent promise, and the parent fitted to the windows;
        best first, none where it cannot be."""
        key = identity(parent.hypothesis)
        if not self.cut.holds(parent.hypothesis):
            return []
        if key not in self._led:
            if key not in self.trials:
                self.trials[key] = self.cut.ground(parent.hypothesis, parent.values)
            ground = self.trials[key]
            held = [h for h in more(ground) if self.cut.holds(h)]
            found = leads(self.cut.bench, ground, [h for h in held if not _at_contacts(h)], self.starts)
            for hypothesis in held:
                if _at_contacts(hypothesis):  # no slope tells of a wall that the path has not come to
                    seen = [self.cut.seen(ground, x) for x in leads(self.cut.bench, ground, [hypothesis], SEEN)]
                    found += sorted(seen, key=lambda lead: lead.chi2)[: self.starts]
            self._led[key] = [(ground, lead) for lead in sorted(found, key=lambda lead: lead.chi2)]
        return self._led[key]

    def fitted(
        self, found: Sequence[tuple[FittedHypothesis, ScoreTestStart]], most: int, known: Collection[tuple[str, ...]]
    ) -> list[FittedHypothesis]:
        """At most so many of the hypotheses that were found, fitted; those worth fitting to whole runs, best first.

        known: hypotheses that whole runs were fitted with already, which are left out.
        """
        before = min(ground.chi2 for ground, _ in found)
        promises = sorted(shares(found, before, self.cut.bench.observations), key=lambda p: -p.share)
        ways: dict[tuple[str, ...], list[tuple[FittedHypothesis, ScoreTestStart]]] = {}
        for p in in_turn(promises):
            ways.setdefault(identity(p.lead.hypothesis), []).append((p.parent, p.lead))
        share = {identity(p.lead.hypothesis): p.share for p in reversed(promises)}
        fits: list[FittedHypothesis] = []
        rest = [key for key in ways if key not in known]
        unforeseen = [key for key in rest[most:] if _unforeseen(ways[key][0][1].hypothesis)]
        for key in (*rest[:most], *unforeseen):
            if share[key] >= HOPELESS or not any(_nearly_all(t, before) for t in fits):
                foretold = max(min(lead.chi2 for _, lead in ways[key]), self.cut.bench.observations)
                trial = self._first_fit(*self.cut.nearest(ways[key]), foretold + LITTLE * (before - foretold))
                leads_so_far = all(trial.chi2 < t.chi2 for t in fits)
                fits.append(mended(trial) if leads_so_far else trial)
        for i, trial in enumerate(fits):
            if any(_explains(t) for t in fits):
                break
            asked = self._where_asked(trial, ways[identity(trial.hypothesis)])
            fits[i] = asked if asked is trial else mended(asked)
        wanted = [mended(self.cut.bench.refit(t, iterations=ITERATIONS)) for t in _worth_more(fits, before)]
        if not _settled(wanted):
            for i, trial in enumerate(wanted):
                wanted[i] = self._closer(trial, ways[identity(trial.hypothesis)])
                if _explains(wanted[i]):
                    break  # whole runs decide between it and what is hardly behind
        for trial in (*fits, *wanted):
            self._keep(trial)
        ranked = _worth_more(wanted, before)
        return self._to_the_end(ranked) if ranked else []

    def _first_fit(self, hypothesis: Hypothesis, at: Start, hoped: float) -> FittedHypothesis:
        """First iterations of a contender. Where bodies collide, and it does not come to the chi2 hoped for, states
        bent to a law that lacked something may lie behind other collisions than the right ones: it is fitted from the
        data's own too, a little more at a time."""
        bench = self.cut.bench
        trial = bench.fit(hypothesis, at.values, at.states, iterations=ITERATIONS)
        if not profile.collide(bench.design) or _explains(trial) or trial.chi2 < hoped:
            return trial
        begun, horizons = profile.start_states(bench.design), profile.horizons_for(bench.design)
        other = bench.fit(hypothesis, at.values, begun, horizons=horizons, iterations=ITERATIONS)
        return min([trial, other], key=lambda t: t.chi2)

    def _where_asked(
        self, trial: FittedHypothesis, ways: Sequence[tuple[FittedHypothesis, ScoreTestStart]]
    ) -> FittedHypothesis:
        """A trial, or a better one from where windows ask for its effect, if that has an edge; or from other strengths,
        if slopes at the present one tell little of these."""
        if _unforeseen(trial.hypothesis):
            return self._from_other_strengths(trial, ways)
        edged = [(p, x.hypothesis) for p, x in ways if x.hypothesis.parts[-1].variant.everywhere is not None]
        if not edged:
            return trial
        ground, hypothesis = edged[0]
        return self._best_of(trial, ground, mapped(ground, hypothesis))

    def _from_other_strengths(
        self, trial: FittedHypothesis, ways: Sequence[tuple[FittedHypothesis, ScoreTestStart]]
    ) -> FittedHypothesis:
        """The best of a trial and of fits that begin at other strengths of its effect, with the data's own states: the
        parent's are bent to a law that does otherwise."""
        bench = self.cut.bench
        begun, horizons = profile.start_states(bench.design), profile.horizons_for(bench.design)
        for _, lead in ways:
            if lead.before is not None and not _explains(trial):
                tried = bench.fit(lead.hypothesis, lead.before, begun, horizons=horizons, iterations=ITERATIONS)
                trial = min([trial, mended(tried)], key=lambda t: t.chi2)
        return trial

    def _closer(
        self, trial: FittedHypothesis, ways: Sequence[tuple[FittedHypothesis, ScoreTestStart]]
    ) -> FittedHypothesis:
        """A trial, or a better one from closer starts where the effect has a place or a rhythm."""
        if not trial.hypothesis.parts[-1].variant.idle:
            return trial
        same = [(p, lead) for p, lead in ways if labels(lead.hypothesis) == labels(trial.hypothesis)]
        ground = same[0][0]
        own = [lead for parent, lead in same if parent is ground]
        return self._best_of(trial, ground, closer(self.cut.bench, ground, trial.hypothesis, own)[:TRIED])

    def _best_of(
        self, trial: FittedHypothesis, ground: FittedHypothesis, found: Sequence[ScoreTestStart]
    ) -> FittedHypothesis:
        """The best of a trial and of fits from some leads, up to the first that explains the windows."""
        bench = self.cut.bench
        for x in found:
            tried = mended(bench.fit(x.hypothesis, x.values, ground.fit.states, iterations=CLOSER))
            trial = min([trial, tried], key=lambda t: t.chi2)
            if _explains(trial):
                break
        return trial

    def hopeless(self, effects: int) -> bool:
        """Whether so many effects do not even explain windows, with the best of them fitted to the end there."""
        return self.settled.get(effects, 0.0) > FAILED

    def _to_the_end(self, ranked: Sequence[FittedHypothesis]) -> list[FittedHypothesis]:
        """The best fitted on; where it fails, also those behind it, which may only be slower."""
        done: list[FittedHypothesis] = []
        settled = True
        for trial in ranked:
            level = min((t.chi2 for t in done), default=np.inf) / self.cut.bench.observations
            if level < FAILED or len(done) == FEW:
                break
            onward = searched(self.cut.bench.refit(trial))
            onward = onward if _explains(onward) else profiled(onward)
            settled = settled and (onward.fit.converged or onward.chi2 > (1.0 - ONWARD) * trial.chi2)
            self._keep(onward)
            done.append(onward)
        best = min(done, key=lambda t: t.ebic)
        if settled:
            self.settled[len(best.hypothesis.parts)] = best.chi2 / self.cut.bench.observations
        return sorted([*done, *ranked[len(done) :]], key=lambda t: t.ebic)

    def _keep(self, trial: FittedHypothesis) -> None:
        self.trials[identity(trial.hypothesis)] = trial
        self.tell("windows", trial.figures())


def _settled(trials: Sequence[FittedHypothesis]) -> bool:
    """Whether nothing is left for closer places to explain: the best leaves hardly more than noise; or has no place,
    and leaves no more where any of them explains a window, which is nearly everywhere."""
    if not trials:
        return False
    best = min(trials, key=lambda t: t.chi2)
    counts = best.bench.counts
    known = np.min([t.misfits for t in trials], axis=0) < ILL
    if best.hypothesis.parts[-1].variant.idle or np.sum(~known) > FEW_LOST * len(known):
        known[:] = True
    return bool(best.costs[known].sum() <= SETTLED * counts[known].sum())


def _at_contacts(hypothesis: Hypothesis) -> bool:
    """Whether the last effect acts where bodies touch: what stands in the way, another law of contact, or friction."""
    candidate = hypothesis.parts[-1].candidate
    return candidate.group in ("structure", "contact") or candidate.name == "friction_error"


def _unforeseen(hypothesis: Hypothesis) -> bool:
    """Whether no slope tells what the last effect would do, nor chi2 before all initial states have followed: it cannot
    be switched off, or what it does ends where bodies grip."""
    part = hypothesis.parts[-1]
    jumps = part.variant.strength is None and len(part.variant.starts) > 1
    return _at_contacts(hypothesis) and (jumps or part.candidate.further is not None)


def _worth_more(trials: Sequence[FittedHypothesis], before: float) -> list[FittedHypothesis]:
    """Of some trials all that gain at least a share of what the best of them does, or are hardly behind it, and the
    best few, unless one gains nearly all there is; best first."""
    ranked = sorted(trials, key=lambda t: t.ebic)
    few = 1 if any(_nearly_all(t, before) for t in ranked) else FEW
    return [
        t
        for i, t in enumerate(ranked)
        if i < few or before - t.ebic >= HOPELESS * (before - ranked[0].ebic) or t.ebic <= ranked[0].ebic + BESIDE
    ]


def _explains(trial: FittedHypothesis) -> bool:
    """Whether a trial leaves no more than noise would, but for twice how much that varies."""
    noise = trial.bench.observations
    return trial.chi2 < noise + 2.0 * float(np.sqrt(2.0 * noise))


def _nearly_all(trial: FittedHypothesis, before: float) -> bool:
    """Whether a trial gains nearly all that there is to gain on a fit with chi2 `before`."""
    noise = trial.bench.observations
    return trial.chi2 - noise < LITTLE * (before - noise)
