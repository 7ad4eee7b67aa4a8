"""The page with a document inside: one HTML file that needs nothing else."""

from __future__ import annotations

import base64
from pathlib import Path

FILE = Path(__file__).parent / "viewer.html"
PLACE = "<!--document-->"


def page(document: bytes) -> str:
    """Return the page that shows a packed document. Raises FileNotFoundError where the page was never built."""
    text = base64.b64encode(document).decode("ascii")
    inside = f'<script type="application/octet-stream" id="document">{text}</script>'
    return _built().replace(PLACE, inside, 1)


def _built() -> str:
    if not FILE.is_file():
        raise FileNotFoundError(f"{FILE} is missing: `node build.mjs` in atw_mcp/viewer/web makes it")
    return FILE.read_text(encoding="utf-8")


def live_page() -> str:
    """Return the page that asks the server which sent it for the document. Raises FileNotFoundError as `page`."""
    return _built().replace(PLACE, '<meta name="atw-live">', 1)
