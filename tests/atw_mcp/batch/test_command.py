"""`atw-mcp batch` as a shell sees it: exit codes, the table, what is refused."""

from __future__ import annotations

from pathlib import Path

import pytest

from atw_mcp.batch import run as running
from atw_mcp.cli import main
from tests.atw_mcp.batch.cases import HIT, discs, rows, write


def test_the_table_and_the_exit_code_report_every_case(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = discs(
        "broken", questions=[{"id": "q", "text": "?", "predicate": {**HIT, "b": "nobody"}, "horizon_seconds": 1}]
    )
    manifest = write(tmp_path, discs(), broken, discs("silent", questions=[]))
    given = ["batch", str(manifest), "--out", str(tmp_path / "out"), "--executor", "serial"]
    assert main(given) == 1
    table = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert [line[:3] for line in table[1:6]] == [
        ["discs", "hit", "true"],
        ["discs", "when", "0.8"],
        ["discs", "slower", "false"],
        ["broken", "q", "FAILED"],
        ["silent", "modelled,", "nothing"],
    ]
    assert " ".join(table[6]) == f"3 cases (0 done before), 3 answers, 1 failures: {tmp_path / 'out'}"
    write(tmp_path, discs())
    assert main(given) == 0  # the others are kept, and not merged
    printed = capsys.readouterr().out
    assert "1 cases (1 done before)" in printed
    assert "not merged, because the manifest does not have them: broken, silent" in printed
    assert {row["case"] for row in rows(tmp_path / "out" / "answers.jsonl")} == {"discs"}


def test_what_cannot_be_run_is_refused_with_the_cure(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(running, "run_case", None)  # nothing is to be run
    manifest, out = str(write(tmp_path, discs())), str(tmp_path / "out")
    for given, said in (
        ([], "--out FOLDER is needed"),
        (["--out", out, "--executor", "cloud"], "'cloud' names no executor"),
        (["--out", out, "--limits", str(tmp_path / "none.toml")], "none.toml"),
        (["--out", manifest], "File exists"),
    ):
        assert main(["batch", manifest, *given]) == 2
        assert said in capsys.readouterr().err
    assert main(["batch", str(tmp_path / "none.jsonl"), "--out", out]) == 2
    assert "No such file" in capsys.readouterr().err
