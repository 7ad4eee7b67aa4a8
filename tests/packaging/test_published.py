"""The bundle and `server.json`: complete, and as the official schemas want them where those can be had."""

from __future__ import annotations

import json
import shutil
import subprocess
import urllib.error
import urllib.request
import zipfile
from pathlib import Path
from typing import Any

import jsonschema
import pytest

from tests.packaging.published import ROOT, SERVER_SCHEMA, bundle_manifest, server_json, write

PACKER = "@anthropic-ai/mcpb@2"


def test_bundle_holds_what_starting_the_server_takes(tmp_path: Path) -> None:
    bundle, described = write(tmp_path)
    with zipfile.ZipFile(bundle) as archive:
        names = set(archive.namelist())
        manifest: dict[str, Any] = json.loads(archive.read("manifest.json"))
    assert {"manifest.json", "pyproject.toml", "README.md", "LICENSE", "atw_mcp/tools/manifest.json"} <= names
    assert manifest["server"]["entry_point"] in names
    assert {f"prompts/{path.name}" for path in (ROOT / "prompts").glob("*.md")} <= names
    assert not [name for name in names if "__pycache__" in name or name.startswith("tests")]
    assert json.loads(described.read_text())["packages"][0]["version"] == manifest["version"]


def test_readme_states_the_name_by_which_the_registry_knows_the_package() -> None:
    assert f"<!-- mcp-name: {server_json()['name']} -->" in (ROOT / "README.md").read_text(encoding="utf-8")


def test_bundle_is_valid_by_the_official_tool(tmp_path: Path) -> None:
    if shutil.which("npx") is None:
        pytest.skip("Node.js is not installed: the bundle was not validated by @anthropic-ai/mcpb")
    path = tmp_path / "manifest.json"
    path.write_text(json.dumps(bundle_manifest()))
    finished = subprocess.run(
        ["npx", "--yes", PACKER, "validate", str(path)], capture_output=True, text=True, timeout=300, check=False
    )
    if "npm error" in finished.stderr:
        pytest.skip(f"npm has no {PACKER} here: {finished.stderr.strip().splitlines()[-1]}")
    assert finished.returncode == 0, finished.stdout + finished.stderr


def test_server_json_is_valid_by_the_official_schema() -> None:
    described = server_json()
    assert len(described["description"]) <= 100
    try:
        with urllib.request.urlopen(SERVER_SCHEMA, timeout=10) as answer:
            schema = json.load(answer)
    except (urllib.error.URLError, TimeoutError) as error:
        pytest.skip(f"{SERVER_SCHEMA} cannot be reached: {error}")
    jsonschema.validate(described, schema)
