"""Reading of a file in a child process with limits: what a file makes of a reader's time and memory ends there.

Readers are native code that runs until it is done: a file of 200 bytes can ask for a thousand million bodies. The child
answers in JSON, so that nothing of it is believed but a world that is validated again.
"""

from __future__ import annotations

import json
import math
import multiprocessing
import os
import signal
import tempfile
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from polyworld.core import interruption
from polyworld.exchange.reading import Imported, import_world
from polyworld.world import World

BEAT = 0.1  # between looks at whether the import was cancelled [s]
CONTENT, REFUSED = b"+", b"-"  # first byte of what the child gets for a file that it asks for


@dataclass(frozen=True)
class ImportLimits:
    """Bounds of one import.

    seconds: of the reader, the child's own start not counted; a robot of a hundred meshes takes a few. memory: bytes
    beyond what the readers themselves occupy; the same robot takes a tenth of it. start_seconds: for the child to load
    the readers, which takes two the first time, on an idle machine, and a tenth after it.
    """

    seconds: float = 10.0
    memory: int = 1_000_000_000
    start_seconds: float = 60.0


def import_confined(
    path: str | Path,
    *,
    keyframe: str | int | None = None,
    floating: bool = False,
    read: Callable[[Path], bytes] | None = None,
    limits: ImportLimits | None = None,
) -> Imported:
    """Read a file as `import_world` does, in a process that is ended where it exceeds the limits or is interrupted.

    `read` is called in this process. Raises what `import_world` raises, and ValueError where a limit is exceeded.
    """
    limits, path = limits or ImportLimits(), Path(path).absolute()
    context = _context()
    here, there = context.Pipe()
    with tempfile.TemporaryDirectory(prefix="atw-import-") as folder, here:
        options = (str(path), keyframe, floating, read is not None, limits)
        child = context.Process(target=_serve, args=(there, folder, *options), daemon=True)
        child.start()
        there.close()
        try:
            _receive(here, path, limits.start_seconds, "load")
            return _answer(here, path, read, limits)
        finally:
            child.kill()
            child.join()


def _context() -> Any:
    """Return what starts children: copies of a process that has loaded what readers need, where the system can."""
    if "forkserver" not in multiprocessing.get_all_start_methods():  # Windows
        return multiprocessing.get_context("spawn")
    context = multiprocessing.get_context("forkserver")
    context.set_forkserver_preload([__name__, "mujoco"])  # what is not installed is left out
    return context


def _answer(pipe: Connection, path: Path, read: Callable[[Path], bytes] | None, limits: ImportLimits) -> Imported:
    """Give the child the files that it asks for, until it answers."""
    last = time.monotonic() + limits.seconds
    while True:
        message = json.loads(_receive(pipe, path, last - time.monotonic(), "read", limits))
        if "world" in message:
            return Imported(World.model_validate_json(message["world"]), tuple(map(str, message["left_out"])))
        if "read" not in message or read is None:
            raise (ImportError if message.get("missing") else ValueError)(str(message.get("failed")))
        try:
            content = CONTENT + read(Path(message["read"]))
        except (OSError, ValueError) as error:
            content = REFUSED + str(error).encode()
        with suppress(OSError):  # the child is gone, which shows at once
            pipe.send_bytes(content)


def _receive(pipe: Connection, path: Path, seconds: float, doing: str, limits: ImportLimits | None = None) -> bytes:
    last = time.monotonic() + seconds
    while not pipe.poll(BEAT):
        interruption.check()
        if time.monotonic() > last:
            raise ValueError(f"{path.name} takes more than {seconds:.3g} s to {doing}: make it smaller")
    try:
        return pipe.recv_bytes()
    except (EOFError, OSError):
        memory = f"needs more than {limits.memory / 1e9:.3g} GB of memory, or " if limits else ""
        raise ValueError(f"{path.name} {memory}ended its reader: make it smaller, or write it again") from None


def _serve(
    pipe: Connection,
    folder: str,
    path: str,
    keyframe: str | int | None,
    floating: bool,
    alone: bool,
    limits: ImportLimits,
) -> None:
    """Read a file in this process and answer. folder: where readers may write, removed by the parent."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the parent decides
    os.dup2(2, 1)  # standard output may carry the parent's protocol
    os.chdir(folder)
    tempfile.tempdir = folder

    def ask(other: Path) -> bytes:
        pipe.send_bytes(json.dumps({"read": str(other)}).encode())
        content = pipe.recv_bytes()
        if content[:1] == REFUSED:
            raise ValueError(content[1:].decode())
        return content[1:]

    _load_readers(Path(path))
    with suppress(OSError):  # nobody waits any more: the parent was killed
        _bound(limits)
        pipe.send_bytes(b"ready")
        pipe.send_bytes(json.dumps(_outcome(path, keyframe, floating, ask if alone else None)).encode())


def _outcome(
    path: str, keyframe: str | int | None, floating: bool, read: Callable[[Path], bytes] | None
) -> dict[str, object]:
    try:
        found = import_world(path, keyframe=keyframe, floating=floating, read=read)
    except MemoryError:
        os._exit(1)  # as where native code ends the process
    except (ImportError, OSError, ValueError, RecursionError) as error:
        return {"failed": str(error), "missing": isinstance(error, ImportError)}
    return {"world": found.world.canonical_json(), "left_out": found.left_out}


def _load_readers(path: Path) -> None:
    """Import the reader of a file, whose code is no part of what the file needs."""
    with suppress(ImportError):  # which `import_world` explains
        if path.suffix.lower().startswith(".usd"):
            from pxr import Sdf, Usd, UsdGeom, UsdPhysics  # noqa: F401
        else:
            import mujoco  # noqa: F401


def _bound(limits: ImportLimits) -> None:
    """Bound what this process may take beyond what it has, where the system can: a killed parent ends no child."""
    try:
        import resource
    except ImportError:  # Windows
        return
    spent = math.ceil(time.process_time() + limits.seconds * (os.cpu_count() or 1))
    resource.setrlimit(resource.RLIMIT_CPU, (spent, spent + 1))
    with suppress(OSError, ValueError):  # macOS takes no bound of the address space
        size = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE") + limits.memory
        resource.setrlimit(resource.RLIMIT_AS, (size, size))
