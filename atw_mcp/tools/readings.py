"""Readings of rollouts: events, an object's motion, and what happens in order."""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any, Literal

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field, WithJsonSchema

from atw_mcp.calls.app import App
from atw_mcp.calls.intervals import FrameRange, Seconds, Span, chosen_span
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.names import chosen_names, object_name
from atw_mcp.calls.results import Answer, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.observation.shape_reading import EXAMPLE as READOUT_EXAMPLE
from atw_mcp.observation.shape_reading import readout_schema, shape_rows
from atw_mcp.probing import readouts
from atw_mcp.probing.ensemble_answers import trajectory_answer, trajectory_in_words
from atw_mcp.probing.ensembles import EnsembleSize, compute_ensemble, lineage
from atw_mcp.results.experimentation import Events, Shape, Timeline, Trajectory
from atw_mcp.tools.experimentation import PATIENCE, RolloutId, end_of
from atw_mcp.worlds.rollouts import (
    evidence_status,
    sample_seconds_of,
    stored_rollout,
)
from evidence_store import Case
from polyworld.trajectory import Rollout
from polyworld.world import World

GROUP = ToolGroup("world experimentation")

READOUTS = readout_schema()
Readout = Annotated[Any, WithJsonSchema(READOUTS)]
Column = Literal[
    "time", "frame", "x", "y", "z", "vx", "vy", "vz", "speed", "yaw_deg", "u", "v",
    "ax", "ay", "az", "px", "py", "pz", "kinetic_energy", "potential_energy", "energy",
]  # fmt: skip


@GROUP.tool("ReadEvents", title="Read a rollout's events", returns=Events)
def read_events(
    app: App,
    rollout: RolloutId,
    objects: Annotated[
        list[str] | None, Field(description="objects or statics that take part; default: all", max_length=64)
    ] = None,
    together: Annotated[bool, Field(description="only events of all these objects together")] = False,
    kinds: Annotated[
        list[Literal["contact_begin", "contact_end", "entry", "exit", "rest", "release"]] | None,
        Field(description="default: all; release: a fastening let go or broke", max_length=6),
    ] = None,
    interval: Seconds = None,
    frames: FrameRange = None,
    floor: Annotated[bool, Field(description="also of what stands or slides: all its touches of the floor")] = False,
    limit: Annotated[int, Field(ge=1, le=500, description="how many events to return")] = 20,
    cursor: Annotated[int, Field(ge=0, description="first event to return")] = 0,
) -> Answer:
    """Every contact beginning (with the first step's impulse and approach speed) and ending (with the whole contact's
    impulse), entry into and exit from the view,
    coming to rest, and release of a fastening, one by one, with times. ReadTimeline is the short form."""
    case, world, result, span = _read(app, rollout, interval, frames)
    statics = [s.name for s in world.statics]
    chosen = chosen_names(app, case, objects, [*result.trajectory.names, *statics])
    named = bool(readouts.floors(world) & set(objects or []))
    every = floor or named or readouts.floor_contacts_included(world, result)
    wanted = [
        event
        for event in (result.events if every else readouts.reported_events(world, result))
        if span.holds(event.time)
        and (kinds is None or event.kind in kinds)
        and (objects is None or _takes_part(set(event.participants), set(chosen), together))
    ]
    page = wanted[cursor : cursor + limit]
    rest = cursor + limit if cursor + limit < len(wanted) else None
    return Answer(
        summary=f"{len(wanted)} events between {span.start:.4g} and {span.end:.4g} s"
        + ("" if every else "; without slow touches of the floor (floor=true)")
        + diverged_in_words(result),
        data={
            "events": [readouts.event_row(event, span) for event in page],
            "of": len(wanted),
            "next_cursor": rest,
            "covers": span.shown(),
            "floor_contacts_included": every,
            "impulse_Ns": "of contact_begin: of its first step; of contact_end: of the whole contact",
        },
        case=case.id,
        world=world.id,
        rollout=rollout,
        objects=tuple(chosen),
        interval=span.seconds,
        status=evidence_status(result),
    )


