"""The command line: serve, or be a client of a server that it starts itself.

Imports only what reading a command takes. A command that calls tools starts its server before it imports what a client
needs, so that both load at the same time.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from functools import partial
from pathlib import Path

from atw_mcp import (
    batch_command,
    client_configuration,
    exchange_commands,
    server_process,
    store_commands,
    viewer_commands,
)
from atw_mcp.allowed_paths import add_allow, allowed_here
from atw_mcp.calls.spelling import did_you_mean
from atw_mcp.calls.toolsets import Selection, add_selection
from atw_mcp.device_option import add_device
from atw_mcp.gap import command as gap_command
from atw_mcp.printing import print_reply, tool_line
from atw_mcp.replies import ServerLost
from atw_mcp.script import ScriptError, read_arguments, read_script, split_pairs
from atw_mcp.shell import HELP
from atw_mcp.store_option import PICTURES, add_store, pictures_of
from atw_mcp.tools import manifest

OK, FAILED, USAGE, INTERRUPTED = 0, 1, 2, 130


SCRIPT_HELP = """\
Call the tools of a script, one call a line: a name for the result and a colon, if it is wanted later; the tool;
its arguments as key=value. $name.field is a field of an earlier result or of its data, $name alone a variable of
the command line, @path a file's content, $folder the script's own folder; > says what is being done, # is a comment.

  > What if the red ball had not been there?
  open: OpenCase video=$clip
  as_it_was: Rollout case=$open.case horizon_frames=100
  without: Rollout case=$open.case horizon_frames=100 edits='[{"action": "remove", "object": "red"}]'
  CompareWorlds base=$as_it_was.rollout edited=$without.rollout

