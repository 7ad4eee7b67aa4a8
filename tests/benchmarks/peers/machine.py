"""The machine and the versions that a run of the benchmarks used."""

from __future__ import annotations

import importlib.metadata
import os
import platform
import subprocess
from pathlib import Path

PACKAGES = ("warp-lang", "mujoco", "newton", "numpy", "scipy")
THREADS = len(os.sched_getaffinity(0))


def description() -> tuple[str, ...]:
    """Return lines on processor, cores, memory, load, system, Python, packages and the commit measured."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return (
        f"processor: {_processor()}, {THREADS} cores in use, {memory:.0f} GiB of memory, no GPU used",
        f"load average at the start: {os.getloadavg()[0]:.1f} (of {THREADS} cores)",
        f"system: {platform.system()} {platform.release()}, Python {platform.python_version()}",
        "packages: " + ", ".join(f"{name} {_version(name)}" for name in PACKAGES),
        f"commit: {_commit()}",
    )


def _processor() -> str:
    path = Path("/proc/cpuinfo")
    if path.exists():
        fields = dict(line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
        named = {key.strip(): value.strip() for key, value in fields.items()}
        family = f"family {named.get('cpu family')}, model {named.get('model')}"
        return f"{named.get('model name', platform.machine())} ({family})"
    return platform.processor() or platform.machine()


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return "not installed"


def _commit() -> str:
    folder = Path(__file__).parent
    try:
        found = subprocess.run(
            ["git", "log", "-1", "--format=%h of %cs"], cwd=folder, capture_output=True, text=True, check=True
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return found.stdout.strip()
