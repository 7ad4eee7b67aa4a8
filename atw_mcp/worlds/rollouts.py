"""Rollouts in the store: computed once for a world and a horizon, found again by id."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, Literal

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError

from atw_mcp.calls.app import App
from atw_mcp.calls.names import case_hint
from atw_mcp.worlds.rollout_cost import cost, longest_horizon
from evidence_store import Case, Content, UnknownRecord
from polyworld.solver.core.patience import PATIENCE, TooLong
from polyworld.solver.rollout import MAX_SUBSTEPS, rollout
from polyworld.trajectory import Event, PointMotion, Rollout, Trajectory, Truncation
from polyworld.world import World

KIND = "rollout"
ENGINE = 3  # raise when the engine's results change: stored rollouts then no longer answer for new ones
MAX_SAMPLES = 20_000  # frames in one rollout
MANY_POINTS = 4_000  # of one object
ROUNDED = 1e-5  # a frame's time as people write it, such as 0.033333

SERIES = ("times", "positions", "orientations", "velocities", "angular_velocities", "active")


def checked_horizon(world: World, seconds: float | None, sample: float | None = None) -> float:
    """The horizon to roll out to [s]: as asked, else the observed stretch; raises ToolError when it cannot be.

    sample: seconds between samples, at most a frame; default: a frame.
    """
    frame = world.time.seconds_per_frame
    step = frame if sample is None else sample
    if not 0.0 < step <= frame * (1.0 + ROUNDED):
        raise ToolError(f"sample_seconds must be above 0 and at most a frame ({frame:g} s), got {step:g}")
    longest = min(MAX_SAMPLES * step, MAX_SUBSTEPS * min(world.time.substep, step))
    longest = min(longest, longest_horizon(world) * step / frame)
    if seconds is None:
        if world.time.frame_count < 2:
            raise ToolError(
                "this world has no observed frames, so horizon_seconds must be given: "
                f"any value above 0 up to {longest:g} s"
            )
        seconds = (world.time.frame_count - 1) * frame
    if not (math.isfinite(seconds) and 0 < seconds <= longest):
        raise ToolError(
            f"horizon_seconds must be above 0 and at most {longest:.6g} s ({int(longest / frame)} frames of "
            f"{frame:g} s in steps of {world.time.substep:g} s{_crowd(world)}"
            + (f", with sample_seconds={step:g}: a longer one allows more" if sample is not None else "")
            + f"), got {seconds:g}"
        )
    return seconds


def _crowd(world: World) -> str:
    """How many points limit the horizon, where they do."""
    if not np.isfinite(longest_horizon(world)):
        return ""
    points = sum(cost(world, world.time.seconds_per_frame).points.values())
    return f", with {points} points and particles in each; a coarser grid or mesh, or longer frames, allow more"


def find_rollout(app: App, world: World, horizon: float, sample: float | None = None) -> tuple[str, Rollout] | None:
    """Return the stored rollout of a world and its id, if it was computed before."""
    found = app.store.rollouts.find(KIND, _inputs(app, world, horizon, sample))
    return None if found is None else (found.id, _from_content(found))


def compute_rollout(
    app: App,
    world: World,
    horizon: float,
    progress: Callable[[float], None] | None = None,
    sample: float | None = None,
) -> tuple[str, Rollout]:
    """Roll a world out, or find it rolled out before; returns its id too. Raises ValueError where it cannot be run.

    progress: called with the share done; what it raises ends the run. sample: seconds between samples, default a frame.
    """
    limit = app.limits.rollout_seconds

    def compute() -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
        return content_of(rollout(world, horizon, sample_interval=sample, progress=progress, patience=limit))

    try:
        content, _ = app.store.rollouts.get_or_compute(KIND, _inputs(app, world, horizon, sample), compute)
    except TooLong as error:
        raise ValueError(str(error).replace("(patience)", "(rollout_seconds) of this server")) from error
    except RuntimeError as error:  # more contacts at once than there is room for
        raise ValueError(f"the rollout could not be finished: {error}") from error
    return content.id, _from_content(content)


def stored_rollout(app: App, identifier: str) -> tuple[Case, World, Rollout]:
    """A rollout by its id, with its world and the case it was made for; raises ToolError for an unknown id."""
    try:
        result = _from_content(app.store.rollouts.get(identifier))
    except UnknownRecord as error:
        made = app.store.evidence.rollouts(20)
        known = f"rollouts, the latest first: {made}" if made else "there are none yet"
        raise ToolError(
            f"{error}; {known}. Next: Rollout(case={case_hint(app)}) makes one and returns its id"
        ) from error
    cases = [c for c in app.store.cases.all() if app.store.cases.has_world(c.id, result.world_id)]
    if not cases:
        raise ToolError(f"{identifier} belongs to no case of this store. Next: Rollout(case={case_hint(app)})")

    def last_use(case: Case) -> int:
        used = app.store.evidence.last_about(case.id, identifier)
        return 0 if used is None else int(used.removeprefix("ev-"))

    # The same file opened under two names gives two cases with equal worlds: the one that asked last is meant.
    case = max(cases, key=last_use)
    return case, app.world(case, result.world_id), result


def sample_seconds_of(app: App, identifier: str) -> float | None:
    """The time between samples that a stored rollout was asked for [s]; None for a frame."""
    found: float | None = app.store.rollouts.get(identifier).inputs.get("sample_seconds")
    return found


def _inputs(app: App, world: World, horizon: float, sample: float | None) -> dict[str, Any]:
    inputs = {"world": world.id, "horizon": horizon, "engine": ENGINE}
    if app.limits.rollout_seconds != PATIENCE:  # one that ended at another limit is not the answer
        inputs["patience"] = app.limits.rollout_seconds
    if sample is None or sample == world.time.seconds_per_frame:
        return inputs
    return {**inputs, "sample_seconds": sample}


def evidence_status(result: Rollout) -> Literal["completed", "diverged"]:
    """Return a rollout's status in evidence, where `diverged` is any run that ended before its horizon."""
    return "completed" if result.status == "completed" else "diverged"


