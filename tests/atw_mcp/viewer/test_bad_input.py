"""Commands and pages given what cannot be shown say so, say what to do next, and show the rest."""

from __future__ import annotations

import base64
import re
import sqlite3
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest

from atw_mcp.calls.app import App
from atw_mcp.cli import main
from atw_mcp.viewer import document as view
from atw_mcp.viewer.case_document import case_document
from atw_mcp.viewer.packing import Blocks, packed
from atw_mcp.viewer.page import page
from atw_mcp.worlds.rollouts import compute_rollout
from evidence_store import Evidence, EvidenceStore
from polyworld.world import World
from tests.atw_mcp.viewer.acceptance import Reader, report
from tests.atw_mcp.viewer.conftest import Pages
from tests.atw_mcp.viewer.stores import discs_store

if TYPE_CHECKING:
    from playwright.sync_api import Browser

RUNAWAY = {
    "time": {"seconds_per_frame": 0.02},
    "objects": [
        {
            "name": "puck",
            "representation": "rigid_planar",
            "shape": {"kind": "cylinder", "radius": 0.1, "half_height": 0.03},
            "position": [0, 0, 0.03],
            "velocity": [1.0, 0, 0],
            "mass": 1.0,
            "friction": 0.0,
        }
    ],
    "environment": {"motion_plane": {}},
    "effects": [{"name": "push", "kind": "uniform_acceleration", "parameters": {"x": 1e4}}],
}
DAMAGE = "UPDATE rollouts SET document = '{}' WHERE id = (SELECT min(id) FROM rollouts)"


def _discs(folder: Path) -> Path:
    discs_store(folder / "atw.db")
    return folder / "atw.db"


def _of_another_version(folder: Path) -> Path:
    EvidenceStore(folder / "atw.db").close()
    with sqlite3.connect(folder / "atw.db") as database:
        database.execute("PRAGMA user_version = 9999")
    return folder / "atw.db"


def _of_another_program(folder: Path) -> Path:
    with sqlite3.connect(folder / "atw.db") as database:
        database.execute("CREATE TABLE notes (text)")
    return folder / "atw.db"


@pytest.mark.parametrize(
    ("store", "words"),
    [
        (_discs, "no case 'disks'; cases: ['discs']"),
        (_of_another_version, "update atw-mcp"),
        (_of_another_program, "another program"),
    ],
)
def test_commands_refuse_what_they_cannot_show(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], store: Callable[[Path], Path], words: str
) -> None:
    path = store(tmp_path)
    for command in (["report", "disks", "--out", str(tmp_path / "r.html")], ["view", "disks", "--no-browser"]):
        assert main([*command, "--store", str(path)]) == 1
        assert words in capsys.readouterr().err


@pytest.mark.benchmark
def test_report_of_a_video_that_has_moved_shows_the_rest(pages: Pages, tmp_path: Path) -> None:
    opened = pages.open(report(_discs(tmp_path), "discs", tmp_path / "r.html"))
    assert "discs.mp4 is not where it was" in opened.inner_text(".notices")
    assert "/clips" not in (opened.text_content("main") or "")
    opened.wait_for_selector('.film[data-observed~="striker"]')
    reader = Reader(opened)
    assert len(reader.rollouts()) == 2
    reader.scrub(0.5)
    assert reader.series("x")


@pytest.mark.benchmark
def test_report_of_a_case_without_a_world(pages: Pages, tmp_path: Path) -> None:
    store = EvidenceStore(tmp_path / "atw.db")
    store.cases.add("empty", content="x", kind="data", path="", facts={})
    store.cases.add_question("empty", "What will happen?")
    store.evidence.add(Evidence("OpenCase", {}, case="empty", summary="opened"))
    store.close()
    opened = pages.open(report(tmp_path / "atw.db", "empty", tmp_path / "r.html"))
    text = opened.inner_text("main")
    assert "The case has no world yet." in text
    assert "neither a video nor a world" in text
    assert "not answered yet" in text
    opened.click("#tab-evidence")
    assert opened.locator("[data-evidence]").count() == 1


