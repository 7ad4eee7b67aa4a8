"""Scripts: tool calls written down, whose arguments may refer to earlier results.

One call a line (a line ending in a backslash continues on the next):

    # a comment
    > said to the reader before the next call; may quote ${observe.summary}
    open: OpenCase video=$folder/clip.mp4
    observe: ObserveObjects case=$open.case
    Rollout case=$open.case edits='[{"action": "remove", "object": "red"}]'
    Rollout {"case": "$open.case", "horizon_seconds": 2}

`$name.field` and `${name.field.0.field}` stand for part of the result called `name`: a field of the result, of
its source, or of its data. A variable (`$folder`, the script's own folder, or one given on the command line) is
written the same way. An argument that is nothing but a reference keeps the type of what it refers to. `$$` is a
dollar sign.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import AsyncIterator, Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from atw_mcp.calls.spelling import did_you_mean
from atw_mcp.replies import Reply, ToolCaller

NAME = r"[A-Za-z_][\w-]*"
REFERENCE = re.compile(rf"\$(?:\$|\{{(?P<braced>{NAME}(?:\.[\w-]+)*)\}}|(?P<bare>{NAME}(?:\.[\w-]+)*))")


class ScriptError(Exception):
    """A script or an argument that cannot be understood."""


@dataclass(frozen=True)
class Step:
    """One call of a script. arguments: as written, not yet read by the tool's schema."""

    tool: str
    arguments: dict[str, Any] = field(default_factory=dict)
    name: str | None = None
    say: str | None = None


def read_script(path: Path) -> list[Step]:
    """The steps of a script file; raises ScriptError naming the line that is wrong."""
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScriptError(f"cannot read the script {path}: {error}") from error
    steps = _steps(text)
    if not steps:
        raise ScriptError(f"{path} has no calls")
    return steps


def read_line(line: str) -> Step | None:
    """Parse one line of a script; None for an empty line or a comment. Raises ScriptError."""
    whole = re.fullmatch(rf"\s*(?:(?P<name>{NAME}):\s*)?(?P<tool>{NAME})\s*(?P<object>\{{.*)", line, re.DOTALL)
    if whole is not None:  # arguments as one JSON object
        return Step(whole["tool"], split_pairs([whole["object"]]), whole["name"])
    try:
        words = shlex.split(_with_json_quoted(line), comments=True)
    except ValueError as error:
        raise ScriptError(str(error)) from error
    if not words:
        return None
    name = words.pop(0)[:-1] if words[0].endswith(":") else None
    if name is not None and not re.fullmatch(NAME, name):
        raise ScriptError(f"{name!r} cannot name a result")
    if not words:
        raise ScriptError("a tool name is missing")
    return Step(words[0], dict(split_pairs(words[1:])), name)


def _with_json_quoted(line: str) -> str:
    """Quote lists and objects that follow an equals sign, so that the quotes within them are those of JSON."""
    found, done = "", 0
    for opening in re.finditer(r"(?<==)[\[{]", line):
        depth, text = 0, False
        for i in range(opening.start(), len(line) if opening.start() >= done else 0):
            character = line[i]
            if character == '"' and line[i - 1] != "\\":
                text = not text
            depth += 0 if text else (character in "[{") - (character in "]}")
            if depth == 0:
                found += line[done : opening.start()] + shlex.quote(line[opening.start() : i + 1])
                done = i + 1
                break
    return found + line[done:]


async def run_script(
    steps: list[Step], caller: ToolCaller, variables: Mapping[str, Any], begin: Callable[[Step, str | None], None]
) -> AsyncIterator[tuple[Step, Reply]]:
    """Call step after step; yields each step with its reply.

    begin: called before each step, with the step and what it says. Raises ScriptError for a reference to nothing
    and ToolFailed, and stops there.
    """
    known: dict[str, Any] = dict(variables)
    for step in steps:
        begin(step, None if step.say is None else str(resolved(step.say, known)))
        reply = await caller.call(step.tool, step_arguments(step, known, caller.schemas))
        if step.name is not None:
            known[step.name] = reply.body
        yield step, reply


def step_arguments(step: Step, known: Mapping[str, Any], schemas: Mapping[str, Any]) -> dict[str, Any]:
    """Resolve a step's references and read its arguments by the tool's schema; raises ScriptError."""
    given = {k: resolved(v, known) if isinstance(v, str) else v for k, v in step.arguments.items()}
    return read_arguments(given, schemas, step.tool)


def resolved(value: str, known: Mapping[str, Any]) -> Any:
    """The text with its references replaced; raises ScriptError naming what there is to refer to."""
    whole = REFERENCE.fullmatch(value)
    if whole is not None and whole[0] != "$$":
        return _looked_up(whole["braced"] or whole["bare"], known)

    def text(found: re.Match[str]) -> str:
        if found[0] == "$$":
            return "$"
        part = _looked_up(found["braced"] or found["bare"], known)
        return part if isinstance(part, str) else json.dumps(part)

    return REFERENCE.sub(text, value)


