"""Prompts as a client lists them and fills them in."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import anyio
import pytest
from mcp.shared.exceptions import MCPError

from atw_mcp.calls.prompting import all_prompts, read_prompt
from atw_mcp.server import all_tools
from tests.atw_mcp.connections import Mode, connection

PROMPTS = {
    "world-representation-routing",
    "object-discovery",
    "closing-the-gap",
    "world-probing",
    "evidence-based-answer",
}


@pytest.mark.parametrize("mode", ["auto", "legacy"])
def test_prompts_are_listed_filled_and_refused(mode: Mode, tmp_path: Path) -> None:
    async def session() -> None:
        with connection("memory", tmp_path / "atw.db", mode) as client:
            async with client:
                listed = (await client.list_prompts()).prompts
                assert {prompt.name for prompt in listed} == PROMPTS
                assert all(prompt.title and prompt.description for prompt in listed)
                probing = next(prompt for prompt in listed if prompt.name == "world-probing")
                assert [(a.name, a.required) for a in probing.arguments or []] == [
                    ("case", True),
                    ("question", True),
                    ("options", False),
                ]
                given = {"case": "marbles-12ab", "question": "Does {{case}} reach the wall?"}
                filled = await client.get_prompt("world-probing", given)
                text: Any = filled.messages[0].content
                assert "marbles-12ab" in text.text
                assert "Does {{case}} reach the wall?" in text.text  # a value is not a template
                for name, arguments, expected in (
                    ("no-such-prompt", {}, "world-probing"),
                    ("world-probing", {"case": "marbles-12ab"}, "missing ['question']"),
                    ("world-probing", {**given, "colour": "red"}, "unknown ['colour']"),
                ):
                    with pytest.raises(MCPError) as refused:
                        await client.get_prompt(name, arguments)
                    assert refused.value.code == -32602
                    assert expected in refused.value.message

    anyio.run(session)


def test_prompts_name_only_tools_that_exist() -> None:
    tools = {tool.name for tool in all_tools()}
    for prompt in all_prompts():
        called = set(re.findall(r"`([A-Z][a-z]+(?:[A-Z][a-z]+)+|Rollout|Finish)[`(]", prompt.text))
        assert called
        assert called <= tools, prompt.name


def test_calls_in_prompts_use_arguments_that_exist() -> None:
    arguments = {tool.name: set(tool.parameters.get("properties", {})) for tool in all_tools()}
    checked = 0
    for prompt in all_prompts():
        for tool, call in re.findall(r"`([A-Z]\w+)\(([^`]*)\)`", prompt.text):
            names = set(re.findall(r"(?:^|, )(\w+)=", call))
            assert names <= arguments[tool], (prompt.name, tool)
            checked += len(names)
    assert checked > 10


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("no front matter", "no front matter"),
        (
            '+++\nname = "n"\ntitle = "t"\ndescription = "d"\narguments = []\n+++\n{{case}}',
            r"declares the arguments \[\]",
        ),
    ],
)
def test_malformed_prompt_file_is_named(text: str, complaint: str, tmp_path: Path) -> None:
    path = tmp_path / "broken.md"
    path.write_text(text)
    with pytest.raises(ValueError, match=complaint) as refused:
        read_prompt(path)
    assert str(path) in str(refused.value)
