"""Describe the force that no effect of the catalogue explains, as an expression chosen term by term.

Score   every term of a library on top of the law so far, by the motion it would change (Rao's score test): residual
        accelerations are weighed in simulated positions, never by differentiating noisy ones.
Fit     those of largest predicted gain in the simulator, with base unknowns and initial states.
Choose  the law with the least extended BIC: forward selection, with a step back after each addition.
Refine  the noise by what that law leaves.
Stop    when only noise is left, no term lowers the criterion, or the limits of terms or integration steps are reached.

Whether the law explains the data is for the goodness of fit to say; otherwise it is reported as the closest found.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis, without_part
from polyworld.estimation.intervals import intervals95
from polyworld.estimation.noise import Noise
from polyworld.estimation.profile import Fit
from polyworld.estimation.score_test import ScoreTestStart, score_test_starts
from polyworld.gap import ebic
from polyworld.gap.examine import with_refined_noise
from polyworld.gap.segment_context import SegmentContext
from polyworld.gap.settings import SymbolicSettings
from polyworld.gap.symbolic_law import Law
from polyworld.gap.symbolic_terms import Term, library, scales_of
from polyworld.world import World

Array = NDArray[np.float64]

ITERATIONS = 40  # of a fit: an exponent and a strength that trade off make long valleys


@dataclass(frozen=True)
class Number:
    """A fitted number of the law with its 95% interval."""

    value: float
    unit: str
    interval95: tuple[float, float]


@dataclass(frozen=True)
class ResidualForce:
    """The law of the unexplained force.

    explains: whether with it the fit passes the goodness of fit; otherwise the law is only the closest found. law,
    trial: its terms, none where no term helps, and its fit. numbers: by name. chi2_before: of the fit without it.
    alternatives: other laws and by how much their criterion is worse. complete: False where the search ended at its
    limit of integration steps.
    """

    explains: bool
    law: Law
    trial: FittedHypothesis
    numbers: dict[str, Number]
    chi2_before: float
    alternatives: tuple[tuple[str, float], ...]
    complete: bool

    @property
    def expression(self) -> str:
        """The law as an acceleration [m/s^2], empty where no term helps."""
        return self.law.text

    @property
    def written(self) -> str:
        """The expression with its fitted numbers in it."""
        return self.law.literal({name: float(f"{n.value:.4g}") for name, n in self.numbers.items()})

    @property
    def beside(self) -> tuple[str, ...]:
        """Effects of the catalogue that are in the world with it."""
        names = self.trial.hypothesis.names
        return names[: len(names) - len(self.law.terms)]

    @property
    def world(self) -> World | None:
        """The child world with the law as the effect `unexplained`, fitted; None without a law."""
        return self.trial.hypothesis.fitted_world(self.trial.values) if self.law.terms else None

    def summary(self) -> str:
        """Describe the law in one sentence."""
        end = "" if self.complete else "; the search ended at its limit of integration steps, other laws untried"
        if not self.expression:
            return f"no term describes what is unexplained{end}"
        so = "explains the data" if self.explains else "comes closest, but does not explain the data"
        beside = f" beside {' and '.join(self.beside)}" if self.beside else ""
        return f"an acceleration {self.written}{beside} {so}{end}"

    def to_json(self) -> dict[str, Any]:
        """Return plain data for reports; the world is left out."""
        numbers = {name: asdict(n) | {"interval95": list(n.interval95)} for name, n in self.numbers.items()}
        return {
            "explains": self.explains,
            "summary": self.summary(),
            "expression": self.expression,
            "written": self.written,
            "numbers": numbers,
            "direction": [t.direction for t in self.law.terms],
            "speed_exponent": [n for name, n in numbers.items() if name.startswith("p")],
            "depends_on": sorted({factor for t in self.law.terms for factor in t.factors}),
            "chi2_before": self.chi2_before,
            "chi2_after": self.trial.chi2,
            "data": self.trial.context.noise.count,
            "complete": self.complete,
            "beside": list(self.beside),
            "alternatives": [{"expression": e, "ebic_behind": b} for e, b in self.alternatives],
        }


@dataclass(frozen=True)
class Near:
    """Segments of the runs, and the base fitted to them under some noise: near the data, where whole runs are not."""

    segments: SegmentContext
    noise: Noise
    fit: Fit

    def refitted(self, trial: FittedHypothesis) -> Near:
        """Fit another hypothesis to the segments."""
        context = self.segments.context.with_noise(self.noise)
        return replace(self, fit=context.fit(trial.hypothesis, trial.values, self.fit.states).fit)


def describe_unexplained(
    ground: FittedHypothesis,
    best: FittedHypothesis | None = None,
    near: Near | None = None,
    settings: SymbolicSettings | None = None,
) -> ResidualForce:
    """Find the law of the force that is missing.

    ground: the base, fitted. best: the hypothesis that came nearest, under the same noise. Its effects that are no
    force, a torque, a bounce or a fault of the observer, cannot be written as an acceleration; where the law on the
    base alone does not explain the data, it is sought beside them too. near: segments where laws are sought first, for
    a base that is far from the data. Raises `InterruptedError` where `ground.context.cancelled` says so.
    """
    settings = settings or SymbolicSettings()
    alone = _law_on(ground, near, settings)
    kept = None if best is None or alone.explains else _without_forces(ground, best)
    if kept is None:
        return alone
    near = near.refitted(kept) if near is not None and near.segments.holds(kept.hypothesis) else None
    beside = _law_on(kept, near, replace(settings, steps=settings.steps / 4))  # it begins nearer to the data
    return beside if beside.explains or law_bic(beside, kept) < law_bic(alone, ground) else alone


def law_bic(force: ResidualForce, trial: FittedHypothesis) -> float:
    """BIC of a law on top of a trial, under the trial's noise; that of the trial where there is no law."""
    context, own = trial.context, force.trial if force.law.terms else trial
    whole = len(own.fit.states) == len(trial.fit.states)  # or the law was found on segments, and on no whole runs
    fitted = context.fit(own.hypothesis, own.values, own.fit.states if whole else trial.fit.states)
    return ebic.bic(fitted.chi2, own.hypothesis.extra, context)


