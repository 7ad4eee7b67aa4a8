"""A case goes from store to store without a change, and no file that is not one gets in."""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from prov.model import ProvDocument

from evidence_store import BadArchive, Evidence, EvidenceStore, RecordDamaged, StoreError, UnknownRecord
from evidence_store.checking import check
from evidence_store.export import MANIFEST, ArchiveLimits, export_case, import_case
from evidence_store.lineage import lineage
from evidence_store.provenance import prov_json
from evidence_store.renumbering import IMPORTED
from tests.evidence_store.records import filled, tamper


@pytest.fixture
def store(tmp_path: Path) -> EvidenceStore:
    store = filled(tmp_path / "atw.db")
    base = store.observations.put("masks", {"video": "ball"}, {}, {"x": np.arange(5.0)})
    named = store.rollouts.put("preview", {"masks": base.id}, {})
    store.rollouts.put("rollout", {"world": "world-x"}, {})
    store.cases.add("second", content="c", kind="video", path="/s.mp4", facts={})
    store.evidence.add(Evidence("OpenCase", {}, case="second"))
    store.evidence.add(
        Evidence("InspectRollout", {"b": 1, "a": 2}, case="ball", payload={"z": 1, "a": {"preview": named.id}})
    )
    return store


@pytest.fixture
def archive(store: EvidenceStore, tmp_path: Path) -> Path:
    export_case(store, "ball", tmp_path / "case.zip")
    return tmp_path / "case.zip"


def rewritten(archive: Path, change: Callable[[dict[str, bytes]], None]) -> Path:
    """The archive with changed files; its manifest fits them."""
    with zipfile.ZipFile(archive) as read:
        files = {name: read.read(name) for name in read.namelist()}
    change(files)
    manifest = json.loads(files.pop(MANIFEST))
    manifest["files"] = {
        name: {"sha256": hashlib.sha256(data).hexdigest(), "bytes": len(data)} for name, data in files.items()
    }
    target = archive.with_name("changed.zip")
    with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as write:
        for name, data in files.items():
            write.writestr(name, data)
        write.writestr(MANIFEST, json.dumps(manifest))
    return target


def test_a_case_is_the_same_in_an_empty_store(store: EvidenceStore, archive: Path, tmp_path: Path) -> None:
    other = EvidenceStore(tmp_path / "other.db")
    ids, counts = import_case(other, archive)
    assert (ids.case, ids.shift) == ("ball", 0)
    assert (counts["evidence"], counts["rollouts"], counts["observations"]) == (3, 2, 2)
    for record in store.evidence.of_case("ball"):
        assert other.read_evidence(record.id) == store.read_evidence(record.id)
        assert list(other.read_evidence(record.id).payload) == list(store.read_evidence(record.id).payload)
    assert other.cases.get("ball") == store.cases.get("ball")
    for name in ("questions", "observations", "worlds", "bindings", "answers"):
        assert getattr(other.cases, name)("ball") == getattr(store.cases, name)("ball")
    assert other.worlds.parents("world-b") == store.worlds.parents("world-b")
    rollout = other.rollouts.find("rollout", {"world": "world-b"})
    assert rollout is not None
    assert np.array_equal(rollout.arrays["x"], [1.0, np.nan], equal_nan=True)
    assert [case.id for case in other.cases.all()] == ["ball"]
    assert all(finding.good for finding in check(other.path))
    assert other.evidence.add(Evidence("OpenCase", {})).id == "ev-6"
    export_case(other, "ball", tmp_path / "again.zip")
    assert (tmp_path / "again.zip").read_bytes() == archive.read_bytes()


