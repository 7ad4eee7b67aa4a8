"""Numbers behind the pictures of a gap: residuals of every run and object, and jumps between segments.

They are kept in the record that keeps the outcome, not in the evidence, which only names that record.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.gap.comparison import Compared, compared
from polyworld.gap.held_out import Split
from polyworld.gap.segment_jumps import SegmentJump

Array = NDArray[np.float64]
Clocks = Mapping[str, tuple[str, float]]

COLUMNS = ("times", "observed", "before", "residual_before", "after", "residual_after")


@dataclass(frozen=True)
class Residuals:
    """One kind of measurement (position, rotation, spin) of one object in one run, or in a part of it.

    times (T,) [s] since the start of the whole run. observed, before, after (T, 3) [m]: measured, and simulated without
    an effect and with it; residual_before, residual_after (T, 3): simulated less observed in standard deviations. NaN
    where nothing was measured, and in all of after where no effect was fitted; before and after are those of positions
    alone. held_out: no step fitted these data.
    """

    run: str
    name: str
    kind: str
    held_out: bool
    times: Array
    observed: Array
    before: Array
    residual_before: Array
    after: Array
    residual_after: Array


@dataclass(frozen=True)
class GapNumbers:
    """Residuals, and jumps with times since their run's start; jumps are None where none were computed."""

    residuals: tuple[Residuals, ...]
    jumps: tuple[SegmentJump, ...] | None = None

    def to_record(self) -> tuple[dict[str, Any], dict[str, NDArray[np.float32]]]:
        """Return the JSON part and the arrays, those of all series end to end."""
        document = {
            "residuals": [[s.run, s.name, s.kind, s.held_out, len(s.times)] for s in self.residuals],
            "jumps": None if self.jumps is None else [[j.run, j.name] for j in self.jumps],
        }
        arrays = {
            f"residuals.{column}": np.concatenate([getattr(s, column) for s in self.residuals]).astype(np.float32)
            for column in COLUMNS
            if self.residuals
        }
        rows = [[j.time, *j.place, *j.change, j.sigma] for j in self.jumps or ()]
        if rows:
            arrays["jumps"] = np.array(rows, dtype=np.float32)
        return document, arrays

    @classmethod
    def of_record(cls, document: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Self:
        """Read what `to_record` returned."""
        listed = document["residuals"]
        ends = np.cumsum([count for *_, count in listed])[:-1]
        columns = [np.split(arrays[f"residuals.{column}"].astype(float), ends) for column in COLUMNS if listed]
        residuals = tuple(
            Residuals(run, name, kind, held_out, *parts)
            for (run, name, kind, held_out, _), *parts in zip(listed, *columns, strict=True)
        )
        if document["jumps"] is None:
            return cls(residuals)
        rows = arrays["jumps"].astype(float) if document["jumps"] else ()
        jumps = tuple(
            SegmentJump(run, name, float(row[0]), row[1:4], row[4:7], float(row[7]))
            for (run, name), row in zip(document["jumps"], rows, strict=True)
        )
        return cls(residuals, jumps)


def clocks_of(parts: Split) -> dict[str, tuple[str, float]]:
    """Return the whole run that each run of the data belongs to, and what its clock [s] reads at the run's start."""
    found = {run.name: (run.name, run.origin) for run in parts.fitted.runs}
    for run in () if parts.held_out is None else parts.held_out.runs:
        # The later part of the only run goes by the clock of the whole.
        found[run.name] = found[parts.fitted.runs[0].name] if parts.into else (run.name, run.origin)
    return found


def compared_trial(trial: FittedHypothesis) -> tuple[Compared, ...]:
    """Compare what a fitted hypothesis makes of its data with them."""
    return compared(trial.context.forward(trial.hypothesis), trial.context.noise, trial.fit)


def residuals_of(
    trial: FittedHypothesis,
    before: Sequence[Compared],
    after: Sequence[Compared] | None,
    clocks: Clocks,
    *,
    held_out: bool = False,
) -> tuple[Residuals, ...]:
    """Return the residuals of runs compared without an effect and with it; before is that of the trial."""
    runs = {own.run.name: own.run for own in trial.context.design.runs}
    others = {(item.run, item.name): item for item in after or ()}
    found = []
    for item in before:
        own = runs[item.run]
        run, origin = clocks[own.part_of or own.name]
        nothing = np.full(item.observed.shape, np.nan)
        other = others.get((item.run, item.name))
        if other is not None and other.times.shape != item.times.shape:
            other = None  # fitted to other parts of the run
        times = item.times + (own.origin - origin)
        after_residual, after_simulated = (nothing, nothing) if other is None else (other.residual, other.simulated)
        found.append(
            Residuals(
                run,
                item.name,
                "position",
                held_out,
                times,
                item.observed,
                item.simulated,
                item.residual,
                after_simulated,
                after_residual,
            )
        )
        for kind, residual in item.turning.items():
            turned = nothing if other is None else other.turning.get(kind, nothing)
            found.append(
                Residuals(run, item.name, kind, held_out, times, item.observed, nothing, residual, nothing, turned)
            )
    return tuple(found)


def since_start(jumps: Iterable[SegmentJump] | None, clocks: Clocks) -> tuple[SegmentJump, ...] | None:
    """Return jumps with times since the start of their runs."""
    if jumps is None:
        return None
    return tuple(
        SegmentJump(clocks[j.run][0], j.name, j.time - clocks[j.run][1], j.place, j.change, j.sigma) for j in jumps
    )
