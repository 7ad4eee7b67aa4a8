"""The provenance graph of the viewer: from an answer back to the video, as W3C PROV has it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from atw_mcp.viewer.document import Provenance
from atw_mcp.viewer.lineage import provenance
from evidence_store import Answer, Evidence, EvidenceStore
from evidence_store.provenance import prov_json
from tests.evidence_store.records import filled, tamper


def upstream(graph: Provenance, identifier: str) -> set[str]:
    reached, new = set[str](), {identifier}
    while new:
        reached |= new
        new = {edge.source for edge in graph.edges if edge.target in new} - reached
    return reached


def branched(path: Path) -> EvidenceStore:
    """A case with a fit, an effect proposed and added, a branch, a comparison, and an answer that rests on it."""
    store = filled(path)
    fit = store.fits.put("fit", {"world": "world-a", "observation": "obs-1"}, {"world": "world-b"})
    store.worlds.put("world-b", '{"b":1}', parent="world-a", how="fitted", detail={"fit": fit.id})
    store.evidence.add(Evidence("ProposeEffects", {"case": "ball", "world": "world-b"}, case="ball", world="world-b"))
    store.worlds.put("world-c", "{}", parent="world-b", how="effect_added", detail={"proposal": "ev-4"})
    edits = {"edits": [{"action": "remove", "object": "cube"}]}
    store.worlds.put("world-d", '{"d":1}', parent="world-c", how="intervention", detail=edits)
    for world in ("world-c", "world-d"):
        store.cases.add_world("ball", world, "effect_added" if world == "world-c" else "intervention")
    base, edited = (store.rollouts.put("rollout", {"world": f"world-{w}", "horizon": 2.0}, {}) for w in "cd")
    arguments = {"base": base.id, "edited": edited.id}
    store.evidence.add(Evidence("CompareWorlds", arguments, case="ball", world="world-d", rollout=edited.id))
    store.evidence.add(Evidence("InspectFrames", {"video": "/home/someone/ball.mp4"}, case="ball"))
    store.cases.add_answer("ball", Answer("and without the cube?", None, None, ("ev-5",), "nobody knows"))
    return store


def test_an_answer_leads_back_to_the_video_and_to_no_evidence_that_it_does_not_rest_on(tmp_path: Path) -> None:
    store, missing = branched(tmp_path / "s.db"), list[str]()
    graph = provenance(store, "ball", missing)
    reached = upstream(graph, "answer-2-ball")
    tracks = store.cases.observations("ball")[0][1]
    rollouts = {store.rollouts.key("rollout", {"world": f"world-{w}", "horizon": 2.0}) for w in "cd"}
    assert rollouts | {"case-ball", tracks, "world-a", "world-b", "world-c", "world-d"} < reached
    assert {node for node in reached if node.startswith("ev-")} == {"ev-5", "ev-4"}  # and what proposed the effect
    assert any(node.startswith("fit-") for node in reached)
    assert not missing
    nodes = {node.id: node for node in graph.nodes}
    assert nodes["world-d"].title == "without cube"
    assert nodes["answer-2-ball"].title == "unresolved"
    assert "someone" not in nodes["ev-6"].detail
    assert upstream(graph, "ev-6") == {"ev-6", "case-ball"}


def test_the_graph_is_that_of_w3c_prov(tmp_path: Path) -> None:
    store = branched(tmp_path / "s.db")
    graph, prov = provenance(store, "ball", []), json.loads(prov_json(store, "ball"))
    derived = {
        (link["prov:usedEntity"].removeprefix("atw:"), link["prov:generatedEntity"].removeprefix("atw:"))
        for link in prov["wasDerivedFrom"].values()
    }
    assert {(edge.source, edge.target) for edge in graph.edges} == derived
    assert {f"atw:{node.id}" for node in graph.nodes} == set(prov["entity"])


@pytest.mark.parametrize(
    ("statement", "said", "still"),
    [
        ("UPDATE evidence SET summary = 'x' WHERE seq = 3", "evidence ev-3", "answer-2-ball"),
        ("UPDATE evidence SET summary = 'x' WHERE seq = 5", "evidence ev-5", "answer-2-ball"),
        ("UPDATE answers SET answer = 'no' WHERE seq = 1", "an answer (number 1)", "ev-5"),
        ("UPDATE world_parents SET how = 'x' WHERE child = 'world-d'", "the origin of world 'world-d'", "world-d"),
        ("UPDATE case_worlds SET origin = 'x' WHERE seq = 1", "a world (number 1)", "world-a"),
        ("UPDATE case_observations SET kind = 'x' WHERE seq = 1", "an observation (number 1)", "case-ball"),
    ],
)
def test_a_damaged_record_is_named_and_the_rest_is_shown(tmp_path: Path, statement: str, said: str, still: str) -> None:
    branched(tmp_path / "s.db").close()
    tamper(tmp_path / "s.db", statement)
    missing = list[str]()
    graph = provenance(EvidenceStore(tmp_path / "s.db"), "ball", missing)
    assert any(said in sentence for sentence in missing)
    ids = {node.id for node in graph.nodes}
    assert still in ids
    assert {end for edge in graph.edges for end in (edge.source, edge.target)} <= ids
