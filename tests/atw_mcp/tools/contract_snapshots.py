"""One JSON file a tool under `contracts/`: its full declaration. Regenerated, as are manifest and page of the tools, by

    uv run python -m tests.atw_mcp.tools.contract_snapshots

after a deliberate change; `test_contracts.py` compares.
"""

from __future__ import annotations

import json
import tempfile
from pathlib import Path
from typing import Any

import anyio
from mcp_types import Tool

from atw_mcp.server import build_server
from atw_mcp.tools import manifest
from tests.atw_mcp.tools import tools_page

FOLDER = Path(__file__).parent / "contracts"


def full_contracts() -> dict[str, dict[str, Any]]:
    """Every tool in full, by name."""

    async def listed() -> list[Tool]:
        with tempfile.TemporaryDirectory() as folder:
            return await build_server(Path(folder) / "atw.db").full_tools()

    return {t.name: t.model_dump(mode="json", by_alias=True, exclude_none=True) for t in anyio.run(listed)}


def write() -> None:
    """Replace the manifest of the tools, their page, and every snapshot."""
    manifest.write()
    tools_page.write()
    FOLDER.mkdir(exist_ok=True)
    for old in FOLDER.glob("*.json"):
        old.unlink()
    for name, contract in full_contracts().items():
        (FOLDER / f"{name}.json").write_text(json.dumps(contract, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    write()