def read_arguments(given: Mapping[str, Any], schemas: Mapping[str, Any], tool: str) -> dict[str, Any]:
    """Arguments from text: JSON where the tool's schema wants more than a string, `@path` for a file's content.

    A list may be written as comma-separated words. What the tool has no argument for is passed on: the tool's
    refusal names its arguments.
    """
    if tool not in schemas:
        raise ScriptError(f"there is no tool {tool!r}{did_you_mean(tool, schemas)}; tools: {', '.join(schemas)}")
    properties = schemas[tool].get("properties", {})
    return {key: _read_value(value, properties.get(key, {}), key) for key, value in given.items()}


def split_pairs(words: list[str]) -> dict[str, Any]:
    """key=value words, or one word that is a JSON object or `@path` of one, as a mapping; raises ScriptError for a word
    without a key."""
    if len(words) == 1 and words[0].startswith(("{", "@")):
        try:
            return dict(json.loads(_content(words[0], "arguments")).items())
        except (json.JSONDecodeError, AttributeError) as error:
            raise ScriptError(f"the arguments are no JSON object: {error}") from error
    pairs: dict[str, Any] = {}
    for word in words:
        key, equals, value = word.partition("=")
        if not equals or not re.fullmatch(NAME, key):
            raise ScriptError(f"{word!r} is not key=value; arguments may also be one JSON object, or @FILE of one")
        if key in pairs:
            raise ScriptError(f"{key!r} is given twice")
        pairs[key] = value
    return pairs


def _content(text: str, key: str) -> str:
    """Return the content of the file that a text beginning with @ names, or the text."""
    if not text.startswith("@"):
        return text
    try:
        return Path(text[1:]).expanduser().read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScriptError(f"{key}: cannot read the file {text[1:]!r}: {error}") from error


def _read_value(value: Any, schema: Mapping[str, Any], key: str) -> Any:
    if not isinstance(value, str):
        return value
    value = value[1:] if value.startswith("@@") else _content(value, key)
    forms = [schema, *schema.get("anyOf", [])]
    kinds = {form.get("type") for form in forms}
    if "string" in kinds and not kinds & {"object", "array", "number", "integer", "boolean"}:
        return None if value == "null" and "null" in kinds else value
    items = next((form["items"] for form in forms if "items" in form), None)
    if items is None or value.lstrip().startswith(("[", "{")) or value == "null":
        return _json_or_text(value)
    words = [word.strip() for word in value.split(",")]  # a list in short: frames=0,24 or objects=red
    return words if items.get("type") == "string" else [_json_or_text(word) for word in words]


def _json_or_text(text: str) -> Any:
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return text


def _looked_up(reference: str, known: Mapping[str, Any]) -> Any:
    name, *path = reference.split(".")
    if name not in known:
        raise ScriptError(f"${reference}: nothing is called {name!r}; known: {', '.join(known) or 'nothing yet'}")
    value = known[name]
    for depth, part in enumerate(path):
        places = [value]
        if depth == 0 and isinstance(value, dict):  # a result: its source and its data may be left out
            places += [value.get("source"), value.get("data")]
        for place in places:
            if isinstance(place, dict) and part in place:
                value = place[part]
                break
            if isinstance(place, list) and part.lstrip("-").isdecimal() and -len(place) <= int(part) < len(place):
                value = place[int(part)]
                break
        else:
            choices = [str(k) for place in places if isinstance(place, dict) for k in place]
            if isinstance(value, list):
                choices = [f"0..{len(value) - 1}"] if value else []
            raise ScriptError(f"${reference}: no {part!r} there; there is: {', '.join(choices) or 'nothing'}")
    return value


def _steps(text: str) -> list[Step]:
    steps: list[Step] = []
    said: list[str] = []
    pending, first = "", 0
    for number, line in enumerate(text.splitlines(), start=1):
        first = first or number
        if line.rstrip().endswith("\\"):
            pending += line.rstrip()[:-1] + " "
            continue
        line, pending, at, first = pending + line, "", first, 0
        if line.lstrip().startswith(">"):
            said.append(line.lstrip()[1:].strip())
            continue
        try:
            step = read_line(line)
        except ScriptError as error:
            raise ScriptError(f"line {at}: {error}") from error
        if step is None:
            continue
        steps.append(replace(step, say="\n".join(said) or None))
        said = []
    if pending.strip():
        raise ScriptError(f"line {first}: the last line ends in a backslash")
    if said:
        raise ScriptError(f"nothing is called after {said[-1]!r}: what is said belongs before a call")
    return steps