def content_of(result: Rollout) -> tuple[dict[str, Any], dict[str, np.ndarray[Any, Any]]]:
    """JSON part and arrays of a rollout, as the store keeps them."""
    document = {
        "world": result.world_id,
        "horizon": result.horizon,
        "names": list(result.trajectory.names),
        "events": [event.to_dict() for event in result.events],
        "status": result.status,
        "diverged_time": result.diverged_time,
        "diverged_object": result.diverged_object,
        "diverged_element": result.diverged_element,
        "diverged_reason": result.diverged_reason,
        "truncated": None if result.truncated is None else asdict(result.truncated),
        "contacts_until": result.contacts_until,
    }
    arrays = {name: getattr(result.trajectory, name) for name in SERIES}
    for name, motion in result.trajectory.deformables.items():
        # Single precision is a ten millionth of the scene; velocities of many particles need no more than half.
        many = motion.points.shape[-2] > MANY_POINTS
        arrays[f"points/{name}"] = motion.points.astype(np.float32)
        arrays[f"velocities/{name}"] = motion.velocities.astype(np.float16 if many else np.float32)
        for quantity, values in motion.quantities.items():
            arrays[f"quantities/{name}/{quantity}"] = values.astype(np.float32)
    return document, arrays


def _from_content(content: Content) -> Rollout:
    return rollout_from(content.document, content.arrays)


def rollout_from(document: Mapping[str, Any], arrays: Mapping[str, np.ndarray[Any, Any]]) -> Rollout:
    """The rollout that `content_of` took apart."""
    return Rollout(
        world_id=document["world"],
        horizon=document["horizon"],
        trajectory=Trajectory(
            names=tuple(document["names"]),
            times=arrays["times"],
            positions=arrays["positions"],
            orientations=arrays["orientations"],
            velocities=arrays["velocities"],
            angular_velocities=arrays["angular_velocities"],
            active=arrays["active"],
            deformables=_motions(arrays),
        ),
        events=tuple(_event(item) for item in document["events"]),
        status=document["status"],
        diverged_time=document["diverged_time"],
        diverged_object=document["diverged_object"],
        diverged_element=document.get("diverged_element"),
        diverged_reason=document.get("diverged_reason"),
        truncated=None if document.get("truncated") is None else Truncation(**document["truncated"]),
        contacts_until=document.get("contacts_until"),
    )


def _motions(arrays: Mapping[str, np.ndarray[Any, Any]]) -> dict[str, PointMotion]:
    """Points of the deformable objects by name, as `content_of` keeps them."""
    found = {}
    for name in [key.split("/")[1] for key in arrays if key.startswith("points/")]:
        first = f"quantities/{name}/"
        quantities = {k[len(first) :]: v.astype(np.float64) for k, v in arrays.items() if k.startswith(first)}
        points, velocities = (arrays[f"{kind}/{name}"].astype(np.float64) for kind in ("points", "velocities"))
        found[name] = PointMotion(points, velocities, quantities)
    return found


def _event(item: dict[str, Any]) -> Event:
    place = item["position"]
    return Event(
        kind=item["kind"],
        time=item["time"],
        participants=tuple(item["participants"]),
        position=None if place is None else (place[0], place[1], place[2]),
        impulse=item["impulse"],
        speed=item["speed"],
    )
