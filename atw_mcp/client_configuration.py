"""`atw-mcp config`: the entry of this server in the configuration of an MCP client.

Imports nothing but the standard library.
"""

from __future__ import annotations

import argparse
import json
import os
import shlex
import shutil
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

NAME = "asking-the-world"


@dataclass(frozen=True)
class ClientForm:
    """How a client is configured.

    title: its name. key: the object that holds the servers. place: the file that the object belongs in, of the user or,
    where relative, of the project. entry: what an entry states besides command and arguments.
    """

    title: str
    key: str
    place: str
    entry: Mapping[str, Any] = field(default_factory=dict)


def _desktop_file() -> str:
    if sys.platform == "darwin":
        return "~/Library/Application Support/Claude/claude_desktop_config.json"
    if sys.platform == "win32":
        return r"%APPDATA%\Claude\claude_desktop_config.json"
    return "~/.config/Claude/claude_desktop_config.json"


STDIO = {"type": "stdio"}
FORMS = {
    "claude-code": ClientForm("Claude Code", "mcpServers", ".mcp.json", STDIO),
    "claude-desktop": ClientForm("Claude Desktop", "mcpServers", _desktop_file()),
    "codex": ClientForm("Codex", "mcp_servers", "~/.codex/config.toml"),
    "cursor": ClientForm("Cursor", "mcpServers", "~/.cursor/mcp.json", STDIO),
    "goose": ClientForm("Goose", "extensions", "~/.config/goose/config.yaml", {**STDIO, "name": NAME, "enabled": True}),
    "lm-studio": ClientForm("LM Studio", "mcpServers", "~/.lmstudio/mcp.json"),
    "vscode": ClientForm("VS Code", "servers", ".vscode/mcp.json", STDIO),
    "windsurf": ClientForm("Windsurf", "mcpServers", "~/.codeium/windsurf/mcp_config.json"),
    "zed": ClientForm("Zed", "context_servers", "~/.config/zed/settings.json", {"source": "custom"}),
}


def add_parser(commands: Any) -> None:
    """Declare the command."""
    config = commands.add_parser(
        "config", help="print or write this server's entry in the configuration of an MCP client"
    )
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
    config.add_argument("--write", action="store_true", help="add the entry to the client's file, which keeps the rest")
    config.set_defaults(command=run)


def run(options: argparse.Namespace) -> int:
    """Print the configuration on stdout, and on stderr where it goes; or write it there. Return the exit code."""
    form = FORMS[options.client]
    if options.write:
        try:
            print(f"wrote {write(options.client, options.allow, options.store)}")
        except ValueError as error:
            print(f"error: {error}", file=sys.stderr)
            return 1
        return 0
    print(text(options.client, options.allow, options.store))
    where = form.place if form.place.startswith(("~", "%")) else f"{form.place} in the project's folder"
    print(f"{form.title} reads this from {where}", file=sys.stderr)
    if options.client == "claude-code":
        command = ["claude", "mcp", "add", "--scope", "user", NAME, "--", *_command(options.allow, options.store)]
        print(f"or, for all projects: {shlex.join(command)}", file=sys.stderr)
    return 0


def configuration(client: str, allow: Sequence[Path] = (), store: Path | None = None) -> dict[str, Any]:
    """Return what a client's configuration file holds to start the server of this installation.

    client: a key of `FORMS`. allow: folders whose files the tools may read. store: default the user's. Paths are made
    absolute: a client starts servers in a folder of its own choice.
    """
    form = FORMS[client]
    command, *arguments = _command(allow, store)
    word = "cmd" if client == "goose" else "command"
    return {form.key: {NAME: {**form.entry, word: command, "args": arguments}}}


def text(client: str, allow: Sequence[Path] = (), store: Path | None = None) -> str:
    """Return the configuration as the client's file has it: JSON, which YAML includes, or TOML."""
    found = configuration(client, allow, store)
    if not FORMS[client].place.endswith(".toml"):
        return json.dumps(found, indent=2)
    lines = [f"{name} = {json.dumps(value)}" for name, value in found[FORMS[client].key][NAME].items()]
    return "\n".join([f"[{FORMS[client].key}.{NAME}]", *lines])  # strings and lists of TOML are those of JSON


def write(client: str, allow: Sequence[Path] = (), store: Path | None = None) -> Path:
    """Add the entry to the client's file, in place of an earlier one, and return the file.

    Raises ValueError where the file is not JSON, or not JSON without comments: it is left as it is.
    """
    form = FORMS[client]
    path = Path(os.path.expandvars(form.place)).expanduser().resolve()  # a link stays one
    there: Any = {}
    if path.suffix == ".json" and path.exists():
        try:
            there = json.loads(path.read_text("utf-8") or "{}")
        except ValueError as error:
            raise ValueError(
                f"{path} is left as it is, since it is not plain JSON ({error}); add by hand what "
                f"`atw-mcp config {client}` prints"
            ) from error
    if path.suffix != ".json" or not isinstance(there, dict) or not isinstance(there.get(form.key, {}), dict):
        raise ValueError(f"{path} is left as it is; add by hand what `atw-mcp config {client}` prints")
    entry = configuration(client, allow, store)[form.key]
    path.parent.mkdir(parents=True, exist_ok=True)
    new = path.with_name(path.name + ".new")
    new.write_text(json.dumps({**there, form.key: {**there.get(form.key, {}), **entry}}, indent=2) + "\n", "utf-8")
    if path.exists():
        shutil.copymode(path, new)  # other servers' entries may hold secrets
    new.replace(path)
    return path


def _command(allow: Sequence[Path], store: Path | None) -> list[str]:
    folders = [word for folder in allow for word in ("--allow", os.path.abspath(folder.expanduser()))]
    kept = [] if store is None else ["--store", os.path.abspath(store.expanduser())]
    return [sys.executable, "-m", "atw_mcp", "serve", *folders, *kept]
