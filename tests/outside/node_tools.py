"""Programs from npm that judge the server; installed once into the user's cache, or skipped with the reason."""

from __future__ import annotations

import os
import shutil
import subprocess
import tempfile
from pathlib import Path

import platformdirs
import pytest

PACKAGES = ("node@24", "@modelcontextprotocol/conformance@0.2.0-alpha.12", "@modelcontextprotocol/inspector@2.12.0")
INSTALLING = 180.0  # [s]


def node_environment() -> dict[str, str]:
    """Environment whose PATH has `conformance` and `mcp-inspector`; skips the test where they cannot be had."""
    folder = Path(platformdirs.user_cache_dir("atw-mcp-tests", appauthor=False)) / "-".join(
        package.rpartition("/")[2].replace("@", "-") for package in PACKAGES
    )
    if not folder.is_dir():
        _install(folder)
    return {**os.environ, "PATH": f"{folder / 'node_modules' / '.bin'}{os.pathsep}{os.environ['PATH']}"}


def _install(folder: Path) -> None:
    npm = shutil.which("npm")
    if npm is None:
        pytest.skip("npm is not installed: the conformance suite and the Inspector cannot be had")
    folder.parent.mkdir(parents=True, exist_ok=True)
    fresh = Path(tempfile.mkdtemp(dir=folder.parent))  # moved into place whole, so that two tests may do this at once
    command = [npm, "install", "--silent", "--no-fund", "--no-audit", "--prefix", str(fresh), *PACKAGES]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=INSTALLING, check=False)
    except subprocess.TimeoutExpired:
        shutil.rmtree(fresh, ignore_errors=True)
        pytest.skip(f"npm install took more than {INSTALLING:g} s")
    if done.returncode != 0:
        shutil.rmtree(fresh, ignore_errors=True)
        pytest.skip(f"npm cannot install {', '.join(PACKAGES)} here: {done.stderr.strip()[-200:]}")
    try:
        fresh.rename(folder)
    except OSError:  # another test was faster
        shutil.rmtree(fresh, ignore_errors=True)
