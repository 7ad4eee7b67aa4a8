"""A manifest that cannot be run says which line, which field, and what there is instead."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from atw_mcp.batch.manifest import ManifestError, manifest_schema, read_manifest
from atw_mcp.cli import main
from tests.atw_mcp.batch.cases import HIT, discs, puck, write


def findings(folder: Path, *entries: dict[str, Any] | str, look: bool = False) -> list[str]:
    with pytest.raises(ManifestError) as refused:
        read_manifest(write(folder, *entries), look_for_files=look)
    return list(refused.value.findings)


def question(**more: Any) -> dict[str, Any]:
    return {"id": "a", "questions": [{"id": "q", "text": "?", "predicate": HIT, **more}]}


def test_cases_keep_their_lines_places_and_paths(tmp_path: Path) -> None:
    cases = read_manifest(write(tmp_path, "# of two", discs(), "", puck(tmp_path)), look_for_files=True)
    assert [(c.entry.id, c.entry.kind, c.line, c.place, c.first_evidence) for c in cases] == [
        ("discs", "described", 2, 1, 1),
        ("slide", "tracks", 4, 2, 1001),
    ]
    assert cases[1].entry.files(tmp_path) == {"tracks": tmp_path / "slide.csv"}


@pytest.mark.parametrize(
    ("entry", "parts"),
    [
        ("{oops", ["line 2, column 2: no JSON object"]),
        ("[1]", ["line 2: a list; give one JSON object a line"]),
        ({"id": "a b"}, ["line 2 (a b): id:", "got 'a b'"]),
        ({"id": "a", "video": "v.mp4", "tracks": "t.csv"}, ["video, tracks: give one of them"]),
        ({"id": "a", "video": "v.mp4", "pionts": []}, ["pionts: no such field (did you mean 'points'?)"]),
        ({"id": "a", "tracks": "t", "fit": {"methd": "cem"}}, ["fit.methd: no such field (did you mean 'method'?)"]),
        (
            {"id": "a", "tracks": "t", "fit": {"generations": 0}},
            ["fit: FitWorld: generations", "greater than or equal to 1"],
        ),
        ({"id": "a", "tracks": "t", "fit": {"seed": 1}}, ["fit.seed: give it as the seed of the case"]),
        ({"id": "a", "fit": {}}, ["fit: not of a case without video or tracks"]),
        ({"id": "a", "floor": [1]}, ["BuildWorld: floor", "`atw-mcp tools BuildWorld`"]),
        ({"id": "discs"}, ["line 1 has the case 'discs' already"]),
        (question(predicate=None), ["questions.0", "predicate"]),
        (question(predicate={"predicate": "colides"}), ["questions.0.predicate", "did you mean 'collides'?"]),
        (
            question(edits=[{"action": "delete"}]),
            ["questions.0.edits.0: no action 'delete' (did you mean 'remove'?)", "remove, add, move"],
        ),
        (question(), ["questions.0.horizon_seconds: is required"]),
        (question(horizon_seconds=1, how_sure=True), ["questions.0.how_sure: a described world is not fitted"]),
        (question(ensemble=2), ["questions.0.ensemble: no such field", "how_sure"]),
        (question(how_sure=True, aggregation="all"), ["questions.0.how_sure: is known of", "any, first, count"]),
        (question(horizon=2), ["questions.0.horizon: no such field", "horizon_seconds"]),
    ],
)
def test_what_is_wrong_is_named_with_its_line_and_what_there_is(tmp_path: Path, entry: Any, parts: list[str]) -> None:
    found = "\n".join(findings(tmp_path, discs(), entry))
    assert found.startswith("line 2")
    for part in parts:
        assert part in found


def test_a_byte_order_mark_is_no_part_of_a_line(tmp_path: Path) -> None:
    path = tmp_path / "windows.jsonl"
    path.write_text(json.dumps(discs()), encoding="utf-8-sig")
    assert [case.entry.id for case in read_manifest(path)] == ["discs"]


def test_the_manifest_that_the_page_runs_has_nothing_wrong() -> None:
    root = Path(__file__).parents[3]
    assert "atw-mcp batch atw_mcp/demo/batch.jsonl" in (root / ".docs" / "pages" / "serve.md").read_text()
    cases = read_manifest(root / "atw_mcp" / "demo" / "batch.jsonl", look_for_files=True)
    assert [case.entry.kind for case in cases] == ["video", "described"]


def test_everything_wrong_is_reported_at_once_and_missing_files_where_asked(tmp_path: Path) -> None:
    broken = {"id": "a", "tracks": "none.csv", "colour": 1}
    found = findings(tmp_path, broken, "{", question(colour=1, horizon_seconds=1), look=True)
    assert [text.partition(":")[0] for text in found] == [
        "line 1 (a)",
        "line 1 (a)",
        "line 2, column 2",
        "line 3 (a)",
        "line 3 (a)",
    ]
    assert f"there is no file {tmp_path / 'none.csv'}" in found[1]
    assert findings(tmp_path, "# nothing") == [
        "the manifest has no case: give one JSON object a line, as `atw-mcp schema manifest` says"
    ]


def test_check_says_it_on_stderr_and_the_schema_has_every_field(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write(tmp_path, {"id": "a", "tracks": "none.csv"})
    assert main(["batch", str(path), "--check"]) == 2
    assert f"{path}: line 1 (a): tracks: there is no file" in capsys.readouterr().err
    assert main(["batch", str(write(tmp_path, discs())), "--check"]) == 0
    assert "1 cases with 3 questions" in capsys.readouterr().out
    assert main(["schema", "manifest"]) == 0
    schema = json.loads(capsys.readouterr().out)
    assert schema == manifest_schema()
    video, tracks, described = (set(form["properties"]) for form in schema["oneOf"])
    assert {"id", "video", "points", "known_length", "objects", "observe", "fit", "questions", "seed"} <= video
    assert {"tracks", "read", "fit", "parts"} <= tracks - video | {"fit"}
    assert not {"video", "tracks", "fit", "case"} & described
    asked = schema["oneOf"][0]["properties"]["questions"]["items"]["properties"]
    assert {"id", "text", "predicate", "edits", "horizon_seconds", "aggregation", "how_sure"} <= set(asked)
