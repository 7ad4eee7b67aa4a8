"""A session with the server written down, call by call: `python -m tests.packaging.transcript` replaces the file.

The calls are those of the demo about a collision, with one made too early, as agents do, which the server refuses.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import anyio
from mcp import Client

from atw_mcp.client import Session
from atw_mcp.demo.truth import FOLDER
from atw_mcp.replies import Reply, ToolFailed
from atw_mcp.script import Step, read_script, resolved, step_arguments
from atw_mcp.server import build_server
from atw_mcp.tools import manifest

FILE = Path(__file__).parents[2] / "prompts" / "sessions" / "collision.md"
ROOM = 700  # characters shown of the data of a result
SHOWN_FOLDER = "/videos"  # instead of where the clip lies here
TITLE = """\
# A session, call by call

Two questions about a video of 72 frames: *does the red cylinder touch the yellow one?* And *would it, if the blue cube
were not there?* What the agent thinks stands in italics; each call is a `tools/call` with these arguments; the replies
are the server's own, their data shortened. Made by `python -m tests.packaging.transcript`.
"""


class Silent:
    """Shows no progress."""

    def show(self, done: float, total: float | None, message: str) -> None:
        """Do nothing."""

    def clear(self) -> None:
        """Do nothing."""


def steps() -> Iterator[Step]:
    """The calls of the demo; before the commit a rollout, which is refused."""
    for step in read_script(FOLDER / "collision.atw"):
        if step.tool == "CommitWorld":
            say = "The outlines follow the objects. What would happen without the blue cube?"
            yield Step(
                "Rollout", {"case": "$open.case", "edits": '[{"action":"remove","object":"blue_cube"}]'}, None, say
            )
            step = replace(step, say="The world must be committed first; its fit is good enough for that.")
        yield step


def write() -> None:
    """Hold the session and write it down."""
    FILE.parent.mkdir(parents=True, exist_ok=True)
    FILE.write_text(anyio.run(transcript), encoding="utf-8")


async def transcript() -> str:
    """The session in Markdown."""
    parts = [TITLE]
    known: dict[str, Any] = {"folder": str(FOLDER), "name": "collision"}
    with tempfile.TemporaryDirectory() as folder:
        async with Client(build_server(Path(folder) / "atw.db")) as client:
            session = Session(client, manifest.schemas(), Silent())
            for number, step in enumerate(steps(), start=1):
                arguments = step_arguments(step, known, session.schemas)
                said = "" if step.say is None else f"*{' '.join(str(resolved(step.say, known)).split())}*\n\n"
                try:
                    reply = await session.call(step.tool, arguments)
                    answer = _reply(reply)
                    if step.name is not None:
                        known[step.name] = reply.body
                except ToolFailed as refusal:
                    answer = f"Refused: {refusal}"
                called = json.dumps(arguments, ensure_ascii=False)
                parts.append(f"## {number}. {step.tool}\n\n{said}```json\n{called}\n```\n\n{answer}\n")
    return "\n".join(parts).replace(str(FOLDER), SHOWN_FOLDER)


def _reply(reply: Reply) -> str:
    text = json.dumps(reply.body["data"], ensure_ascii=False)
    shown = text if len(text) <= ROOM else f"{text[:ROOM]} ..."
    pictures = f" Pictures: {len(reply.pictures)}." if reply.pictures else ""
    return f"`{reply.body['evidence']}` {reply.body['summary']}.{pictures}\n\n    {shown}"


if __name__ == "__main__":
    write()
