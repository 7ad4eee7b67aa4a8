"""Every block of README and of the pages is one that works: commands, calls of tools, arguments, measured tables.

Blocks of Python run in `test_page_examples` and `test_new_effect`; the long commands in the tests of their own.
"""

from __future__ import annotations

import json
import re
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atw_mcp import cli
from atw_mcp.calls.deferred import DeferredTool
from atw_mcp.script import Step, read_arguments, read_line, split_pairs
from atw_mcp.tools import manifest
from polyworld.data.recording_csv import read_recording
from tests.atw_mcp.clips import write_clip

ROOT = Path(__file__).parent.parent
TEXTS = [ROOT / "README.md", *sorted((ROOT / ".docs" / "pages").glob("*.md"))]
FENCED = re.compile(r"^```(\w*)\n(.*?)^```", re.MULTILINE | re.DOTALL)
INDENTED = re.compile(r"(?:(?<=\n\n)|\A)((?: {4}.*\n)+)")
COMMAND = re.compile(r"^(?:\$ )?(?:pip install uv && )?uv run (?:--\w+ \w+ )*(?=\S)(.*)$")
TOOLS = {entry["name"]: DeferredTool.from_entry(entry) for entry in manifest.entries()}
QUICK = ("tools", "call OpenCase", "run", "schema", "import-world", "export-world world.json")
"""Commands that run here, in a folder that holds what they name."""
ROBOT = """<mujoco><worldbody><geom type="plane" size="5 5 1"/><body name="ball" pos="0 0 1"><freejoint/>
<geom type="sphere" size="0.1" mass="1"/></body></worldbody>
<keyframe><key name="home" qpos="0 0 2 1 0 0 0"/></keyframe></mujoco>"""


def blocks() -> list[tuple[str, str, str]]:
    """Return page, language ("" of none, "indented") and text of every block."""
    found = []
    for path in TEXTS:
        text = path.read_text(encoding="utf-8")
        found += [(path.name, language, body) for language, body in FENCED.findall(text)]
        rest = FENCED.sub("", text)
        found += [(path.name, "indented", re.sub("^ {4}", "", body, flags=re.M)) for body in INDENTED.findall(rest)]
    return found


def commands() -> list[list[str]]:
    """Return the arguments of every command of atw-mcp."""
    lines = [
        m[1]
        for _, language, body in blocks()
        if language == "indented"
        for m in map(COMMAND.match, body.splitlines())
        if m
    ]
    return [shlex.split(line.partition(" > ")[0])[1:] for line in lines if line.startswith("atw-mcp")]


def scripts() -> list[str]:
    """Return the blocks that are calls of tools, a line each."""
    return [body for _, language, body in blocks() if language == "indented" and re.match(r"\w+: [A-Z]\w+ ", body)]


def test_every_block_is_of_a_kind_that_is_run() -> None:
    kinds = {
        "python": lambda _: True,
        "json": lambda body: isinstance(json.loads(body), dict),
        "": lambda body: body.startswith("run,object,t,"),
        "indented": lambda body: bool(COMMAND.match(body.splitlines()[0])) or body in scripts() or body[0] in "{$",
    }
    assert len(blocks()) >= 25
    assert [(page, body[:60]) for page, kind, body in blocks() if not kinds[kind](body)] == []
    assert all(page in ("python.md", "worlds.md", "effects.md") for page, kind, _ in blocks() if kind == "python")


@pytest.mark.parametrize("words", commands(), ids=" ".join)
def test_every_command_is_understood(words: list[str]) -> None:
    assert callable(cli._read(words).command)


def test_quick_commands_of_the_pages_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    write_clip(tmp_path / "clip.mp4", frames=30)
    (tmp_path / "robot.xml").write_text(ROBOT)
    (tmp_path / "ask.atw").write_text(next(body for body in scripts() if "clip.mp4" in body))
    quick = [words for words in commands() if " ".join(words).startswith(QUICK)]
    assert len(quick) >= 7
    for words in quick:
        calls = words[0] in ("call", "run")
        assert cli.main([*words, *(["--store", "atw.db"] if calls else [])]) == 0, words
        said = capsys.readouterr().out
        assert said
        if words[0] == "import-world":
            Path("world.json").write_text(said, encoding="utf-8")


def test_calls_of_tools_have_arguments_that_the_tools_take() -> None:
    schemas = manifest.schemas()
    steps = [read_line(line.replace(", ...]", "]")) for body in scripts() for line in body.splitlines()]
    steps += [Step(words[1], split_pairs(words[2:])) for words in commands() if words[0] == "call"]
    assert len(steps) > 15
    for step in steps:
        assert step is not None
        given = {name: re.sub(r"\$\w+\.(\w+)", r"\1-1", str(value)) for name, value in step.arguments.items()}
        read: dict[str, Any] = read_arguments(given, schemas, step.tool)
        if step.tool == "CalibrateCamera":
            read["points"] *= 4  # the page shows the first
        TOOLS[step.tool].checked(read)


def test_arguments_written_as_json_are_those_of_a_tool() -> None:
    written = [json.loads(body) for _, language, body in blocks() if language == "json"]
    assert [TOOLS["ModelVideo" if "video" in given else "BuildWorld"].checked(given) for given in written]


def test_the_line_of_a_batch_is_one_without_a_fault(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    (line,) = [body for _, language, body in blocks() if language == "indented" and body.startswith("{")]
    (tmp_path / "cases.jsonl").write_text(json.dumps(json.loads(line)))
    (tmp_path / "slide.csv").write_text("t,object,x,y,z\n0,puck,0,0,0.05\n0.04,puck,0.04,0,0.05\n")
    assert cli.main(["batch", "cases.jsonl", "--check", "--out", "results"]) == 0, capsys.readouterr().err


def test_the_table_of_measured_places_is_read(tmp_path: Path) -> None:
    (table,) = [body for _, language, body in blocks() if language == ""]
    (tmp_path / "throws.csv").write_text(table)
    run = read_recording(tmp_path / "throws.csv", ["ball"]).runs[0]
    np.testing.assert_array_equal(run.positions[:, 0], [[0.0, 0.0, 1.0], [0.05, 0.0, 1.066]])
