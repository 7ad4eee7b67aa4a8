"""A server of this installation as a child process, started before what its client needs is imported.

Imports nothing but the standard library: the server loads while the client does.
"""

from __future__ import annotations

import os
import subprocess
import sys
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

LEAVE = 5.0  # [s] for a server whose client has left: it stops its work and closes its store
TERMINATE = 2.0  # [s] from SIGTERM to SIGKILL


class ServerProcess:
    """A running server with the pipes that it is spoken to over, one JSON-RPC message a line."""

    def __init__(self, store: Path | None, allow: Iterable[Path] = ()) -> None:
        """Start it on a store, default the user's; it may read files below `allow`."""
        options = [] if store is None else ["--store", str(store)]
        options += [f"--allow={path}" for path in allow]
        search = [str(Path(__file__).parents[1]), *filter(None, [os.environ.get("PYTHONPATH")])]
        self._process = subprocess.Popen(
            [sys.executable, "-m", "atw_mcp", "serve", *options],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(search)},
            encoding="utf-8",
            errors="replace",
            start_new_session=True,  # Ctrl-C is for the client, which cancels the call
        )
        assert self._process.stderr is not None
        self._errors = threading.Thread(target=forward_errors, args=(self._process.stderr,), daemon=True)
        self._errors.start()

    @property
    def pid(self) -> int:
        """Its process id."""
        return self._process.pid

    @property
    def exit_code(self) -> int | None:
        """Its exit code; None while it runs."""
        return self._process.poll()

    def lines(self) -> Iterator[str]:
        """Yield what the server writes, until it ends."""
        assert self._process.stdout is not None
        yield from self._process.stdout

    def write(self, line: str) -> None:
        """Send a line; raises OSError or ValueError where the server or the pipe is gone."""
        assert self._process.stdin is not None
        self._process.stdin.write(line + "\n")
        self._process.stdin.flush()

    def stop(self) -> None:
        """Close the server's stdin and wait until it has ended; one that does not is killed."""
        assert self._process.stdin is not None
        with suppress(OSError, ValueError):  # it is gone already
            self._process.stdin.close()
        for end, patience in ((self._process.terminate, LEAVE), (self._process.kill, TERMINATE)):
            try:
                self._process.wait(patience)
                break
            except subprocess.TimeoutExpired:
                end()
        self._process.wait()
        self._errors.join(timeout=2.0)  # what the server left running may hold the other end


@contextmanager
def started(store: Path | None, allow: Iterable[Path] = ()) -> Iterator[ServerProcess]:
    """A server on `store` (default: the user's) that may read files below `allow` and is stopped in the end."""
    server = ServerProcess(store, allow)
    try:
        yield server
    finally:
        server.stop()


def forward_errors(lines: Iterable[str]) -> None:
    """Copy lines to stderr as they come."""
    for line in lines:
        sys.stderr.write(line)
        sys.stderr.flush()