run with: atw-mcp run ask.atw clip=film.mp4 (here of a case whose world is committed)
"""


def main(arguments: list[str] | None = None) -> int:
    """Run one command; returns the exit code: 0 done, 1 a tool refused or failed, 2 wrong usage."""
    given = sys.argv[1:] if arguments is None else arguments
    if not given or (given[0].startswith("-") and given[0] not in ("-h", "--help", "--version")):
        given = ["serve", *given]  # what an MCP client that knows only the command's name wants
    options = _read(given)
    try:
        return int(options.command(options))
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:  # whoever read the output has seen enough, as in `atw-mcp tools | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return OK
    except ScriptError as error:
        print(f"atw-mcp: {error}", file=sys.stderr)
        return USAGE
    except ServerLost as error:  # it has said why on stderr
        print(f"atw-mcp: the server that this command started is gone ({error})", file=sys.stderr)
        return FAILED


def _read(given: list[str]) -> argparse.Namespace:
    """Read a command line; key=value may come before, between and after options."""
    parser = _parser()
    options, rest = parser.parse_known_args(given)
    if not rest:
        return options
    pairs: list[str] | None = getattr(options, "pairs", None)
    # argparse takes what is repeated from one place only
    if pairs is None or any(word.startswith("-") for word in rest):
        parser.error(f"unrecognized arguments: {' '.join(rest)}")
    options.pairs = [*pairs, *rest]
    return options


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="atw-mcp", description="Answer physical questions about a video by experimenting on a world built from it."
    )
    parser.add_argument("--version", action=_ShowVersion, nargs=0, help="show the version and exit")
    commands = parser.add_subparsers(required=True, metavar="COMMAND")

    serve = commands.add_parser("serve", help="be an MCP server (the default)")
    serve.add_argument("--http", action="store_true", help="streamable HTTP at /mcp instead of stdio")
    serve.add_argument("--host", default="127.0.0.1", help="address to listen on with --http (default: loopback)")
    serve.add_argument("--port", type=int, default=8000, help="port to listen on with --http (default: 8000)")
    serve.add_argument(
        "--legacy-only", action="store_true", help="only protocol revisions up to 2025-11-25, for clients that mix eras"
    )
    serve.add_argument(
        "--token-file",
        type=Path,
        metavar="FILE",
        help="bearer tokens of --http, a line each: TOKEN or NAME TOKEN (or one token in ATW_MCP_TOKEN); "
        "needed where --host is not loopback",
    )
    serve.add_argument("--oauth-issuer", metavar="URL", help="authorization server whose access tokens --http takes")
    serve.add_argument(
        "--oauth-audience", metavar="URL", help="this server's public https://.../mcp, for which they are issued"
    )
    serve.add_argument(
        "--allow-host", action="append", default=[], metavar="HOST", help="a name under which --http is reached"
    )
    serve.add_argument(
        "--allow-origin", action="append", default=[], metavar="ORIGIN", help="pages that may call --http, https://..."
    )
    add_store(serve)
    add_allow(serve)
    add_selection(serve)
    add_device(serve)
    serve.add_argument(
        "--limits", type=Path, metavar="FILE.toml", help="limits of what one call may ask for; also ATW_MCP_LIMITS"
    )
    serve.set_defaults(command=_serve)

    tools = commands.add_parser("tools", help="list the tools, or describe one")
    tools.add_argument("tool", nargs="?", metavar="TOOL")
    tools.set_defaults(command=_tools)

    call = commands.add_parser("call", help="call one tool; prints its result as one line of JSON")
    call.add_argument("tool", metavar="TOOL")
    call.add_argument("pairs", nargs="*", metavar="key=value", help="JSON where the tool wants it; @path reads a file")
    call.set_defaults(command=_call)

    run = commands.add_parser(
        "run",
        help="call the tools of a script, whose arguments may refer to earlier results",
        description=SCRIPT_HELP,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    run.add_argument("script", type=Path, metavar="SCRIPT")
    run.add_argument("pairs", nargs="*", metavar="name=value", help="variables: $name in the script")
    run.set_defaults(command=_run)

    shell = commands.add_parser(
        "shell",
        help="call tools line by line, from a prompt or a pipe, over one server that keeps running",
        description=f"Call tools line by line over one server.\n\n{HELP}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    shell.add_argument("pairs", nargs="*", metavar="name=value", help="variables: $name in the lines")
    shell.set_defaults(command=_shell)

    demo = commands.add_parser(
        "demo",
        help="a video in, an answered what-if question (or, with gap, a better world) out, checked against the truth",
    )
    demo.add_argument(
        "which",
        nargs="?",
        choices=("collision", "gap"),
        default="collision",
        help="collision: what if the blue cube had not been there (the default); gap: what is the world missing?",
    )
    demo.add_argument(
        "--output", type=Path, default=Path("atw-demo"), help="folder for the pictures (default: %(default)s)"
    )
    demo.add_argument("--store", type=Path, metavar="FILE", help="evidence store (default: demo.db in that folder)")
    add_device(demo)
    demo.set_defaults(command=_demo)

    for command in (call, run, shell):
        add_store(command)
        add_allow(command)
        add_device(command)
        command.add_argument("--indent", action="store_true", help="print indented JSON")
        command.add_argument(
            "--pictures",
            type=Path,
            metavar="FOLDER",
            help=f"where to write pictures (default: a folder of the store's own in {PICTURES})",
        )

    gap_command.add_parser(commands)
    batch_command.add_parser(commands)
    viewer_commands.add_parser(commands)
    store_commands.add_parser(commands)
    exchange_commands.add_parser(commands)
    client_configuration.add_parser(commands)

    schema = commands.add_parser("schema", help="print the JSON schema of a world, or of a line of a batch's manifest")
    schema.add_argument("what", choices=["world", "manifest"])
    schema.set_defaults(command=_schema)

    warmup = commands.add_parser("warmup", help="compile every kernel now, so that no later call has to")
    warmup.set_defaults(command=_warmup)
    return parser


class _ShowVersion(argparse.Action):
    """Finds the version out only when it is asked for."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from atw_mcp.calls.version import installed_version

        print(f"atw-mcp {installed_version()}")
        parser.exit()


