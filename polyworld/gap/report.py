"""Report the verdict with its evidence, and how it was reached, as plain data; motions side by side for pictures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.core.reported import Reported, json_ready
from polyworld.estimation.readout import CHANNELS
from polyworld.gap.experiment import Experiment
from polyworld.gap.fitting import Fitted
from polyworld.gap.residual_force import ResidualForce
from polyworld.gap.sealed import SealedGap, left_in_units
from polyworld.gap.set_aside import Aside
from polyworld.gap.verdict import Verdict, intervals
from polyworld.world import World

Array = NDArray[np.float64]

LISTED = 8  # hypotheses


@dataclass(frozen=True, repr=False)
class GapReport(Reported):
    """The outcome of the search for the gap.

    null: the base, fitted. pool: all hypotheses fitted to the end, best first. sealed: the gap on runs that no step has
    seen. set_aside: runs, or tails of runs, that no candidate predicts. limited: the time limit [s] that ended the
    search. experiment: the run that would decide where the verdict is ambiguous. force: the law of what stays
    unexplained. to_dict gives all of it as JSON-ready values.
    """

    verdict: Verdict
    null: Fitted
    pool: tuple[Fitted, ...]
    sealed: SealedGap | None
    set_aside: tuple[Aside, ...]
    cautions: tuple[str, ...]
    history: tuple[dict[str, object], ...]
    substep: float
    limited: float | None = None
    experiment: Experiment | None = None
    force: ResidualForce | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the effects of the best hypothesis, empty where nothing is missing."""
        return tuple(p.candidate.name for p in self.verdict.best.hypothesis.parts)

    @property
    def world(self) -> World:
        """The child world with the effects, fitted."""
        fitted = self.verdict.best.hypothesis.fitted_world(self.verdict.best.values)
        return fitted.with_substep(self.substep)

    def summary(self) -> str:
        """Return the verdict, every effect with its unknowns and 95% intervals, and errors on data left out."""
        v = self.verdict
        named = " and ".join(self.names) or "nothing"
        lines = [
            f"{v.kind}: {named}" if v.kind.startswith(("identified", "nothing")) else f"{v.kind}; nearest: {named}"
        ]
        for effect in effects_of(v.best):
            for name, row in effect["unknowns"].items():
                low, high = row["interval95"]
                unit = "" if row["unit"] == "1" else f" {row['unit']}"
                lines.append(f"  {effect['name']}, {name}: {row['value']:.4g}{unit}, 95% {low:.4g} to {high:.4g}")
        lines.append(f"  error on data left out: {v.before:.3g} standard deviations before, {v.after:.3g} after")
        others = [" and ".join(p.candidate.name for p in f.hypothesis.parts) or "nothing" for f in v.competitors]
        lines += [f"  as near: {', '.join(others)}"] if others else []
        lines += [f"  {text}" for text in (*v.reasons, *self.cautions)]
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values; numbers that are not finite become None."""
        v = self.verdict
        _, floor, unit = left_in_units(v.best)
        payload = {
            "verdict": v.kind,
            "reasons": list(v.reasons),
            "effects": effects_of(v.best),
            "equivalent": [_listed(f) for f in v.equivalent],
            "competitors": [_listed(f) for f in v.competitors],
            "frequencies": v.frequencies,
            "stable": v.stable,
            "error": {"before": v.before, "after": v.after, "unit": "standard deviations of the noise"},
            "noise": {"position": floor, "unit": unit},
            "independent_share": v.share,
            "plain_laws": [_listed(f) for f in plain_laws(self.pool)],
            "hypotheses": [_listed(f) for f in self.pool[:LISTED]],
            "base": {u.name: float(x) for u, x in zip(self.null.hypothesis.base, v.best.values, strict=False)},
            "sealed": None if self.sealed is None else self.sealed.to_json(),
            "set_aside": [a.to_json() | {"summary": a.summary()} for a in self.set_aside],
            "experiment": None if self.experiment is None else self.experiment.to_dict(),
            "residual_force": None if self.force is None else self.force.to_dict(),
            "cautions": list(self.cautions),
            "time_limit": self.limited,
            "world": self.world.model_dump(mode="json"),
            "history": list(self.history),
        }
        result: dict[str, Any] = json_ready(payload)
        return result


def plain_laws(pool: Sequence[Fitted]) -> list[Fitted]:
    """Return plain laws alone and in pairs, best first."""
    return [f for f in pool if f.hypothesis.parts and all(p.candidate.plain for p in f.hypothesis.parts)]


def effects_of(fitted: Fitted) -> list[dict[str, Any]]:
    """Return every effect of a hypothesis with its fitted unknowns and their 95% intervals."""
    found = []
    ends = intervals(fitted)
    for i, part in enumerate(fitted.hypothesis.parts):
        at = fitted.hypothesis.of_part(i)
        unknowns = {
            u.name: {
                "value": float(v),
                "unit": u.unit,
                "interval95": [float(e[0]), float(e[1])],
                "paths": list(u.paths),
            }
            for u, v, e in zip(part.shared, fitted.values[at], ends[at], strict=True)
        }
        found.append(
            {
                "name": part.candidate.name,
                "label": part.variant.label,
                "law": part.candidate.law,
                "same_as": list(part.variant.same_as),
                "unknowns": unknowns,
            }
        )
    return found


def _listed(fitted: Fitted) -> dict[str, Any]:
    """Return a hypothesis in short."""
    return {
        "effects": [p.candidate.name for p in fitted.hypothesis.parts],
        "labels": [p.variant.label for p in fitted.hypothesis.parts],
        "values": {u.name: float(v) for u, v in zip(fitted.hypothesis.unknowns, fitted.values, strict=True)},
        "score": fitted.total,
        "error": fitted.error,
    }


@dataclass(frozen=True)
class Compared:
    """One object in one run: times (T,) [s] from the run's start; observed and simulated positions (T, 3) [m], NaN
    where not measured; residual (T, 3): simulated less observed, in standard deviations of the noise. turning: the same
    of rotations and spins, by kind, as far as they were measured."""

    run: str
    name: str
    times: Array
    observed: Array
    simulated: Array
    residual: Array
    turning: Mapping[str, Array] = field(default_factory=dict)

    @property
    def size(self) -> Array:
        """Root mean square over the measured components (T,), NaN where none was measured."""
        count = np.isfinite(self.residual).sum(axis=1)
        total = np.nansum(self.residual**2, axis=1)
        size: Array = np.sqrt(np.where(count > 0, total / np.maximum(count, 1), np.nan))
        return size


def compared(fitted: Fitted) -> tuple[Compared, ...]:
    """Compare every object of every run with what a fitted hypothesis makes of it."""
    found: list[Compared] = []
    for run, readout, one in zip(fitted.ground.recording.runs, fitted.ground.readouts, fitted.slopes, strict=True):
        grid = readout.grid(one.residuals)
        for column, name in enumerate(run.names):
            first = CHANNELS * column
            residual, turn, spin = (grid[:, first + 3 * k : first + 3 * k + 3] for k in range(3))
            observed = run.positions[:, column]
            apart = residual * readout.sigma[:, first : first + 3]
            if column in readout.tangents:  # along the arc, from the one coordinate that was compared
                tangent = readout.tangents[column]
                along = np.nansum(apart * tangent, axis=1) / np.nansum(np.isfinite(apart) * tangent**2, axis=1)
                apart = along[:, None] * tangent
            simulated = observed + apart
            turning = {k: v for k, v in (("rotation", turn), ("spin", spin)) if np.isfinite(v).any()}
            times = run.times - run.times[0] + run.lead
            found.append(Compared(run.name, name, times, observed, simulated, residual, turning))
    return tuple(found)
