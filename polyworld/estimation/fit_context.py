"""Fit hypotheses to one design: keep their forward models, and compute criteria."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.criteria import extended_bic, held_out
from polyworld.estimation.descent import Estimate, trial_costs
from polyworld.estimation.design import Design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.goodness import Goodness, goodness
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.noise import Noise

Array = NDArray[np.float64]

FINER = 4.0  # times shorter are the steps that are tried next
FINEST = 16.0  # times shorter than a world's own are the shortest
SAME_STEP = 0.8  # of the steps, from which on others are another fit
UNMINDED = 1.0  # sum of squared whitened changes that decides nothing
READY = 12  # forward models that keep their simulators: more would fill the memory


@dataclass(frozen=True)
class Start:
    """Where a fit may begin: shared values (S,) and initial states[run] (N,)."""

    values: Array
    states: tuple[Array, ...]


@dataclass(frozen=True)
class FittedHypothesis:
    """A hypothesis fitted: the fit, under which noise, and what it is worth."""

    hypothesis: Hypothesis
    fit: profile.Fit
    context: FitContext = field(repr=False)

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals."""
        return self.fit.chi2

    @property
    def ebic(self) -> float:
        """Extended BIC: lower is better."""
        return self.chi2 + self.price

    @property
    def price(self) -> float:
        """Cost of the effects in the extended BIC: of their unknowns, of choosing them, and of implausible values."""
        h = self.hypothesis
        occam = extended_bic(0.0, h.extra, self.context.observations, len(h.parts), self.context.candidates)
        return occam + self.implausibility

    @property
    def implausibility(self) -> float:
        """Minus twice the log density of a normal prior at the effects' values, up to a constant."""
        first = len(self.hypothesis.base)
        added = zip(self.hypothesis.unknowns[first:], self.values[first:], strict=True)
        return sum(((float(v) - u.start) / u.plausible) ** 2 for u, v in added if u.plausible is not None)

    @cached_property
    def goodness(self) -> Goodness:
        """Whether what is left is noise."""
        return goodness(self.context.design, self.context.noise, self.fit)

    @property
    def passes(self) -> bool:
        """Whether the gate is passed."""
        return self.goodness.passes

    @cached_property
    def held_out(self) -> Array:
        """chi2 (F,) of data left out."""
        return held_out(self.context.design, self.hypothesis.unknowns, self.fit)

    @cached_property
    def nuisance(self) -> NuisanceProjection:
        """Projection of further effects off what is fitted."""
        return NuisanceProjection(self.fit)

    @property
    def values(self) -> Array:
        """Shared unknowns (S,)."""
        return self.fit.values

    @property
    def misfits(self) -> Array:
        """chi2 per measurement (R,) of each run, infinite where its rollout diverges."""
        return self.costs / self.context.counts

    @property
    def costs(self) -> Array:
        """chi2 (R,) of each run, infinite where its rollout diverges."""
        return np.array([float(r @ r) for r in self.fit.linear.r])

    def figures(self) -> dict[str, Any]:
        """Return the figures of a fit that are reported as a search goes on, JSON-ready."""
        return {
            "hypothesis": self.hypothesis.title,
            "chi2": self.chi2,
            "ebic": self.ebic,
            "converged": self.fit.converged,
            "substep": self.hypothesis.world.time.substep,
            "values": {u.name: float(v) for u, v in zip(self.hypothesis.unknowns, self.values, strict=True)},
        }


Fitted = Callable[[FittedHypothesis], None]


class NuisanceProjection:
    """Projection off what is fitted, nuisance parameters: the initial states of each run, then the shared unknowns.

    bases[run] (m, n): orthonormal, of what the initial state can take up. answers[run] (N, m): what the initial state
    does to take up a residual. slopes[run] (m, S): derivatives by the shared unknowns, less what the initial state
    takes up. inverse (S, S): of their information.
    """

    def __init__(self, fit: profile.Fit) -> None:
        linear = fit.linear
        self.bases: list[Array] = []
        self.answers: list[Array] = []
        self.slopes: list[Array] = []
        for a, b in zip(linear.a, linear.b, strict=True):
            lengths = np.maximum(np.linalg.norm(b, axis=0), 1e-300)
            basis, size, turn = np.linalg.svd(b / lengths, full_matrices=False)
            use = size > 1e-8 * size.max(initial=0.0)
            basis = basis[:, use]
            self.bases.append(basis)
            self.answers.append(-(turn[use].T / size[use]) @ basis.T / lengths[:, None])
            self.slopes.append(a - basis @ (basis.T @ a))
        s = len(fit.values)
        information = sum((a.T @ a for a in self.slopes), np.zeros((s, s)))
        self.inverse = np.linalg.pinv(information, rcond=1e-10, hermitian=True)

    def off(self, run: int, vectors: Array) -> Array:
        """Return vectors (..., m) of one run less what its initial state can take up."""
        basis = self.bases[run]
        rest: Array = vectors - (vectors @ basis) @ basis.T
        return rest


