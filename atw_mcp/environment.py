"""Examination of what the server needs besides its store: packages, the kernel cache, room on the disk."""

from __future__ import annotations

import importlib
import os
import platform
import shutil
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from evidence_store.checking import Finding

NEEDED_FREE = 200e6  # [bytes] on the store's disk: a few long rollouts of some tens of MB


def environment(store: Path) -> list[Finding]:
    """Examine versions of Python, Warp and OpenCV, the kernel cache, and the free room on the disk of `store`."""
    return [
        Finding("Python", True, f"{platform.python_version()} on {platform.system()} {platform.machine()}"),
        _package("Warp", "warp"),
        _package("OpenCV", "cv2"),
        _kernel_cache(),
        _disk(store),
    ]


def _package(name: str, module: str) -> Finding:
    try:
        return Finding(name, True, str(importlib.import_module(module).__version__))
    except Exception as error:  # a broken shared library raises errors of many kinds
        return Finding(name, False, f"cannot be imported ({error}): install atw-mcp again")


def _kernel_cache() -> Finding:
    try:
        import warp

        import polyworld.core.warp_settings  # noqa: F401  (Warp's own report is not wanted)

        start: Any = warp.init
        with redirect_stdout(sys.stderr):  # it prints its own report
            start()
        folder = Path(warp.config.kernel_cache_dir or "")
    except Exception as error:
        return Finding("kernel cache", False, f"Warp does not start ({error})")
    if folder.is_dir() and os.access(folder, os.W_OK):
        return Finding("kernel cache", True, str(folder))
    return Finding("kernel cache", False, f"{folder} cannot be written: set WARP_CACHE_PATH to a folder that can")


def _disk(store: Path) -> Finding:
    folder = next(parent for parent in store.absolute().parents if parent.is_dir())
    free = shutil.disk_usage(folder).free
    advice = "" if free >= NEEDED_FREE else f", less than {NEEDED_FREE / 1e6:.0f} MB: free some, or `atw-mcp prune`"
    return Finding("disk", free >= NEEDED_FREE, f"{free / 1e9:.1f} GB free in {folder}{advice}")
