"""The session written down is one with the tools there are, and comes out the same again."""

from __future__ import annotations

import json
import re

import anyio
import pytest

from atw_mcp.tools import manifest
from tests.packaging.transcript import FILE, steps, transcript

WRITTEN = FILE.read_text(encoding="utf-8")
CALL = re.compile(r"^## \d+\. (\w+)$.*?^```json\n(.*?)\n```$", re.MULTILINE | re.DOTALL)


def test_session_written_down_makes_the_calls_of_the_demo_with_arguments_that_exist() -> None:
    calls = CALL.findall(WRITTEN)
    assert [tool for tool, _ in calls] == [step.tool for step in steps()]
    schemas = manifest.schemas()
    for tool, arguments in calls:
        assert set(json.loads(arguments)) <= set(schemas[tool]["properties"])


@pytest.mark.benchmark
def test_session_comes_out_the_same_again() -> None:
    def outline(text: str) -> list[str]:
        return [line for line in text.splitlines() if line.startswith(("## ", "`ev-", "Refused"))]

    assert outline(anyio.run(transcript)) == outline(WRITTEN)
