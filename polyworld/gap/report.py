"""Report the verdict with its evidence, and how it was reached, as plain data."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.gap import ebic
from polyworld.gap.checks import Check
from polyworld.gap.decide import RunnerUp, Stability, Verdict
from polyworld.gap.held_out import HeldOutGap
from polyworld.gap.null_control import NullControl
from polyworld.gap.outlying import OutlyingRun
from polyworld.gap.remainder import Remainder
from polyworld.gap.settings import DecisionSettings
from polyworld.gap.stability import equivalents
from polyworld.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GapReport:
    """The outcome of the search for the gap.

    intervals (S, 2): 95%, of the best hypothesis' unknowns. world: child with the effects, fitted; None where nothing
    is missing. near_misses: effects that would lower the misfit of data that are explained already. cautions: what the
    recording cannot determine. history: every step with its figures. set_aside: runs that behave unlike the rest, which
    nothing was fitted to. checks: what contradicted the verdict and lowered it. plain: fits of the plain laws.
    remainder: what the answer leaves undone. limited: the time limit [s] that ended the search. to_dict gives all of
    it as JSON-ready values.
    """

    verdict: Verdict
    context: FitContext = field(repr=False)
    base: FittedHypothesis = field(repr=False)
    intervals: Array
    world: World | None
    held_out: HeldOutGap | None
    null: NullControl | None
    experiment: dict[str, Any] | None
    residual_force: dict[str, Any] | None
    near_misses: tuple[dict[str, Any], ...]
    cautions: tuple[str, ...]
    history: tuple[dict[str, Any], ...]
    set_aside: tuple[OutlyingRun, ...] = ()
    checks: tuple[Check, ...] = ()
    plain: tuple[FittedHypothesis, ...] = ()
    remainder: Remainder | None = None
    limited: float | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects of the best hypothesis, empty where nothing is missing."""
        return self.verdict.best.hypothesis.names if self.verdict.best is not None else ()

    def _effects(self) -> list[dict[str, Any]]:
        """Return the effects named, each with those that these data cannot distinguish from it."""
        best = self.verdict.best
        if best is None:
            return []
        found = effects_of(best, self.intervals)
        if self.verdict.stability is not None:
            alike = equivalents([*self.plain, best], DecisionSettings().chance)
            for effect in found:
                known = alike.get(effect["name"], frozenset())
                effect["same_as"] = sorted({*effect["same_as"], *known} - {effect["name"]})
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values; numbers that are not finite become None."""
        best = self.verdict.best
        judged = best if best is not None else self.base
        payload = {
            "verdict": self.verdict.kind,
            "checks": [{"check": c.name, "found": c.found} for c in self.checks],
            "set_aside": [o.to_json() | {"summary": o.summary()} for o in self.set_aside],
            "stability": None if self.verdict.stability is None else _stability(self.verdict.stability),
            "plain_laws": [_plain(t, judged) for t in self.plain],
            "remainder": None if self.remainder is None else self.remainder.to_json(),
            "time_limit": self.limited,
            "effects": self._effects(),
            "credible_set": [list(t.hypothesis.names) for t in self.verdict.credible],
            "other_forms": [t.hypothesis.title for t in self.verdict.forms],
            "runner_up": _runner_up(self.verdict.runner_up),
            "experiment": self.experiment,
            "residual_force": self.residual_force,
            "noise": self.context.noise.to_json(),
            "goodness": judged.goodness.to_json(),
            "sealed": None if self.held_out is None else self.held_out.to_dict(),
            "null_control": None if self.null is None else self.null.to_dict(),
            "near_misses": list(self.near_misses),
            "cautions": list(self.cautions),
            "base": {
                "unknowns": _unknowns(judged, 0, len(judged.hypothesis.base), self.intervals),
                "passes": self.base.passes,
                "chi2": self.base.chi2,
            },
            "world": None if self.world is None else self.world.model_dump(mode="json"),
            "history": list(self.history),
        }
        result: dict[str, Any] = finite(payload)
        return result


def effects_of(trial: FittedHypothesis, intervals: Array) -> list[dict[str, Any]]:
    """Return every effect of a hypothesis with its fitted unknowns and their 95% intervals."""
    found = []
    at = len(trial.hypothesis.base)
    for part in trial.hypothesis.parts:
        count = len(part.variant.unknowns)
        found.append(
            {
                "name": part.candidate.name,
                "label": part.variant.label,
                "law": part.candidate.law,
                "same_as": list(part.variant.same_as),
                "unknowns": _unknowns(trial, at, count, intervals),
            }
        )
        at += count
    return found


def _unknowns(trial: FittedHypothesis, first: int, count: int, intervals: Array) -> dict[str, dict[str, Any]]:
    payload = {}
    for i in range(first, first + count):
        u = trial.hypothesis.unknowns[i]
        payload[u.name] = {
            "value": float(trial.values[i]),
            "unit": u.unit,
            "interval95": [float(v) for v in intervals[i]] if i < len(intervals) else None,
            "paths": list(u.paths),
        }
    return payload


def _plain(trial: FittedHypothesis, best: FittedHypothesis) -> dict[str, Any]:
    """Return a plain law, fitted by itself, beside the answer."""
    (part,) = trial.hypothesis.parts
    return {
        "name": part.candidate.name,
        "label": part.variant.label,
        "values": {
            u.name: float(trial.values[len(trial.hypothesis.base) + i]) for i, u in enumerate(part.variant.unknowns)
        },
        "chi2": trial.chi2,
        "ebic_behind": ebic.behind(trial, best),
        "passes": trial.passes,
    }


def _stability(found: Stability) -> dict[str, Any]:
    """Return the comparison with model error admitted."""
    return {
        "chosen_in": found.support,
        "held_out_gain": found.held_out.gain,
        "held_out_error": found.held_out.error,
        "ebic_ahead": found.ahead,
        "model_error": found.error.size,
        "competitors": [list(names) for names in found.competitors],
        "reasons": list(found.reasons),
    }


def _runner_up(found: RunnerUp | None) -> dict[str, Any] | None:
    if found is None:
        return None
    return {
        "effects": list(found.trial.hypothesis.names),
        "ebic_behind": found.ebic_behind,
        "held_out_behind": found.held_out.gain,
        "held_out_error": found.held_out.error,
        "passes": found.trial.passes,
    }


def finite(value: Any) -> Any:
    """Return the same with None for every number that JSON cannot hold."""
    if isinstance(value, dict):
        return {k: finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [finite(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
