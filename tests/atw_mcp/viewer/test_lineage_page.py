"""The panels of provenance and fits in a browser, against the store."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from atw_mcp.viewer import document as view
from atw_mcp.viewer import page as made
from atw_mcp.viewer.fits import fit_views
from atw_mcp.viewer.lineage import provenance
from atw_mcp.viewer.packing import Blocks, packed
from evidence_store import Evidence, EvidenceStore
from tests.atw_mcp.viewer.conftest import Pages
from tests.atw_mcp.viewer.test_fits import CURVE, VALUES, fitted
from tests.atw_mcp.viewer.test_lineage import branched, upstream


def written(graph: view.Provenance, fits: EvidenceStore, path: Path) -> Path:
    """A page with a provenance graph and the fits of another case: one page is opened sooner than two."""
    if not made.FILE.is_file():
        pytest.skip("the page was not built: `node build.mjs` in atw_mcp/viewer/web")
    blocks = Blocks()
    head = view.CaseView(
        id="ball", kind="video", file="c.mp4", questions=[], answers=[], bindings=[], committed_world=None
    )
    empty: dict[str, Any] = {name: [] for name, kind in view.ViewDocument.model_fields.items() if kind.is_required()}
    shown = empty | {
        "made_by": "a test",
        "case": head,
        "film": None,
        "observed": None,
        "fits": fit_views(fits, "c", blocks, []),
        "provenance": graph,
    }
    path.write_text(made.page(packed(view.ViewDocument(**shown), blocks)), encoding="utf-8")
    return path


def test_an_answer_lights_what_it_rests_on_and_parameters_have_their_values(tmp_path: Path, pages: Pages) -> None:
    store = branched(tmp_path / "s.db")
    for _ in range(12):
        store.evidence.add(Evidence("ReadEvents", {}, case="ball", world="world-d"))
    graph = provenance(store, "ball", [])
    page = pages.open(written(graph, fitted(tmp_path / "fits.db"), tmp_path / "page.html"))
    page.click("#tab-provenance")
    for answer in ("answer-2-ball", "answer-1-ball"):
        page.click(f"[data-node='{answer}']")
        lit = page.eval_on_selector_all(".node.lit", "nodes => nodes.map(n => n.dataset.node)")
        assert set(lit) == upstream(graph, answer)
    fold = page.locator("[data-node='fold:evidence:ReadEvents']")
    assert fold.get_attribute("data-count") == "12"
    fold.click()
    assert page.locator(".node[data-kind=evidence]").count() >= 12
    page.focus("[data-node='answer-2-ball']")
    page.keyboard.press("ArrowLeft")
    page.keyboard.press("Enter")
    assert page.get_attribute("[data-detail]", "data-detail") == "ev-5"
    page.click("button:text-is('list')")
    page.click("summary:has-text('and without the cube?')")
    listed = page.eval_on_selector_all("details[open] [data-node]", "nodes => nodes.map(n => n.dataset.node)")
    assert set(listed) == upstream(graph, "answer-2-ball") - {"answer-2-ball"}

    page.set_viewport_size({"width": 400, "height": 800})
    page.click("#tab-fits")
    for value in VALUES:
        row = page.locator(f"[data-parameter='{value['name']}']")
        assert float(row.get_attribute("data-value") or "") == value["value"]
        assert row.locator(".at-bound").count() == value["at_bound"]
    friction = page.locator("[data-parameter='ball.friction']")
    assert friction.locator(".value").text_content() == "0.200 ± 0.020"
    assert friction.locator("circle").count() == 64
    assert float(page.get_attribute("[data-best]", "data-best") or "") == CURVE["best"][-1]
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
