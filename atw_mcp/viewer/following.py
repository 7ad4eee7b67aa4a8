"""How far answers can be trusted: how well worlds follow the data, and what ensembles say of the statements asked."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from atw_mcp.viewer.document import Chance
from atw_mcp.viewer.world_parts import Following
from evidence_store import EvidenceStore, RecordDamaged, UnknownRecord

RANK = ("good", "doubtful", "poor")
UNREADABLE = (RecordDamaged, UnknownRecord, KeyError, TypeError, ValueError)


def followings(store: EvidenceStore, case: str) -> dict[str, Following]:
    """Return by world what FitWorld found of it, and ModelVideo where that is worse.

    Records that cannot be read are named by `fit_views`, which reads the same ones.
    """
    found: dict[str, Following] = {}
    for tool in ("FitWorld", "ModelVideo"):
        for head in store.evidence.of_case(case, tool=tool):
            if head.status not in ("completed", "cancelled"):
                continue
            try:
                data = store.evidence.get(head.id).payload["data"]
                if tool == "FitWorld":
                    found[data["world"]] = _fitted(head.id, data)
                elif "verdict" in data:
                    found[data["world"]] = _modelled(head.id, data, found.get(data["world"]))
            except UNREADABLE:
                continue
    return found


def _fitted(evidence: str, data: Mapping[str, Any]) -> Following:
    doubts = [str(text) for text in (data["why"], *data["warnings"]) if text]
    verdict: Any = "doubtful" if data["verdict"] == "good" and data["warnings"] else data["verdict"]
    return Following(
        evidence=evidence,
        verdict=verdict,
        rms=_rms(data.get("accuracy")),
        rms_held_out=_rms(data.get("held_out")),
        doubts=doubts,
    )


def _modelled(evidence: str, data: Mapping[str, Any], fitted: Following | None) -> Following:
    verdict: Any = data["verdict"]
    if fitted is not None and RANK.index(fitted.verdict) >= RANK.index(verdict):
        return fitted
    doubts = [*data["doubts"], *(() if fitted is None else fitted.doubts)]
    return Following(
        evidence=evidence,
        verdict=verdict,
        rms=None if fitted is None else fitted.rms,
        rms_held_out=None if fitted is None else fitted.rms_held_out,
        doubts=list(dict.fromkeys(map(str, doubts))),
    )


def _rms(accuracy: Mapping[str, Any] | None) -> float | None:
    return None if accuracy is None else accuracy.get("position_rmse")


def chances(store: EvidenceStore, evidence: Sequence[str]) -> list[Chance]:
    """Return the probabilities of all statements that Ask was asked about in this evidence."""
    found: list[Chance] = []
    for identifier in evidence:
        try:
            record = store.evidence.get(identifier)
            if record.tool == "Ask" and record.status == "completed":
                data = record.payload["data"]
                found += _asked(identifier, data.get("answers", [data]))
        except UNREADABLE:
            continue
    return found


def _asked(evidence: str, rows: Iterable[Mapping[str, Any]]) -> list[Chance]:
    return [
        Chance(
            evidence=evidence,
            statement=row["question"].replace("whether ", "", 1).replace("_", " "),
            probability=row["probability"],
            interval90=None,
            less_sure_because=row.get("less_sure_because") or "",
        )
        for row in rows
        if "probability" in row
    ]
