"""Compute the power of a design: how strong each effect had to be to be seen.

Each candidate is planted in the design. The change of the motion, less what initial states and base unknowns can take
up, against the noise: its squared length is the noncentrality of the gain in chi2 that a search would find. An effect
counts as seen where that gain lowers the extended BIC by more than the search asks for.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chndtrinc

from polyworld.estimation.candidate import Candidate
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.forward import Settings
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.unknown import Unknown
from polyworld.gap import ebic
from polyworld.gap.settings import PowerSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Power:
    """How strong one way to add an effect had to be.

    effect, label: which one, and whom it acts on. unknown, unit: the number planted; empty for an effect that is there
    or not. strength: its least change from neutral that is seen with the power asked for, the median over the starts
    planted; infinite where none within its bounds is. typical: an ordinary change. noncentrality: of chi2's gain at the
    ordinary change; needed: for it to be seen. seen: whether an ordinary effect would have been.
    """

    effect: str
    label: str
    unknown: str
    unit: str
    strength: float
    typical: float
    noncentrality: float
    needed: float

    @property
    def seen(self) -> bool:
        """Whether an effect of ordinary strength would have been seen."""
        return self.noncentrality >= self.needed

    def summary(self) -> str:
        """Describe the power in words."""
        name = f"{self.effect} ({self.label})" if self.label else self.effect
        if not self.unknown:
            return f"{name}: {'would have been seen' if self.seen else 'cannot be seen'} where it was planted."
        if not np.isfinite(self.strength):
            return f"{name}: cannot be seen in these data, at no {self.unknown} within its bounds."
        ordinary = "would have been seen" if self.seen else "could have been missed"
        return (
            f"{name}: seen from {self.unknown} {self.strength:.3g} {self.unit} on; an ordinary one "
            f"({self.typical:.3g}) {ordinary}."
        )

    def to_json(self) -> dict[str, object]:
        """Return the power as plain data."""
        return {
            "effect": self.effect,
            "label": self.label,
            "unknown": self.unknown,
            "unit": self.unit,
            "detectable": self.strength if np.isfinite(self.strength) else None,
            "typical": self.typical,
            "noncentrality": self.noncentrality,
            "needed": self.needed,
            "seen": self.seen,
            "summary": self.summary(),
        }


def power_check(
    trial: FittedHypothesis, candidates: Sequence[Candidate] | None = None, settings: PowerSettings | None = None
) -> tuple[Power, ...]:
    """Compute the power of a trial's design against every way to add each candidate, weakest first.

    candidates: default the catalogue. Effects whose unknowns are free already are left out. Planted motion is compared
    by one simulation a strength; what fits could take up of it is projected out linearly at the trial's fit.
    """
    settings = settings or PowerSettings()
    if candidates is None:
        from polyworld.gap.catalogue import catalogue

        candidates = tuple(catalogue().values())
    count = max(trial.context.candidates, len(candidates))
    found: list[Power] = []
    for candidate in candidates:
        for hypothesis in extended(trial.hypothesis, candidate, trial.context.design.recording):
            extra = hypothesis.extra - trial.hypothesis.extra
            needed = noncentrality_needed(extra, trial.context.observations, count, settings)
            found += _of_hypothesis(trial, hypothesis, needed, settings)
    return tuple(sorted(found, key=lambda p: (p.noncentrality / p.needed, p.effect, p.label)))


def noncentrality_needed(
    unknowns: int, observations: float, candidates: int, settings: PowerSettings | None = None
) -> float:
    """Noncentrality with which the gain of an effect with so many unknowns suffices with the power asked for."""
    settings = settings or PowerSettings()
    gain = ebic.required_gain(unknowns, observations, candidates, settings.alarm)
    return float(chndtrinc(gain, unknowns, 1.0 - settings.power))


def _of_hypothesis(
    trial: FittedHypothesis, hypothesis: Hypothesis, needed: float, settings: PowerSettings
) -> list[Power]:
    part = hypothesis.parts[-1]
    variant = part.variant
    starts = hypothesis.starts(trial.values)
    chosen = np.unique(np.linspace(0, len(starts) - 1, min(settings.starts, len(starts))).astype(int))
    at = np.array([starts[i] for i in chosen])
    strong = [u for u in variant.unknowns if variant.strength == u.name]
    if not strong and variant.strength is None:
        strong = [u for u in variant.unknowns if u.name not in variant.idle]
    still = float(np.nanmedian(_noncentralities(trial, hypothesis, at)))
    if still > 0.1 * needed:  # it acts at its starts already: it is there or not
        return [Power(part.candidate.name, variant.label, "", "", 0.0, 0.0, still, needed)]
    return [_of_unknown(trial, hypothesis, at, u, needed, settings.corrections) for u in strong]


def _of_unknown(
    trial: FittedHypothesis, hypothesis: Hypothesis, starts: Array, unknown: Unknown, needed: float, corrections: int
) -> Power:
    part = hypothesis.parts[-1]
    unknowns = part.variant.unknowns
    place = starts.shape[1] - len(unknowns) + unknowns.index(unknown)
    up, down = unknown.upper - unknown.start, unknown.start - unknown.lower
    room, sign = (up, 1.0) if up >= down else (down, -1.0)
    ordinary = np.full(len(starts), min(unknown.typical, room))

    def planted(change: Array) -> Array:
        values = starts.copy()
        values[:, place] = unknown.start + sign * change
        return _noncentralities(trial, hypothesis, values)

    usual = planted(ordinary)
    change, reached = ordinary, usual
    for _ in range(corrections):
        with np.errstate(divide="ignore", invalid="ignore"):
            factor = np.sqrt(needed / reached)
        factor = np.where(np.isfinite(factor), np.clip(factor, 1e-4, 1e4), 1e4)
        change = np.minimum(change * factor, room)
        reached = planted(change)
    enough = np.isfinite(reached) & (reached >= 0.5 * needed)
    strength = np.where(enough, change * np.sqrt(needed / np.where(enough, reached, 1.0)), np.inf)
    return Power(
        part.candidate.name,
        part.variant.label,
        unknown.name,
        unknown.unit,
        float(np.median(strength)),
        unknown.typical,
        float(np.median(np.nan_to_num(usual, nan=0.0))),
        needed,
    )


def _noncentralities(trial: FittedHypothesis, hypothesis: Hypothesis, values: Array) -> Array:
    """Squared length (k,) of the change of the whitened motion at shared values (k, S), all fitted projected out."""
    context: FitContext = trial.context
    ground = trial.nuisance
    settings = [
        Settings(r.index, values, np.repeat(trial.fit.states[r.index][None], len(values), axis=0))
        for r in context.design.runs
    ]
    square = np.zeros(len(values))
    along = np.zeros((len(values), ground.inverse.shape[0]))
    for r, raw in zip(context.design.runs, context.forward(hypothesis).residuals(settings), strict=True):
        change = ground.off(r.index, context.noise.whiten(r.index, raw) - trial.fit.linear.r[r.index])
        square += (change**2).sum(axis=1)
        along += change @ ground.slopes[r.index]
    result: Array = square - np.einsum("ks,st,kt->k", along, ground.inverse, along)
    return result
