"""The committed page is what its sources give."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import pytest

import atw_mcp.viewer
from atw_mcp.viewer.typescript import FILE, typescript

FOLDER = Path(atw_mcp.viewer.__file__).parent
WEB = FOLDER / "web"
STAMP = json.loads((FOLDER / "viewer.json").read_text())
ADVICE = "run `npm install --no-package-lock && npm run build` in atw_mcp/viewer/web and commit what it wrote"


def test_types_of_the_page_are_those_of_the_document() -> None:
    assert FILE.read_text(encoding="utf-8") == typescript(), "run `python -m atw_mcp.viewer.typescript`"


def test_page_was_built_from_the_present_sources() -> None:
    names = ["build.mjs", "index.html", "package.json", "tsconfig.json"]
    names += [path.relative_to(WEB).as_posix() for path in (WEB / "src").rglob("*") if path.is_file()]
    whole = hashlib.sha256()
    for name in sorted(names):
        whole.update(f"{name}\n{hashlib.sha256((WEB / name).read_bytes()).hexdigest()}\n".encode())
    assert STAMP["sources"] == whole.hexdigest(), ADVICE
    assert STAMP["sha256"] == hashlib.sha256((FOLDER / "viewer.html").read_bytes()).hexdigest(), ADVICE


def test_page_runs_nothing_but_its_own_script() -> None:
    page = (FOLDER / "viewer.html").read_text(encoding="utf-8")
    policy = page.split('http-equiv="Content-Security-Policy" content="')[1].split('"')[0]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    assert rules["script-src"].startswith("'sha256-")
    assert "http" not in policy
    assert page.count("<script") - page.count('"<script') == 1


def test_rebuilt_page_has_the_same_bytes(tmp_path: Path) -> None:
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("Node.js is not installed: the page cannot be rebuilt")
    web = tmp_path / "web"
    shutil.copytree(WEB, web, ignore=shutil.ignore_patterns("node_modules"))
    install = ["npm", "install", "--no-package-lock", "--no-audit", "--no-fund", "--prefer-offline"]
    done = subprocess.run(install, cwd=web, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"npm could not install what the page is made of: {done.stderr.strip()[-200:]}")
    subprocess.run(["node", "build.mjs", "--out", str(tmp_path / "viewer.html")], cwd=web, check=True)
    types = subprocess.run(["npx", "tsc", "--noEmit"], cwd=web, capture_output=True, text=True, check=False)
    assert types.returncode == 0, types.stdout
    assert (tmp_path / "viewer.html").read_bytes() == (FOLDER / "viewer.html").read_bytes(), ADVICE
