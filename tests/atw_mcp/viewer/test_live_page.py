"""The live page in a browser: it shows work and new records of another process as they come, and their end."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from atw_mcp.calls.app import App
from atw_mcp.calls.error_curve import ErrorCurve
from atw_mcp.transports.web import web_server
from atw_mcp.viewer.live.access import Access
from atw_mcp.viewer.live.site import Site, address
from atw_mcp.worlds.rollouts import compute_rollout
from evidence_store import Answer, Evidence, EvidenceStore
from polyworld.edits.interventions import Remove, branch
from tests.atw_mcp.two_discs import FRAME, two_discs
from tests.atw_mcp.viewer.conftest import Pages

TOKEN = "token-of-this-test"


@pytest.fixture
def writer(tmp_path: Path) -> Iterator[EvidenceStore]:
    """A store with a case that has a question."""
    store = EvidenceStore(tmp_path / "atw.db")
    store.cases.add("ball", content="described", kind="data", path="", facts={})
    store.cases.add_question("ball", "will it bounce?")
    yield store
    store.close()


@pytest.fixture
def url(writer: EvidenceStore) -> Iterator[str]:
    """The address of the case's page on a server in a thread."""
    store = EvidenceStore.to_read(writer.path)
    site = Site(store)
    listening = socket.create_server(("127.0.0.1", 0))
    port = listening.getsockname()[1]
    server = web_server(Access(site.app, TOKEN, port))
    thread = threading.Thread(target=server.run, kwargs={"sockets": [listening]}, daemon=True)
    thread.start()
    yield address(TOKEN, port, "ball")
    server.should_exit = True
    thread.join(10.0)
    site.close()
    store.close()


def test_page_follows_work_and_answers_of_another_process(url: str, pages: Pages, writer: EvidenceStore) -> None:
    page = pages.open(url)
    assert page.query_selector("[data-running]") is None
    work = writer.evidence.add(Evidence("FitWorld", {}, case="ball", status="running", summary="fitting"))
    writer.jobs.start(work.id, "key")
    curve = ErrorCurve("generation", "m")
    for best in (0.004, 0.003, 0.0028):
        curve.add(1.1 * best, best)
    message = "generation 3 of 12, error 3.08 mm, best 2.8 mm, about 8 s left"
    writer.jobs.beat(work.id, 3.0, 12.0, message, curve.to_dict())
    shown = page.wait_for_selector(f'[data-running="{work.id}"][data-done="3"] [data-best]')
    assert shown is not None
    assert float(shown.get_attribute("data-best") or "nan") == 0.0028
    text = " ".join(page.inner_text("[data-running]").split())
    assert "FitWorld generation 3 of 12, error 3.08 mm, best 2.8 mm 25 %, about 8 s left" in text
    page.evaluate("document.querySelector('main').dataset.kept = 'yes'")
    with writer.transaction():
        writer.jobs.finish(work.id)
        writer.evidence.update(Evidence("FitWorld", {}, id=work.id, case="ball", summary="a good fit"))
        writer.cases.add_answer("ball", Answer("will it bounce?", "true", None, (work.id,), ""))
    page.wait_for_selector('[data-question="will it bounce?"][data-answer="true"]')
    page.wait_for_selector("[data-running]", state="detached")
    assert page.query_selector("main[data-kept=yes]") is not None, "the page itself was not loaded again"


def test_page_follows_to_the_committed_world_until_a_person_chooses(
    url: str, pages: Pages, writer: EvidenceStore
) -> None:
    app = App(writer.path)
    case, draft = app.store.cases.get("ball"), two_discs()
    better = branch(draft, [Remove(object="target")])  # any other world
    for world in (draft, better):
        app.keep_world(case, world, how="built")
    runs = {world.id: compute_rollout(app, world, 3 * FRAME)[0] for world in (draft, better)}

    def used(world: str) -> str:
        row = Evidence("Rollout", {}, case="ball", world=world, rollout=runs[world], summary="run")
        return writer.evidence.add(row).id

    for world in (better, draft):
        used(world.id)
    app.close()
    page = pages.open(url)
    shown = "document.querySelector('[name=rollout]').value"
    assert page.evaluate(shown) == runs[draft.id], "the latest while none is committed"
    writer.cases.commit_world("ball", better.id)
    page.wait_for_selector("[name=rollout] option:checked:has-text('committed')", state="attached")
    assert page.evaluate(shown) == runs[better.id]
    page.select_option("[name=rollout]", runs[draft.id])
    row = used(better.id)
    writer.cases.add_answer("ball", Answer("will it bounce?", "true", None, (row,), ""))
    page.wait_for_selector('[data-question="will it bounce?"][data-answer="true"]')
    assert page.evaluate(shown) == runs[draft.id], "what a person chose stays"


def test_note_written_in_the_page_is_kept_and_shown(url: str, pages: Pages, writer: EvidenceStore) -> None:
    app = App(writer.path)
    case, world = app.store.cases.get("ball"), two_discs()
    app.keep_world(case, world, how="built")
    rollout = compute_rollout(app, world, 3 * FRAME)[0]
    app.close()
    writer.evidence.add(Evidence("Rollout", {}, case="ball", world=world.id, rollout=rollout, summary="run"))
    page = pages.open(url)
    page.keyboard.press("ArrowRight")
    page.fill("[aria-label='note at this moment']", "here they meet")
    page.keyboard.press("Enter")
    page.wait_for_selector("[data-note]:has-text('here they meet')")
    (note,) = [row for row in writer.evidence.of_case("ball") if row.tool == "Note"]
    assert (note.rollout, note.world, note.summary) == (rollout, world.id, "here they meet")
    assert note.interval == pytest.approx((FRAME, FRAME))