@GROUP.tool("ReadTrajectory", title="Read an object's simulated motion", returns=Trajectory | Shape)
def read_trajectory(
    app: App,
    rollout: RolloutId,
    object: Annotated[str, Field(description="name of the object")],
    interval: Seconds = None,
    frames: FrameRange = None,
    limit: Annotated[int, Field(ge=2, le=500, description="most rows: every k-th sample, and the last")] = 24,
    fields: Annotated[
        list[Column] | None,
        Field(
            description="columns; default time, frame, x, y, z, speed. Also vx, vy, vz, speed [m/s], yaw_deg: heading "
            "about the vertical, u, v: pixel of the centre, ax, ay, az: acceleration [m/s^2]; of rigid objects px, py, "
            "pz: momentum [kg m/s], kinetic_energy, potential_energy (0 at z = 0), energy: their sum [J]",
            max_length=21,
        ),
    ] = None,
    readout: Annotated[
        Readout | None,
        Field(
            description="of a deformable object: what to read instead of its centre. " + READOUTS["description"],
            examples=[READOUT_EXAMPLE],
        ),
    ] = None,
    nodes: Annotated[
        list[Annotated[int, Field(ge=0)]] | None,
        Field(
            description="nodes of a rope, cloth or soft body to read; InspectWorld(fields=['nodes']) "
            "says where they start",
            min_length=1,
            max_length=64,
        ),
    ] = None,
    ensemble: EnsembleSize = None,
) -> Answer | LongWork:
    """Where one object is over time in a rollout, and how fast: its centre of mass; its acceleration, momentum, energy
    and, where it goes to and fro, its period; of ropes, cloth, soft bodies and fluids also their centreline, extent,
    tension, stretch, amount in a container, single nodes. Rows are thinned out to `limit`; the resource link leads to
    all of them. With ensemble=40 every column also comes with median and 90% interval over 40 worlds that the data
    allow, and so do path, speeds and period."""
    case, world, result, span = _read(app, rollout, interval, frames)
    name = object_name(app, case, object, list(result.trajectory.names))
    if readout is not None or nodes is not None:
        if readout is not None and nodes is not None:
            raise ToolError("give readout or nodes, not both")
        if ensemble is not None:
            raise ToolError("an ensemble is read for the centre: leave readout and nodes out, or ensemble")
        read = shape_rows(world, result, span, name, readout, nodes, limit)
        return _shape_answer(case, world, rollout, result, span, name, read, limit)
    columns = list(fields or ("time", "frame", "x", "y", "z", "speed"))
    if world.camera is None and {"u", "v"} & set(columns):
        raise ToolError(f"this world has no camera, so no pixels u, v; fields: {[*readouts.COLUMNS[:-2]]}")
    with explained():
        rows = readouts.series(world, result, name, span, columns)
    about = {**readouts.motion(result, name, span), "period": readouts.periods_of(result, name, span)}
    data = {"object": name, "columns": columns, "rows": rows, "motion": about, "covers": span.shown(), "of": len(rows)}
    if rows:
        summary = (
            f"{name} goes {about['path_length']:.3g} m between {span.start:.4g} and {span.end:.4g} s, ending "
            f"{about['displacement']:.3g} m from where it began, at {about['final_speed']:.3g} m/s"
            f"{diverged_in_words(result)}"
        )
    else:
        summary = f"{name} is not in the simulation between {span.start:.4g} and {span.end:.4g} s"
    answer = Answer(
        summary=summary,
        data=data,
        shown={**data, "rows": readouts.thinned(rows, limit)} if len(rows) > limit else None,
        case=case.id,
        world=world.id,
        rollout=rollout,
        objects=(name,),
        interval=span.seconds,
        status=evidence_status(result),
    )
    if ensemble is None:
        return answer
    lineage(app, case, world)  # refused before any work
    timed = readouts.series(world, result, name, span, ["time", "frame"])

    def work(progress: Progress) -> Answer:
        message = f"running {ensemble} members for {result.horizon:g} s"
        progress.report(0, 1, message)
        with explained():
            members = compute_ensemble(
                app,
                case,
                world,
                result.horizon,
                sample_seconds_of(app, rollout),
                ensemble,
                lambda share: progress.report(share, 1, message),
            )
            spread = trajectory_answer(members, name, span, columns, timed)
        shown = {**(answer.shown or data), "ensemble": {**spread, "rows": readouts.thinned(spread["rows"], limit)}}
        text = f"{answer.summary}. Of the ensemble, {trajectory_in_words(spread, name)}"
        return replace(answer, summary=text, data={**data, "ensemble": spread}, shown=shown)

    draft = replace(answer, summary=f"reading {ensemble} members of {world.id}", data={}, shown=None)
    key = f"trajectory {rollout} {ensemble} {name} {span.seconds} {columns} {limit}"
    return LongWork(key, work, draft, PATIENCE)