def _serve(options: argparse.Namespace) -> int:
    from atw_mcp.calls.limits import Limits, LimitsError
    from atw_mcp.server import build_server, default_store
    from atw_mcp.serving import serve_stdio
    from evidence_store import StoreError

    try:
        selection = Selection.of(options.toolsets, options.read_only)
        build = partial(build_server, allow=options.allow, selection=selection, limits=Limits.read(options.limits))
        if options.http:
            from atw_mcp.transports.command import serve_http

            return serve_http(options, build, options.store or default_store())
        server = build(options.store)
    except (LimitsError, StoreError, ValueError) as error:
        print(f"atw-mcp: {error}", file=sys.stderr)
        return FAILED
    if sys.stdin.isatty():
        print("waiting for an MCP client on stdin; atw-mcp --help lists the other commands", file=sys.stderr)
    return serve_stdio(server, legacy_only=options.legacy_only)


def _tools(options: argparse.Namespace) -> int:
    tools = {entry["name"]: entry for entry in manifest.entries()}
    if options.tool is None:
        for entry in tools.values():
            print(tool_line(entry["name"], entry["description"]))
        return OK
    if options.tool not in tools:
        near = did_you_mean(options.tool, tools)
        raise ScriptError(f"there is no tool {options.tool!r}{near}; tools: {', '.join(tools)}")
    chosen = tools[options.tool]
    schema = json.dumps(chosen["parameters"], indent=2)
    print(f"{chosen['name']} ({chosen['role']})\n\n{chosen['description']}\n\n{schema}")
    return OK


def _call(options: argparse.Namespace) -> int:
    pairs = split_pairs(options.pairs)
    arguments = read_arguments(pairs, manifest.schemas(), options.tool)
    show = partial(print_reply, indent=options.indent, pictures=options.pictures or pictures_of(options.store))
    with server_process.started(options.store, allowed_here(options.allow, pairs)) as server:
        from atw_mcp.sessions import call_tool

        return OK if call_tool(server, options.tool, arguments, show) else FAILED


def _run(options: argparse.Namespace) -> int:
    steps = read_script(options.script)
    pairs, folder = split_pairs(options.pairs), options.script.absolute().parent
    variables = {"folder": str(folder), **pairs}
    show = partial(print_reply, indent=options.indent, pictures=options.pictures or pictures_of(options.store))
    with server_process.started(options.store, allowed_here(options.allow, pairs, folder)) as server:
        from atw_mcp.sessions import call_steps

        return OK if call_steps(server, steps, variables, show) else FAILED


def _shell(options: argparse.Namespace) -> int:
    pairs = split_pairs(options.pairs)
    known = {"folder": str(Path.cwd()), **pairs}
    allow = allowed_here(options.allow, pairs)
    show = partial(print_reply, indent=options.indent, pictures=options.pictures or pictures_of(options.store))
    with server_process.started(options.store, allow) as server:
        from atw_mcp.sessions import call_lines

        return OK if call_lines(server, known, show) else FAILED


def _demo(options: argparse.Namespace) -> int:
    store = options.store or options.output / "demo.db"
    with server_process.started(store) as server:
        from atw_mcp.sessions import show_demo

        return OK if show_demo(server, options.which, options.output, store) else FAILED


def _schema(options: argparse.Namespace) -> int:
    if options.what == "manifest":
        from atw_mcp.batch.manifest import manifest_schema

        print(json.dumps(manifest_schema(), indent=2))
        return OK
    from polyworld.world import World

    print(json.dumps(World.model_json_schema(), indent=2))
    return OK


def _warmup(options: argparse.Namespace) -> int:
    del options
    from atw_mcp.warmup import warm_up

    for name, seconds in warm_up():
        print(f"{name}: {seconds:.1f} s", file=sys.stderr)
    return OK
