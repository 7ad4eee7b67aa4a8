"""Progress of running work, reported to the client that waits for it."""

from __future__ import annotations

import time
from collections.abc import Awaitable, Callable

import anyio

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import RunningJob

LOOK = 0.05  # [s] between two looks at work of this process
LOOK_AT_STORE = 0.5  # [s] between two looks at work of another process
SILENCE = 0.9  # [s] after which progress is reported although there is none: below the promised second
HAIR = 1e-6  # of the total: the protocol wants each value to exceed the last, also while nothing is completed

Report = Callable[[float, float | None, str], Awaitable[None]]


async def follow(app: App, job: RunningJob, report: Report) -> None:
    """Report the progress of work at least once a second, until it ends."""
    shown, reported, looked = -1.0, time.monotonic(), 0.0
    done, total, message = 0.0, None, ""
    while not job.ended.is_set():
        await anyio.sleep(LOOK)
        now = time.monotonic()
        if job.progress is not None:
            done, total, message = job.progress.done, job.progress.total, job.progress.in_words()
        elif now - looked >= LOOK_AT_STORE:
            looked = now
            record = await anyio.to_thread.run_sync(app.store.read_evidence, job.evidence)
            if record.status != "running":
                return
            seen = await anyio.to_thread.run_sync(app.store.jobs.get, job.evidence)
            if seen is not None:
                done, total, message = seen.done, seen.total, seen.message
        if done > shown:
            shown, reported = done, now
            await report(shown, total, message)
        elif now - reported >= SILENCE:
            shown, reported = shown + HAIR * max(total or 1.0, 1.0), now
            await report(shown, total, message)
