"""A prompt, or a pipe, of tool calls, however they are made."""

from __future__ import annotations

import os
import select
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from atw_mcp.calls.schemas import argument_lines
from atw_mcp.calls.spelling import did_you_mean
from atw_mcp.printing import tool_line
from atw_mcp.replies import Reply, ToolFailed
from atw_mcp.script import ScriptError, read_line, resolved, step_arguments

PROMPT, CONTINUED = "atw> ", "...> "
LAST = "last"  # name of the result of the call before
LEAVE = ("exit", "quit")
SPELL = 0.2  # [s] within which an interruption is noticed while nothing comes through a pipe
CHUNK = 65536  # bytes read from a pipe at once
HELP = """\
[NAME:] TOOL key=value ...   call a tool; a value is JSON where the tool wants it, @path is a file's content
[NAME:] TOOL {"key": value}  the same, arguments as one JSON object
                             $NAME.field is part of an earlier result, $last.field of the one before
> TEXT                       print a text, references resolved; # starts a comment, \\ at the end continues a line
tools [TOOL]                 list the tools, or describe one
help                         show this
exit, or Ctrl-D              leave; Ctrl-C cancels the call that runs
"""
Call = Callable[[str, dict[str, Any]], Reply]
Entry = Mapping[str, Any]


class Shell:
    """Runs one line after another: tool calls in the syntax of scripts, and `help` and `tools`.

    tools: their entries of the manifest. known: what `$name` refers to at first. show: prints the reply of a call.
    """

    def __init__(
        self, call: Call, tools: Sequence[Entry], known: Mapping[str, Any], show: Callable[[Reply], None]
    ) -> None:
        self._call, self._show = call, show
        self._tools = {tool["name"]: tool for tool in tools}
        self._known = dict(known)

    def run(self, line: str) -> bool:
        """Run a line and print its result, or on stderr why there is none; returns whether it succeeded."""
        try:
            self._run(line)
        except (ScriptError, ToolFailed) as error:
            print(f"atw-mcp: {error}", file=sys.stderr, flush=True)
            return False
        return True

    def run_typed(self, line: str) -> bool:
        """Run a line as `run` does; an interruption ends the line, and not the session."""
        try:
            return self.run(line)
        except KeyboardInterrupt:
            print("atw-mcp: cancelled", file=sys.stderr, flush=True)
            return False

    def _run(self, line: str) -> None:
        if line.lstrip().startswith(">"):
            print(resolved(line.lstrip()[1:].strip(), self._known), file=sys.stderr, flush=True)
            return
        words = line.split()
        if words[:1] == ["help"]:
            print(HELP, end="", flush=True)
        elif words[:1] == ["tools"]:
            self._print_tools(words[1:])
        else:
            self._run_call(line)

    def _run_call(self, line: str) -> None:
        step = read_line(line)
        if step is None:
            return
        schemas = {name: tool["parameters"] for name, tool in self._tools.items()}
        reply = self._call(step.tool, step_arguments(step, self._known, schemas))
        self._known[LAST] = reply.body
        if step.name is not None:
            self._known[step.name] = reply.body
        self._show(reply)

    def _print_tools(self, names: list[str]) -> None:
        for name in names:
            if name not in self._tools:
                raise ScriptError(f"there is no tool {name!r}{did_you_mean(name, self._tools)}")
            tool = self._tools[name]
            print(f"{name}\n\n{tool['description']}\n")
            for line in argument_lines(tool["parameters"]):
                needed = "required, " if line["required"] else ""
                print(f"  {line['argument']}: {needed}{line['type']}\n      {line['description']}")
        if not names:
            for tool in self._tools.values():
                print(tool_line(tool["name"], tool["description"]))
        sys.stdout.flush()


def run_shell(call: Call, tools: Sequence[Entry], known: Mapping[str, Any], show: Callable[[Reply], None]) -> bool:
    """Read lines from stdin and run each; returns whether all of a pipe's calls succeeded.

    At a terminal a failed call is no failure of the session, and Ctrl-C cancels a line; of a pipe it ends the reading.
    """
    at_terminal = sys.stdin.isatty() and sys.stdout.isatty()
    succeeded = True
    shell = Shell(call, tools, known, show)
    run = shell.run_typed if at_terminal else shell.run
    for line in _typed_lines(tools) if at_terminal else _joined(_piped_lines()):
        if line.strip() in LEAVE:
            break
        succeeded &= run(line)
    return succeeded or at_terminal


def _piped_lines() -> Iterator[str]:
    """Yield the lines of stdin, waiting in short spells: an interruption just before a read would wait for its end."""
    try:
        pipe = sys.stdin.fileno()
    except OSError:  # no file is behind it
        yield from sys.stdin
        return
    if sys.platform == "win32":  # where `select` takes sockets alone
        yield from sys.stdin
        return
    pending = b""
    while True:
        while not select.select([pipe], [], [], SPELL)[0]:
            pass
        read = os.read(pipe, CHUNK)
        if not read:
            break
        *whole, pending = (pending + read).split(b"\n")
        yield from (line.decode(errors="replace") for line in whole)
    if pending:
        yield pending.decode(errors="replace")


def _joined(lines: Iterator[str] | Any) -> Iterator[str]:
    """Join each line that ends in a backslash with the next."""
    pending = ""
    for line in lines:
        text = line.rstrip("\n")
        if text.rstrip().endswith("\\"):
            pending += text.rstrip()[:-1] + " "
            continue
        yield pending + text
        pending = ""
    if pending.strip():
        yield pending


def _typed_lines(tools: Sequence[Entry]) -> Iterator[str]:
    """Yield what is typed at the prompt, with history and completion where there is readline; ends at Ctrl-D."""
    history = _with_readline(tools)
    pending = ""
    try:
        while True:
            try:
                line = input(CONTINUED if pending else PROMPT)
            except KeyboardInterrupt:  # drop the line that was being typed
                print()
                pending = ""
                continue
            except EOFError:
                print()
                return
            if line.rstrip().endswith("\\"):
                pending += line.rstrip()[:-1] + " "
                continue
            yield pending + line
            pending = ""
    finally:
        history()


def _with_readline(tools: Sequence[Entry]) -> Callable[[], None]:
    """Set up history and completion of tool and argument names; returns what saves the history."""
    try:
        import readline
    except ImportError:  # Windows
        return lambda: None
    import platformdirs

    path = Path(platformdirs.user_state_dir("atw-mcp", appauthor=False)) / "history"
    with suppress(OSError):
        readline.read_history_file(path)
    arguments = {tool["name"]: sorted(tool["parameters"].get("properties", {})) for tool in tools}

    def complete(text: str, state: int) -> str | None:
        before = readline.get_line_buffer()[: readline.get_begidx()].split()
        named = next((word for word in before if word in arguments), None)
        words = [f"{key}=" for key in arguments[named]] if named else [f"{name} " for name in [*arguments, "tools"]]
        return [*(word for word in words if word.startswith(text)), None][state]

    readline.set_completer(complete)
    readline.set_completer_delims(" ")
    readline.parse_and_bind("tab: complete")

    def save() -> None:
        with suppress(OSError):
            path.parent.mkdir(parents=True, exist_ok=True)
            readline.set_history_length(1000)
            readline.write_history_file(path)

    return save
