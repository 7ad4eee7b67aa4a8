"""Where the results of a case come from, as W3C PROV-JSON (https://www.w3.org/submissions/prov-json/)."""

from __future__ import annotations

from typing import TYPE_CHECKING

from evidence_store.canonical import to_json
from evidence_store.references import CONTENTS, IDENTIFIER, referred
from evidence_store.store import EvidenceStore

if TYPE_CHECKING:
    from prov.model import ProvDocument

NAMESPACE = "urn:asking-the-world:"


def prov_json(store: EvidenceStore, case: str) -> str:
    """Return the provenance of a case: a W3C PROV document in JSON.

    Entities: the case's file, its observations, worlds, rollouts and fits, every piece of evidence and every answer.
    Activities: the call of a tool behind each piece of evidence. Relations: what a call used, what it generated, what
    was derived from what.
    """
    from prov.model import ProvDocument  # imports much, and only this needs it

    document = ProvDocument()
    document.add_namespace("atw", NAMESPACE)
    opened = store.cases.get(case)
    document.agent("atw:atw-mcp", {"prov:type": "prov:SoftwareAgent"})
    document.entity(
        f"atw:case-{case}", {"prov:type": "atw:Case", "atw:sha256": opened.content, "atw:kind": opened.kind}
    )
    known = _add_records(store, case, document)
    for record in store.evidence.of_case(case):
        call, result = f"atw:call-{record.id}", f"atw:{record.id}"
        document.activity(
            call, other_attributes={"prov:label": record.tool, "atw:arguments": to_json(record.arguments)}
        )
        document.entity(
            result, {"prov:type": "atw:Evidence", "prov:label": record.summary, "atw:status": record.status}
        )
        document.wasAssociatedWith(call, "atw:atw-mcp")
        document.wasGeneratedBy(result, call)
        document.used(call, f"atw:case-{case}")
        for source in (record.world, record.rollout, record.observation):
            if source in known:
                document.used(call, f"atw:{source}")
                document.wasDerivedFrom(result, f"atw:{source}")
    for number, answer in enumerate(store.cases.answers(case), start=1):
        entity = f"atw:answer-{number}-{case}"
        document.entity(
            entity,
            {"prov:type": "atw:Answer", "atw:question": answer.question, "prov:value": answer.answer or "unresolved"},
        )
        for identifier in answer.evidence:
            document.wasDerivedFrom(entity, f"atw:{identifier}")
    return document.serialize(indent=1) or ""


def _add_records(store: EvidenceStore, case: str, document: ProvDocument) -> set[str]:
    """Add worlds and results with their derivations; returns their ids."""
    with store.connection.read() as database:
        used = referred(database.conn, case)
        known = set(used.worlds | used.contents)
        for world in sorted(used.worlds):
            document.entity(f"atw:{world}", {"prov:type": "atw:World"})
            for descent in store.worlds.parents(world):
                derived = {"prov:type": f"atw:{descent.how or 'built'}", "atw:detail": to_json(descent.detail)}
                document.wasDerivedFrom(f"atw:{world}", f"atw:{descent.parent}", other_attributes=derived)
        for world, _ in store.cases.worlds(case):
            observation = store.cases.modelled_observation(case, world)
            if observation in known:
                document.wasDerivedFrom(f"atw:{world}", f"atw:{observation}")
        for table in CONTENTS:
            for identifier, kind, inputs in database.conn.execute(f"SELECT id, kind, inputs FROM {table} ORDER BY id"):
                if identifier not in used.contents:
                    continue
                document.entity(f"atw:{identifier}", {"prov:type": f"atw:{table.removesuffix('s')}", "atw:kind": kind})
                for source in sorted(set(IDENTIFIER.findall(inputs)) & known - {identifier}):
                    document.wasDerivedFrom(f"atw:{identifier}", f"atw:{source}")
        for _, identifier in store.cases.observations(case):
            document.wasDerivedFrom(f"atw:{identifier}", f"atw:case-{case}")
    return known
