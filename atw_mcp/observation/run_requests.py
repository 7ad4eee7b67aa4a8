"""Requests that a model be run on a case, what becomes of them, and what all of them read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import Progress
from atw_mcp.models import (
    Limits,
    ModelError,
    ModelFolder,
    Prompt,
)
from atw_mcp.observation.observing import (
    image_observation,
    latest_image_observation,
    video_file,
)
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import Frames, load
from evidence_store import Case

Use = Literal["model", "agreement", "report"]


@dataclass(frozen=True)
class KnownObject:
    """An object a model is asked about; size: its greatest extent [m]; mesh: id of a mesh of the case."""

    name: str
    size: float | None = None
    mesh: str | None = None


@dataclass(frozen=True)
class RunRequest:
    """Request that a model be run on a case. prompts: rows are frame numbers here. use: what becomes of the result."""

    model: ModelFolder
    limits: Limits
    prompts: tuple[Prompt, ...] = ()
    objects: tuple[KnownObject, ...] = ()
    stride: int = 1
    use: Use = "model"


@dataclass(frozen=True)
class RunOutcome:
    """id: of what was kept; summary and data: for the agent; objects: whom it is about."""

    id: str
    summary: str
    data: dict[str, Any]
    objects: tuple[str, ...] = field(default=())


@dataclass(frozen=True)
class Prepared:
    """A run that has been checked: inputs determine its result, work does it."""

    kind: str
    inputs: dict[str, Any]
    work: Callable[[Progress], RunOutcome]


def inputs_of(case: Case, request: RunRequest) -> dict[str, Any]:
    """Return what determines the result of every run."""
    return {"video": case.content, "model": request.model.name, "weights": request.model.sha256()}


def masks_by_others(app: App, case: Case, model: ModelFolder) -> tuple[str, ImageObservation] | None:
    """The latest observation that these weights did not make: what a model is compared with is not itself."""
    for _, identifier in app.store.cases.observations(case.id, "objects"):
        content = app.store.observations.get(identifier)
        if content.inputs.get("weights") != model.sha256():
            return identifier, image_observation(content)
    return None


def latest_observed(app: App, case: Case, request: RunRequest) -> tuple[str, ImageObservation]:
    """Return the latest observation of objects and its id; raises ModelError where there is none."""
    latest = latest_image_observation(app, case)
    if latest is None:
        raise ModelError(f"{request.model.name} needs objects: ObserveObjects(case={case.id!r}) first")
    return latest


def asked_names(request: RunRequest, seen: ImageObservation) -> list[str]:
    """Return the objects a model is asked about; raises where one was not observed."""
    for item in request.objects:
        seen.object(item.name)
    return [item.name for item in request.objects] or list(seen.names)


def frames_of(app: App, case: Case, seen: ImageObservation) -> Frames:
    """Read the frames that were observed."""
    return load(video_file(app, case), stride=stride_of(seen))[1]


def stride_of(seen: ImageObservation) -> int:
    """Return the frames from one that was observed to the next."""
    return seen.frames[1] - seen.frames[0] if len(seen.frames) > 1 else 1


def callbacks_of(progress: Progress) -> dict[str, Any]:
    """Return what a model reports its progress to, and asks whether to stop."""
    return {
        "progress": lambda share, what: progress.report(share, 1.0, what),
        "cancelled": progress.cancelled,
    }
