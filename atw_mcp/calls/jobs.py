"""Work that may outlive a call: run in a thread, watched through the store, cancellable from any process."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from mcp.server.mcpserver.exceptions import ToolError
from mcp.shared.exceptions import MCPError
from mcp_types import INTERNAL_ERROR

from atw_mcp.calls.error_curve import ErrorCurve
from atw_mcp.calls.error_text import shortened
from atw_mcp.calls.limits import DEFAULT, Limits, releasing
from atw_mcp.calls.results import Answer
from evidence_store import Evidence, EvidenceStore, StoreError

if TYPE_CHECKING:
    from polyworld.core.interruption import Interruption

GRACE = 0.3  # [s] for cancelled work to end by itself, with what it has; then it is interrupted where it is
LEAST_SECONDS = 2.0  # [s] of work before the rest of it is predicted: it may begin with loading kernels,
LEAST_SHARE = 0.01  # and this share of it
BEAT = 1.0  # [s] between signs of life; also how soon a cancellation from another process is seen
logger = logging.getLogger(__name__)


class Cancelled(Exception):
    """Raised inside work whose cancellation was asked for."""


def _interruption() -> Interruption:
    from polyworld.core.interruption import Interruption  # the engine: only its work need be interrupted

    return Interruption()


@dataclass
class Progress:
    """How far a piece of work is. The work calls `report`, which raises `Cancelled` when it should stop.

    curve: the error so far, of work that makes one smaller. began: when the work began, on the monotonic clock [s].
    """

    done: float = 0.0
    total: float | None = None
    message: str = ""
    curve: ErrorCurve | None = None
    began: float = field(default_factory=time.monotonic)
    interruption: Interruption = field(default_factory=_interruption)
    _cancel: threading.Event = field(default_factory=threading.Event)

    def report(self, done: float, total: float | None = None, message: str = "") -> None:
        """Say how far the work is; raises Cancelled if it should stop."""
        self.note(done, total, message)
        if self._cancel.is_set():
            raise Cancelled

    def note(self, done: float, total: float | None = None, message: str = "") -> None:
        """Say how far the work is, for work that asks `cancelled` itself."""
        self.done, self.total, self.message = done, total, message

    def in_words(self) -> str:
        """Return what is done, and the time that is left where that can be predicted."""
        return self.message + time_left(self.done, self.total, time.monotonic() - self.began)

    def cancelled(self) -> bool:
        """Whether the work should stop."""
        return self._cancel.is_set()

    def cancel(self) -> None:
        """Ask the work to stop; what does not is interrupted after a moment."""
        if self._cancel.is_set():
            return
        self._cancel.set()
        interrupt = threading.Timer(GRACE, self.interruption.request)
        interrupt.daemon = True
        interrupt.start()


@dataclass(frozen=True)
class LongWork:
    """Work that a tool returns instead of an Answer when computing it may take long.

    key: names what is computed, so that equal work under way is joined instead of repeated. work: computes
    the answer, reporting progress often; solvers interrupt it where it was cancelled, other loops that take longer than
    a second call `polyworld.core.interruption.check`. draft: the provenance known beforehand, its summary what is being
    done. patience [s]: how long the call waits before it returns `running`.
    """

    key: str
    work: Callable[[Progress], Answer]
    draft: Answer
    patience: float


@dataclass
class RunningJob:
    """A piece of work of this process, or (progress None) one that another process does.

    callers: how many calls wait for it. held: whether a task was made of it, which outlives every call.
    """

    evidence: str
    progress: Progress | None
    ended: threading.Event = field(default_factory=threading.Event)
    callers: int = 0
    held: bool = False
    stopped: str | None = None  # the limit that it exceeded
    abandoned: bool = False  # its server ends


class JobRunner:
    """Runs long work in threads, within limits of time and memory, and keeps its evidence record true."""

    def __init__(self, store: EvidenceStore, limits: Limits = DEFAULT) -> None:
        self._store = store
        self._limits = limits
        self._running: dict[str, RunningJob] = {}
        self._guard = threading.Lock()

    def start(self, tool: str, arguments: dict[str, object], work: LongWork) -> RunningJob:
        """Begin the work, or join it where a living process already does it.

        Raises ToolError where the process has no memory left for it.
        """
        reason = self._limits.exceeded()
        if reason is not None:
            raise ToolError(f"{tool} cannot begin: {reason}. Wait for running work, or cancel it with CancelWork")
        with self._guard, self._store.transaction():
            other = self._store.jobs.working_on(work.key)
            if other is not None:
                return self.running(other.evidence)
            record = self._store.evidence.add(replace(work.draft, status="running").to_evidence(tool, arguments))
            self._store.jobs.start(record.id, work.key)
            job = RunningJob(record.id, Progress(), threading.Event())
            self._running[record.id] = job
        # daemon: a client that goes away must not leave a process behind that nobody can talk to
        threading.Thread(target=self._run, args=(record, job, work), daemon=True, name=f"work-{record.id}").start()
        threading.Thread(target=self._watch, args=(job,), daemon=True, name=f"watch-{record.id}").start()
        return job

    def cancel(self, evidence: str) -> None:
        """Ask the work for an evidence record to stop, wherever it runs."""
        self._store.jobs.request_cancel(evidence)
        job = self._running.get(evidence)
        if job is not None and job.progress is not None:
            job.progress.cancel()

    def running(self, evidence: str) -> RunningJob:
        """Return the job of an evidence record; without progress where this process does not work on it."""
        return self._running.get(evidence) or RunningJob(evidence, None, threading.Event())

    @property
    def busy(self) -> bool:
        """Whether this process works on anything."""
        return bool(self._running)

    def wait_for(self, evidence: str, seconds: float) -> Evidence:
        """The record once its work has ended, or as it is after `seconds`. Blocks: for threads of work only."""
        deadline = time.monotonic() + seconds
        while True:
            record = self._store.read_evidence(evidence)
            if record.status != "running" or time.monotonic() > deadline:
                return record
            time.sleep(0.05)

    def shutdown(self, wait: float = 3.0) -> None:
        """Stop everything this process works on and mark it failed."""
        deadline = time.monotonic() + wait
        jobs = list(self._running.values())
        for job in jobs:
            job.abandoned = True
            if job.progress is not None:
                job.progress.cancel()
        for job in jobs:
            if not job.ended.wait(max(0.0, deadline - time.monotonic())):
                try:
                    record = self._interrupted(self._store.evidence.get(job.evidence))
                    self._close(record, _no_answer(record.summary))
                except StoreError as error:  # whoever reads the record next finds that its process has ended
                    logger.warning("%s could not be marked failed: %s", job.evidence, error)

    def _run(self, record: Evidence, job: RunningJob, work: LongWork) -> None:
        from polyworld.core.interruption import Interrupted

        progress = job.progress
        assert progress is not None
        unanswered: dict[str, object] | None = None
        try:
            with progress.interruption.active(), releasing():
                answer = work.work(progress)
            done = answer.to_evidence(record.tool, record.arguments)
            ended = replace(done, id=record.id, case=record.case)
        except (Cancelled, Interrupted):
            ended = self._halted(record, job)
        except MCPError as error:
            ended = replace(record, status="failed", summary=error.message)
            unanswered = _no_answer(error.message, error.code)
        except ToolError as error:
            ended = replace(record, status="failed", summary=str(error))
        except StoreError as error:
            ended = replace(record, status="failed", summary=str(error))
        except Exception as error:
            if progress.cancelled():  # libraries have their own exceptions for being asked to stop
                ended = self._halted(record, job)
            else:
                logger.exception("%s failed", record.tool)
                kind = type(error).__name__
                summary = f"{record.tool} failed unexpectedly ({kind}); the server's log has the details"
                ended = replace(record, status="failed", summary=summary)
        if job.abandoned and ended.status == "failed" and unanswered is None:
            unanswered = _no_answer(ended.summary)
        try:
            self._close(ended, unanswered)
        except StoreError as error:
            logger.error("the result of %s (%s) could not be stored: %s", record.tool, record.id, error)
        except Exception:
            logger.exception("the result of %s could not be stored", record.tool)
        finally:
            job.ended.set()
            self._running.pop(record.id, None)

    def _halted(self, record: Evidence, job: RunningJob) -> Evidence:
        """Return the record of work that was asked to stop: cancelled, or failed where the reason is the server's."""
        if job.abandoned:
            return self._interrupted(record)
        assert job.progress is not None
        at = _how_far(job.progress)
        if job.stopped is not None:
            return replace(record, status="failed", summary=f"stopped at {at}: {job.stopped}")
        return replace(record, status="cancelled", summary=f"cancelled at {at}")

    @staticmethod
    def _interrupted(record: Evidence) -> Evidence:
        summary = f"the server stopped before this was done; call {record.tool} again with the same arguments"
        return replace(record, status="failed", summary=summary)

    def _close(self, record: Evidence, unanswered: dict[str, object] | None) -> None:
        if record.status == "failed":
            record = replace(record, summary=shortened(record.summary))
        with self._store.transaction():
            self._store.tasks.end(record.id, unanswered)
            if self._store.evidence.get(record.id).status in ("running", "failed"):
                self._store.evidence.update(record)
            self._store.jobs.finish(record.id)

    def _watch(self, job: RunningJob) -> None:
        progress = job.progress
        assert progress is not None
        while not job.ended.wait(BEAT):
            job.stopped = job.stopped or self._limits.exceeded(time.monotonic() - progress.began)
            if job.stopped is not None:
                progress.cancel()
            try:
                curve = None if progress.curve is None else progress.curve.to_dict()
                self._store.jobs.beat(job.evidence, progress.done, progress.total, progress.in_words(), curve)
                seen = self._store.jobs.get(job.evidence)
            except StoreError as error:
                logger.warning("could not report progress of %s: %s", job.evidence, error)
                continue
            except Exception:
                logger.warning("could not report progress of %s", job.evidence, exc_info=True)
                continue
            if seen is not None and seen.cancel_requested:
                progress.cancel()


def time_left(done: float, total: float | None, seconds: float) -> str:
    """Return ', about 40 s left', from what was done in some seconds; '' where that is too little to predict from."""
    from polyworld.solver.core.patience import in_words

    share = done / total if total else 0.0
    if seconds < LEAST_SECONDS or not LEAST_SHARE <= share < 1.0:
        return ""
    return f", about {in_words(seconds * (1.0 - share) / share)} left"


def _no_answer(message: str, code: int = INTERNAL_ERROR) -> dict[str, object]:
    """Return the JSON-RPC error of work that ended without an answer of its tool."""
    return {"code": code, "message": message}


def _how_far(progress: Progress) -> str:
    if progress.total:
        return f"{100 * progress.done / progress.total:.0f} %"
    return "an unknown stage"