def _without_forces(ground: FittedHypothesis, best: FittedHypothesis) -> FittedHypothesis | None:
    """Refit the best hypothesis less its forces; None where nothing is left of it."""
    hypothesis, values, plan = best.hypothesis, best.values, best.context.design
    while forces := [
        i for i, p in enumerate(hypothesis.parts) if p.candidate.group == "force" and not p.candidate.torque
    ]:
        base = Hypothesis(plan.world, hypothesis.base)
        less = without_part(base, hypothesis, forces[0], values, plan.recording)
        if less is None:
            return None
        hypothesis, values = less
    fits = [best.context.fit(hypothesis, values, states) for states in (best.fit.states, ground.fit.states)]
    return min(fits, key=lambda t: t.chi2) if hypothesis.parts else None


def _law_on(ground: FittedHypothesis, near: Near | None, settings: SymbolicSettings) -> ResidualForce:
    """Search for a law on top of one hypothesis: on its runs, or on segments, then refitted to whole runs."""
    ground = replace(ground, hypothesis=ground.hypothesis.stepped(ground.context.design.world.time.substep))
    whole = _Search(ground, settings)
    if near is None:
        return whole.report(whole.run())
    context = near.segments.context.with_noise(near.noise)
    search = _Search(replace(ground, fit=near.fit, context=context), settings)
    best = search.run()
    if not best.law.terms:
        return search.report(best)
    fitted = [
        whole.fit(f.law, f.trial.hypothesis, f.trial.values, near.segments.start(f.trial.fit).states)
        for f in [best, *search.alternatives(best)][: settings.contenders]
    ]
    found = whole.with_refined_noise(min(fitted, key=lambda f: f.criterion))
    return whole.report(found) if found.law.terms else search.report(best)


@dataclass(frozen=True)
class _Fitted:
    """A law fitted. penalty: for each factor that it depends on."""

    law: Law
    trial: FittedHypothesis
    penalty: float

    @property
    def criterion(self) -> float:
        """Extended BIC and penalty; lower is better."""
        return self.trial.ebic + self.penalty * sum(len(t.factors) for t in self.law.terms)