def test_a_case_is_renumbered_with_every_reference_where_its_ids_are_taken(tmp_path: Path) -> None:
    source = filled(tmp_path / "atw.db")
    source.worlds.put("world-c", "{}", parent="world-b", how="effect", detail={"proposal": "ev-1", "hypothesis": "a"})
    source.cases.add_world("ball", "world-c", "effect")
    finish = Evidence(
        "Finish", {"case": "ball", "evidence": ["ev-1"]}, case="ball", summary="yes, by\nev-1: case='ball'"
    )
    assert source.evidence.add(finish).id == "ev-4"
    export_case(source, "ball", tmp_path / "case.zip")
    before = lineage(source, "ball")
    other = filled(tmp_path / "other.db", "cube")
    for named, shift in (("ball", 3), ("ball-2", 7)):
        ids, _ = import_case(other, tmp_path / "case.zip")
        case = ids.case
        assert (case, ids.shift) == (named, shift)

        def there(name: str, case: str = case, shift: int = ids.shift) -> str:
            name = name.replace("case-ball", f"case-{case}").replace("answer-1-ball", f"answer-1-{case}")
            return f"ev-{int(name[3:]) + shift}" if name.startswith("ev-") else name

        after = lineage(other, case)
        assert set(after.records) == {there(name) for name in before.records}
        assert {(d.source, d.target, d.how) for d in after.derivations} == {
            (there(d.source), there(d.target), d.how) for d in before.derivations
        }
        assert other.cases.answers(case)[0].evidence == (there("ev-1"),)
        record = other.read_evidence(there("ev-4"))
        assert record.arguments == {"case": case, "evidence": [there("ev-1")]}
        assert record.summary == f"yes, by\n{there('ev-1')}: case='{case}'"
        assert record.payload == {IMPORTED: [{"case": "ball", "evidence": "ev-4"}]}
    assert other.read_evidence("ev-1").case == "cube"
    assert all(finding.good for finding in check(other.path))
    export_case(other, "ball-2", tmp_path / "again.zip")
    third = filled(tmp_path / "third.db")
    assert import_case(third, tmp_path / "again.zip")[0].shift == 0
    ids, _ = import_case(third, tmp_path / "again.zip")
    assert [old["evidence"] for old in third.read_evidence(f"ev-{8 + ids.shift}").payload[IMPORTED]] == ["ev-1", "ev-8"]


def test_what_a_case_left_behind_is_not_mistaken_for_another_record(tmp_path: Path) -> None:
    source = filled(tmp_path / "atw.db")
    source.evidence.add(Evidence("Finish", {"evidence": ["ev-2"]}, case="ball"))  # ev-2 has no case
    export_case(source, "ball", tmp_path / "case.zip")
    other = filled(tmp_path / "other.db", "cube")
    ids, _ = import_case(other, tmp_path / "case.zip")
    (named,) = other.read_evidence(f"ev-{4 + ids.shift}").arguments["evidence"]
    with pytest.raises(UnknownRecord, match=named):
        other.read_evidence(named)


def test_a_pruned_case_can_come_back(store: EvidenceStore, archive: Path) -> None:
    from evidence_store.upkeep import prune

    before = store.read_evidence("ev-1")
    store.close()
    prune(store.path, cases=["ball"])
    again = EvidenceStore(store.path)
    import_case(again, archive)
    assert again.read_evidence("ev-1") == before
    assert [case.id for case in again.cases.all()] == ["second", "ball"]


def test_exports_that_make_no_sense_are_refused(store: EvidenceStore, archive: Path, tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="exists already"):
        export_case(store, "ball", archive)
    with pytest.raises(UnknownRecord, match="second"):
        export_case(store, "third", tmp_path / "third.zip")
    running = store.evidence.add(Evidence("FitWorld", {}, case="second", status="running"))
    store.jobs.start(running.id, "key")
    with pytest.raises(StoreError, match="still running"):
        export_case(store, "second", tmp_path / "second.zip")
    tamper(store.path, "UPDATE evidence SET payload = '{}' WHERE seq = 1")
    with pytest.raises(RecordDamaged, match="ev-1"):
        export_case(store, "ball", tmp_path / "damaged.zip")
    assert sorted(path.name for path in tmp_path.glob("*.zip*")) == ["case.zip"]


