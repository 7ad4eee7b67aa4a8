"""What evidence records cost: to write, to read again, to list by tool, object, interval and words."""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from anyio.from_thread import start_blocking_portal

from atw_mcp.client import Session, connected
from atw_mcp.printing import ProgressLine
from atw_mcp.server import build_server
from evidence_store import Evidence, EvidenceStore
from tests.benchmarks.peers import progress
from tests.benchmarks.peers.table import Table

CASE = "case"
REPEATS = 5
STORE = ("add", "get", "by tool", "by object", "by interval", "by words", "nothing found", "by rollout")
CLIENT = ("ReadEvidence of one", "list", "list by tool", "list by object", "list by words")


def record(number: int) -> Evidence:
    """A record as probing makes them; number 0 is unlike the others."""
    name = "rare" if number == 0 else f"ball_{number % 7}"
    return Evidence(
        tool="CompareWorlds" if number == 0 else ("Rollout", "QueryWorld", "ReadTrajectory")[number % 3],
        arguments={"case": CASE, "rollout": f"rollout-{number // 50}", "object": name},
        case=CASE,
        rollout=f"rollout-{number // 50}",
        objects=(name, "floor"),
        interval=(-2.0, -1.0) if number == 0 else (0.0, 2.0),
        summary=f"{name} comes to rest at {number % 97 / 50} s",
        payload={"data": {"positions": [[number * 0.001 * k, 0.1, 0.2] for k in range(8)], "at": number % 97 / 50}},
    )


def fill(store: EvidenceStore, first: int, last: int) -> float:
    """Write records in transactions of a thousand; returns milliseconds a record."""
    began = time.perf_counter()
    for start in range(first, last, 1000):
        with store.transaction():
            for number in range(start, min(start + 1000, last)):
                store.evidence.add(record(number))
    return 1e3 * (time.perf_counter() - began) / max(1, last - first)


def milliseconds(call: Callable[[], object]) -> float:
    """Median time of a call [ms]; one that takes seconds is timed once."""
    took: list[float] = []
    while len(took) < REPEATS and sum(took) < 1e3:
        began = time.perf_counter()
        call()
        took.append(1e3 * (time.perf_counter() - began))
    return statistics.median(took)


def of_store(store: EvidenceStore, count: int) -> dict[str, float]:
    """Milliseconds of each operation through the store that holds `count` records."""
    find = store.evidence.search
    calls: dict[str, Callable[[], object]] = {
        "add": lambda: store.evidence.add(record(1)),
        "get": lambda: store.evidence.get(f"ev-{count // 2}"),
        "by tool": lambda: find(CASE, tool="CompareWorlds"),
        "by object": lambda: find(CASE, object="rare"),
        "by interval": lambda: find(CASE, interval=(-1.5, -1.2)),
        "by words": lambda: find(CASE, text="rare rest"),
        "nothing found": lambda: find(CASE, status="failed"),
        "by rollout": lambda: store.evidence.last_about(CASE, "rollout-0"),
    }
    return {name: milliseconds(calls[name]) for name in STORE}


@contextmanager
def session(path: Path) -> Iterator[Callable[[str, dict[str, Any]], None]]:
    """Yield what calls a tool of a server in this process, over the protocol."""
    with (
        start_blocking_portal() as portal,
        portal.wrap_async_context_manager(connected(build_server(path), ProgressLine())) as opened,
    ):
        assert isinstance(opened, Session)

        def call(tool: str, arguments: dict[str, Any]) -> None:
            portal.call(opened.call, tool, arguments)

        yield call


def of_client(path: Path, count: int) -> dict[str, float]:
    """Milliseconds of each call of `ReadEvidence` by a client."""
    arguments: dict[str, dict[str, Any]] = {
        "ReadEvidence of one": {"evidence": f"ev-{count // 2}"},
        "list": {"case": CASE},
        "list by tool": {"case": CASE, "tool": "CompareWorlds"},
        "list by object": {"case": CASE, "object": "rare"},
        "list by words": {"case": CASE, "text": "rare rest"},
    }
    with session(path) as call:
        call("ReadEvidence", {"case": CASE})  # the tool's module is imported
        return {name: milliseconds(lambda name=name: call("ReadEvidence", arguments[name])) for name in CLIENT}  # type: ignore[misc]


def tables(quick: bool) -> list[Table]:
    """Return a table of the store and one of the client."""
    sizes = (100, 1_000, 5_000) if quick else (100, 1_000, 10_000, 100_000, 1_000_000)
    rows: list[tuple[str, ...]] = []
    calls: list[tuple[str, ...]] = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "atw.db"
        store = EvidenceStore(path)
        store.cases.add(CASE, content="x", kind="data", path="x", facts={})
        held = 0
        for size in sizes:
            progress.show(f"{size} evidence records")
            bulk = fill(store, held, size)
            found = of_store(store, size)
            held = size
            megabytes = path.stat().st_size / 1e6
            rows.append((f"{size}", f"{bulk:.3f}", *(f"{found[name]:.3g}" for name in STORE), f"{megabytes:.0f}"))
            served = of_client(path, size)
            calls.append((f"{size}", *(f"{served[name]:.3g}" for name in CLIENT)))
        store.close()
    note = (
        "Milliseconds a call, of one case. The record looked for by tool, object, interval and words is the oldest, so "
        "that a search without an index reads all others first."
    )
    columns = ("records", "add in bulk", *STORE, "file [MB]")
    return [
        Table("Evidence records: the store", note, columns, tuple(rows)),
        Table("Evidence records: a client in the same process", note, ("records", *CLIENT), tuple(calls)),
    ]
