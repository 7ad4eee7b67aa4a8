"""Steps of the gap workflow as the viewer shows them: residuals, jumps, candidates, and what an effect is worth."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.gap.numbers import GapNumbers, Jump, Residuals
from atw_mcp.viewer import fit_parts
from atw_mcp.viewer.packing import Blocks
from atw_mcp.viewer.parts import Block
from evidence_store import Case, Evidence, EvidenceStore, StoreError

Array = NDArray[np.float64]

TOOLS = ("FindDiscrepancy", "ProposeEffects", "AddEffect")


def gap_views(store: EvidenceStore, case: Case, blocks: Blocks) -> tuple[list[fit_parts.GapView], list[str]]:
    """Return the completed steps of a case's gap workflow, oldest first, and sentences about what cannot be shown of
    them."""
    views: list[fit_parts.GapView] = []
    missing: list[str] = []
    older: list[str] = []
    for head in store.evidence.of_case(case.id):
        if head.tool not in TOOLS or head.status != "completed":
            continue
        try:
            record = store.evidence.get(head.id)
            numbers = _numbers(store, record)
            views.append(_view(record, numbers or GapNumbers(()), blocks))
        except (StoreError, ValueError, KeyError) as error:  # KeyError: as another version wrote it
            missing.append(f"The numbers of {head.id} ({head.tool}) cannot be shown: {str(error).rstrip('.')}.")
            continue
        if numbers is None:
            older.append(head.id)
    if older:
        missing.append(
            f"Residuals of {', '.join(older)} are not shown: an older version kept pictures of them, not numbers."
        )
    return views, missing


def _numbers(store: EvidenceStore, record: Evidence) -> GapNumbers | None:
    """Read the numbers behind a result; None where its version kept none."""
    kept = record.payload.get("record")
    if kept is None:
        return None
    content = store.fits.get(kept)
    numbers = content.document.get("numbers")
    return None if numbers is None else GapNumbers.of_record(numbers, content.arrays)


def _view(record: Evidence, numbers: GapNumbers, blocks: Blocks) -> fit_parts.GapView:
    data = record.payload["data"]
    runs = list(dict.fromkeys(item.run for item in numbers.residuals))
    names = {run: run if len(runs) > 1 else "" for run in runs}
    groups: dict[tuple[str, str, str], list[Residuals]] = {}
    for item in numbers.residuals:
        groups.setdefault((item.run, item.name, item.kind), []).append(item)
    sealed = data.get("sealed")
    worth = sealed or data.get("fitted_data") or {}
    return fit_parts.GapView(
        evidence=record.id,
        tool=record.tool,  # type: ignore[arg-type]  # one of TOOLS
        world=record.world,
        verdict=_verdict(record.tool, data),
        summary=record.summary,
        series=[
            _series(names[run], items, blocks)
            for (run, *_), items in groups.items()
            if any(np.isfinite(item.residual_before).any() for item in items)
        ],
        jumps=[_shown_jump(names[j.run], j, groups[j.run, j.name, "position"]) for j in numbers.jumps or ()],
        candidates=_candidates(record.tool, data),
        gap_before=worth.get("gap_before"),
        gap_after=worth.get("gap_after"),
        noise=worth.get("noise_floor"),
        gap_unit=worth.get("unit", "m"),
        gap_held_out=sealed is not None or not worth,
    )


def _series(run: str, parts: Sequence[Residuals], blocks: Blocks) -> fit_parts.GapSeries:
    """Join the parts of a run."""
    parts = sorted(parts, key=lambda part: part.times[0])

    def joined(values: Iterable[Array]) -> Block:
        return blocks.floats(np.concatenate(list(values)))

    with_effect = any(np.isfinite(part.residual_after).any() for part in parts)
    return fit_parts.GapSeries(
        run=run,
        object=parts[0].name,
        kind=parts[0].kind,  # type: ignore[arg-type]  # of the series of a design
        times=joined(part.times for part in parts),
        observed=joined(part.observed for part in parts),
        before=joined(part.before for part in parts),
        residual_before=joined(part.residual_before for part in parts),
        after=joined(part.after for part in parts) if with_effect else None,
        residual_after=joined(part.residual_after for part in parts) if with_effect else None,
        held_out=[[float(part.times[0]), float(part.times[-1])] for part in parts if part.held_out],
    )


def _shown_jump(run: str, jump: Jump, parts: Sequence[Residuals]) -> fit_parts.Jump:
    """Return a jump; where a body is along axes that no residual measures is taken from what was observed there."""
    times = np.concatenate([part.times for part in parts])
    observed = np.concatenate([part.observed for part in parts])
    near = observed[int(np.argmin(np.abs(times - jump.time)))]
    place = np.where(np.isfinite(jump.place), jump.place, np.nan_to_num(near))
    return fit_parts.Jump(
        run=run,
        object=jump.name,
        time=jump.time,
        sigmas=jump.size / jump.sigma,
        position=[float(value) for value in place],
        velocity_change=[float(value) for value in np.nan_to_num(jump.change)],
    )


def _verdict(tool: str, data: dict[str, Any]) -> str:
    if tool == "FindDiscrepancy":
        return "Nothing is missing" if data["explained"] else "Something is missing"
    if tool == "AddEffect":
        names = " and ".join(effect["name"] for effect in data["effects"])
        return f"With {names}, {'nothing is missing' if data['explains'] else 'something is still missing'}"
    titles = list(dict.fromkeys([data["title"], *(proposal["title"] for proposal in data["proposals"])]))
    return {
        "identified": f"Identified: {titles[0]}",
        "identified_with_remainder": f"Identified, with a remainder: {titles[0]}",
        "ambiguous": f"Ambiguous: {', '.join(titles[:-1])} or {titles[-1]}",
        "unexplained": "Unexplained: no known effect may be named",
        "nothing_missing": "Nothing is missing",
    }[data["verdict"]]


def _candidates(tool: str, data: dict[str, Any]) -> list[fit_parts.Candidate]:
    """Return what was proposed, the best of another name and the plain laws; or the effect that was added."""
    if tool == "FindDiscrepancy":
        return []
    if tool == "AddEffect":
        title = " + ".join(effect["name"] for effect in data["effects"])
        return [
            fit_parts.Candidate(title=title, behind=None, explains=data["explains"], values=_values(data["effects"]))
        ]
    others = [] if data["runner_up"] is None else [data["runner_up"]]
    found = {
        item["title"]: fit_parts.Candidate(
            title=item["title"], behind=item["behind"], explains=item["explains"], values=_values(item["effects"])
        )
        for item in reversed([*data["proposals"], *others, *data["plain_laws"]])
    }
    return sorted(found.values(), key=lambda c: np.inf if c.behind is None else c.behind)


def _values(effects: Sequence[dict[str, Any]]) -> list[fit_parts.FittedParameter]:
    several = len(effects) > 1
    return [
        fit_parts.FittedParameter(
            name=f"{effect['name']} {name}" if several else name,
            value=number["value"],
            unit=number["unit"],
            interval95=number["interval95"],
            bounds=None,
            at_bound=False,
            sample=None,
        )
        for effect in effects
        for name, number in effect["unknowns"].items()
    ]
