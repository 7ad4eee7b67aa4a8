"""The commands that look after a store say what they found and did, and fail where something is wrong."""

from __future__ import annotations

import json
from pathlib import Path

import anyio
import pytest
from mcp import Client

from atw_mcp.cli import main
from atw_mcp.server import build_server
from atw_mcp.store_option import pictures_of
from evidence_store import Evidence, EvidenceStore
from tests.atw_mcp.session import Session
from tests.evidence_store.records import filled, tamper


@pytest.fixture
def store(tmp_path: Path) -> Path:
    store = filled(tmp_path / "atw.db")
    store.close()
    return store.path


def test_doctor_is_content_with_a_whole_store(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["doctor", "--store", str(store)]) == 0
    said = capsys.readouterr().out
    assert "WRONG" not in said
    for subject in ("checksums", "jobs", "Python", "Warp", "OpenCV", "kernel cache", "disk"):
        assert f"{subject}: " in said


def test_doctor_fails_on_damage_and_recovers_the_rest(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    tamper(store, "UPDATE evidence SET summary = 'something else' WHERE seq = 1")
    assert main(["doctor", "--store", str(store)]) == 1
    assert "WRONG  checksums: damaged: evidence ev-1" in capsys.readouterr().out
    assert main(["doctor", "--repair", "--store", str(store)]) == 1, "the store itself is still damaged"
    said = capsys.readouterr().out
    recovered = store.with_name("atw.recovered-1.db")
    assert str(recovered) in said
    assert "lost: evidence ev-1" in said
    assert main(["doctor", "--store", str(recovered)]) == 0
    assert EvidenceStore(recovered).read_evidence("ev-3").tool == "FitWorld"


def test_doctor_repairs_what_ended_processes_left(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    opened = EvidenceStore(store)
    opened.evidence.update(Evidence("FitWorld", {}, case="ball", status="running", id="ev-3"))
    opened.close()
    assert main(["doctor", "--store", str(store)]) == 1
    assert main(["doctor", "--store", str(store), "--repair"]) == 0
    assert "repaired: marked failed" in capsys.readouterr().out


def test_doctor_says_what_is_no_store(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("notes " * 1000)
    assert main(["doctor", "--store", str(path)]) == 1
    assert main(["doctor", "--repair", "--store", str(path)]) == 1
    assert "not an evidence store" in capsys.readouterr().err
    assert path.read_text() == "notes " * 1000


def test_backup_and_prune_say_what_they_did(store: Path, capsys: pytest.CaptureFixture[str]) -> None:
    copy = store.with_name("copy.db")
    assert main(["backup", str(copy), "--store", str(store)]) == 0
    assert main(["backup", str(copy), "--store", str(store)]) == 1
    assert "exists already" in capsys.readouterr().err
    assert main(["prune", "--dry-run", "--store", str(store)]) == 0
    assert "would remove nothing" in capsys.readouterr().out
    assert main(["prune", "--case", "ball", "--store", str(store)]) == 0
    assert "1 cases" in capsys.readouterr().out
    assert EvidenceStore(store).cases.all() == []
    assert [case.id for case in EvidenceStore(copy).cases.all()] == ["ball"]


def result_of(store: Path, evidence: str) -> tuple[object, ...]:
    """All that ReadEvidence returns for a record, as an agent receives it."""

    async def session() -> tuple[object, ...]:
        async with Client(build_server(store)) as client:
            read = await client.call_tool("ReadEvidence", {"evidence": evidence})
            return [block.model_dump_json() for block in read.content], json.dumps(read.structured_content)

    return anyio.run(session)


def test_an_exported_case_reads_the_same_bytes_where_it_is_imported(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    archive, other, provenance = tmp_path / "case.zip", tmp_path / "other.db", tmp_path / "prov.json"
    assert main(["export", "ball", "--store", str(store)]) == 2
    assert main(["export", "ball", "--out", str(archive), "--prov", str(provenance), "--store", str(store)]) == 0
    assert "wasDerivedFrom" in json.loads(provenance.read_text())
    assert main(["import", str(archive), "--store", str(other)]) == 0
    for evidence in ("ev-1", "ev-3"):
        assert result_of(other, evidence) == result_of(store, evidence)
    assert main(["import", str(provenance), "--store", str(other)]) == 1
    assert main(["export", "ball", "--out", str(tmp_path / "x.zip"), "--store", str(tmp_path / "none.db")]) == 1
    said = capsys.readouterr().err
    assert "no zip file" in said
    assert not (tmp_path / "none.db").exists()


def test_a_case_imported_twice_into_a_store_in_use_is_read_under_free_ids(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    archive, provenance = tmp_path / "case.zip", tmp_path / "prov.json"
    assert main(["export", "ball", "--out", str(archive), "--store", str(store)]) == 0
    for name, shift in (("ball-2", 3), ("ball-3", 6)):
        assert main(["import", str(archive), "--store", str(store)]) == 0
        assert f"case ball is {name}, its ev-N is ev-(N + {shift})" in capsys.readouterr().out
        call = Session(store)
        listed = call("ReadEvidence", case=name)["data"]["records"]
        assert [row["evidence"] for row in listed] == [f"ev-{3 + shift}", f"ev-{1 + shift}"]
        read, first = call("ReadEvidence", evidence=f"ev-{1 + shift}"), call("ReadEvidence", evidence="ev-1")
        assert read["data"] == first["data"]
        assert read["case"] == name
        assert read["summary"] == f"{first['summary']} [imported: ev-1 of case 'ball']"
        assert main(["export", name, "--prov", str(provenance), "--store", str(store)]) == 0
        derived = json.loads(provenance.read_text())["wasDerivedFrom"].values()
        (ground,) = (d["prov:usedEntity"] for d in derived if d["prov:generatedEntity"] == f"atw:answer-1-{name}")
        assert ground == f"atw:ev-{1 + shift}"
    assert main(["doctor", "--store", str(store)]) == 0


def test_stores_side_by_side_write_their_pictures_to_different_folders(tmp_path: Path) -> None:
    stores = [None, tmp_path / "a.db", tmp_path / "b.db", tmp_path / "below" / "a.db"]
    assert len({pictures_of(store) for store in stores}) == 4
    assert pictures_of(tmp_path / "below" / ".." / "a.db") == pictures_of(tmp_path / "a.db")