@pytest.mark.benchmark
def test_report_of_a_rollout_that_diverged(pages: Pages, tmp_path: Path) -> None:
    app = App(tmp_path / "atw.db")
    world = World.model_validate(RUNAWAY)
    app.store.cases.add("runaway", content="x", kind="data", path="", facts={})
    app.keep_world(app.store.cases.get("runaway"), world, how="given")
    rollout, result = compute_rollout(app, world, 120.0)
    assert result.status == "diverged"
    app.store.evidence.add(Evidence("Rollout", {}, case="runaway", world=world.id, rollout=rollout, status="diverged"))
    app.close()
    opened = pages.open(report(tmp_path / "atw.db", "runaway", tmp_path / "r.html"))
    assert "puck" in opened.inner_text('.choosers [data-status="diverged"]')
    reader = Reader(opened)
    reader.press("End")
    assert 0 < reader.time < 120.0
    assert all(np.isfinite(value) for value in reader.series("x").values())


@pytest.mark.benchmark
def test_report_of_a_damaged_record_names_it(pages: Pages, tmp_path: Path) -> None:
    path = _discs(tmp_path)
    with sqlite3.connect(path) as database:
        database.execute(DAMAGE)
    opened = pages.open(report(path, "discs", tmp_path / "r.html"))
    assert re.search(r"Rollout rollout-\w+ cannot be shown", opened.text_content(".notices") or "")
    assert len(Reader(opened).rollouts()) == 1


@pytest.fixture
def document(tmp_path: Path) -> tuple[view.ViewDocument, Blocks]:
    """The document of a small case."""
    store = EvidenceStore.to_read(_discs(tmp_path))
    try:
        return case_document(store, "discs")
    finally:
        store.close()


@pytest.mark.benchmark
def test_pages_with_a_document_that_is_incomplete_or_of_another_version_say_so(
    browser: Browser, pages: Pages, tmp_path: Path, document: tuple[view.ViewDocument, Blocks]
) -> None:
    data = packed(*document)
    whole = page(data)
    inside = base64.b64encode(data).decode()
    other = page(packed(document[0].model_copy(update={"format": "atw-view/0"}), document[1]))
    for name, html, words in (
        ("cut", whole.replace(inside, inside[: len(inside) // 2]), "incomplete"),
        ("odd", whole.replace(inside, inside[: len(inside) // 2 + 1]), "incomplete"),
        ("older", other, "atw-view/0"),
    ):
        (tmp_path / f"{name}.html").write_text(html, encoding="utf-8")
        said = pages.open(tmp_path / f"{name}.html").get_by_role("alert").first
        assert words in said.inner_text(), name
    half = tmp_path / "half.html"  # the file itself was cut off, with the script behind the document
    half.write_text(whole[: whole.index(inside) + 1000], encoding="utf-8")
    context = browser.new_context()
    opened = context.new_page()
    opened.goto(half.as_uri())
    assert "the file is incomplete" in opened.inner_text("#app")
    context.close()


@pytest.mark.benchmark
def test_film_that_the_browser_cannot_play_leaves_outlines_and_scene(
    pages: Pages, tmp_path: Path, document: tuple[view.ViewDocument, Blocks]
) -> None:
    shown, blocks = document
    film = view.Film(
        mime="video/mp4",
        data=blocks.raw(np.frombuffer(b"no film" * 100, dtype=np.uint8)),
        url=None,
        width=320,
        height=240,
        frame_count=4,
        media_times=blocks.floats(np.arange(4) * 0.04),
        note="",
    )
    path = tmp_path / "film.html"
    path.write_text(page(packed(shown.model_copy(update={"film": film}), blocks)), encoding="utf-8")
    opened = pages.open(path)
    opened.wait_for_selector(".film-legend [role=status]:has-text('video')")
    opened.wait_for_selector('.film[data-observed~="striker"]')
    reader = Reader(opened)
    reader.scrub(0.5)
    assert reader.series("x")
