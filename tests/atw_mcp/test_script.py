"""Scripts of tool calls: reading, references, arguments from text."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import anyio
import pytest

from atw_mcp.replies import Reply, ToolFailed
from atw_mcp.script import ScriptError, Step, read_arguments, read_line, read_script, resolved, run_script, split_pairs

SCHEMAS: dict[str, Any] = {
    "Echo": {
        "properties": {
            "text": {"type": "string"},
            "maybe": {"anyOf": [{"type": "string"}, {"type": "null"}]},
            "number": {"type": "number"},
            "names": {"anyOf": [{"type": "array", "items": {"type": "string"}}, {"type": "null"}]},
            "frames": {"anyOf": [{"type": "array", "items": {"type": "integer"}}, {"type": "null"}]},
            "edits": {"type": "array", "items": {"type": "object"}},
        }
    }
}


class Echo:
    """Returns the arguments it is called with, as a tool result would look."""

    def __init__(self) -> None:
        self.calls: list[dict[str, Any]] = []

    @property
    def schemas(self) -> dict[str, dict[str, Any]]:
        return SCHEMAS

    async def call(self, tool: str, arguments: dict[str, Any]) -> Reply:
        self.calls.append(arguments)
        if arguments.get("text") == "fail":
            raise ToolFailed("no")
        source = {"world": f"world-{len(self.calls)}", "rollout": None}
        return Reply(tool, {"evidence": f"ev-{len(self.calls)}", "source": source, "data": arguments})


def run(steps: list[Step], **variables: Any) -> tuple[Echo, list[str | None]]:
    caller, said = Echo(), []

    async def all_steps() -> None:
        async for _ in run_script(steps, caller, variables, lambda _, text: said.append(text)):
            pass

    anyio.run(all_steps)
    return caller, said


def script(tmp_path: Path, text: str) -> list[Step]:
    path = tmp_path / "calls.atw"
    path.write_text(text)
    return read_script(path)


def test_later_calls_use_earlier_results_with_their_types(tmp_path: Path) -> None:
    steps = script(
        tmp_path,
        """
        # first a number and a list
        one: Echo number=0.25 names=red,blue
        > it said ${one.number} to $one.names.1; a price is $$5
        Echo number=$one.number text=$one.evidence maybe="in ${one.world}, $who" \\
             names=$one.names edits='[{"action": "remove", "object": "$one.names.0"}]'
        """,
    )
    caller, said = run(steps, who="Ann")
    assert caller.calls[0] == {"number": 0.25, "names": ["red", "blue"]}
    assert caller.calls[1] == {
        "number": 0.25,
        "text": "ev-1",
        "maybe": "in world-1, Ann",
        "names": ["red", "blue"],
        "edits": [{"action": "remove", "object": "red"}],
    }
    assert said == [None, "it said 0.25 to blue; a price is $5"]


def test_strings_stay_strings_where_the_tool_wants_them() -> None:
    given = {"text": "0012", "number": "12", "maybe": "null", "names": '["a,b"]', "other": "[1]"}
    assert read_arguments(given, SCHEMAS, "Echo") == {
        "text": "0012",
        "number": 12,
        "maybe": None,
        "names": ["a,b"],
        "other": [1],
    }


@pytest.mark.parametrize(
    ("given", "read"),
    [
        ({"frames": "7"}, [7]),
        ({"frames": "0,24, 40"}, [0, 24, 40]),
        ({"frames": "[1, 2]"}, [1, 2]),
        ({"frames": "null"}, None),
        ({"names": "7"}, ["7"]),
    ],
)
def test_lists_may_be_written_in_short(given: dict[str, str], read: Any) -> None:
    assert list(read_arguments(given, SCHEMAS, "Echo").values()) == [read]


def test_at_sign_reads_a_file_and_two_are_one(tmp_path: Path) -> None:
    (tmp_path / "edits.json").write_text('[{"action": "remove"}]')
    given = {"edits": f"@{tmp_path / 'edits.json'}", "text": "@@home"}
    assert read_arguments(given, SCHEMAS, "Echo") == {"edits": [{"action": "remove"}], "text": "@home"}
    with pytest.raises(ScriptError, match="cannot read the file"):
        read_arguments({"text": "@/no/such/file"}, SCHEMAS, "Echo")


def test_a_value_with_dollar_signs_is_not_read_twice() -> None:
    assert resolved("$a", {"a": "$b", "b": "wrong"}) == "$b"


def test_failing_call_stops_the_script(tmp_path: Path) -> None:
    steps = script(tmp_path, "Echo text=fail\nEcho text=never")
    caller = Echo()

    async def all_steps() -> None:
        async for _ in run_script(steps, caller, {}, lambda *_: None):
            pass

    with pytest.raises(ToolFailed):
        anyio.run(all_steps)
    assert len(caller.calls) == 1


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("Echo nonsense", r"line 1: 'nonsense' is not key=value"),
        ("# x\n\nEcho text=1 text=2", r"line 3: 'text' is given twice"),
        ("one:", "line 1: a tool name is missing"),
        ("Echo text='open", "line 1: No closing quotation"),
        ("Echo text=1 \\", "line 1: the last line ends in a backslash"),
        ("Echo text=1\n> done", "nothing is called after 'done'"),
        ("", "has no calls"),
    ],
)
def test_malformed_scripts_are_refused_with_the_place(text: str, complaint: str, tmp_path: Path) -> None:
    with pytest.raises(ScriptError, match=complaint):
        script(tmp_path, text)


@pytest.mark.parametrize(
    ("reference", "complaint"),
    [
        ("$two.x", "nothing is called 'two'; known: one"),
        ("$one.wrold", "no 'wrold' there; there is: .*world"),
        ("$one.names.7", r"no '7' there; there is: 0..1"),
    ],
)
def test_reference_to_nothing_names_what_there_is(reference: str, complaint: str) -> None:
    known = {"one": {"evidence": "ev-1", "source": {"world": "w"}, "data": {"names": ["red", "blue"]}}}
    with pytest.raises(ScriptError, match=complaint):
        resolved(reference, known)


def test_unknown_tool_is_refused_before_any_call(tmp_path: Path) -> None:
    with pytest.raises(ScriptError, match=r"there is no tool 'Ecko' \(did you mean 'Echo'\?\); tools: Echo"):
        run(script(tmp_path, "Ecko text=1"))


def test_pairs_keep_equals_signs_in_values() -> None:
    assert split_pairs(["text=a=b", "number="]) == {"text": "a=b", "number": ""}


def test_lists_and_objects_are_json_without_further_quotes() -> None:
    """A quote within them is JSON's, also where the shell of a terminal would take it away."""
    line = """Ask case=a worlds=["w-1", "w-2"] questions=[{"object": "it's"}] build='{"x": 1}' s={"t": "a]b=[c"}"""
    step = read_line(line)
    assert step is not None
    assert step.arguments == {
        "case": "a",
        "worlds": '["w-1", "w-2"]',
        "questions": '[{"object": "it\'s"}]',
        "build": '{"x": 1}',
        "s": '{"t": "a]b=[c"}',
    }


def test_arguments_may_be_one_json_object() -> None:
    step = read_line('said: Echo {"text": "a = {b}", "number": 2, "edits": [{"action": "remove"}]}')
    assert step == Step("Echo", {"text": "a = {b}", "number": 2, "edits": [{"action": "remove"}]}, "said")
    caller, _ = run([step, Step("Echo", {"number": "$said.number"})])
    assert caller.calls == [step.arguments, {"number": 2}]
    with pytest.raises(ScriptError, match="the arguments are no JSON object"):
        read_line('Echo {"text": ')


def test_arguments_may_be_a_file_of_one_json_object(tmp_path: Path) -> None:
    file = tmp_path / "a.json"
    file.write_text('{"text": "a b", "number": 2}')
    assert split_pairs([f"@{file}"]) == {"text": "a b", "number": 2}
    file.write_text("[1, 2]")
    with pytest.raises(ScriptError, match="the arguments are no JSON object"):
        split_pairs([f"@{file}"])
    with pytest.raises(ScriptError, match="cannot read the file"):
        split_pairs([f"@{tmp_path / 'none.json'}"])