class _Search:
    """Forward selection of terms on top of a fitted hypothesis."""

    def __init__(self, ground: FittedHypothesis, settings: SymbolicSettings) -> None:
        self.settings = settings
        self.terms = library(scales_of(ground))
        self.context = replace(ground.context, candidates=len(self.terms))
        self.base = ground.hypothesis
        self.tried = {frozenset[Term](): _Fitted(Law(), replace(ground, context=self.context), settings.penalty)}
        self.complete = True
        self._rollouts_before = self.context.rollouts

    def run(self) -> _Fitted:
        """Select a law."""
        best = self.tried[frozenset()]
        for _ in range(self.settings.max_terms):
            found = self.with_one_more(best)
            if found is None or found.criterion > best.criterion - self.settings.improvement:
                break
            best = self.with_refined_noise(self.pruned(found))
            if self.explains(best) or self.at_its_limit():
                return best
        if len(best.law.terms) > 1:
            best = self.with_refined_noise(self.with_one_replaced(best))
        return best

    def explains(self, fitted: _Fitted) -> bool:
        """Check whether what is left is noise in its course, and no louder than short differences of the data say."""
        trial = fitted.trial
        return trial.chi2 < self.settings.loudest * trial.context.noise.count and trial.passes

    def at_its_limit(self) -> bool:
        """Check whether no further law may be tried; that one would have been is noted."""
        duration = np.mean([r.times[-1] - r.times[0] for r in self.context.design.runs])
        steps = max(float(duration) / self.base.world.time.substep, self.settings.rollout)
        if (self.context.rollouts - self._rollouts_before) * steps >= self.settings.steps:
            self.complete = False
        return not self.complete

    def scores(self, known: _Fitted) -> list[tuple[Law, ScoreTestStart]]:
        """Score all terms that can be added to a law: the laws, and where their fits begin, best first."""
        laws = [Law((*known.law.terms, t)) for t in self.terms if t not in known.law.terms]
        begins = (
            (law, score_test_starts(self.context, known.trial, [law.hypothesis(self.base)], 1))
            for law in laws
            if law.fits
        )
        found = [(law, start) for law, starts in begins for start in starts]
        return sorted(found, key=lambda f: ebic.bic(f[1].chi2, len(f[1].values), self.context))

    def with_one_more(self, known: _Fitted) -> _Fitted | None:
        """Fit the terms of largest predicted gain beside those of a law; the best of them."""
        fitted: list[_Fitted] = []
        for law, start in self.scores(known)[: self.settings.contenders]:
            if fitted and self.at_its_limit():
                break
            tried = self.tried.get(frozenset(law.terms))
            fitted.append(tried or self.fit(law, start.hypothesis, start.values, known.trial.fit.states))
        return min(fitted, key=lambda f: f.criterion, default=None)

    def fit(self, law: Law, hypothesis: Hypothesis, values: Array, states: Sequence[Array]) -> _Fitted:
        """Fit a law; the better of this fit and of what is known of the same terms."""
        trial = self.context.fit(hypothesis, values, states, iterations=ITERATIONS)
        found = _Fitted(law, trial, self.settings.penalty)
        key = frozenset(law.terms)
        self.tried[key] = min(found, self.tried.get(key, found), key=lambda f: f.criterion)
        return self.tried[key]

    def without_term(self, known: _Fitted, term: Term) -> _Fitted:
        """Fit a law less one term from where it stands: an earlier fit of the rest may have been trapped."""
        law, own = Law(tuple(t for t in known.law.terms if t != term)), known.trial.hypothesis
        dropped = own.parts[len(self.base.parts) + known.law.terms.index(term)].variant.unknowns
        values = [v for u, v in zip(own.unknowns, known.trial.values, strict=True) if u not in dropped]
        return self.fit(law, law.hypothesis(self.base), np.array(values), known.trial.fit.states)

    def pruned(self, known: _Fitted) -> _Fitted:
        """Drop every term that is not worth its numbers."""
        while len(known.law.terms) > 1:
            smaller = min((self.without_term(known, t) for t in known.law.terms), key=lambda f: f.criterion)
            if smaller.criterion > known.criterion:
                break
            known = smaller
        return known

    def with_one_replaced(self, known: _Fitted) -> _Fitted:
        """Replace each term in turn by that of largest predicted gain; the best law then."""
        best = known
        for term in () if self.at_its_limit() else known.law.terms:
            found = self.with_one_more(self.without_term(known, term))
            best = min(best, found or best, key=lambda f: f.criterion)
        return best

    def with_refined_noise(self, best: _Fitted) -> _Fitted:
        """Estimate the noise from what the best law leaves, and refit all laws under it; the best then."""
        refined = with_refined_noise(best.trial)
        if abs(refined.chi2 - best.trial.chi2) < self.settings.same_noise * best.trial.chi2:
            return best
        self.context = refined.context
        self.tried = {key: replace(f, trial=self.context.refit(f.trial)) for key, f in self.tried.items()}
        return min(self.tried.values(), key=lambda f: f.criterion)

    def alternatives(self, best: _Fitted) -> list[_Fitted]:
        """List the other laws tried whose criterion is near the best, best first."""
        laws = [f for f in self.tried.values() if f.law.terms and f is not best]
        near = [f for f in laws if f.criterion - best.criterion < self.settings.near]
        return sorted(near, key=lambda f: f.criterion)

    def report(self, best: _Fitted) -> ResidualForce:
        """Return the best law with what is known of it."""
        trial, base = best.trial, len(self.base.unknowns)
        intervals = intervals95(trial.context, trial)[base:].tolist() if best.law.terms else []
        numbers = zip(best.law.numbers.items(), trial.values[base:].tolist(), intervals, strict=True)
        return ResidualForce(
            explains=bool(best.law.terms) and self.explains(best),
            law=best.law,
            trial=trial,
            numbers={name: Number(value, s.unit, (low, high)) for (name, s), value, (low, high) in numbers},
            chi2_before=self.tried[frozenset()].trial.chi2,
            alternatives=tuple(
                (f.law.text, f.criterion - best.criterion) for f in self.alternatives(best) if f is not best
            ),
            complete=self.complete,
        )
