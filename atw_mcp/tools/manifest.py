"""The manifest: all that is listed of every tool, so that nothing need be imported to list them.

`manifest.json` is made from the declarations by

    python -m atw_mcp.tools.manifest

after any change of a tool's name, description, arguments or result. A module of tools is added to `MODULES`. This
module itself imports no other, so that the command line may read the manifest without loading the server.
"""

from __future__ import annotations

import json
from importlib import import_module
from pathlib import Path
from typing import Any

FILE = Path(__file__).with_name("manifest.json")
MODULES = (
    "opening",
    "observation",
    "measurement",
    "models",
    "construction",
    "identification",
    "modelling",
    "discrepancy",
    "commitment",
    "inspection",
    "looking",
    "rollout_pictures",
    "asking",
    "experimentation",
    "readings",
    "querying",
    "control",
)
"""Modules of `atw_mcp/tools` in the order of the method; each has one `GROUP`."""


def entries() -> list[dict[str, Any]]:
    """Read the manifest: one entry a tool, in the order of the method."""
    listed: list[dict[str, Any]] = json.loads(FILE.read_text(encoding="utf-8"))
    return listed


def schemas() -> dict[str, dict[str, Any]]:
    """Return the JSON schema of the arguments of every tool, by name."""
    return {entry["name"]: entry["parameters"] for entry in entries()}


def declared_entries() -> list[dict[str, Any]]:
    """Return what the manifest should be: imports every tool."""
    from atw_mcp.calls.deferred import entry_of

    names = [f"atw_mcp.tools.{module}" for module in MODULES]
    return [entry_of(tool, name) for name in names for tool in import_module(name).GROUP.tools]


def write() -> None:
    """Replace the manifest, one tool a line."""
    lines = [json.dumps(entry, ensure_ascii=False, separators=(",", ":")) for entry in declared_entries()]
    FILE.write_text("[\n" + ",\n".join(lines) + "\n]\n", encoding="utf-8")


if __name__ == "__main__":
    write()