def outside(files: dict[str, bytes]) -> None:
    files["../../outside"] = b"x"


def another_array(files: dict[str, bytes]) -> None:
    name = next(name for name in files if name.startswith("arrays/"))
    files[name] = files[name] + b"x"


def another_summary(files: dict[str, bytes]) -> None:
    files["records/evidence.jsonl"] = files["records/evidence.jsonl"].replace(b"f\\u00e4llt", b"steigt")


def another_field(files: dict[str, bytes]) -> None:
    files["records/worlds.jsonl"] = files["records/worlds.jsonl"].replace(b'"document"', b'"documents"')


def no_worlds(files: dict[str, bytes]) -> None:
    del files["records/worlds.jsonl"]


def deep(files: dict[str, bytes]) -> None:
    files["records/worlds.jsonl"] = b"[" * 200_000


def no_manifest_entries(files: dict[str, bytes]) -> None:
    files[MANIFEST] = b'{"format": "atw-case", "version": 1, "case": "ball", "files": {}}'


@pytest.mark.parametrize(
    "change", [outside, another_array, another_summary, another_field, no_worlds, deep, no_manifest_entries]
)
def test_a_changed_archive_is_refused(
    archive: Path, tmp_path: Path, change: Callable[[dict[str, bytes]], None]
) -> None:
    other = EvidenceStore(tmp_path / "other.db")
    with pytest.raises(BadArchive, match="nothing was imported"):
        import_case(other, rewritten(archive, change))
    assert other.cases.all() == []
    assert not (tmp_path.parent.parent / "outside").exists()


def test_a_flipped_bit_is_noticed(archive: Path, tmp_path: Path) -> None:
    content = bytearray(archive.read_bytes())
    rng = np.random.default_rng(0)
    for index, position in enumerate(rng.integers(0, len(content), 25)):
        content[position] ^= 8
        archive.write_bytes(content)
        other = EvidenceStore(tmp_path / f"other{index}.db")
        try:
            import_case(other, archive)
        except BadArchive:
            assert other.cases.all() == []
        else:  # a bit that means nothing, such as a date
            assert all(finding.good for finding in check(other.path))
        other.close()
        content[position] ^= 8


def test_archives_beyond_the_limits_are_refused(archive: Path, tmp_path: Path) -> None:
    other = EvidenceStore(tmp_path / "other.db")
    limits = ArchiveLimits()
    for tight in (replace(limits, total=1000), replace(limits, files=3), replace(limits, arrays=10)):
        with pytest.raises(BadArchive, match="at most"):
            import_case(other, archive, tight)
    buffer = io.BytesIO()
    with zipfile.ZipFile(buffer, "w") as empty:
        empty.writestr("x", "x")
    for content in (b"", b"no zip file at all", buffer.getvalue()):
        archive.write_bytes(content)
        with pytest.raises(BadArchive):
            import_case(other, archive)
    with pytest.raises(BadArchive, match="No such file"):
        import_case(other, tmp_path / "none.zip")


def test_provenance_is_prov_json_and_leads_from_answer_to_case(store: EvidenceStore, archive: Path) -> None:
    text = prov_json(store, "ball")
    with zipfile.ZipFile(archive) as read:
        assert read.read("provenance.json").decode() == text
    document = ProvDocument.deserialize(content=text)
    assert document == ProvDocument.deserialize(content=document.serialize())
    loaded = json.loads(text)
    derived = {
        (relation["prov:generatedEntity"].removeprefix("atw:"), relation["prov:usedEntity"].removeprefix("atw:"))
        for relation in loaded["wasDerivedFrom"].values()
    }
    reached, new = set[str](), {"answer-1-ball"}
    while new:
        reached |= new
        new = {used for made, used in derived if made in reached} - reached
    assert {"ev-1", "world-b", "world-a", "case-ball"} <= reached
    assert any(name.startswith("rollout-") for name in reached)
    assert loaded["activity"]["atw:call-ev-1"]["prov:label"] == "Rollout"
