"""An unexplained force described: when no effect of the catalogue fits, the law that does, term by term.

Terms (`polyworld.gap.residual_terms`) are ranked by a score test, fitted on simulated trajectories together
with base unknowns and initial states, and chosen by the extended BIC, forward with a step back after each addition.
Whether the law found explains the data is for the goodness of fit to say; where it does not, the closest is told as
that and no more.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from polyworld.estimation.design import Design
from polyworld.estimation.goodness import goodness
from polyworld.estimation.noise import Noise
from polyworld.estimation.profile import Fit
from polyworld.estimation.unknown import Unknown
from polyworld.gap.residual_dependence import FACTORS, Dependence, dependences, without_factor
from polyworld.gap.residual_law import (
    FittedLaw,
    Law,
    Problem,
    Score,
    fit_law,
    refitted,
    room_for,
    score_term,
    with_refined_noise,
)
from polyworld.gap.residual_scales import scales_of
from polyworld.gap.residual_terms import Term, library
from polyworld.gap.windows import Windows
from polyworld.parameters import with_parameters
from polyworld.world import World

CONTENDERS = 6  # terms that are fitted, of those the score test ranks
MAX_TERMS = 3
NOISIER = 2.0  # more than this times the variance that third differences tell is no noise, whatever its course
REFINEMENTS = 2  # of the noise, after a better law is found
BETTER = 2.0  # least fall of the criterion for one more term
NEAR = 10.0  # laws within this of the best criterion are told as alternatives
MOST_STEPS = 4e7  # of integration in all laws fitted, after which no further one is tried: some minutes
LEAST_STEPS = 1e3  # that a rollout counts for: to begin one has its cost too
Z95 = 1.959963984540054


@dataclass(frozen=True)
class Number:
    """A fitted number of the law with its 95% interval, from the curvature at the minimum."""

    value: float
    unit: str
    interval95: tuple[float, float]


@dataclass(frozen=True)
class ResidualForce:
    """What the unexplained force looks like.

    explains: whether with it the fit passes the goodness of fit; where not, the law is only the closest found.
    expression: an acceleration [m/s^2], empty where no term helps; written: with its numbers in it. numbers: by name.
    directions: one a term. speed_exponents: of the terms that have one. dependence: what each factor buys.
    chi2_before, chi2_after; data: measured components. alternatives: other laws and by how much their criterion is
    worse. world: the child world with the law as the effect `unexplained`, fitted; None without a law.
    fit: of the base unknowns, those of the effects beside it, then the law's numbers. tried: laws fitted. complete:
    False where the search ended at its limit of steps, so that a better law may have been left untried. beside:
    effects of the catalogue, no forces, that are in the world with it.
    """

    explains: bool
    expression: str
    written: str
    numbers: dict[str, Number]
    directions: tuple[str, ...]
    speed_exponents: tuple[Number, ...]
    dependence: tuple[Dependence, ...]
    chi2_before: float
    chi2_after: float
    data: int
    alternatives: tuple[tuple[str, float], ...]
    world: World | None
    fit: Fit
    unknowns: tuple[Unknown, ...]
    tried: int
    complete: bool
    beside: tuple[str, ...] = ()

    def summary(self) -> str:
        """One sentence for readers."""
        end = (
            "" if self.complete else "; the search ended at its limit of integration steps, before all laws were tried"
        )
        if not self.expression:
            return f"no term describes what is unexplained{end}"
        so = "explains the data" if self.explains else "comes closest, but does not explain the data"
        beside = f" beside {' and '.join(self.beside)}" if self.beside else ""
        return f"an acceleration {self.written}{beside} {so}{end}"

    def to_json(self) -> dict[str, Any]:
        """As reports and evidence hold it; the world is left out."""
        return {
            "explains": self.explains,
            "summary": self.summary(),
            "expression": self.expression,
            "written": self.written,
            "numbers": {n: _number_json(x) for n, x in self.numbers.items()},
            "direction": list(self.directions),
            "speed_exponent": [_number_json(x) for x in self.speed_exponents],
            "dependence": {d.factor: d.to_json() for d in self.dependence},
            "chi2_before": self.chi2_before,
            "chi2_after": self.chi2_after,
            "data": self.data,
            "complete": self.complete,
            "beside": list(self.beside),
            "alternatives": [{"expression": e, "ebic_behind": b} for e, b in self.alternatives],
        }


@dataclass(frozen=True)
class Near:
    """Windows of the runs, and the base fitted to them under some noise: near the data, where whole runs are not."""

    windows: Windows
    noise: Noise
    fit: Fit


@dataclass
class _Search:
    problem: Problem
    terms: tuple[Term, ...]
    base: FittedLaw
    most_terms: int
    progress: Callable[[float, str], None] | None
    budget: float = 1.0
    history: dict[tuple[str, ...], FittedLaw] = field(default_factory=dict)
    first_scores: list[Score] = field(default_factory=list)
    spent: float = 0.0  # steps of integration
    complete: bool = True

    def at_its_limit(self) -> bool:
        """Whether no further law may be tried; that one would have been is noted."""
        if self.spent >= self.most:
            self.complete = False
        return not self.complete

    @property
    def most(self) -> float:
        """Steps of integration after which no further law is tried."""
        return self.budget * MOST_STEPS

    def _counted(self, fitted: FittedLaw) -> FittedLaw:
        spans = [float(r.times[-1] - r.times[0]) for r in self.problem.design.runs]
        steps = float(np.mean(spans)) / self.problem.world.time.substep
        self.spent += fitted.fit.rollouts * max(steps, LEAST_STEPS)
        return fitted

    def run(self) -> FittedLaw:
        """The best law found."""
        best = self.base
        self.history[()] = self.base
        for depth in range(self.most_terms):
            found = self._extended(best, depth)
            if found is None or found.ebic > best.ebic - BETTER:
                break
            best = self._renoised(self._reduced(found))
            if self.passes(best):
                return best
            if self.at_its_limit():
                return best
        if len(best.law.terms) > 1:
            best = self._renoised(self._swapped(best))
        return best

    def passes(self, known: FittedLaw) -> bool:
        """Whether what a law leaves is noise, in its course and in its size."""
        noise = self.problem.noise
        return known.fit.chi2 < NOISIER * noise.count and goodness(self.problem.design, noise, known.fit).passes

    def _renoised(self, best: FittedLaw) -> FittedLaw:
        """The best law under the noise that its residuals tell, and all others judged under that noise too."""
        for _ in range(REFINEMENTS):
            problem = with_refined_noise(self.problem, best)
            if problem is self.problem:
                break
            self.problem = problem
            self.history = {key: self._counted(refitted(problem, known)) for key, known in self.history.items()}
            self.base = self.history[()]
            best = min(self.history.values(), key=lambda f: f.ebic)
            if self.spent >= self.most:  # what has been refitted may be judged; no more than that
                break
        return best

    def scores(self, known: FittedLaw) -> list[Score]:
        """All terms not yet in a law, best promise first."""
        cost = np.log(self.problem.noise.count)
        found = []
        for term in self.terms:
            if term not in known.law.terms and room_for(known.law, term):
                score = score_term(self.problem, known, term)
                if score is not None:
                    found.append(score)
        return sorted(found, key=lambda s: cost * len(s.values) - s.gain)

    def fit_with(self, known: FittedLaw, score: Score) -> FittedLaw:
        """A law with one more term, fitted from what the score test suggests."""
        law = Law((*known.law.terms, score.term))
        key = tuple(sorted(t.name for t in law.terms))
        if key not in self.history:
            settled = known.fit.values[len(self.problem.base) :]
            numbers = [*settled.tolist(), *score.values]
            self.history[key] = self._counted(fit_law(self.problem, law, known.fit, numbers))
        return self.history[key]

    def _extended(self, known: FittedLaw, depth: int) -> FittedLaw | None:
        scores = self.scores(known)
        if not known.law.terms:
            self.first_scores = scores
        fitted: list[FittedLaw] = []
        for i, score in enumerate(scores[:CONTENDERS]):
            if fitted and self.at_its_limit():
                break
            self._tell((depth + (i + 1) / (CONTENDERS + 1)) / (self.most_terms + 1), f"fitting {score.term.name}")
            fitted.append(self.fit_with(known, score))
        return min(fitted, key=lambda f: f.ebic, default=None)

    def _reduced(self, known: FittedLaw) -> FittedLaw:
        """The law less every term that is not worth its numbers."""
        while len(known.law.terms) > 1:
            smaller = min((self._less(known, i) for i in range(len(known.law.terms))), key=lambda f: f.ebic)
            if smaller.ebic > known.ebic:
                return known
            known = smaller
        return known

    def _swapped(self, known: FittedLaw) -> FittedLaw:
        """The best law that replacing one term gives."""
        best = known
        for i in range(len(known.law.terms)):
            if self.at_its_limit():
                break
            found = self._extended(self._less(known, i), self.most_terms)
            if found is not None and found.ebic < best.ebic:
                best = found
        return best

    def _less(self, known: FittedLaw, index: int) -> FittedLaw:
        """The law without one of its terms, fitted on from where it stands: an earlier fit may have been trapped."""
        terms = tuple(t for i, t in enumerate(known.law.terms) if i != index)
        values = known.fit.values[len(self.problem.base) :]
        numbers: list[float] = []
        at = 0
        for i, term in enumerate(known.law.terms):
            width = len(term.strengths) + len(term.shapes)
            if i != index:
                numbers += values[at : at + width].tolist()
            at += width
        return self._keep(self._counted(fit_law(self.problem, Law(terms), known.fit, numbers)))

    def _keep(self, fitted: FittedLaw) -> FittedLaw:
        """The better of a fit and of what is known of the same terms."""
        key = tuple(sorted(t.name for t in fitted.law.terms))
        other = self.history.get(key)
        if other is None or fitted.ebic < other.ebic:
            self.history[key] = fitted
        return self.history[key]

    def _tell(self, share: float, what: str) -> None:
        if self.progress is not None:
            self.progress(share, what)


def describe_unexplained(
    design: Design,
    noise: Noise,
    base: Sequence[Unknown],
    fitted: Fit,
    *,
    world: World | None = None,
    objects: tuple[str, ...] | None = None,
    most_terms: int = MAX_TERMS,
    near: Near | None = None,
    budget: float = 1.0,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> ResidualForce:
    """Describe the force that a fitted world lacks.

    fitted: the fit of the base unknowns alone, under this noise, which is refined as better laws are found. world: the
    one fitted, default the design's. objects: whom the force acts on, default all. most_terms: of the law. near: where
    the law is looked for first, for a fit that is far from the data. budget: share of the integration steps that a
    search has, after which it ends. progress: told the share done and the step.
    cancelled: asked between batches; where it says so `InterruptedError` is raised.
    """
    problem = Problem(design, world or design.world, tuple(base), noise, 1, objects, cancelled)
    scales = scales_of(design, problem.world, fitted)
    terms = library(scales)
    problem = replace(problem, library=len(terms))
    if near is not None:
        problem = replace(problem, design=near.windows.bench.design, noise=near.noise)
    own = fitted if near is None else near.fit
    search = _Search(problem, terms, FittedLaw(Law(()), own, own.chi2), most_terms, progress, budget)
    best = search.run()
    if near is not None and best.law.terms:
        search, best = _on_whole_runs(search, best, replace(problem, design=design, noise=noise), fitted, near)
    problem = search.problem
    for factor in FACTORS:  # so that what a factor buys is told against a fair rival
        rival = without_factor(factor, search.first_scores)
        if best.law.depends_on(factor) and rival is not None and not search.at_its_limit():
            search.fit_with(search.base, rival)
    tests = dependences(problem, best, search.history.values(), search.first_scores, scales)
    return _told(problem, search, best, tests)


def _on_whole_runs(
    search: _Search, best: FittedLaw, problem: Problem, fitted: Fit, near: Near
) -> tuple[_Search, FittedLaw]:
    """The best laws found on windows, fitted to whole runs; and what is known of them there."""
    whole = replace(search, problem=problem, base=FittedLaw(Law(()), fitted, fitted.chi2), history={}, first_scores=[])
    whole.history[()] = whole.base
    least = best.ebic + NEAR
    laws = [best, *(f for f in search.history.values() if f is not best and f.law.terms and f.ebic < least)]
    for known in laws[:CONTENDERS]:
        start = near.windows.start(known.fit)
        begin = replace(known.fit, states=start.states)
        numbers = known.fit.values[len(problem.base) :].tolist()
        whole._keep(whole._counted(fit_law(problem, known.law, begin, numbers)))
    found = min((f for f in whole.history.values() if f.law.terms), key=lambda f: f.ebic)
    found = whole._renoised(found)
    if not found.law.terms:
        return search, best
    whole.first_scores = whole.scores(whole.base)
    return whole, found


def _told(problem: Problem, search: _Search, best: FittedLaw, tests: tuple[Dependence, ...]) -> ResidualForce:
    base = len(problem.base)
    values = best.numbers(base)
    deviations = np.sqrt(np.maximum(np.diag(best.fit.covariance)[base:], 0.0))
    numbers = {
        name: Number(values[name], unit, _interval(values[name], float(d), low, high))
        for (name, unit, low, high, _), d in zip(best.law.numbers, deviations, strict=True)
    }
    exponents = tuple(
        numbers[best.law.name(i, "p")] for i, t in enumerate(best.law.terms) if any(s.name == "p" for s in t.shapes)
    )
    others = sorted((f for f in search.history.values() if f is not best), key=lambda f: f.ebic)
    unknowns = (*problem.base, *best.law.unknowns(problem.world))
    world = None
    if best.law.terms:
        world = best.law.in_world(problem.world, problem.objects, values)
        fitted_base = dict(zip(problem.base, best.fit.values[:base], strict=True))
        shared = {p: float(v) for u, v in fitted_base.items() for p in u.paths}
        world = with_parameters(world, shared) if shared else world
    return ResidualForce(
        explains=bool(best.law.terms) and search.passes(best),
        expression=best.law.text,
        written=best.law.literal({n: float(f"{v:.4g}") for n, v in values.items()}),
        numbers=numbers,
        directions=tuple(t.direction for t in best.law.terms),
        speed_exponents=exponents,
        dependence=tests,
        chi2_before=search.base.fit.chi2,
        chi2_after=best.fit.chi2,
        data=problem.noise.count,
        alternatives=tuple(
            (f.law.text, f.ebic - best.ebic) for f in others if f.ebic - best.ebic < NEAR and f.law.terms
        ),
        world=world,
        fit=best.fit,
        unknowns=unknowns,
        tried=len(search.history) - 1,
        complete=search.complete,
    )


def _interval(value: float, deviation: float, low: float, high: float) -> tuple[float, float]:
    return max(low, value - Z95 * deviation), min(high, value + Z95 * deviation)


def _number_json(number: Number) -> dict[str, Any]:
    return {"value": number.value, "unit": number.unit, "interval95": list(number.interval95)}