@dataclass
class FitContext:
    """A design, its noise as estimated so far, and the forward models of the hypotheses tried on it.

    candidates: how many effects were to choose from. cancelled: asked between batches; where it says so
    `InterruptedError` is raised. fitted: called with each fit.
    """

    design: Design
    noise: Noise
    candidates: int
    cancelled: Callable[[], bool] | None = None
    fitted: Fitted | None = None
    _forwards: dict[int, tuple[Hypothesis, Forward]] = field(default_factory=dict, repr=False)

    @property
    def observations(self) -> float:
        """Number of independent measurements."""
        return float(self.noise.count)

    @property
    def counts(self) -> Array:
        """Measurements (R,) of each run, at least 1."""
        return np.array([max(float(kept.sum()), 1.0) for kept in self.noise.kept])

    @property
    def rollouts(self) -> int:
        """Worlds simulated so far."""
        return sum(f.rollouts for _, f in self._forwards.values())

    def with_noise(self, noise: Noise) -> FitContext:
        """Return the same context under other noise; forward models are shared."""
        return replace(self, noise=noise)

    def forward(self, hypothesis: Hypothesis) -> Forward:
        """Return the forward model of a hypothesis; each is built once."""
        key = id(hypothesis)
        if key in self._forwards:
            self._forwards[key] = self._forwards.pop(key)  # the last used come last
        else:
            made = Forward(self.design, hypothesis.world, hypothesis.unknowns, self.cancelled)
            self._forwards[key] = (hypothesis, made)
            for _, old in list(self._forwards.values())[:-READY]:
                old.release()
        return self._forwards[key][1]

    def fit(
        self,
        hypothesis: Hypothesis,
        values: Array,
        states: Sequence[Array],
        *,
        horizons: Sequence[float] = (1.0,),
        iterations: int = 12,
        target: float | None = None,
    ) -> FittedHypothesis:
        """Fit shared unknowns and initial states from the values given; `target` as in `profile.fit`."""
        found = profile.fit(
            self.forward(hypothesis),
            self.noise,
            values,
            states,
            horizons=horizons,
            iterations=iterations,
            target=target,
        )
        trial = FittedHypothesis(hypothesis, found, self)
        if self.fitted is not None:
            self.fitted(trial)
        return trial

    def nearest(self, hypothesis: Hypothesis, options: Sequence[Start]) -> Start:
        """Return the start of a hypothesis at which chi2 is least; the first where none is finite."""
        return options[int(np.argmin(self.costs(hypothesis, options)))]

    def costs(self, hypothesis: Hypothesis, options: Sequence[Start]) -> Array:
        """Return chi2 (K,) at K starts of a hypothesis, infinite where a rollout diverges."""
        total: Array = self.run_costs(hypothesis, options).sum(axis=1)
        return total

    def run_costs(self, hypothesis: Hypothesis, options: Sequence[Start]) -> Array:
        """Return chi2 (K, R) of each run at K starts of a hypothesis, infinite where a rollout diverges."""
        points = [Estimate(o.values, o.states) for o in options]
        return trial_costs(self.forward(hypothesis), self.noise, points, 1.0)

    def raw_residuals(self, trial: FittedHypothesis) -> list[Array]:
        """Simulated less observed (m,) of every run at a fit [m, rad], as measured, not whitened."""
        settings = [Settings(r.index, trial.values[None], trial.fit.states[r.index][None]) for r in self.design.runs]
        return [raw[0] for raw in self.forward(trial.hypothesis).residuals(settings)]

    def refit(self, trial: FittedHypothesis, *, iterations: int = 12, target: float | None = None) -> FittedHypothesis:
        """Go on from where a fit ended, under this context's noise."""
        return self.fit(trial.hypothesis, trial.fit.values, trial.fit.states, iterations=iterations, target=target)


def refined(trial: FittedHypothesis, substep: float, shortest: float) -> FittedHypothesis:
    """Refit with shorter steps, as long as longer ones leave errors that show: down to `substep` [s],
    and where it then fails the gate, down to `shortest` [s]."""
    while True:
        now = trial.hypothesis.world.time.substep
        coarse = now > substep / SAME_STEP
        if not coarse and (now * SAME_STEP < shortest or trial.passes):
            return trial
        step = max(substep, now / FINER) if coarse else now / FINER
        if step_error(trial, step) < UNMINDED:
            return trial
        trial = trial.context.fit(trial.hypothesis.stepped(step), trial.values, trial.fit.states)


def step_error(trial: FittedHypothesis, step: float) -> float:
    """Return the sum of squares of what a rollout with other steps [s] changes in the whitened residuals of a fit, less
    what the initial states can take up."""
    context = trial.context
    settings = [Settings(r.index, trial.values[None], trial.fit.states[r.index][None]) for r in context.design.runs]
    finer = Forward(context.design, trial.hypothesis.stepped(step).world, trial.hypothesis.unknowns, context.cancelled)
    total = 0.0
    for r, raw in zip(context.design.runs, finer.residuals(settings), strict=True):
        change = context.noise.whiten(r.index, raw)[0] - trial.fit.linear.r[r.index]
        total += float(np.sum(trial.nuisance.off(r.index, change) ** 2)) if np.all(np.isfinite(change)) else np.inf
    return total
