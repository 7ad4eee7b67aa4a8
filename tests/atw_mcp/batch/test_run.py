"""Cases are modelled and asked by the tools, each once, and what fails does not stop the rest."""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path
from typing import Any

import pytest

from atw_mcp.batch.run import BatchRefused, run_batch
from atw_mcp.batch.shards import held, new_shard, result_of, under_way
from evidence_store import Evidence, EvidenceStore, StoreError
from evidence_store.checking import check
from polyworld.executors import SerialExecutor
from tests.atw_mcp.batch.cases import MEETING, batch_of, discs, puck, rows

RUN = SerialExecutor()


@pytest.fixture(scope="module")
def done(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the results of three cases, one of which has no file."""
    folder = tmp_path_factory.mktemp("batch")
    run_batch(batch_of(folder, discs(), {"id": "gone", "tracks": "none.csv"}, puck(folder)), RUN)
    return folder


@pytest.fixture
def folder(done: Path, tmp_path: Path) -> Path:
    """A copy of it, at the same age."""
    return Path(shutil.copytree(done, tmp_path / "batch"))


def test_answers_are_those_of_the_worlds(done: Path) -> None:
    hit, when, slower, far = rows(done / "results" / "answers.jsonl")
    assert [row["question"] for row in (hit, when, slower, far)] == ["hit", "when", "slower", "far"]
    assert (hit["answer"], slower["answer"]) == (True, False)
    assert when["answer"] == pytest.approx(MEETING, abs=1e-4)
    assert when["unit"] == "s"
    assert (far["case"], far["answer"], far["fit"]) == ("slide", True, "good")  # it slides 0.51 m
    assert far["probability"] > 0.5
    assert far["interval_80%"] is None  # of a statement
    (failure,) = rows(done / "results" / "failures.jsonl")
    assert (failure["case"], failure["step"]) == ("gone", "OpenCase")
    assert "none.csv" in failure["reason"]


def test_evidence_is_that_of_an_agent_and_answers_refer_to_it(done: Path) -> None:
    store = EvidenceStore.to_read(done / "results" / "store.db")
    assert [case.id for case in store.cases.all()] == ["discs", "slide"]
    tools = [record.tool for record in store.evidence.of_case("slide")]
    assert tools[:5] == ["OpenCase", "ImportObservation", "BuildWorld", "FitWorld", "CommitWorld"]
    assert tools[5:] == ["Rollout", "QueryWorld", "Ask", "Ask", "Finish"]  # the call, and its one answer
    for row in rows(done / "results" / "answers.jsonl"):
        records = [store.evidence.get(identifier) for identifier in row["evidence"]]
        sure = ["Ask"] if row["case"] == "slide" else []
        assert [record.tool for record in records] == ["Rollout", "QueryWorld", *sure, "Finish"]
        assert {record.case for record in records} == {row["case"]}
    assert store.cases.answers("discs")[0].evidence == tuple(
        rows(done / "results" / "answers.jsonl")[0]["evidence"][:2]
    )
    store.close()
    assert all(finding.good for finding in check(done / "results" / "store.db"))


def test_a_case_that_is_done_is_not_run_again_and_one_that_is_not_is(folder: Path) -> None:
    batch = batch_of(folder, discs(), {"id": "gone", "tracks": "none.csv"}, puck(folder))
    before = {path: path.read_bytes() for path in (folder / "results").glob("*.jsonl")}
    assert run_batch(batch, RUN).ran == 0
    (batch.shards / "discs.db").unlink()
    half_way = batch.shards / ".unfinished-x"  # what a killed worker leaves
    half_way.mkdir()
    EvidenceStore(half_way / "case.db").close()
    assert result_of(batch.shards, "discs") is None
    assert run_batch(batch, RUN).ran == 1
    assert sorted(path.name for path in batch.shards.iterdir()) == ["discs.db", "gone.db", "slide.db"]
    for path, content in before.items():
        if path.name != "times.jsonl":
            assert path.read_bytes() == content


def test_what_changed_is_refused_or_run_again(folder: Path) -> None:
    moved = batch_of(folder, discs(), puck(folder))
    with pytest.raises(BatchRefused, match=r"has results of slide from before .* --redo changed"):
        run_batch(moved, RUN)
    changed: dict[str, Any] = discs()
    changed["objects"][0]["velocity"] = [0, 1, 0]
    batch = batch_of(folder, changed, {"id": "gone", "tracks": "none.csv"}, puck(folder))
    with pytest.raises(BatchRefused, match="has results of discs from before"):
        run_batch(batch, RUN)
    assert run_batch(batch, RUN, ["changed"]).ran == 1
    assert [row["answer"] for row in rows(folder / "results" / "answers.jsonl")][:2] == [False, "never"]
    (folder / "none.csv").write_text((folder / "slide.csv").read_text())
    with pytest.raises(BatchRefused, match="has results of gone from before"):
        run_batch(batch, RUN)
    assert run_batch(batch, RUN, ["failed"]).ran == 1  # what failed may be mended


def test_a_second_run_into_the_same_folder_is_refused(folder: Path) -> None:
    batch = batch_of(folder, discs(), {"id": "gone", "tracks": "none.csv"}, puck(folder))
    with held(batch.out) as alone:
        assert alone
        with pytest.raises(BatchRefused, match="another batch is running"):
            run_batch(batch, RUN)
    assert run_batch(batch, RUN).ran == 0
    with pytest.raises(StoreError, match="cannot be written"), held(folder / "none"):
        pass


def test_a_changed_question_repeats_no_fit_and_leaves_nothing_of_the_earlier_run(folder: Path) -> None:
    def kept(table: str) -> set[str]:
        with sqlite3.connect(folder / "results" / "shards" / "slide.db") as database:
            return {row[0] for row in database.execute(f"SELECT id FROM {table}")}

    before = {table: kept(table) for table in ("worlds", "observations", "fits", "rollouts")}
    slide = puck(folder)
    slide["questions"][0]["horizon_seconds"] = 1.4
    batch = batch_of(folder, discs(), {"id": "gone", "tracks": "none.csv"}, slide)
    assert run_batch(batch, RUN, ["changed"]).failures[0]["case"] == "gone"
    store = EvidenceStore.to_read(batch.store)
    (fit,) = store.evidence.of_case("slide", tool="FitWorld")
    assert store.evidence.get(fit.id).payload["shown"]["computed_now"] is False
    store.close()
    assert {table: kept(table) for table in ("worlds", "observations", "fits")} == {
        table: before[table] for table in ("worlds", "observations", "fits")
    }
    assert not kept("rollouts") & before["rollouts"]


def test_a_store_that_was_worked_on_is_not_replaced(folder: Path) -> None:
    batch = batch_of(folder, discs(), {"id": "gone", "tracks": "none.csv"}, puck(folder))
    store = EvidenceStore(batch.store)
    store.evidence.add(Evidence("ReadEvidence", {}, case="discs"))
    store.close()
    assert run_batch(batch, RUN).ran == 0  # nothing to replace
    with pytest.raises(BatchRefused, match=r"has 1 records of later work.*move it away"):
        run_batch(batch, RUN, ["failed"])


def test_a_question_that_fails_leaves_the_others(tmp_path: Path) -> None:
    entry: dict[str, Any] = discs()
    entry["questions"][1]["predicate"] = {"predicate": "collides", "a": "striker", "b": "nobody"}
    outcome = run_batch(batch_of(tmp_path, entry), RUN)
    assert [row["question"] for row in outcome.answers] == ["hit", "slower"]
    (failure,) = outcome.failures
    assert (failure["question"], failure["step"]) == ("when", "QueryWorld")
    assert "nobody" in failure["reason"]


def test_work_under_way_is_seen_from_outside(tmp_path: Path) -> None:
    shards = tmp_path / "shards"
    with new_shard(shards, "ball.1") as file:
        assert under_way(shards) == {}
        store = EvidenceStore(file)
        for message in ("FitWorld: searching", "searching"):
            record = store.evidence.add(Evidence("ModelVideo", {}, status="running"))
            store.jobs.start(record.id, message)
            store.jobs.beat(record.id, 0.5, 1.0, message)
        assert under_way(shards) == {"ball.1": "FitWorld: searching"}
        store.close()
    assert under_way(shards) == {}
    assert [path.name for path in shards.iterdir()] == ["ball.1.db"]
