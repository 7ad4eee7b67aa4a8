"""Search over hypotheses by moves: add an effect, swap one, drop one, simplify one, perturb; one rule accepts.

Every move proposes hypotheses with starts; each is fitted to whole runs, and the best fit of each hypothesis is kept.
Hypotheses with equally many effects are ranked by their extended BIC; the fewest effects that explain the data win.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.candidate import Candidate
from polyworld.estimation.fit_context import FINEST, FitContext, FittedHypothesis, Start, refined
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.refitting import (
    fit_near,
    refit_ill_runs,
    refused_by_most,
    restarted,
)
from polyworld.estimation.score_test import score_test_starts
from polyworld.estimation.variable_projection import profiled, sensitive
from polyworld.gap import ebic
from polyworld.gap.contest import Contest, ReportStep, identity
from polyworld.gap.moves import Move, distinct, moves, reduced
from polyworld.gap.segment_context import segment_context
from polyworld.gap.sensitive_runs import sensitive_runs
from polyworld.gap.settings import SearchSettings
from polyworld.gap.stability import far_fetched

Array = NDArray[np.float64]

SHORT, LONG = 4, 2  # segments of a run


@dataclass
class Search:
    """The search on one design.

    ground: the base, fitted. substep [s]: of the world that was given, which the design's may exceed; the best are
    judged with it. whole: the contest on whole runs. used: that on segments, where there was one.
    """

    ground: FittedHypothesis
    candidates: tuple[Candidate, ...]
    settings: SearchSettings
    report: ReportStep
    substep: float
    whole: Contest
    used: Contest | None = None

    @classmethod
    def begin(
        cls,
        ground: FittedHypothesis,
        candidates: tuple[Candidate, ...],
        settings: SearchSettings,
        report: ReportStep,
        substep: float,
    ) -> Search:
        """Begin a search from a fitted base."""
        return cls(ground, candidates, settings, report, substep, Contest(ground.context, None, settings, report))

    @property
    def context(self) -> FitContext:
        """Design and noise of the fits to whole runs."""
        return self.whole.context

    @cached_property
    def segments(self) -> Contest | None:
        """The contest on segments: on long ones, or where the base is farther off, on short ones, unless it explains
        these. None where runs cannot be cut."""
        if self.ground.chi2 > self.settings.farther * self.context.observations:
            short = self._segments(SHORT)
            if short is None:
                return None
            ground = self._on(short, self.ground)
            if ground.chi2 > self.settings.near * short.observations:
                return short
        return self.long_segments

    @cached_property
    def long_segments(self) -> Contest | None:
        """The contest on long segments."""
        return self._segments(LONG)

    def _segments(self, pieces: int) -> Contest | None:
        cut = segment_context(self.context, pieces)
        return None if cut is None else Contest(cut.context, cut, self.settings, self.report)

    # -- ranking -------------------------------------------------------------------------------------------------

    def ranked(self, effects: int) -> list[FittedHypothesis]:
        """Return the fits to whole runs with so many effects, lowest extended BIC first."""
        return self.whole.ranked(effects)

    def best(self, effects: int) -> FittedHypothesis | None:
        """Return the first of these."""
        return self.whole.best(effects)

    def passes(self, effects: int) -> bool:
        """Return whether the best with so many effects leaves only noise."""
        best = self.best(effects)
        return best is not None and best.passes

    def hopeless(self, effects: int) -> bool:
        """Return whether so many effects do not even explain segments."""
        if self.used is None:
            return False
        best = self.used.best(effects)
        return best is not None and best.fit.converged and best.chi2 > 2.0 * self.used.observations

    def under(self, context: FitContext, effects: int) -> None:
        """Go on under other noise: fits near the best are refitted, the others dropped."""
        before = self.ranked(effects)
        self.whole.context = context
        self.whole.fitted = {}
        for trial in before[: self.settings.few + 2]:
            self.whole.take(context.refit(trial))

    # -- moves ---------------------------------------------------------------------------------------------------

    def add(self, parents: Sequence[FittedHypothesis]) -> None:
        """Fit the hypotheses that one more effect makes of the parents."""
        parents = distinct(parents, self.settings.alike)
        effects = len(parents[0].hypothesis.parts) + 1
        level = min(p.chi2 for p in parents)
        limit = self.settings.far_colliding if profile.collide(self.context.design) else self.settings.far
        far = level > limit * self.context.observations
        if far and effects == 1 and self._in_one_run():
            return
        contest = self.segments if far else None
        tried: list[Contest] = []
        while contest is not None:
            tried.append(contest)
            self.used = contest
            own = [self._on(contest, p) for p in parents if contest.holds(p.hypothesis)]
            if own:
                predictions = contest.predict(own, self._more)
                found = contest.fit(predictions, self.settings.contenders, min(p.chi2 for p in own))
                self._transfer(contest, found)
            best = self.best(effects)
            if best is not None and self._explains(best, level):
                return
            others = self.long_segments if effects == 1 else None
            contest = others if all(others is not c for c in tried) else None
        whole = self.whole.predict(parents, self._more)
        if tried:
            whole = [p for p in whole if not (tried[-1].holds(p.parent.hypothesis) and tried[-1].holds(p.hypothesis))]
        if whole:
            self.whole.fit(whole, self.settings.contenders, level)

    def swap(self, effects: int) -> None:
        """Replace each effect of the best hypothesis by every other that predicts more."""
        best = self.best(effects)
        if best is None or effects < 2:
            return
        parents = []
        for less, values in reduced(self.context, best):
            known = self.whole.fitted.get(identity(less))
            parents.append(known or self.whole.take(self.context.fit(less, values, best.fit.states)))
        if parents:
            self.add(parents)

    def drop(self, effects: int) -> int:
        """Drop effects of the best that the data do not need; the number of effects then."""
        best = self.best(effects)
        while best is not None and len(best.hypothesis.parts) > 1 and best.passes:
            fewer = [self._dropped(less, values, best) for less, values in reduced(self.context, best)]
            good = [t for t in fewer if t.passes and ebic.competes(t, best, self.settings.credible)]
            if not good:
                break
            best = ebic.ranked(good)[0]
            self.report("drop", best.figures())
        return effects if best is None else len(best.hypothesis.parts)

    def improve(self, effects: int) -> None:
        """Fit what may do as well as the best: competitors on segments, nested submodels, greater friction."""
        best = self.best(effects)
        if best is None:
            return
        for move in moves(self, best, effects):
            known = self.whole.fitted.get(identity(move.hypothesis))
            perturbed = identity(move.hypothesis) == identity(best.hypothesis)
            if known is not None and ebic.competes(known, best, self.settings.credible) and not perturbed:
                continue
            trial = self._moved(move, best)
            self.report("move", trial.figures())
            self.whole.take(trial)

    def settle(self, effects: int) -> None:
        """Fit what is near the best with all care: runs that fit ill again by themselves, and to convergence."""
        best = self.best(effects)
        if best is None:
            return
        near = [t for t in self.ranked(effects) if ebic.competes(t, best, self.settings.credible)]
        for trial in near[: self.settings.few + 2]:
            if sensitive(self.context.design):
                self.whole.take(profiled(refit_ill_runs(trial)))
            elif _edged(trial.hypothesis):
                self.whole.take(refit_ill_runs(restarted(trial, trial.hypothesis)))
        self.converge(effects)

    def converge(self, effects: int) -> None:
        """Fit the best on for as long as that moves it."""
        best = self.best(effects)
        for _ in range(self.settings.rounds):
            if best is None or best.fit.converged or best.chi2 > self.settings.nearly * self.context.observations:
                return
            before, best = best.chi2, self.whole.take(self.context.refit(best))
            if before - best.chi2 < 0.5:
                return

    def restart(self, effects: int) -> None:
        """Fit the leaders again from the data's own starts, a little more of each run at a time."""
        for trial in self.ranked(effects)[:2]:
            own = trial.hypothesis.stepped(self.context.design.world.time.substep)
            self.whole.take(refit_ill_runs(restarted(trial, own)))

    def refine_steps(self, effects: int, times: float = FINEST) -> None:
        """Fit the best, and what is near it, with steps so short that longer ones leave no error that shows."""
        best = self.best(effects)
        if best is None or best.chi2 > self.settings.nearly * self.context.observations:
            return
        near = [t for i, t in enumerate(self.ranked(effects)) if i == 0 or ebic.competes(t, best, self.settings.close)]
        for trial in near[: self.settings.few + 2]:
            fine = refined(trial, self.substep, self.substep / times)
            if fine is not trial:
                self.whole.fitted[identity(trial.hypothesis)] = fine
                self.report("finer steps", fine.figures())

    def with_predicted_gain(self, gain: float) -> list[FittedHypothesis]:
        """Fit single effects for which the score test predicts that the extended BIC falls by more than `gain`."""
        found = [
            tested
            for tested in score_test_starts(self.context, self.ground, self._more(self.ground), 1)
            if ebic.predicted(tested, self.context) < self.ground.ebic - gain
        ]
        fits = []
        for tested in found[: self.settings.contenders]:
            start = Start(tested.values, self.ground.fit.states)
            fits.append(profiled(self.context.fit(tested.hypothesis, start.values, start.states)))
        return ebic.ranked(fits)

    def parents(self, effects: int) -> list[FittedHypothesis]:
        """Return the hypotheses that a further effect is added to: the leaders, and the one that leads on segments.

        Over whole runs what is still missing adds up, and a wrong effect that happens to bend paths alike comes nearer
        than a right one beside which another lacks.
        """
        ranked = self.ranked(effects)
        chosen = ranked[: self.settings.few]
        ordinary = next((t for t in ranked if not far_fetched(t)), None)
        if ordinary is not None and all(ordinary is not t for t in chosen):
            chosen[-1] = ordinary  # two ordinary laws together are what one richer effect mimics
        if self.used is not None:
            there = [t for t in self.used.ranked(effects) if identity(t.hypothesis) in self.whole.fitted]
            if there:
                leader = self.whole.fitted[identity(there[0].hypothesis)]
                if all(leader is not t for t in chosen):
                    chosen.append(leader)
        return chosen

    def worth_a_third(self, parents: Sequence[FittedHypothesis]) -> bool:
        """Return whether one more effect is predicted to explain much of what two leave: sums of three mimic much."""
        predictions = self.whole.predict(parents, self._more)
        if not predictions:
            return False
        best = min(predictions, key=lambda p: p.starts[0].chi2)
        missing = best.parent.chi2 - self.context.observations
        return best.parent.chi2 - best.starts[0].chi2 >= self.settings.half * missing

    def sensitive_runs(self, effects: int) -> tuple[str, ...]:
        """Return runs that the best, or the base, does not follow as a whole although it explains their segments."""
        for whole in (self.ground, self.best(effects)):
            if whole is None or self.used is None or self.used.segments is None:
                continue
            there = self.used.fitted.get(identity(whole.hypothesis))
            if there is not None and (found := sensitive_runs(whole, self.used.segments, there)):
                return found
        return ()

    # -- parts of moves ------------------------------------------------------------------------------------------

    def _more(self, parent: FittedHypothesis) -> list[Hypothesis]:
        """Return the hypotheses that one more effect makes of a fit, stepped as the design's world is."""
        own = parent.hypothesis.stepped(self.context.design.world.time.substep)
        return [h for c in self.candidates for h in extended(own, c, self.context.design.recording)]

    def _on(self, contest: Contest, parent: FittedHypothesis) -> FittedHypothesis:
        """Return a parent as fitted in a contest on segments."""
        known = contest.fitted.get(identity(parent.hypothesis))
        if known is None:
            assert contest.segments is not None
            known = contest.take(contest.segments.fit_base(parent.hypothesis, parent.values))
        return known

    def _in_one_run(self) -> bool:
        """Return whether most runs are explained, and the others by what happens in one run alone."""
        if np.median(self.ground.misfits) > self.settings.near:
            return False
        local = [h for h in self._more(self.ground) if h.parts[-1].candidate.score_test is not None]
        if not local:
            return False
        missing = self.ground.chi2 - self.context.observations
        predictions = [
            p
            for p in self.whole.predict([self.ground], lambda _: local)
            if self.ground.chi2 - p.starts[0].chi2 > self.settings.one_run * missing
        ]
        if predictions:
            self.whole.fit(predictions, 1, self.ground.chi2)
        return self.passes(1)

    def _explains(self, trial: FittedHypothesis, level: float) -> bool:
        """Return whether a fit explains what fits with chi2 `level` do not; an effect with an edge has to pass the
        gate, since it may be at a wrong place, which comes near the data and not there."""
        near = self.settings.near * self.context.observations
        return trial.passes if level < near or _edged(trial.hypothesis) else trial.chi2 < near

    def _transfer(self, contest: Contest, found: Sequence[FittedHypothesis]) -> None:
        """Fit whole runs from what was found on segments, until one explains them and the others are far behind."""
        if not found:
            return
        hopeless = not contest.explained(found[0]) and found[0].chi2 > 2.0 * contest.observations
        chosen: list[FittedHypothesis] = []
        for trial in found[: self.settings.few if hopeless else self.settings.contenders]:
            behind = not ebic.competes(trial, found[0], self.settings.close)
            if behind and any(t.chi2 < self.settings.near * self.context.observations for t in chosen):
                break
            chosen.append(self._whole(contest, trial))
        if not hopeless:
            level = max(t.chi2 for t in chosen)
            self.whole.finish(chosen, level)

    def _whole(self, contest: Contest, trial: FittedHypothesis) -> FittedHypothesis:
        """Return the best fit to whole runs of a hypothesis fitted on segments."""
        assert contest.segments is not None
        start = contest.segments.start(trial.fit)
        context = self.context
        if not sensitive(context.design):
            horizons = profile.FINE_HORIZONS if profile.collide(context.design) else (1.0,)
            whole = context.fit(
                trial.hypothesis, start.values, start.states, horizons=horizons, iterations=self.settings.rough + 1
            )
            return self.whole.take(refit_ill_runs(whole))
        best = self.best(len(trial.hypothesis.parts))
        like = None
        if best is not None and best.chi2 < self.settings.near * context.observations:
            like = context.fit(trial.hypothesis, start.values, best.fit.states)
            if best.passes and refused_by_most(like, best):
                return self.whole.take(like)
        starts = [start.states, profile.start_states(context.design)]
        return self.whole.take(refit_ill_runs(fit_near(context, trial.hypothesis, start.values, starts, like)))

    def _dropped(self, less: Hypothesis, values: Array, best: FittedHypothesis) -> FittedHypothesis:
        fewer = self.whole.take(self.context.fit(less, values, best.fit.states))
        if not fewer.passes:  # the states may have followed the effect that is left out
            states, horizons = profile.start_states(self.context.design), profile.horizons_for(self.context.design)
            again = self.context.fit(less, values, states, horizons=horizons)
            fewer = self.whole.take(refit_ill_runs(again))
        return fewer

    def _moved(self, move: Move, best: FittedHypothesis) -> FittedHypothesis:
        """Fit a move; where bodies collide, run by run unless most runs refuse it."""
        context = self.context
        coupled = profile.collide(context.design) and not sensitive(context.design)
        horizons = profile.FINE_HORIZONS if coupled else (1.0,)
        trial = context.fit(move.hypothesis, move.start.values, move.start.states, horizons=horizons)
        if not sensitive(context.design):
            # Initial states may have been bent to the other law.
            if not ebic.competes(trial, best, self.settings.credible):
                data, wide = profile.start_states(context.design), profile.horizons_for(context.design)
                other = context.fit(move.hypothesis, trial.values, data, horizons=wide, iterations=self.settings.rough)
                trial = min([trial, context.refit(other, target=best.chi2 + self.settings.close)], key=lambda t: t.chi2)
            return refit_ill_runs(trial)
        if refused_by_most(trial, best):
            return trial
        starts = [best.fit.states, profile.start_states(context.design)]
        return refit_ill_runs(fit_near(context, move.hypothesis, move.start.values, starts))


def _edged(hypothesis: Hypothesis) -> bool:
    """Return whether the last effect is one of contacts within a place: with an edge that paths cross."""
    part = hypothesis.parts[-1]
    return part.candidate.group == "contact" and bool(part.variant.idle)
