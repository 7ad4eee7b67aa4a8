"""The provenance graph of a case as the viewer draws it, from the lineage that the store writes as W3C PROV."""

from __future__ import annotations

import json
from pathlib import PurePath
from typing import Any

from atw_mcp.viewer.document import Edge, Node, Provenance
from atw_mcp.viewer.edits import branch_label, edit_words
from evidence_store import EvidenceStore
from evidence_store.lineage import Record, lineage

CONTENTS = {
    "observe": "objects",
    "world_tracks": "tracks",
    "imported_tracks": "tracks",
    "imported_shapes": "shapes",
    "fit": "values fitted",
    "posterior": "values sampled",
    "gap": "gap examined",
}
ORIGINS = {
    "built": "as built",
    "given": "as given",
    "fitted": "as fitted",
    "effect_added": "with an effect",
}
FILES = ("video", "data", "file", "path")  # arguments that are paths of this machine: their last part is shown
ARGUMENT, ARGUMENTS = 80, 400  # characters of a value and of all arguments that are shown


def provenance(store: EvidenceStore, case: str, missing: list[str]) -> Provenance:
    """Return the records that results of a case rest on; names in `missing` what is damaged and left out."""
    found = lineage(store, case)
    missing.extend(f"{name} is damaged and left out of the provenance graph." for name in found.unreadable)
    return Provenance(
        nodes=[_node(record, case) for record in found.records.values()],
        edges=[Edge(source=link.source, target=link.target, how=link.how) for link in found.derivations],
    )


def _node(record: Record, case: str) -> Node:
    title, detail = _words(record, case)
    return Node(id=record.id, kind=record.kind, title=title, detail=detail)


def _words(record: Record, case: str) -> tuple[str, str]:
    """Return a word or two for a record, and a sentence."""
    about, label = record.about, record.label
    match record.kind:
        case "case":
            file = PurePath(about["path"]).name
            return label if label != "none" else "case", f"{case}: {file}" if file else f"{case}, without a file"
        case "world":
            detail = about["detail"]
            committed = "; committed: what every probe starts from" if about["committed"] else ""
            return _origin(label, detail), f"{_made(label, detail)}{committed}"
        case "evidence":
            return label, _short(about["arguments"]) if "arguments" in about else "its record is not in this case"
        case "answer":
            return label, " ".join(part for part in (about["question"], about["missing"]) if part)
        case "rollout":
            inputs = json.loads(about["inputs"])
            members = f" of {inputs['members']} members" if "members" in inputs else ""
            until = f" until {inputs['horizon']:.4g} s" if "horizon" in inputs else ""
            return "ensemble" if members else "rollout", f"motion of the world{until}{members}"
        case "fit":
            return CONTENTS.get(label, label), {
                "fit": "search for the values that make the world's motion match the observed motion",
                "posterior": "sample of the values that the observations allow",
                "gap": "comparison of the world with what was observed",
            }.get(label, label.replace("_", " "))
        case _:
            word = CONTENTS.get(label, label.replace("_", " "))
            return word, f"{word} measured"


def _origin(origin: str, detail: dict[str, Any]) -> str:
    """Name a world by how it was made."""
    if "edits" in detail:
        return branch_label([edit_words(edit) for edit in detail["edits"]])
    return ORIGINS.get(origin, origin.replace("_", " ") or "world")


def _made(origin: str, detail: dict[str, Any]) -> str:
    if "edits" in detail:
        return "edited: " + ", ".join(edit_words(edit).text for edit in detail["edits"])
    if "proposal" in detail:
        return f"an effect that {detail['proposal']} proposed was added"
    return {"fitted": "fitted to the observed motion", "built": "built from the observations"}.get(
        origin, ORIGINS.get(origin, origin or "an ancestor of the case's worlds")
    )


def _short(arguments: dict[str, Any]) -> str:
    """Return arguments in a line, long ones cut; the case is left out."""
    shown = []
    for name, value in arguments.items():
        if name == "case":
            continue
        text = value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
        if name in FILES:
            text = PurePath(text).name
        shown.append(f"{name}: {text if len(text) <= ARGUMENT else text[: ARGUMENT - 1] + '…'}")
    line = ", ".join(shown) or "no arguments"
    return line if len(line) <= ARGUMENTS else line[: ARGUMENTS - 1] + "…"
