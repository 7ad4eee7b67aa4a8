"""A process that forks a writer for every line on its input, so that the writers can be killed.

Each writer prints its process id, then one line for every record that the store has acknowledged.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace

import numpy as np

from evidence_store import Evidence, EvidenceStore
from evidence_store.canonical import Arrays


def compute(number: int) -> tuple[dict[str, object], Arrays]:
    """A rollout of some ten kilobytes that its number determines."""
    return {"number": number}, {"x": np.random.default_rng(number).random(2000)}


def say(line: str) -> None:
    """Write a line whole or not at all, whenever the process is killed."""
    os.write(1, f"{line}\n".encode())


def write(path: str, seed: int) -> None:
    """Do long work without end: note that it runs, store its result, store what became of it."""
    store = EvidenceStore(path)
    say(f"pid {os.getpid()}")
    for number in range(seed * 1000, seed * 1000 + 1000):
        with store.transaction():
            record = store.evidence.add(Evidence("Rollout", {"number": number}, case="ball", status="running"))
            store.jobs.start(record.id, f"rollout {number}")
        say(f"started {record.id} {number}")
        rollout, _ = store.rollouts.get_or_compute("rollout", {"number": number}, lambda: compute(number))  # noqa: B023
        say(f"rollout {rollout.id} {number}")
        with store.transaction():
            store.evidence.update(
                replace(record, status="completed", rollout=rollout.id, payload={"data": {"number": number}})
            )
            store.jobs.finish(record.id)
        say(f"completed {record.id} {number}")


if __name__ == "__main__":
    for line in sys.stdin:
        child = os.fork()
        if child == 0:
            write(sys.argv[1], int(line))
            os._exit(0)
        os.waitpid(child, 0)
        say("gone")
