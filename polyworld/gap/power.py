"""Estimate the power of a design: how strong an effect has to be to be noticed.

A strength s off neutral changes residuals by s times their slope, less what initial states and fitted unknowns take up.
With the slope's length L in standard deviations of what the fit leaves, it gains s^2 L^2 / 2 nats, of correlated
residuals their independent share. It is noticed where that exceeds what a hypothesis has to gain to be chosen.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.unknown import Unknown
from polyworld.gap.candidate import Candidate
from polyworld.gap.fitting import Fitted, independent_share
from polyworld.gap.hypothesis import Hypothesis, extended, starts_of
from polyworld.gap.propose import Projection

Array = NDArray[np.float64]

STARTS = 4  # of an effect with a place or a clock, spread over all of its own, at which slopes are taken
ROUNDING = 1e-6  # share of a change that rounding leaves of one that is taken up; in standard deviations, of none


@dataclass(frozen=True)
class Power:
    """How strong one way to add an effect has to be to be noticed.

    unknown, unit: the strength; empty for an effect that was not asked about, since it changes courses at once and no
    slope shows that. strength: least departure from neutral that is noticed, the median over places; infinite where
    none within bounds is. typical: an ordinary departure.
    """

    effect: str
    label: str = ""
    unknown: str = ""
    unit: str = ""
    strength: float = np.inf
    typical: float = 0.0

    @property
    def seen(self) -> bool:
        """Whether an ordinary strength would be noticed."""
        return self.strength <= self.typical

    def summary(self) -> str:
        """Describe the power in words."""
        name = f"{self.effect} ({self.label})" if self.label else self.effect
        if not self.unknown:
            return f"{name}: not asked about, since it changes courses at once."
        if not np.isfinite(self.strength):
            return f"{name}: cannot be seen in these data, at no {self.unknown} within its bounds."
        ordinary = f"an ordinary one ({self.typical:.3g}) {'would have been seen' if self.seen else 'could be missed'}"
        return f"{name}: seen from {self.unknown} {self.strength:.3g} {self.unit} off neutral on; {ordinary}."

    def to_json(self) -> dict[str, object]:
        """Return JSON-ready values."""
        strength = self.strength if np.isfinite(self.strength) else None
        judged = {"asked": bool(self.unknown), "seen": self.seen, "summary": self.summary()}
        return asdict(self) | {"strength": strength} | judged


def power_check(fitted: Fitted, library: Sequence[Candidate]) -> list[Power]:
    """Estimate the power against every way to add each candidate, weakest first and those not asked last.

    Effects that the hypothesis holds, and unknowns whose parameters it fits, are left out.
    """
    projection, share = Projection(fitted), independent_share(fitted)
    taken = {path for u in fitted.hypothesis.unknowns for path in u.paths}
    found: list[Power] = []
    for candidate in library:
        for hypothesis in extended(fitted.hypothesis, candidate, fitted.ground.recording):
            part = hypothesis.parts[-1]
            if part.sudden:
                found.append(Power(candidate.name))
                break
            acting: dict[tuple[str, ...], list[Unknown]] = {}
            for u in part.variant.unknowns:
                if u.name not in part.variant.idle and not taken & set(u.paths):
                    acting.setdefault(u.paths, []).append(u)  # those of single runs together
            if acting:
                lengths = _lengths(fitted, hypothesis, list(acting.values()), projection) * np.sqrt(share)
                found += _rows(fitted, hypothesis, list(acting.values()), lengths)
    return sorted(found, key=lambda p: (not p.unknown, p.typical / p.strength, p.effect, p.label, p.unknown))


def _rows(fitted: Fitted, hypothesis: Hypothesis, groups: Sequence[Sequence[Unknown]], lengths: Array) -> list[Power]:
    settings, part = fitted.ground.settings, hypothesis.parts[-1]
    asked = settings.nats + hypothesis.cost(settings) - fitted.hypothesis.cost(settings)
    found = []
    for (u, *_), own in zip(groups, lengths.T, strict=True):
        if np.isnan(own).all() and not np.isnan(lengths).all():
            continue  # a place, which does nothing while its effect is off
        least = float(np.sqrt(2.0 * asked) / max(float(np.median(np.nan_to_num(own))), 1e-300))
        least = least if least <= max(u.upper - u.start, u.start - u.lower) else np.inf
        name = u.name if u.run is None else u.paths[0].rsplit(".", 1)[-1]
        found.append(Power(part.candidate.name, part.variant.label, name, u.unit, least, u.typical))
    return found


def _lengths(
    fitted: Fitted, hypothesis: Hypothesis, groups: Sequence[Sequence[Unknown]], projection: Projection
) -> Array:
    """Return the lengths (K, G) of the slopes by groups of unknowns at K starts, in standard deviations of what the fit
    leaves; NaN where nothing moves."""
    ground, part = fitted.ground, hypothesis.parts[-1]
    starts = starts_of(hypothesis)
    chosen = np.linspace(0, len(starts) - 1, STARTS).astype(int) if part.variant.idle else [0]
    starts = starts[np.unique(chosen)]
    k, g, first = len(starts), len(groups), len(fitted.values)
    steps = np.array([ground.settings.probe * u.typical * (1.0 if u.upper > u.start else -1.0) for u, *_ in groups])
    values = np.concatenate([np.repeat(fitted.values[None], k, axis=0), starts], axis=1)
    jobs = []
    for run, (block,), own in zip(
        ground.recording.runs, ground.problem(hypothesis).runs, fitted.of_states(), strict=True
    ):
        extra = [u for u in part.own if u.run == run.name]
        shared, states = np.repeat(values[:, None], g + 1, axis=1), np.zeros((k, g + 1, len(own) + len(extra)))
        states[...] = [*own, *(u.start for u in extra)]
        for j, group in enumerate(groups):
            for u in group:
                if u.run is None:
                    shared[:, 1 + j, first + part.shared.index(u)] += steps[j]
                elif u.run == run.name:
                    states[:, 1 + j, len(own) + extra.index(u)] += steps[j]
        jobs.append((block, shared.reshape(k * (g + 1), -1), states.reshape(k * (g + 1), -1)))
    left, whole = [], np.zeros(k * g)
    for r, one in enumerate(fitted.problem.evaluate(jobs, 1.0)):
        moved = one.residuals.reshape(k, g + 1, -1)
        change = (moved[:, 1:] - moved[:, :1]).reshape(k * g, -1).T
        left.append(projection.off_states(r, change))
        whole += (change**2).sum(axis=0)
    length = np.linalg.norm(projection.off_shared(np.concatenate(left)), axis=0)
    length[length <= ROUNDING * np.sqrt(whole)] = 0.0
    length[whole <= ROUNDING**2] = np.nan
    found: Array = length.reshape(k, g) / np.abs(steps) / fitted.scale
    return found
