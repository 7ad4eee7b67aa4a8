"""Worlds as given, in a document or a file, kept as drafts."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer, explained
from atw_mcp.worlds.built_answer import described_parts
from atw_mcp.worlds.sizes import check_sizes, takes_long
from atw_mcp.worlds.warnings import fluid_warnings
from atw_mcp.worlds.world_files import world_of_file
from evidence_store import Case
from polyworld.model.notes import model_notes
from polyworld.world import World

DIVIDING = "dividing soft bodies into elements"


def as_long_work(case: Case, key: str, patience: float, doing: str, build: Callable[[], Answer]) -> LongWork:
    """Return work that builds a world. key: of what is built; doing: what is said meanwhile."""

    def work(progress: Progress) -> Answer:
        progress.note(0.0, 1.0, doing)
        with explained():
            return build()

    return LongWork(key=key, work=work, draft=Answer(summary=doing, data={}, case=case.id), patience=patience)


def from_document(app: App, case: Case, document: dict[str, Any] | str, patience: float) -> Answer | LongWork:
    """Keep a world as a draft of the case: one written out, or the path of a file."""
    if isinstance(document, str):
        with explained():
            key = f"build {case.id} {app.files.file(document)}"
        return as_long_work(case, key, patience, "reading a world", lambda: _from_file(app, case, document))
    with explained("DescribeTool(tool='BuildWorld', argument='world') gives the schema of a world"):
        made = World.model_validate(document)
        check_sizes(made, app.limits)
    if takes_long(made.deformables):
        return as_long_work(
            case, f"build {case.id} {made.id}", patience, DIVIDING, lambda: _kept_document(app, case, made, ())
        )
    return _kept_document(app, case, made, ())


def _from_file(app: App, case: Case, path: str) -> Answer:
    with explained("DescribeTool(tool='BuildWorld', argument='world') gives the schema of a world"):
        made, left_out = world_of_file(app.files, path)
        check_sizes(made, app.limits)
    return _kept_document(app, case, made, left_out)


def _kept_document(app: App, case: Case, made: World, left_out: tuple[str, ...]) -> Answer:
    with explained("DescribeTool(tool='BuildWorld', argument='world') gives the schema of a world"):
        warned = (*fluid_warnings(made), *model_notes(made))
    record = app.store.cases.observations(case.id, "tracks")
    observation = record[0][1] if record else None
    app.keep_world(case, made, how="given", observation=observation)
    names = made.moving_names
    return Answer(
        summary=f"draft world {made.id} with {len(names)} objects, as given",
        data={
            "world": made.id,
            "objects": made.objects,
            "statics": made.statics,
            **described_parts(made),
            "assumed": [*left_out, *warned],
        },
        case=case.id,
        world=made.id,
        observation=observation,
        objects=names,
    )
