"""A server over HTTP in a process of its own."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

STARTING = 60.0  # [s]


@contextmanager
def serving(module: str, arguments: list[str], folder: Path) -> Iterator[str]:
    """Run `python -m module ARGUMENTS PORT` and yield the URL once it listens; raises RuntimeError where it does not.

    folder: where its log is written.
    """
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    log = folder / "server.log"
    with log.open("w") as stderr:
        command = [sys.executable, "-m", module, *arguments, str(port)]
        process = subprocess.Popen(command, stderr=stderr)
    try:
        deadline = time.monotonic() + STARTING
        while True:
            with socket.socket() as probe:
                if probe.connect_ex(("127.0.0.1", port)) == 0:
                    break
            if process.poll() is not None or time.monotonic() > deadline:
                raise RuntimeError(f"{module} does not listen: {log.read_text()[-500:]}")
            time.sleep(0.1)
        yield f"http://127.0.0.1:{port}/mcp"
    finally:
        process.terminate()
        process.wait(10)
