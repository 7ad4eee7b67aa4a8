"""Look at rollouts, over the frames that they should follow or beside a rollout without edits."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.intervals import Seconds, chosen_span
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.names import chosen_names
from atw_mcp.calls.results import Answer, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.looking.overlay import encoded
from atw_mcp.looking.picture_rows import EVERY_FRAME, simulated_rows
from atw_mcp.probing.branch_difference import BranchDifference, Instant, Side
from atw_mcp.probing.branch_view import BranchView
from atw_mcp.probing.rollout_view import RolloutView
from atw_mcp.results.looking import SimulatedFrames
from atw_mcp.tools.looking import PATIENCE, CaseId, Objects, Pictures, chosen_frames
from atw_mcp.worlds.rollout_cost import size_in_words
from atw_mcp.worlds.rollouts import (
    checked_horizon,
    compute_rollout,
    evidence_status,
    find_rollout,
    sample_seconds_of,
    stored_rollout,
)
from atw_mcp.worlds.sizes import check_sizes
from evidence_store import Case
from polyworld.trajectory import Rollout
from polyworld.world import World

GROUP = ToolGroup("world inspection")


@GROUP.tool("InspectRollout", title="Look at a rollout", pictures=True, viewer=True, returns=SimulatedFrames)
def inspect_rollout(
    app: App,
    case: CaseId,
    rollout: Annotated[str | None, Field(description="rollout id; default: the world below, over the video")] = None,
    world: Annotated[str | None, Field(description="world id; default: the committed, else the latest")] = None,
    frames: Annotated[
        list[Annotated[int, Field(ge=0)]] | None,
        Field(description="frame numbers; default: spread over the interval", min_length=1, max_length=12),
    ] = None,
    interval: Seconds = None,
    objects: Objects = None,
    pictures: Pictures = 6,
    background: Annotated[
        Literal["auto", "video", "rendered"],
        Field(
            description="video: real frames; rendered: the simulated world. auto: video "
            "where the world should follow it, rendered for branches and beyond the video"
        ),
    ] = "auto",
) -> Answer | LongWork:
    """See whether a world, draft or committed, follows the video: simulated objects outlined in magenta over the real
    frames, observed ones dashed in white, beside each the plan, to scale: what touches and what is only behind; and
    where and when it is off. A branch is shown beside its base when they differ most and events are gone or new. The
    text has the distances of each object."""
    found = app.case(case)
    if rollout is not None and world is not None:
        raise ToolError("give rollout or world, not both: a rollout belongs to its world")

    asked = (frames, interval, objects, pictures, background)

    def answer(identifier: str, shown: World, result: Rollout) -> Answer | LongWork:
        wanted, seen = _Wanted(*asked), Side(identifier, shown, result)
        base = None if background == "video" else _base_world(app, found, shown)
        if base is None:
            return _rollout_pictures(app, found, wanted, seen, given=rollout)
        sample = sample_seconds_of(app, identifier)

        def beside(progress: Callable[[float], None] | None = None) -> Answer:
            with explained("background='video' shows the branch without its base"):
                made = compute_rollout(app, base, result.horizon, progress, sample)
            return _branch_pictures(app, found, wanted, BranchDifference(Side(made[0], base, made[1]), seen), rollout)

        if shown.coupled and find_rollout(app, base, result.horizon, sample) is None:
            message = f"running {base.id}, the base, for {result.horizon:g} s{size_in_words(base, result.horizon)}"

            def work(progress: Progress) -> Answer:
                return beside(lambda share: progress.report(share, 1, message))

            draft = Answer(summary=message, data={}, case=found.id, world=shown.id, objects=shown.moving_names)
            return LongWork(f"pictures of {identifier} beside its base {asked!r}", work, draft, PATIENCE)
        return beside()

    if rollout is not None:
        of_case, shown_world, result = stored_rollout(app, rollout)
        if of_case.content != found.content:
            raise ToolError(f"{rollout} belongs to case {of_case.id!r}, not to {found.id!r}")
        return answer(rollout, shown_world, result)
    shown_world = app.world(found, world)
    with explained():
        check_sizes(shown_world, app.limits)
        horizon = checked_horizon(shown_world, _unobserved_horizon(shown_world, interval, frames))
        check_sizes(shown_world, app.limits, horizon)
    known = find_rollout(app, shown_world, horizon)
    if known is None and not shown_world.coupled:  # such worlds take no longer than their pictures
        with explained():
            known = compute_rollout(app, shown_world, horizon)
    if known is not None:
        return answer(known[0], shown_world, known[1])
    message = f"running {shown_world.id} for {horizon:g} s{size_in_words(shown_world, horizon)}"

    def work(progress: Progress) -> Answer:
        with explained():
            made = compute_rollout(app, shown_world, horizon, lambda share: progress.report(share, 1, message))
        outcome = answer(made[0], shown_world, made[1])
        return outcome.work(progress) if isinstance(outcome, LongWork) else outcome

    draft = Answer(summary=message, data={}, case=found.id, world=shown_world.id, objects=shown_world.moving_names)
    return LongWork(f"pictures of {shown_world.id} {horizon!r} {asked!r}", work, draft, PATIENCE)


@dataclass(frozen=True)
class _Wanted:
    """Which pictures of a rollout were asked for."""

    frames: list[int] | None
    interval: list[float] | None
    objects: list[str] | None
    pictures: int
    background: str


def _base_world(app: App, case: Case, world: World) -> World | None:
    """The world that a branch was made from; None where it is no branch."""
    parents = [d.parent for d in app.store.worlds.parents(world.id) if d.how == "intervention"]
    return app.world(case, parents[-1]) if parents else None


def _branch_pictures(app: App, found: Case, wanted: _Wanted, difference: BranchDifference, given: str | None) -> Answer:
    branch, frame_time = difference.branch, difference.frame_time
    further = _further(found, branch.world, given)
    last_frame = int(np.floor(difference.end / frame_time + 1e-6))
    span = chosen_span(
        wanted.interval,
        None,
        covered=(0.0, last_frame * frame_time),
        seconds_per_frame=frame_time,
        further=further,
    )
    names = chosen_names(app, found, wanted.objects, list(difference.names))
    first = int(np.ceil(span.start / frame_time - 1e-6))
    last = int(np.floor(span.end / frame_time + 1e-6))
    if wanted.frames is None:
        instants = difference.instants(names, wanted.pictures, first, last)
    else:
        frames = chosen_frames(wanted.frames, wanted.pictures, first, last, "the rollout", further)
        instants = [Instant(frame, ()) for frame in frames]
    view = BranchView(difference, names)
    drawn, rows = view.draw(instants)
    facts = {
        "rollout": branch.id,
        "world": branch.world.id,
        "branch": True,
        "base": difference.base.id,
        "legend": view.legend(),
        "camera": "the calibrated one" if branch.world.camera is not None else "a view from above and the side",
        "seconds_per_frame": frame_time,
    }
    moments = "; ".join(f"{row['time']:.4g} s" + f" ({', '.join(row['why'])})" * bool(row["why"]) for row in rows)
    summary = f"{branch.id}: a branch beside its base {difference.base.id} at {moments}"
    if difference.comparison is None:
        summary += ". Events of one of them were not recorded, so none is marked as gone or new"
    return Answer(
        summary=summary,
        data={**facts, "frames": rows, "error": None},
        shown={
            **facts,
            "why": ["; ".join(row["why"]) for row in rows],
            **simulated_rows(rows, None, {}),
            "every_frame": EVERY_FRAME,
        },
        case=found.id,
        world=branch.world.id,
        rollout=branch.id,
        objects=tuple(names),
        interval=span.seconds,
        status=evidence_status(branch.result),
        pictures=encoded(drawn)[0],
    )


def _rollout_pictures(app: App, found: Case, wanted: _Wanted, seen: Side, given: str | None) -> Answer:
    identifier, shown_world, result = seen.id, seen.world, seen.result
    view = RolloutView(app, found, shown_world, result, wanted.background)
    further = _further(found, shown_world, given)
    span = chosen_span(
        wanted.interval,
        None,
        covered=(0.0, view.last_frame * view.frame_time),
        seconds_per_frame=view.frame_time,
        further=further,
    )
    names = chosen_names(app, found, wanted.objects, list(result.trajectory.names))
    first = int(np.ceil(span.start / view.frame_time - 1e-6))
    last = int(np.floor(span.end / view.frame_time + 1e-6))
    chosen = chosen_frames(wanted.frames, wanted.pictures, first, last, "the rollout", further)
    drawn, rows = view.draw(chosen, names)
    fit = view.accuracy()
    facts = {
        "rollout": identifier,
        "world": shown_world.id,
        "branch": not view.follows,
        "legend": view.legend(names),
        "camera": "the calibrated one" if shown_world.camera is not None else "a view from above and the side",
        "seconds_per_frame": view.frame_time,
    }
    return Answer(
        summary=_rollout_summary(identifier, view, rows, fit),
        data={**facts, "frames": rows, "error": fit},
        shown={**facts, **simulated_rows(rows, fit, view.worst_errors()), "every_frame": EVERY_FRAME},
        case=found.id,
        world=shown_world.id,
        rollout=identifier,
        observation=view.record.id if view.record is not None else None,
        objects=tuple(names),
        interval=span.seconds,
        status=evidence_status(result),
        pictures=encoded(drawn)[0],
    )


def _unobserved_horizon(world: World, interval: list[float] | None, frames: list[int] | None) -> float | None:
    """How far to run a world that models no frames; None for one that does: its frames say how far."""
    if world.time.frame_count >= 2:
        return None
    if interval is None and not frames:
        raise ToolError("this world models no frames: give interval=[0, SECONDS] or frames to say how far to run it")
    return interval[1] if interval is not None else max(frames or [1]) * world.time.seconds_per_frame


def _further(case: Case, world: World, rollout: str | None) -> str:
    """How to see a world beyond the time that is covered."""
    longer = f"Rollout(case={case.id!r}, horizon_seconds=...)"
    if rollout is not None:
        return f"Next: {longer} with a longer horizon covers more"
    if world.time.frame_count < 2:
        return "A longer interval covers more"
    if case.committed_world is None:
        return (
            f"Drafts are shown over the observed frames only. Next: CommitWorld(case={case.id!r}, "
            f"world={world.id!r}), then {longer}, then InspectRollout with its rollout id"
        )
    return (
        f"Without a rollout id, worlds are shown over the observed frames only. Next: {longer}, then InspectRollout "
        "with its rollout id"
    )


def _rollout_summary(identifier: str, view: RolloutView, rows: list[dict[str, Any]], fit: dict[str, Any] | None) -> str:
    summary = f"{identifier}: {len(rows)} pictures"
    if not view.follows:
        return summary + " of a branch; it is meant to differ from the video, so no error is given"
    if fit is None or fit["position_rmse"] is None:
        return summary + "; nothing observed to compare with"
    each = ", ".join(
        f"{name} {value:.3g}" for name, value in fit["position_rmse_by_object"].items() if value is not None
    )
    return summary + f"; distance to the observed positions {fit['position_rmse']:.3g} m rms ({each})"
