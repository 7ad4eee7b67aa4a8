"""A search over the evidence of a case finds what meets every condition, page by page, latest first."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from evidence_store import Evidence, EvidenceStore, UnknownRecord
from evidence_store.checksums import intact


@pytest.fixture
def store(tmp_path: Path) -> EvidenceStore:
    store = EvidenceStore(tmp_path / "atw.db")
    for name in ("ball", "other"):
        store.cases.add(name, content=name, kind="video", path=f"/{name}.mp4", facts={})
    for record in (
        Evidence("OpenCase", {"video": "/ball.mp4"}, case="ball", summary="30 frames"),
        Evidence("Rollout", {"seed": 1}, case="ball", objects=("red", "blue"), interval=(0, 2), summary="Red falls"),
        Evidence("Rollout", {"seed": 2}, case="ball", objects=("blue",), interval=(3.0, 4.0), status="diverged"),
        Evidence("ReadEvents", {}, case="other", objects=("red",), interval=(0.0, 2.0), summary="red falls"),
        Evidence(
            "ReadEvents", {}, case="ball", objects=("red",), interval=(1.0, 3.5), summary="two events",
            payload={"data": {"note": 'Öl on the "floor"'}}, pictures={"a.png": b"x"},
        ),
    ):  # fmt: skip
        store.evidence.add(record)
    return store


@pytest.mark.parametrize(
    ("conditions", "found"),
    [
        ({}, ["ev-5", "ev-3", "ev-2", "ev-1"]),
        ({"tool": "Rollout"}, ["ev-3", "ev-2"]),
        ({"status": "diverged"}, ["ev-3"]),
        ({"object": "red"}, ["ev-5", "ev-2"]),
        ({"object": "re"}, []),
        ({"interval": (2.0, 2.5)}, ["ev-5", "ev-2"]),
        ({"interval": (2.1, 2.5)}, ["ev-5"]),
        ({"interval": (3.6, 9.0)}, ["ev-3"]),
        ({"text": "FALLS red"}, ["ev-2"]),
        ({"text": "ball.mp4"}, ["ev-1"]),
        ({"text": "öl"}, ["ev-5"]),
        ({"text": '"floor"'}, ["ev-5"]),
        ({"text": "100%"}, []),
        ({"tool": "Rollout", "object": "blue", "interval": (0.0, 1.0), "status": "completed"}, ["ev-2"]),
    ],
)
def test_conditions_select_records_of_the_case(
    store: EvidenceStore, conditions: dict[str, object], found: list[str]
) -> None:
    page = store.evidence.search("ball", **conditions)  # type: ignore[arg-type]
    assert [record.id for record in page.records] == found
    assert page.cursor is None
    assert all(record.payload == {} and record.pictures == {} for record in page.records)


def test_pages_join_without_gap_or_repetition_while_records_are_added(store: EvidenceStore) -> None:
    seen: list[str] = []
    cursor = None
    while True:
        page = store.evidence.search("ball", limit=3, cursor=cursor)
        seen += [record.id for record in page.records]
        store.evidence.add(Evidence("Rollout", {}, case="ball"))
        if page.cursor is None:
            break
        cursor = page.cursor
    assert seen == ["ev-5", "ev-3", "ev-2", "ev-1"]
    assert store.evidence.search("ball", tool="ReadEvents", limit=1).cursor is None, "nothing more matches"


def test_a_search_that_makes_no_sense_is_refused(store: EvidenceStore) -> None:
    with pytest.raises(ValueError, match="limit"):
        store.evidence.search("ball", limit=0)
    with pytest.raises(ValueError, match="start <= end"):
        store.evidence.search("ball", interval=(2.0, 1.0))
    with pytest.raises(ValueError, match="word"):
        store.evidence.search("ball", text="  ")
    with pytest.raises(UnknownRecord, match="page-2"):
        store.evidence.search("ball", cursor="page-2")
    assert store.evidence.search("nothing").records == ()


def test_a_search_reads_only_records_that_match(store: EvidenceStore, monkeypatch: pytest.MonkeyPatch) -> None:
    for number in range(50):
        store.evidence.add(Evidence("QueryWorld", {"n": number}, case="ball", objects=("grey",), interval=(9.0, 9.5)))
    read: list[int] = []

    def counted(table: str, row: Mapping[str, Any]) -> bool:
        read.append(row["seq"])
        return intact(table, row)

    monkeypatch.setattr("evidence_store.evidence.intact", counted)
    for conditions in ({"object": "red"}, {"interval": (0.0, 3.0)}, {"text": "falls red"}, {"status": "diverged"}):
        read.clear()
        found = store.evidence.search("ball", **conditions)  # type: ignore[arg-type]
        matching = [record.id for record in found.records]
        assert matching
        assert set(read) <= {int(name.removeprefix("ev-")) for name in (*matching, "ev-5")}, "ev-5 has an umlaut"


@pytest.mark.parametrize(
    "word", ["ß", "ss", "ſtraße", "strasse", "k", "\u212a", "ﬁ", "fi", "É", "é", 'a"b', "c\\d", "%", "_"]
)
def test_words_are_found_whatever_their_case(store: EvidenceStore, word: str) -> None:
    texts = (
        "Straße",
        "STRASSE",
        "\u212aelvin",
        "kelvin",
        "ﬁn",
        "FIN",
        "ÉTÉ",
        "été",
        'A"B',
        "C\\D",
        "100%",
        "snake_case",
    )
    made = {store.evidence.add(Evidence("Rollout", {"note": text}, case="other")).id: text for text in texts}
    expected = [name for name, text in made.items() if word.casefold() in text.casefold()]
    found = [record.id for record in store.evidence.search("other", text=word).records if record.id in made]
    assert found == expected[::-1]


def test_the_last_record_about_a_rollout_is_found_in_each_case(store: EvidenceStore) -> None:
    ids = {
        number: store.evidence.add(Evidence("QueryWorld", {}, case=case, rollout=rollout)).id
        for number, (case, rollout) in enumerate((("ball", "a"), ("other", "a"), ("ball", "a"), ("ball", "b")))
    }
    assert store.evidence.last_about("ball", "a") == ids[2]
    assert store.evidence.last_about("other", "a") == ids[1]
    assert store.evidence.last_about("other", "b") is None
    assert store.evidence.rollouts(5) == ["b", "a"]
    assert store.evidence.rollouts(1) == ["b"]
