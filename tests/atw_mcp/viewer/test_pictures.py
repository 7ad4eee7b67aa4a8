"""The page looks as in the stored pictures, and the comparison sees what a person would."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from tests.atw_mcp.viewer.pictures import SHOTS, difference, show, stored, take

if TYPE_CHECKING:
    from playwright.sync_api import Browser

TOLERANCE = 0.01
"""Share of the area. Measured on these pages: another font 0 to 0.006; a stage moved by 30 px 0.07 to 0.09; no scene
0.013 where it is dark and small, 0.26 elsewhere; no timeline of two lanes 0.05 to 0.1."""
OTHER_FONT = "* { font-family: 'DejaVu Serif', 'Times New Roman', serif !important }"
FAULTS = {"moved": ".stage { margin-top: 30px }", "empty": ".scene canvas { visibility: hidden }"}
STYLE = "css => { const s = new CSSStyleSheet(); s.replaceSync(css); document.adoptedStyleSheets = [s] }"


@pytest.mark.benchmark
@pytest.mark.parametrize("name", SHOTS)
def test_page_looks_as_stored_and_a_fault_shows(browser: Browser, tmp_path: Path, name: str) -> None:
    opened = show(browser, SHOTS[name], tmp_path)
    known = stored(name)
    assert difference(take(opened), known) < TOLERANCE, "python -m tests.atw_mcp.viewer.pictures, and look"
    opened.evaluate(STYLE, OTHER_FONT)
    assert difference(take(opened), known) < TOLERANCE
    for fault, css in FAULTS.items():
        opened.evaluate(STYLE, css)
        assert difference(take(opened), known) > TOLERANCE, fault
    opened.context.close()
