"""Numbers behind the pictures of a gap: residuals of every run and object, and sudden changes of velocity.

They are kept in the record that keeps the outcome, not in the evidence, which only names that record.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.gap.kinks import kinks
from polyworld.gap.report import Compared
from polyworld.gap.sealed import Split
from polyworld.world import World

Array = NDArray[np.float64]

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
class Jump:
    """A sudden change (3,) [m/s] of an object's velocity that nothing known explains, its time [s] since the start of
    the run, place (3,) [m], and the standard deviation [m/s] of the change."""

    run: str
    name: str
    time: float
    place: Array
    change: Array
    sigma: float

    @property
    def size(self) -> float:
        """Size of the change [m/s]."""
        return float(np.linalg.norm(np.nan_to_num(self.change)))


@dataclass(frozen=True)
class GapNumbers:
    """Residuals, and jumps, which are None where none were looked for."""

    residuals: tuple[Residuals, ...]
    jumps: tuple[Jump, ...] | None = None

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
            Jump(run, name, float(row[0]), row[1:4], row[4:7], float(row[7]))
            for (run, name), row in zip(document["jumps"], rows, strict=True)
        )
        return cls(residuals, jumps)


def residuals_of(
    before: Sequence[Compared], after: Sequence[Compared] | None = None, sealed: Split | None = None
) -> tuple[Residuals, ...]:
    """Return the residuals of runs compared without an effect and, where one was fitted, with it.

    sealed: the split whose held-out data these are; the later part of the only run goes by the clock of the whole.
    """
    late = sealed.into if sealed is not None else 0.0
    others: Sequence[Compared | None] = after or [None] * len(before)
    found = []
    for item, other in zip(before, others, strict=True):
        run = sealed.fitted.runs[0].name if sealed is not None and late else item.run
        nothing = np.full(item.observed.shape, np.nan)
        beside = {} if other is None else {"position": other.residual, **other.turning}
        for kind, residual in {"position": item.residual, **item.turning}.items():
            one, two = nothing, nothing
            if kind == "position":
                one, two = item.simulated, nothing if other is None else other.simulated
            values = (item.observed, one, residual, two, beside.get(kind, nothing))
            found.append(Residuals(run, item.name, kind, sealed is not None, item.times + late, *values))
    return tuple(found)


def jumps_of(world: World, recording: Recording) -> tuple[Jump, ...]:
    """Return the sudden changes of velocity in a recording that nothing in the world explains, the largest first."""
    return tuple(
        Jump(k.run, k.name, k.time - recording.run(k.run).origin, k.place, k.jump, k.sigma)
        for k in kinks(world, recording)
    )


def worst_series(residuals: Sequence[Residuals]) -> list[dict[str, Any]]:
    """Return the root mean square residual of every series in standard deviations of the noise, the largest first."""
    found = [
        {"run": s.run, "name": s.name, "kind": s.kind, "axis": "xyz"[a], "error": float(np.sqrt(np.nanmean(r**2)))}
        for s in residuals
        for a, r in enumerate(s.residual_before.T)
        if np.isfinite(r).any()
    ]
    return sorted(found, key=lambda item: -float(item["error"]))