def _shape_answer(
    case: Case, world: World, rollout: str, result: Rollout, span: Span, name: str, read: dict[str, Any], limit: int
) -> Answer:
    rows = read["rows"]
    what = f"nodes {read['nodes']}" if "nodes" in read else read["readout"]["kind"]
    data = {"object": name, **read, "covers": span.shown(), "of": len(rows)}
    end = diverged_in_words(result)
    summary = f"{what} of {name}, {len(rows)} samples between {span.start:.4g} and {span.end:.4g} s{end}"
    numbers = [row[2] for row in rows]
    if numbers and all(isinstance(value, float) for value in numbers):
        summary = (
            f"{what} of {name} [{read['unit']}]: {numbers[0]:.4g} at {rows[0][0]:.4g} s, {numbers[-1]:.4g} at "
            f"{rows[-1][0]:.4g} s, between {min(numbers):.4g} and {max(numbers):.4g}{end}"
        )
    return Answer(
        summary=summary,
        data=data,
        shown={**data, "rows": readouts.thinned(rows, limit)} if len(rows) > limit else None,
        case=case.id,
        world=world.id,
        rollout=rollout,
        objects=(name,),
        interval=span.seconds,
        status=evidence_status(result),
    )


@GROUP.tool("ReadTimeline", title="Read what happens in order", returns=Timeline)
def read_timeline(
    app: App,
    rollout: RolloutId,
    objects: Annotated[
        list[str] | None, Field(description="objects or statics that take part; default: all", max_length=64)
    ] = None,
    interval: Seconds = None,
    frames: FrameRange = None,
) -> Answer:
    """List what happens in a rollout, in order: collisions (touches of one pair in quick succession count as one),
    entries into the view, exits, and objects coming to rest. Contacts with a static that last from the start on,
    and slow touches of the floor, are left out; impulse_Ns is null while they still touch."""
    case, world, result, span = _read(app, rollout, interval, frames)
    chosen = chosen_names(app, case, objects, [*result.trajectory.names, *(s.name for s in world.statics)])
    rows = readouts.timeline(world, result, span)
    if objects is not None:
        rows = [row for row in rows if set(row["objects"]) & set(chosen)]
    return Answer(
        summary=f"{span.start:.4g} to {span.end:.4g} s: {readouts.in_words(rows, most=12)}{diverged_in_words(result)}",
        data={
            "timeline": rows,
            "covers": span.shown(),
            "floor_contacts_included": readouts.floor_contacts_included(world, result),
        },
        case=case.id,
        world=world.id,
        rollout=rollout,
        objects=tuple(chosen),
        interval=span.seconds,
        status=evidence_status(result),
    )


def _read(
    app: App, rollout: str, interval: list[float] | None, frames: list[int] | None
) -> tuple[Case, World, Rollout, Span]:
    case, world, result = stored_rollout(app, rollout)
    span = chosen_span(
        interval,
        frames,
        covered=(0.0, end_of(result)),
        seconds_per_frame=world.time.seconds_per_frame,
        further="Next: Rollout with a longer horizon_seconds covers more",
    )
    return case, world, result, span


def diverged_in_words(result: Rollout) -> str:
    """Return what a summary adds where a rollout ended early, or lacks contacts."""
    ended, missing = result.why_ended(), result.why_no_contacts()
    found = "" if ended is None else f" (the rollout {ended}: nothing after that is known)"
    return found if missing is None else f"{found} ({missing})"


def _takes_part(participants: set[str], chosen: set[str], together: bool) -> bool:
    return chosen <= participants if together else bool(chosen & participants)
