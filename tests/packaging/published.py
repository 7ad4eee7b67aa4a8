"""The `.mcpb` bundle for desktop clients and the `server.json` of the MCP registry."""

from __future__ import annotations

import json
import tomllib
import zipfile
from pathlib import Path
from typing import Any

from atw_mcp.client_configuration import NAME
from atw_mcp.tools import manifest

ROOT = Path(__file__).parents[2]
SERVER_SCHEMA = "https://static.modelcontextprotocol.io/schemas/2025-12-11/server.schema.json"
SHIPPED = ("atw_mcp", "polyworld", "evidence_store", "prompts")  # as in the wheel
BESIDE = ("pyproject.toml", "README.md", "LICENSE")
SHORT = "Answer physical questions about a video by experimenting on a world built from it."


def write(out: Path) -> tuple[Path, Path]:
    """Write the bundle and `server.json` to the folder `out`; returns their paths."""
    out.mkdir(parents=True, exist_ok=True)
    described = out / "server.json"
    described.write_text(json.dumps(server_json(), indent=2) + "\n", encoding="utf-8")
    bundle = out / f"{_project()['name']}-{_project()['version']}.mcpb"
    with zipfile.ZipFile(bundle, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("manifest.json", json.dumps(bundle_manifest(), indent=2))
        for path in shipped_files():
            archive.write(path, path.relative_to(ROOT).as_posix())
    return bundle, described


def shipped_files() -> list[Path]:
    """Every file of the bundle but its manifest: the packages, and what `uv` needs to install them."""
    inside = [path for folder in SHIPPED for path in (ROOT / folder).rglob("*")]
    code = [path for path in inside if path.is_file() and "__pycache__" not in path.parts]
    return sorted([*code, *(ROOT / name for name in BESIDE)])


def bundle_manifest() -> dict[str, Any]:
    """Manifest of the bundle (version 0.4): the client's `uv` installs the dependencies and runs the server."""
    project = _project()
    return {
        "manifest_version": "0.4",
        "name": project["name"],
        "display_name": "Asking the World",
        "version": project["version"],
        "description": SHORT,
        "long_description": project["description"],
        "author": {"name": project["authors"][0]["name"]},
        "license": project["license"],
        "keywords": project["keywords"],
        "server": {
            "type": "uv",
            "entry_point": "atw_mcp/__main__.py",
            "mcp_config": {
                "command": "uv",
                "args": ["run", "--directory", "${__dirname}", "--no-dev", "atw-mcp", "serve"],
                "env": {"ATW_MCP_ALLOW": "${user_config.folder}"},
            },
        },
        "tools": [{"name": entry["name"], "description": entry["title"]} for entry in manifest.entries()],
        "prompts_generated": True,
        "compatibility": {
            "platforms": ["darwin", "linux", "win32"],
            "runtimes": {"python": project["requires-python"]},
        },
        "user_config": {
            "folder": {
                "type": "directory",
                "title": "Folder of videos and data",
                "description": "The tools read files below this folder, and no others.",
                "required": True,
                "default": "${DOCUMENTS}",
            }
        },
    }


def server_json() -> dict[str, Any]:
    """Entry of the MCP registry: the package on PyPI, run by `uvx` over stdio."""
    project = _project()
    return {
        "$schema": SERVER_SCHEMA,
        "name": f"io.github.{NAME}/{project['name']}",
        "title": "Asking the World",
        "description": SHORT,
        "version": project["version"],
        "packages": [
            {
                "registryType": "pypi",
                "identifier": project["name"],
                "version": project["version"],
                "runtimeHint": "uvx",
                "transport": {"type": "stdio"},
                "packageArguments": [
                    {
                        "type": "named",
                        "name": "--allow",
                        "description": "a folder whose files the tools may read",
                        "format": "filepath",
                        "isRepeated": True,
                    }
                ],
            }
        ],
    }


def _project() -> dict[str, Any]:
    project: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return project
