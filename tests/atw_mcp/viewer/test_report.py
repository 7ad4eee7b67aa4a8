"""`atw-mcp report` writes a page with the document inside, and fails with what to do next."""

from __future__ import annotations

import base64
import re
import sqlite3
from pathlib import Path

import pytest

from atw_mcp.cli import main
from atw_mcp.viewer import page
from atw_mcp.viewer.packing import unpacked
from evidence_store import EvidenceStore
from tests.atw_mcp.viewer.stores import discs_store


@pytest.fixture(scope="module")
def store(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "atw.db"
    discs_store(path)
    return path


@pytest.fixture
def small_page(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "viewer.html"
    file.write_text(f"<html><body>{page.PLACE}<script>1</script></body></html>", encoding="utf-8")
    monkeypatch.setattr(page, "FILE", file)


def report(store: Path, out: Path, *options: str, case: str = "discs") -> int:
    return main(["report", case, "--store", str(store), "--out", str(out), *options])


@pytest.mark.usefixtures("small_page")
def test_the_file_holds_the_document_and_what_is_missing_is_printed(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = store.read_bytes()
    assert report(store, tmp_path / "report.html") == 0
    html = (tmp_path / "report.html").read_text(encoding="utf-8")
    inside = re.search(r'<script type="application/octet-stream" id="document">([A-Za-z0-9+/=]+)</script>', html)
    assert inside is not None
    document, _ = unpacked(base64.b64decode(inside[1]))
    assert document.case.id == "discs"
    assert len(document.rollouts) == 2
    printed = capsys.readouterr().out
    assert "report.html" in printed
    assert all(f"not shown: {sentence}" in printed for sentence in document.missing)
    assert document.film is None
    assert any("discs.mp4 is not where it was" in sentence for sentence in document.missing)  # a video that has moved
    assert store.read_bytes() == before


@pytest.mark.usefixtures("small_page")
def test_what_cannot_be_shown_is_refused_with_what_can(
    store: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "report.html"
    newer, other = tmp_path / "newer.db", tmp_path / "other.db"
    EvidenceStore(newer).close()
    with sqlite3.connect(newer) as database:
        database.execute("PRAGMA user_version = 9999")
    with sqlite3.connect(other) as database:
        database.execute("CREATE TABLE notes (text)")
    for code, words in (
        (lambda: report(store, out, case="disks"), "no case 'disks'; cases: ['discs']"),
        (lambda: report(store, out, "--rollout", "rollout-0"), "has no rollout 'rollout-0'"),
        (lambda: report(tmp_path / "absent.db", out), "there is no evidence store"),
        (lambda: report(newer, out), "newer"),
        (lambda: report(other, out), "another program"),
        (lambda: report(store, tmp_path / "absent" / "report.html"), "cannot be written"),
    ):
        assert code() == 1
        assert words in capsys.readouterr().err
    assert not out.exists()
    assert not (tmp_path / "absent.db").exists()


def test_a_page_that_was_never_built_says_how(
    store: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(page, "FILE", tmp_path / "viewer.html")
    assert report(store, tmp_path / "report.html") == 1
    assert "node build.mjs" in capsys.readouterr().err
