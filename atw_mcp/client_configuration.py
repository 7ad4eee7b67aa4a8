"""`atw-mcp config`: the entry of this server in the configuration of an MCP client.

Imports nothing but the standard library.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

NAME = "asking-the-world"


@dataclass(frozen=True)
class ClientForm:
    """How a client is configured. title: its name; key: the object that holds the servers; typed: whether an entry
    states its transport; place: the file that the printed object belongs in."""

    title: str
    key: str
    typed: bool
    place: str


def _desktop_file() -> str:
    if sys.platform == "darwin":
        return "~/Library/Application Support/Claude/claude_desktop_config.json"
    if sys.platform == "win32":
        return r"%APPDATA%\Claude\claude_desktop_config.json"
    return "~/.config/Claude/claude_desktop_config.json"


FORMS = {
    "claude-desktop": ClientForm("Claude Desktop", "mcpServers", False, _desktop_file()),
    "claude-code": ClientForm("Claude Code", "mcpServers", True, ".mcp.json in the project's folder"),
    "vscode": ClientForm("VS Code", "servers", True, ".vscode/mcp.json in the workspace"),
    "cursor": ClientForm("Cursor", "mcpServers", True, "~/.cursor/mcp.json, or .cursor/mcp.json in the project"),
}


def add_parser(commands: Any) -> None:
    """Declare the command."""
    config = commands.add_parser("config", help="print the entry of this server in the configuration of an MCP client")
    config.add_argument("client", choices=sorted(FORMS), metavar="CLIENT", help=", ".join(sorted(FORMS)))
    config.add_argument(
        "--allow",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="a folder whose files the tools may read; repeatable",
    )
    config.add_argument(
        "--store", type=Path, metavar="FILE", help="evidence store (default: in the user's data folder)"
    )
    config.set_defaults(command=run)


def run(options: argparse.Namespace) -> int:
    """Print the configuration on stdout, and on stderr where it goes."""
    form = FORMS[options.client]
    print(json.dumps(configuration(options.client, options.allow, options.store), indent=2))
    print(f"{form.title} reads this from {form.place}", file=sys.stderr)
    return 0


def configuration(client: str, allow: Sequence[Path] = (), store: Path | None = None) -> dict[str, Any]:
    """Return what a client's configuration file holds to start the server of this installation.

    client: a key of `FORMS`. allow: folders whose files the tools may read. store: default the user's. Paths are made
    absolute: a client starts servers in a folder of its own choice.
    """
    form = FORMS[client]
    arguments = ["-m", "atw_mcp", "serve"]
    for folder in allow:
        arguments += ["--allow", os.path.abspath(folder.expanduser())]
    if store is not None:
        arguments += ["--store", os.path.abspath(store.expanduser())]
    entry: dict[str, Any] = {"type": "stdio"} if form.typed else {}
    return {form.key: {NAME: {**entry, "command": sys.executable, "args": arguments}}}
