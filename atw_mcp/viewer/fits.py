"""Fitted parameters of a case with their spread, from the records of FitWorld and AddEffect."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from atw_mcp.cases.origins import SAMPLE
from atw_mcp.viewer.fit_parts import Curve, FittedParameter, FitView
from atw_mcp.viewer.packing import Blocks
from evidence_store import Evidence, EvidenceStore, RecordDamaged

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


def _fitted(
    store: EvidenceStore, record: Evidence, data: Mapping[str, Any], blocks: Blocks, missing: list[str]
) -> FitView:
    draws = _draws(store, record, missing)
    notes = _notes(data.get("undetermined", []))
    parameters = [_parameter(value, draws, notes, blocks) for value in data["values"]]
    return FitView(
        evidence=record.id,
        source_world=data.get("from_world"),
        world=data.get("world"),
        summary=record.summary,
        parameters=parameters,
        curve=Curve.model_validate(data["curve"]) if data.get("curve") else None,
    )


def _parameter(
    value: Mapping[str, Any], draws: Mapping[str, NDArray[Any]], notes: Mapping[str, str], blocks: Blocks
) -> FittedParameter:
    name, at, error = str(value["name"]), float(value["value"]), value.get("standard_error")
    logarithmic = value.get("scale") == "log"
    column = draws.get(name)
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


def _draws(store: EvidenceStore, record: Evidence, missing: list[str]) -> dict[str, NDArray[Any]]:
    """Return the draws of each constant that the sample of the fitted world keeps."""
    try:
        sample = None if record.world is None else store.fits.find(SAMPLE, {"world": record.world})
    except RecordDamaged:
        missing.append(f"The sample of the fit of {record.id} is not shown: its record is damaged.")
        return {}
    if sample is None:
        return {}
    return {name: sample.arrays[f"constants/{name}"] for name in sample.document.get("constants", [])}


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


def _short(name: str) -> str:
    return name.removeprefix("objects.")
