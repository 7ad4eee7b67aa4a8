"""Where the results of a case come from, as W3C PROV-JSON (https://www.w3.org/submissions/prov-json/)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from evidence_store.canonical import to_json
from evidence_store.lineage import Lineage, Record, lineage
from evidence_store.store import EvidenceStore

if TYPE_CHECKING:
    from prov.model import ProvDocument

NAMESPACE = "urn:asking-the-world:"


def prov_json(store: EvidenceStore, case: str) -> str:
    """Return the provenance of a case: a W3C PROV document in JSON.

    Entities: the records of its lineage. Activities: the call of a tool behind each piece of evidence. Relations: what
    a call used, what it generated, what was derived from what.
    """
    from prov.model import ProvDocument  # imports much, and only this needs it

    document = ProvDocument()
    document.add_namespace("atw", NAMESPACE)
    document.agent("atw:atw-mcp", {"prov:type": "prov:SoftwareAgent"})
    found = lineage(store, case)
    for record in found.records.values():
        document.entity(f"atw:{record.id}", _attributes(record))
    for record in found.records.values():
        if record.kind == "evidence" and "arguments" in record.about:
            _add_call(document, record, found, f"case-{case}")
    for link in found.derivations:
        how = {"prov:type": f"atw:{link.how.replace(' ', '_')}"}
        if link.detail:
            how["atw:detail"] = to_json(link.detail)
        document.wasDerivedFrom(f"atw:{link.target}", f"atw:{link.source}", other_attributes=how)
    return document.serialize(indent=1) or ""


def _add_call(document: ProvDocument, record: Record, found: Lineage, root: str) -> None:
    """Add the call of the tool that made a piece of evidence."""
    call = f"atw:call-{record.id}"
    attributes = {"prov:label": record.label, "atw:arguments": to_json(record.about["arguments"])}
    document.activity(call, other_attributes=attributes)
    document.wasAssociatedWith(call, "atw:atw-mcp")
    document.wasGeneratedBy(f"atw:{record.id}", call)
    for source in dict.fromkeys([root, *(link.source for link in found.derivations if link.target == record.id)]):
        document.used(call, f"atw:{source}")


def _attributes(record: Record) -> dict[str, str]:
    """Return the attributes of a record's entity."""
    about = record.about
    match record.kind:
        case "case":
            return {"prov:type": "atw:Case", "atw:sha256": about["content"], "atw:kind": record.label}
        case "world":
            return {"prov:type": "atw:World", "atw:origin": record.label}
        case "evidence":
            made = {"prov:type": "atw:Evidence", "prov:label": about.get("summary", record.label)}
            return made | ({"atw:status": about["status"]} if "status" in about else {})
        case "answer":
            return {
                "prov:type": "atw:Answer",
                "atw:question": about["question"],
                "prov:value": about["answer"] or "unresolved",
            }
        case _:
            return {"prov:type": f"atw:{record.kind}", "atw:kind": record.label}
