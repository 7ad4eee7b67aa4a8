"""State that all tools share: the store, the jobs, and the case asked about, and its worlds."""

from __future__ import annotations

import logging
import sqlite3
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mcp.server.mcpserver.exceptions import ToolError
from mcp_types import CallToolResult

from atw_mcp.calls.files import AllowedFiles
from atw_mcp.calls.jobs import JobRunner
from atw_mcp.calls.limits import Limits
from atw_mcp.calls.results import to_result
from atw_mcp.calls.spelling import did_you_mean
from atw_mcp.calls.toolsets import Selection
from atw_mcp.calls.waiting import WaitingCalls
from atw_mcp.calls.watching import EvidenceWatch
from evidence_store import Case, EvidenceStore, StoreError, UnknownRecord
from evidence_store.renumbering import IMPORTED
from polyworld.core.kept import BOUNDS, kept

if TYPE_CHECKING:
    from polyworld.world import World

logger = logging.getLogger(__name__)


class App:
    """The state of a server: nothing but the store, so any other server on it continues where this one stopped.

    allow: folders and files whose content calls may have read. limits: of what one call may ask for.
    """

    def __init__(self, store_path: Path, allow: Iterable[Path] = (), limits: Limits | None = None) -> None:
        self.store = EvidenceStore(store_path)
        self.limits = Limits() if limits is None else limits
        self.jobs = JobRunner(self.store, self.limits)
        self.files = AllowedFiles(allow, self.limits, own=[self.derived_files])
        self.waiting = WaitingCalls()
        self.watch = EvidenceWatch(self.store)
        self.tools: list[Any] = []  # every WorldTool, for calls made inside others; set by build_server
        self.selection = Selection()  # which of them are served and listed

    @property
    def served(self) -> list[Any]:
        """The tools that are served."""
        return self.selection.served(self.tools)

    def tool(self, name: str) -> Any:
        """Return the tool served under a name, in upper or lower case; raises ToolError naming those there are."""
        found = next((tool for tool in self.served if tool.name.lower() == name.lower()), None)
        if found is None:
            names = [tool.name for tool in self.served]
            own = self.selection.notes_on(name, self.tools)
            raise ToolError(own or f"no tool {name!r}{did_you_mean(name, names)}; tools: {', '.join(names)}")
        return found

    # --- the end ---

    def stop_work(self, wait: float = 3.0) -> None:
        """Cancel the work of this process and record how it ended; waits at most `wait` seconds for it."""
        try:
            self.jobs.shutdown(wait)
        except StoreError as error:  # such as a full disk: nothing is left to do but to say so
            logger.error("unfinished work could not be recorded: %s", error)

    def close(self) -> None:
        """Stop the work that is left at once and close the store."""
        self.stop_work(0.0)
        try:
            self.store.close()
        except (StoreError, sqlite3.Error) as error:
            logger.error("the evidence store could not be closed: %s", error)

    @property
    def derived_files(self) -> Path:
        """Folder beside the store with results of models that are too large for it."""
        return self.store.path.parent / "models"

    # --- cases ---

    def case(self, identifier: str) -> Case:
        """The case; raises ToolError naming the cases there are."""
        try:
            return self.store.cases.get(identifier)
        except UnknownRecord as error:
            raise ToolError(
                f"{error}. Next: OpenCase(video=PATH) opens one, OpenCase(name=NAME) one without a file"
            ) from error

    def case_to_probe(self, identifier: str, tool: str, wanted: str | None = None) -> tuple[Case, World]:
        """Return the case and its committed world, refused before there is one (experimentation tools).

        wanted: the world that was asked for; the refusal says how to commit this one, default the latest.
        """
        case = self.case(identifier)
        if case.committed_world is None:
            drafts = [world for world, _ in self.store.cases.worlds(case.id)]
            if wanted is not None and drafts:
                self.world(case, wanted)
            step = (
                f"CommitWorld(case={case.id!r}, world={wanted or drafts[-1]!r})"
                if drafts
                else f"BuildWorld(case={case.id!r}), FitWorld and CommitWorld"
            )
            raise ToolError(f"{tool} probes a committed world, and case {case.id!r} has none yet. Next: {step}")
        return case, self.world(case, case.committed_world)

    # --- observations ---

    def track_names(self, case: Case) -> list[str]:
        """Names of the tracks observed in the case so far."""
        names: list[str] = []
        for kind, observation in self.store.cases.observations(case.id):
            if kind == "tracks":
                names += [n for n in self.store.observations.get(observation).document["names"] if n not in names]
        return sorted(names)

    # --- worlds ---

    def world(self, case: Case, identifier: str | None = None) -> World:
        """A world of the case: the one named, else the committed one, else the latest draft."""
        wanted = case.committed_world if identifier is None else identifier
        if wanted is None or not self.store.cases.has_world(case.id, wanted):
            known = [world for world, _ in self.store.cases.worlds(case.id)]
            if wanted is not None:
                raise ToolError(f"case {case.id!r} has no world {wanted!r}; its worlds: {known}")
            if not known:
                raise ToolError(f"case {case.id!r} has no world yet. Next: BuildWorld(case={case.id!r})")
            wanted = known[-1]
        return _parsed(self.store.worlds.document(wanted))

    def draft(self, case: Case, identifier: str | None = None) -> World:
        """A world to model further: the one named, else the latest of the case that no edit made."""
        drafts = [world for world, origin in self.store.cases.worlds(case.id) if origin != "intervention"]
        return self.world(case, drafts[-1] if identifier is None and drafts else identifier)

    def keep_world(
        self,
        case: Case,
        world: World,
        *,
        how: str,
        parent: World | None = None,
        detail: dict[str, Any] | None = None,
        observation: str | None = None,
    ) -> None:
        """Store a world as one of the case's, with where it came from and the track record it models."""
        with self.store.transaction():
            self.store.worlds.put(
                world.id,
                world.canonical_json(),
                parent=None if parent is None else parent.id,
                how=how,
                detail=detail,
            )
            self.store.cases.add_world(case.id, world.id, how, observation)

    # --- evidence ---

    def evidence_result(self, identifier: str, *, whole: bool = False) -> CallToolResult:
        """Return an evidence record as a tool result, whole or shortened; one still running says how far it is."""
        record = self.store.read_evidence(identifier)
        if record.status == "failed":
            record = replace(record, summary=self.files.redacted(record.summary))
        if earlier := [f"{old['evidence']} of case {old['case']!r}" for old in record.payload.get(IMPORTED, [])]:
            record = replace(record, summary=f"{record.summary} [imported: {', then '.join(earlier)}]")
        job = self.store.jobs.get(identifier) if record.status == "running" else None
        if job is not None:
            progress = {"done": job.done, "total": job.total, "message": job.message}
            summary = (
                f"{record.summary}; still running: ReadEvidence(evidence={record.id!r}) shows its progress, "
                "CancelWork stops it"
            )
            record = replace(record, summary=summary, payload={"data": {"progress": progress}})
        return to_result(record, whole=whole)


@kept(BOUNDS.worlds)
def _parsed(document: str) -> World:
    from polyworld.world import World  # the engine: a server that has only been asked what it can do has not loaded it

    return World.model_validate_json(document)
