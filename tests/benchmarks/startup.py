"""Seconds from the start of a command to its answer, and what a server takes while it waits.

    python -m tests.benchmarks.startup        # on an idle machine; targets: 1.2 s without the engine, 150 MB

Byte code is compiled and kernels are cached by a first round that is not counted.
"""

from __future__ import annotations

import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from atw_mcp.demo.truth import FOLDER
from atw_mcp.server_process import started
from atw_mcp.sessions import call_tool

ROUNDS = 5
CALLS = {
    "list the cases": ["call", "OpenCase"],
    "describe a tool": ["call", "DescribeTool", "tool=Rollout"],
    "read evidence": ["call", "ReadEvidence", "evidence=ev-1"],
    "open a video": ["call", "OpenCase", f"video={FOLDER / 'collision.mp4'}"],
    "list the tools (no server)": ["tools"],
}


def seconds_to_answer(arguments: list[str]) -> float:
    """Time [s] from the start of a process to the first line that it prints."""
    begin = time.perf_counter()
    with subprocess.Popen([sys.executable, "-m", "atw_mcp", *arguments], stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        took = time.perf_counter() - begin
        process.stdout.read()
    return took


def idle_megabytes(store: Path) -> float:
    """Resident memory [MB] of a server that has answered one call (Linux)."""
    with started(store) as server:
        resident = 0.0

        def look(_: object) -> None:
            nonlocal resident
            fields = Path(f"/proc/{server.pid}/statm").read_text().split()
            resident = int(fields[1]) * os.sysconf("SC_PAGE_SIZE") / 1e6

        call_tool(server, "OpenCase", {}, look)
    return resident


def main() -> None:
    """Print one line a call, median of some rounds, and the memory."""
    with tempfile.TemporaryDirectory() as folder:
        store = Path(folder) / "atw.db"
        for name, arguments in CALLS.items():
            whole = arguments if arguments[0] == "tools" else [*arguments, "--store", str(store)]
            seconds_to_answer(whole)
            took = [seconds_to_answer(whole) for _ in range(ROUNDS)]
            print(f"{name:28} {statistics.median(took):.2f} s ({min(took):.2f} to {max(took):.2f})", flush=True)
        print(f"{'idle server':28} {idle_megabytes(store):.0f} MB")


if __name__ == "__main__":
    main()
