"""A backup holds what the store held; pruning removes what nothing refers to, and nothing else."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from evidence_store import Evidence, EvidenceStore, StoreError, StoreLocked, UnknownRecord
from evidence_store.checking import check
from evidence_store.upkeep import backup, prune
from tests.evidence_store.records import filled


def test_a_backup_is_made_while_the_store_is_used(tmp_path: Path) -> None:
    store = filled(tmp_path / "atw.db")
    other = EvidenceStore(store.path)
    other.evidence.add(Evidence("OpenCase", {"of": "another process"}))
    size = backup(store.path, tmp_path / "copy.db")
    assert size == (tmp_path / "copy.db").stat().st_size
    store.evidence.add(Evidence("OpenCase", {"after": "the copy"}))
    assert sorted(path.name for path in tmp_path.iterdir() if "copy" in path.name) == ["copy.db"]
    copy = EvidenceStore(tmp_path / "copy.db")
    assert copy.read_evidence("ev-1") == store.read_evidence("ev-1")
    assert copy.read_evidence("ev-4").arguments == {"of": "another process"}
    with pytest.raises(UnknownRecord):
        copy.read_evidence("ev-5")
    with pytest.raises(StoreError, match="exists already"):
        backup(store.path, tmp_path / "copy.db")
    with pytest.raises(StoreError, match="no evidence store"):
        backup(tmp_path / "none.db", tmp_path / "other.db")


def with_caches(path: Path) -> EvidenceStore:
    """Beside what is referred to: a rollout named by none, and an observation named only by a rollout that is."""
    store = filled(path)
    base = store.observations.put("masks", {"video": "ball"}, {}, {"x": np.arange(5.0)})
    named = store.rollouts.put("preview", {"masks": base.id}, {})
    store.rollouts.put(
        "rollout", {"world": "world-b", "horizon": 9}, {}, {"x": np.random.default_rng(1).random(40_000)}
    )
    store.fits.put("ensemble_sample", {"world": "world-b"}, {})
    store.fits.put("fit", {"world": "world-gone"}, {})
    store.evidence.add(Evidence("InspectRollout", {}, case="ball", payload={"data": {"preview": named.id}}))
    return store


def test_pruning_keeps_all_that_is_referred_to(tmp_path: Path) -> None:
    store = with_caches(tmp_path / "atw.db")
    with pytest.raises(StoreLocked, match="end the servers"):
        prune(store.path)
    before = [store.read_evidence(f"ev-{number}") for number in (1, 2, 3, 4)]
    store.close()
    planned = prune(store.path, dry_run=True)
    assert planned.removed == {"observations": 0, "rollouts": 1, "fits": 1}
    done = prune(store.path)
    assert done.removed == planned.removed
    assert done.after is not None
    assert done.after < done.before - 250_000
    assert prune(store.path).removed == {"observations": 0, "rollouts": 0, "fits": 0}
    again = EvidenceStore(store.path)
    assert [again.read_evidence(f"ev-{number}") for number in (1, 2, 3, 4)] == before
    assert again.fits.find("ensemble_sample", {"world": "world-b"}) is not None
    assert again.worlds.document("world-a") == '{"a":1}'
    assert all(finding.good for finding in check(store.path))


def test_a_case_is_removed_with_what_only_it_refers_to(tmp_path: Path) -> None:
    store = with_caches(tmp_path / "atw.db")
    store.cases.add("second", content="c", kind="video", path="/s.mp4", facts={})
    store.cases.add_world("second", "world-a", "built")
    store.evidence.add(Evidence("OpenCase", {}, case="second"))
    store.close()
    with pytest.raises(UnknownRecord, match=r"'ball', 'second'"):
        prune(store.path, cases=["third"])
    removed = prune(store.path, cases=["ball"]).removed
    assert (removed["cases"], removed["evidence"], removed["worlds"], removed["rollouts"]) == (1, 3, 1, 3)
    again = EvidenceStore(store.path)
    assert [case.id for case in again.cases.all()] == ["second"]
    assert again.worlds.document("world-a") == '{"a":1}'
    assert again.read_evidence("ev-5").case == "second"
    assert again.evidence.add(Evidence("OpenCase", {})).id == "ev-6"
    assert all(finding.good for finding in check(store.path))


def test_preferred_world_is_the_latest_with_its_origin_and_tracks(tmp_path: Path) -> None:
    store = filled(tmp_path / "a.db")
    before, modelled = store.cases.worlds("ball"), store.cases.modelled_observations("ball")
    store.cases.prefer_world("ball", before[0][0])
    assert store.cases.worlds("ball") == [*before[1:], before[0]]
    assert store.cases.modelled_observations("ball") == modelled
    store.close()
