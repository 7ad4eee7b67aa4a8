"""Fitted parameters of a case with their spread, from the records of FitWorld and AddEffect."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from atw_mcp.cases.origins import SAMPLE
from atw_mcp.viewer.document import Curve, FittedParameter, FitView
from atw_mcp.viewer.packing import Blocks
from evidence_store import Content, Evidence, EvidenceStore, RecordDamaged, UnknownRecord

NORMAL95 = 1.959964  # standard deviations on either side that hold 95% of a normal distribution


def fit_views(store: EvidenceStore, case: str, blocks: Blocks, missing: list[str]) -> list[FitView]:
    """Return the fits of a case, oldest first; says in `missing` what cannot be shown of them.

    What ModelVideo fitted is in the record of its own FitWorld.
    """
    views = []
    for tool in ("FitWorld", "AddEffect"):
        for head in store.evidence.of_case(case, tool=tool):
            if head.status not in ("completed", "cancelled"):
                continue
            try:
                record = store.evidence.get(head.id)
                data = record.payload["data"]
                if tool == "AddEffect":
                    views.append(_added(record, data))
                else:
                    views.append(_fitted(store, record, data, blocks, missing))
            except RecordDamaged:
                missing.append(f"The fit of {head.id} is not shown: its record is damaged.")
            except (KeyError, TypeError, ValueError) as error:  # as another version wrote it
                missing.append(f"The fit of {head.id} is not shown: its record lacks {error}.")
    return sorted(views, key=lambda view: int(view.evidence.removeprefix("ev-")))


@dataclass(frozen=True)
class _Known:
    """Further records of a fit: which parameters were searched on a logarithmic scale, and the sample by name."""

    logarithmic: frozenset[str] = frozenset()
    columns: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    from_bounds: frozenset[str] = frozenset()


def _fitted(
    store: EvidenceStore, record: Evidence, data: Mapping[str, Any], blocks: Blocks, missing: list[str]
) -> FitView:
    known = _known(store, record, missing)
    notes = _notes(data.get("undetermined", []))
    parameters = [_parameter(value, known, notes, blocks) for value in data["values"]]
    fitted = {value["name"] for value in data["values"]}
    for name, column in known.columns.items():
        if name not in fitted:
            parameters.append(_unfitted(name, column, known, notes, blocks))
    return FitView(
        evidence=record.id,
        source_world=data.get("from_world"),
        world=data.get("world"),
        summary=record.summary,
        parameters=parameters,
        curve=Curve.model_validate(data["curve"]) if data.get("curve") else _curve(data.get("history", [])),
    )


def _parameter(value: Mapping[str, Any], known: _Known, notes: Mapping[str, str], blocks: Blocks) -> FittedParameter:
    name, at, error = str(value["name"]), float(value["value"]), value.get("standard_error")
    logarithmic = name in known.logarithmic
    column = known.columns.get(name)
    return FittedParameter(
        name=_short(name),
        value=at,
        unit=value["unit"],
        interval95=interval(at, error, value["bounds"], logarithmic=logarithmic),
        bounds=value["bounds"],
        at_bound=value["at_bound"],
        sample=None if column is None else blocks.floats(column),
        logarithmic=logarithmic,
        note=notes.get(_short(name), ""),
    )


def _unfitted(
    name: str, column: NDArray[Any], known: _Known, notes: Mapping[str, str], blocks: Blocks
) -> FittedParameter:
    """Return a parameter that was not fitted and that the sample varies, because the observations leave it open."""
    varied = "within its bounds" if name in known.from_bounds else "as far as it was measured"
    return FittedParameter(
        name=_short(name),
        value=float(column[0]),
        unit=known.units[name],
        interval95=None,
        bounds=None,
        at_bound=False,
        sample=blocks.floats(column),
        note=notes.get(_short(name)) or f"not fitted; the sample varies it {varied}",
    )


def interval(value: float, error: float | None, bounds: list[float], *, logarithmic: bool) -> list[float | None] | None:
    """Return the 95% interval of a standard error, within the bounds of the search; None where there is no error.

    On a logarithmic scale the standard error of the logarithm is that of the value over the value.
    """
    if error is None or not math.isfinite(error):
        return None
    if logarithmic:
        factor = math.exp(min(NORMAL95 * error / value, 700.0))
        low, high = value / factor, value * factor
    else:
        low, high = value - NORMAL95 * error, value + NORMAL95 * error
    return [max(low, min(bounds[0], value)), min(high, max(bounds[1], value))]


def _added(record: Evidence, data: Mapping[str, Any]) -> FitView:
    parameters = [
        FittedParameter(
            name=f"{effect['name']}.{name}",
            value=number["value"],
            unit=number["unit"],
            interval95=number["interval95"],
            bounds=None,
            at_bound=False,
            sample=None,
        )
        for effect in data["effects"]
        for name, number in effect["unknowns"].items()
    ]
    return FitView(
        evidence=record.id,
        source_world=data["from_world"],
        world=data["world"],
        summary=record.summary,
        parameters=parameters,
        curve=None,
    )


def _known(store: EvidenceStore, record: Evidence, missing: list[str]) -> _Known:
    """Return what the fit and the sample of the fitted world say."""
    if record.world is None:
        return _Known()
    try:
        logarithmic = _logarithmic(store, record)
        sample = store.fits.find(SAMPLE, {"world": record.world})
    except RecordDamaged:
        missing.append(
            f"The sample of the fit of {record.id} is not shown: its record, or that of the fit, is damaged."
        )
        return _Known()
    if sample is None:
        return _Known(logarithmic)
    return _with_sample(sample, logarithmic)


def _with_sample(sample: Content, logarithmic: frozenset[str]) -> _Known:
    unknowns = sample.document["unknowns"]
    return _Known(
        logarithmic=logarithmic,
        columns={u["name"]: sample.arrays["values"][:, i] for i, u in enumerate(unknowns)},
        units={u["name"]: u["unit"] for u in unknowns},
        from_bounds=frozenset(sample.document["from_bounds"]),
    )


def _logarithmic(store: EvidenceStore, record: Evidence) -> frozenset[str]:
    """Names of the parameters that were searched on a logarithmic scale; a cancelled fit left no record of that."""
    assert record.world is not None
    kept = [d.detail["fit"] for d in store.worlds.parents(record.world) if d.how == "fitted" and "fit" in d.detail]
    try:
        inputs = store.fits.get(kept[-1]).inputs if kept else {}
    except UnknownRecord:
        inputs = {}
    return frozenset(item["name"] for item in inputs.get("parameters", []) if item.get("scale") == "log")


def _notes(undetermined: list[Mapping[str, Any]]) -> dict[str, str]:
    """Why parameters are not determined, by name; the others of a combination are named."""
    found: dict[str, dict[str, None]] = {}  # reasons in order, each once
    for item in undetermined:
        names = [_short(name) for name in item["parameters"]]
        for name in names:
            others = ", ".join(other for other in names if other != name)
            reason = f"determined only in combination with {others}" if others else item["reason"]
            found.setdefault(name, {})[reason] = None
    return {name: "; ".join(reasons) for name, reasons in found.items()}


def _curve(history: list[Mapping[str, Any]]) -> Curve | None:
    """Return the losses of all searches one after another, with an empty step between two, so that no line joins them.

    They are all that fits of earlier versions kept. A loss is the mean square deviation from the observations, in their
    variances, over the samples that the search had come to, so it may rise where it goes on to more of them.
    """
    steps: list[float] = []
    current: list[float | None] = []
    best: list[float | None] = []
    before = None
    for number, point in enumerate(history, start=1):
        if before is not None and point["restart"] != before:
            steps.append(number - 0.5)
            current.append(None)
            best.append(None)
        before = point["restart"]
        steps.append(float(number))
        current.append(point["median"])
        best.append(point["best"])
    if not steps:
        return None
    return Curve(step="generation", steps=steps, current=current, best=best, unit="σ²")


def _short(name: str) -> str:
    return name.removeprefix("objects.")
