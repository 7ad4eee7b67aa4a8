"""What `tools/list` costs an agent's context, by toolset: `python -m tests.benchmarks.list_tokens`.

Bytes of the result on the wire, and tokens by the tokenizer o200k_base of js-tiktoken, which npm fetches; without npm,
a quarter of the bytes, marked by a tilde.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

import anyio
from mcp import Client
from mcp_types import ListToolsResult

from atw_mcp.calls.toolsets import TOOLSETS, Selection
from atw_mcp.server import build_server

TOKENIZER = "js-tiktoken@1.0.21"
COUNT = """
const { Tiktoken } = require("js-tiktoken/lite");
const coder = new Tiktoken(require("js-tiktoken/ranks/o200k_base"));
console.log(coder.encode(require("fs").readFileSync(0, "utf8")).length);
"""


def main() -> int:
    """Print a row a toolset; returns the exit code."""
    with tempfile.TemporaryDirectory() as folder:
        room = Path(folder)
        for toolset in ("core", *TOOLSETS):
            text, count = anyio.run(listed, room / "atw.db", toolset)
            tokens = tokens_of(text, room)
            cost = f"~{len(text.encode()) // 4}" if tokens is None else str(tokens)
            print(f"{toolset:10} {count:3} tools {len(text.encode()):7} bytes {cost:>7} tokens")
    return 0


async def listed(store: Path, toolset: str) -> tuple[str, int]:
    """Return the list as it is sent, and how many tools it has."""
    async with Client(build_server(store, selection=Selection.of(toolset, read_only=False))) as client:
        tools = (await client.list_tools()).tools
    return ListToolsResult(tools=tools).model_dump_json(by_alias=True, exclude_none=True), len(tools)


def tokens_of(text: str, room: Path) -> int | None:
    """Return the number of tokens of a text; None where the tokenizer cannot be had. room: where it is installed."""
    npm, node = shutil.which("npm"), shutil.which("node")
    if npm is None or node is None:
        return None
    if not (room / "node_modules").is_dir():
        subprocess.run([npm, "install", "--silent", "--prefix", str(room), TOKENIZER], check=False, timeout=120)
    counted = subprocess.run(
        [node, "-e", COUNT], input=text, cwd=room, capture_output=True, text=True, check=False, timeout=120
    )
    return int(counted.stdout) if counted.returncode == 0 else None


if __name__ == "__main__":
    sys.exit(main())
