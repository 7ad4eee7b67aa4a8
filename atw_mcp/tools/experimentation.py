"""World experimentation: run the committed world, or a changed copy of it, and read what happened."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Annotated, Any, Literal

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field, WithJsonSchema

from atw_mcp import readouts
from atw_mcp.app import App
from atw_mcp.flat_unions import flat_schema
from atw_mcp.forms import read_form, tagged
from atw_mcp.intervals import FrameRange, Seconds, Span, chosen_span
from atw_mcp.jobs import LongWork, Progress
from atw_mcp.names import chosen_names, object_name, with_own_names
from atw_mcp.results import Answer, explained
from atw_mcp.rollout_cost import cost, size_in_words
from atw_mcp.rollouts import checked_horizon, compute_rollout, find_rollout, stored_rollout
from atw_mcp.shape_reading import EXAMPLE as READOUT_EXAMPLE
from atw_mcp.shape_reading import readout_schema, shape_rows
from atw_mcp.toolbox import ToolGroup
from evidence_store import Case
from polyworld.compare import compare
from polyworld.interventions import Add, Intervention, branch
from polyworld.predicates import Predicate, names_in
from polyworld.query import Aggregation, QueryResult, query, sampled_every
from polyworld.trajectory import Rollout
from polyworld.world import World

GROUP = ToolGroup("world experimentation")

CaseId = Annotated[str, Field(description="case id, as OpenCase returned it")]
RolloutId = Annotated[str, Field(description="rollout id, as Rollout returned it", pattern=r"^rollout-[0-9a-f]+$")]
Objects = Annotated[list[str] | None, Field(description="names of objects; default: all", max_length=64)]
# Checked after names have been replaced, so that a name of a binding may be any text.
Edit = Annotated[Any, WithJsonSchema(flat_schema(Intervention, "action"))]
READOUTS = readout_schema()
Readout = Annotated[Any, WithJsonSchema(READOUTS)]
STATEMENTS = flat_schema(Predicate, "predicate")
Statement = Annotated[Any, WithJsonSchema(STATEMENTS)]
EDIT_EXAMPLE = {"action": "remove", "object": "red"}
STATEMENT_EXAMPLE = {"predicate": "collides", "a": "red", "b": "blue"}
PATIENCE = 40.0  # [s]


@GROUP.tool("Rollout", title="Run a world forward", read_only=False)
def roll_out(
    app: App,
    case: CaseId,
    edits: Annotated[
        list[Edit] | None,
        Field(
            description="changes made before the start, in order; all that was fitted is kept. Default: none, which "
            "continues the world as it was observed",
            max_length=32,
        ),
    ] = None,
    horizon_seconds: Annotated[
        float | None, Field(description="how far to run, from time 0 [s]; default: to the last observed frame", gt=0)
    ] = None,
    horizon_frames: Annotated[int | None, Field(description="the same in frames, instead of seconds", gt=0)] = None,
    world: Annotated[
        str, Field(description="'committed', or the id of a branch that an earlier Rollout made, to edit further")
    ] = "committed",
    sample_seconds: Annotated[
        float | None,
        Field(
            description="time between samples [s], finer than a frame for sharper thresholds; default: a frame", gt=0
        ),
    ] = None,
) -> Answer | LongWork:
    """Run the committed world forward from time 0 and return a rollout id for ReadEvents, ReadTrajectory, ReadTimeline,
    QueryWorld, CompareWorlds and InspectRollout.

    Without edits it replays the observed stretch and, with a horizon beyond it, predicts what comes next. With edits
    it runs a branch in which they hold from the beginning. The same request is never computed twice.
    """
    found, committed = app.case_to_probe(case, "Rollout", None if world == "committed" else world)
    base = committed if world == "committed" else app.world(found, world)
    wanted = _edits(app, found, base, edits or [])
    with explained(f"InspectWorld(case={found.id!r}, world={base.id!r}) lists objects, statics and effects"):
        branched = branch(base, wanted)
    if horizon_seconds is not None and horizon_frames is not None:
        raise ToolError("give horizon_seconds or horizon_frames, not both")
    if horizon_frames is not None:
        horizon_seconds = horizon_frames * branched.time.seconds_per_frame
    horizon = checked_horizon(branched, horizon_seconds, sample_seconds)
    edited = [edit.model_dump(mode="json", exclude_none=True) for edit in wanted]
    if branched.id != base.id:
        app.keep_world(found, branched, how="intervention", parent=base, detail={"edits": edited})
    known = find_rollout(app, branched, horizon, sample_seconds)
    if known is not None:
        return _rollout_answer(found, base, branched, edited, *known)

    size = size_in_words(branched, horizon)

    def work(progress: Progress) -> Answer:
        message = f"running {len(branched.moving_names)} objects for {horizon:g} s{size}"
        progress.report(0, 1, message)
        with explained():
            found_or_made = compute_rollout(
                app, branched, horizon, lambda share: progress.report(share, 1, message), sample_seconds
            )
            return _rollout_answer(found, base, branched, edited, *found_or_made)

    draft = Answer(
        summary=f"running {branched.id} for {horizon:g} s{size}",
        data={},
        case=found.id,
        world=branched.id,
        objects=branched.moving_names,
        interval=(0.0, horizon),
    )
    return LongWork(f"rollout {branched.id} {horizon!r} {sample_seconds!r}", work, draft, PATIENCE)


def _edits(app: App, case: Case, base: World, given: list[Any]) -> list[Intervention]:
    """Edits of `base` as exact types; what one adds, the later ones may name."""
    wanted: list[Intervention] = []
    added: set[str] = set()
    for number, item in enumerate(given, start=1):
        what = f"edit {number}"
        edit = tagged(item, Intervention, "action", what=what, example=EDIT_EXAMPLE)
        read = read_form(with_own_names(app, case, base, edit, added), Intervention, "action", what=what)
        if isinstance(read, Add):
            parts = (read.object, read.static, read.deformable)
            added |= {part.name for part in parts if part is not None}
        wanted.append(read)
    return wanted


def _told(rows: list[dict[str, Any]], observed: float, span: Span) -> str:
    """The timeline in words: what lies beyond the observed frames first, since it is what was asked for."""
    if not 0.0 < observed < span.end - 1e-6 * span.seconds_per_frame:
        return readouts.told(rows)
    beyond = [row for row in rows if row["time"] > observed]
    within = [row for row in rows if row["time"] <= observed]
    return (
        f"after the last observed frame ({observed:.4g} s) {readouts.told(beyond, most=12)}. "
        f"Before it {readouts.told(within)}"
    )


def _rollout_answer(
    case: Case, base: World, world: World, edits: list[dict[str, Any]], identifier: str, result: Rollout
) -> Answer:
    span = Span(0.0, _end(result), world.time.seconds_per_frame)
    rows = readouts.timeline(world, result, span)
    what = "the committed world" if not edits else f"a branch with {len(edits)} edit{'s' * (len(edits) > 1)}"
    observed = (world.time.frame_count - 1) * world.time.seconds_per_frame
    summary = f"{identifier}: {what}, 0 to {span.end:.4g} s: {_told(rows, observed, span)}"
    if result.status == "diverged":
        summary = (
            f"{identifier} DIVERGED at {result.diverged_time:.4g} s ({_where(result)}): valid only before. " + summary
        )
    return Answer(
        summary=summary,
        data={
            "rollout": identifier,
            "world": world.id,
            "base_world": base.id,
            "edits": edits,
            "horizon": span.shown(),
            "sampled_every_s": sampled_every(result.trajectory),
            **({"points": cost(world, result.horizon).points} if world.deformables else {}),
            "observed_until": {"seconds": observed, "frame": world.time.frame_count - 1} if observed > 0 else None,
            "diverged": None
            if result.status == "completed"
            else {
                "time": result.diverged_time,
                "object": result.diverged_object,
                "element": result.diverged_element,
            },
            "timeline": rows,
            "floor_contacts_included": readouts.floor_contacts_included(world, result),
            "objects": [readouts.motion(result, name, span) for name in result.trajectory.names],
        },
        case=case.id,
        world=world.id,
        rollout=identifier,
        objects=result.trajectory.names,
        interval=span.seconds,
        status=result.status,
    )


def _where(result: Rollout) -> str:
    """The object, and the node of it, that a rollout diverged at."""
    if result.diverged_object not in result.trajectory.deformables or result.diverged_element is None:
        return str(result.diverged_object)
    return f"{result.diverged_object}, node {result.diverged_element}"


@GROUP.tool("ReadEvents", title="Read a rollout's events")
def read_events(
    app: App,
    rollout: RolloutId,
    objects: Annotated[
        list[str] | None, Field(description="objects or statics that take part; default: all", max_length=64)
    ] = None,
    together: Annotated[
        bool, Field(description="only events that all the given objects take part in, such as their collisions")
    ] = False,
    kinds: Annotated[
        list[Literal["contact_begin", "contact_end", "entry", "exit", "rest", "release"]] | None,
        Field(description="kinds of events; release: a fastening let go or broke. Default: all", max_length=6),
    ] = None,
    interval: Seconds = None,
    frames: FrameRange = None,
    floor: Annotated[bool, Field(description="also touches of the floor that everything stands on")] = False,
    limit: Annotated[int, Field(ge=1, le=500, description="how many events to return")] = 100,
    cursor: Annotated[int, Field(ge=0, description="first event to return")] = 0,
) -> Answer:
    """Every contact beginning (with the first step's impulse and approach speed) and ending (with the whole contact's
    impulse), entry into and exit from the view,
    coming to rest, and release of a fastening, one by one, with times. ReadTimeline is the short form."""
    case, world, result, span = _read(app, rollout, interval, frames)
    statics = [s.name for s in world.statics]
    chosen = chosen_names(app, case, objects, [*result.trajectory.names, *statics])
    skipped = set() if floor else readouts.floors(world) - set(objects or [])
    wanted = [
        event
        for event in result.events
        if span.holds(event.time)
        and (kinds is None or event.kind in kinds)
        and not set(event.participants) & skipped
        and (objects is None or _takes_part(set(event.participants), set(chosen), together))
    ]
    page = wanted[cursor : cursor + limit]
    rest = cursor + limit if cursor + limit < len(wanted) else None
    return Answer(
        summary=f"{len(wanted)} events between {span.start:.4g} and {span.end:.4g} s{_diverged(result)}",
        data={
            "events": [readouts.event_row(event, span) for event in page],
            "of": len(wanted),
            "next_cursor": rest,
            "covers": span.shown(),
            "floor_contacts_included": not skipped,
            "impulse_Ns": "of contact_begin: of its first step; of contact_end: of the whole contact",
        },
        case=case.id,
        world=world.id,
        rollout=rollout,
        objects=tuple(chosen),
        interval=span.seconds,
        status=result.status,
    )


@GROUP.tool("ReadTrajectory", title="Read an object's simulated motion")
def read_trajectory(
    app: App,
    rollout: RolloutId,
    object: Annotated[str, Field(description="name of the object")],
    interval: Seconds = None,
    frames: FrameRange = None,
    limit: Annotated[int, Field(ge=2, le=500, description="rows shown at most: every k-th sample, and the last")] = 24,
    fields: Annotated[
        list[Literal["time", "frame", "x", "y", "z", "vx", "vy", "vz", "speed", "yaw_deg", "u", "v"]] | None,
        Field(
            description="columns; x, y, z [m], vx, vy, vz, speed [m/s], yaw_deg: heading about the vertical, "
            "u, v: pixel of the centre. Default: time, frame, x, y, z, speed",
            max_length=12,
        ),
    ] = None,
    readout: Annotated[
        Readout | None,
        Field(
            description="of a rope, cloth, soft body or fluid: what to read instead of its centre, e.g. "
            f"{json.dumps(READOUT_EXAMPLE)}. {READOUTS['description']}"
        ),
    ] = None,
    nodes: Annotated[
        list[Annotated[int, Field(ge=0)]] | None,
        Field(
            description="of a rope, cloth or soft body: nodes whose places to read; InspectWorld(fields=['nodes']) "
            "tells where they start",
            min_length=1,
            max_length=64,
        ),
    ] = None,
) -> Answer:
    """Where one object is over time in a rollout, and how fast: its centre of mass; of ropes, cloth, soft bodies and
    fluids also their centreline, extent, tension, stretch, amount in a container, single nodes. Rows are thinned out
    to `limit`; the resource link leads to all of them."""
    case, world, result, span = _read(app, rollout, interval, frames)
    name = object_name(app, case, object, list(result.trajectory.names))
    if readout is not None or nodes is not None:
        if readout is not None and nodes is not None:
            raise ToolError("give readout or nodes, not both")
        read = shape_rows(world, result, span, name, readout, nodes, limit)
        return _shape_answer(case, world, rollout, result, span, name, read, limit)
    columns = list(fields or ("time", "frame", "x", "y", "z", "speed"))
    if world.camera is None and {"u", "v"} & set(columns):
        raise ToolError(f"this world has no camera, so no pixels u, v; fields: {[*readouts.COLUMNS[:-2]]}")
    rows = readouts.series(world, result, name, span, columns)
    about = readouts.motion(result, name, span)
    data = {"object": name, "columns": columns, "rows": rows, "motion": about, "covers": span.shown(), "of": len(rows)}
    if rows:
        summary = (
            f"{name} goes {about['path_length']:.3g} m between {span.start:.4g} and {span.end:.4g} s, ending "
            f"{about['displacement']:.3g} m from where it began, at {about['final_speed']:.3g} m/s{_diverged(result)}"
        )
    else:
        summary = f"{name} is not in the simulation between {span.start:.4g} and {span.end:.4g} s"
    return Answer(
        summary=summary,
        data=data,
        shown={**data, "rows": readouts.thinned(rows, limit)} if len(rows) > limit else None,
        case=case.id,
        world=world.id,
        rollout=rollout,
        objects=(name,),
        interval=span.seconds,
        status=result.status,
    )


def _shape_answer(
    case: Case, world: World, rollout: str, result: Rollout, span: Span, name: str, read: dict[str, Any], limit: int
) -> Answer:
    rows = read["rows"]
    what = f"nodes {read['nodes']}" if "nodes" in read else read["readout"]["kind"]
    data = {"object": name, **read, "covers": span.shown(), "of": len(rows)}
    summary = f"{what} of {name}, {len(rows)} samples between {span.start:.4g} and {span.end:.4g} s{_diverged(result)}"
    numbers = [row[2] for row in rows]
    if numbers and all(isinstance(value, float) for value in numbers):
        summary = (
            f"{what} of {name} [{read['unit']}]: {numbers[0]:.4g} at {rows[0][0]:.4g} s, {numbers[-1]:.4g} at "
            f"{rows[-1][0]:.4g} s, between {min(numbers):.4g} and {max(numbers):.4g}{_diverged(result)}"
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
        status=result.status,
    )


@GROUP.tool("ReadTimeline", title="Read what happens in order")
def read_timeline(
    app: App,
    rollout: RolloutId,
    objects: Annotated[
        list[str] | None, Field(description="objects or statics that take part; default: all", max_length=64)
    ] = None,
    interval: Seconds = None,
    frames: FrameRange = None,
) -> Answer:
    """What happens in a rollout, in order: collisions (touches of one pair in quick succession count as one),
    entries into the view, exits, and objects coming to rest. What stands on the floor or on another static from the
    start, and slow touches of the floor, are left out; impulse_Ns is null while they still touch."""
    case, world, result, span = _read(app, rollout, interval, frames)
    chosen = chosen_names(app, case, objects, [*result.trajectory.names, *(s.name for s in world.statics)])
    rows = readouts.timeline(world, result, span)
    if objects is not None:
        rows = [row for row in rows if set(row["objects"]) & set(chosen)]
    return Answer(
        summary=f"{span.start:.4g} to {span.end:.4g} s: {readouts.told(rows, most=12)}{_diverged(result)}",
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
        status=result.status,
    )


@GROUP.tool("QueryWorld", title="Ask whether something holds")
def query_world(
    app: App,
    rollout: RolloutId,
    predicate: Annotated[
        Statement,
        Field(description=f"what to decide, e.g. {json.dumps(STATEMENT_EXAMPLE)}. " + STATEMENTS["description"]),
    ],
    aggregation: Annotated[
        Aggregation,
        Field(
            description="any: ever; all: throughout; first, last: when; count: how often; fraction: share of the time"
        ),
    ] = "any",
    interval: Annotated[
        list[float] | None,
        Field(
            description="[start, end] in seconds; default: from when all the objects named take part to the end",
            min_length=2,
            max_length=2,
        ),
    ] = None,
    frames: FrameRange = None,
) -> Answer:
    """Decide a statement over a stretch of a rollout: true, false (or a time, a count, a share), or unknown with the
    reason. Unknown means that the rollout does not cover what is asked; it never means false. Of collides, in_contact
    and nearer_than it also tells the closest approach of the two surfaces: how narrow it was. Contacts are exact; the
    rest is judged on samples, sampled_every_s apart: Rollout with a smaller sample_seconds judges it finer."""
    case, world, result = stored_rollout(app, rollout)
    frame = world.time.seconds_per_frame
    if interval is not None and frames is not None:
        raise ToolError("give interval (seconds) or frames, not both")
    asked = interval if interval is not None else None if frames is None else [frames[0] * frame, frames[1] * frame]
    statement = tagged(predicate, Predicate, "predicate", what="predicate", example=STATEMENT_EXAMPLE)
    asked_of = read_form(with_own_names(app, case, world, statement), Predicate, "predicate", what="predicate")
    with explained():
        answer = query(result, world, asked_of, None if asked is None else (asked[0], asked[1]), aggregation)
    span = Span(*(answer.covered or (0.0, _end(result))), frame)
    verdict = "unknown" if not answer.decided else "never" if answer.value is None else answer.value
    if isinstance(verdict, bool):
        verdict = "true" if verdict else "false"
    shown_value = f"{verdict:.5g} s" if aggregation in ("first", "last") and isinstance(verdict, float) else verdict
    why = f": {answer.reason}" if answer.reason else ""
    spoken = " ".join([asked_of.predicate, *names_in(asked_of)])
    return Answer(
        summary=f"{spoken} ({aggregation}, {span.start:.4g} to {span.end:.4g} s{_joining(world, asked_of, asked)}): "
        f"{shown_value}{why}{_how_near(answer)}"
        + (f" (samples every {answer.sampled_every:.3g} s)" if answer.sampled_every is not None else "")
        + _diverged(result),
        data={
            "verdict": verdict,
            **answer.to_dict(),
            "predicate": asked_of.model_dump(mode="json", exclude_none=True),
            "aggregation": aggregation,
            "covers": None if answer.covered is None else span.shown(),
        },
        case=case.id,
        world=world.id,
        rollout=rollout,
        objects=tuple(names_in(asked_of)),
        interval=answer.covered,
        status=result.status,
    )


def _joining(world: World, predicate: Predicate, asked: list[float] | None) -> str:
    """Why a default stretch does not begin at 0."""
    starts = {o.name: getattr(o, "start_time", 0.0) for o in (*world.objects, *world.deformables)}
    late = {name: time for name, time in starts.items() if name in names_in(predicate) and time > 0.0}
    if asked is not None or not late:
        return ""
    return f", from when {max(late, key=lambda name: late[name])} joins"


def _how_near(answer: QueryResult) -> str:
    nearest = answer.evidence.get("closest_approach")
    if nearest is None or nearest["gap_m"] == 0.0:
        return ""
    return f"; closest approach of the surfaces {nearest['gap_m']:.3g} m at {nearest['time']:.4g} s"


@GROUP.tool("CompareWorlds", title="Compare two rollouts")
def compare_worlds(
    app: App,
    base: Annotated[RolloutId, Field(description="rollout id of the world as it was, or any other")],
    edited: Annotated[RolloutId, Field(description="rollout id of the changed world")],
    objects: Objects = None,
    tolerance: Annotated[
        float, Field(gt=0, description="distance from which an object counts as moving differently [m]")
    ] = 0.01,
) -> Answer:
    """What a change altered: how far each object ends up from where it would have been and from when on (of ropes,
    cloth and soft bodies also the rms distance of their points), and which events are new, gone or shifted. Both
    rollouts are compared over the time that both cover."""
    base_case, base_world, first = stored_rollout(app, base)
    case, world, second = stored_rollout(app, edited)
    if base_case.content != case.content:
        raise ToolError(
            f"{base} belongs to case {base_case.id!r} and {edited} to {case.id!r}: they have nothing to share"
        )
    names = list(dict.fromkeys([*first.trajectory.names, *second.trajectory.names]))
    chosen = chosen_names(app, case, objects, names)
    with explained():
        # Told events alone: what stands in one world and drops in the other is a new collision.
        result = compare(
            replace(first, events=readouts.told_events(base_world, first)),
            replace(second, events=readouts.told_events(world, second)),
            chosen if objects is not None else None,
            tolerance=tolerance,
        )
    span = Span(0.0, result.horizon, world.time.seconds_per_frame)
    moved = [d for d in result.objects if d.apart_from is not None]
    rows = {
        "gone": readouts.in_order(result.events_only_in_base, first, span),
        "new": readouts.in_order(result.events_only_in_other, second, span),
    }
    # where things come to rest differs whenever they move differently: the summary leaves it to the data
    striking = {key: [row for row in found if row["what"] != "comes to rest"] for key, found in rows.items()}
    told = "; ".join(f"{key}: {readouts.told(found)}" for key, found in striking.items() if found)
    changed = ", ".join(f"{d.name} by up to {d.largest:.3g} m" for d in moved)
    bent = [d for d in result.objects if d.apart_from is None and (d.shape_largest or 0.0) > tolerance]
    if bent:
        reshaped = ", ".join(f"{d.name} (points up to {d.shape_largest:.3g} m rms apart)" for d in bent)
        changed = "; ".join(text for text in (changed, f"in shape alone: {reshaped}") if text)
    data = {
        "events": {
            "gone": rows["gone"],
            "new": rows["new"],
            "kept": [
                {"kind": m.base.kind, "objects": list(m.base.participants), "time": m.base.time, "shift": m.shift}
                for m in result.events_in_both
            ],
        },
        "floor_contacts_included": readouts.floor_contacts_included(base_world, first)
        and readouts.floor_contacts_included(world, second),
        "objects": [
            {
                "object": d.name,
                "largest_distance": d.largest,
                "at": d.largest_time,
                "final_distance": d.final,
                "apart_from": d.apart_from,
                "moves_differently": d.apart_from is not None,
                **(
                    {}
                    if d.shape_largest is None
                    else {"largest_shape_distance": d.shape_largest, "shape_at": d.shape_largest_time}
                ),
            }
            for d in result.objects
        ],
        "only_in_base": list(result.objects_only_in_base),
        "only_in_edited": list(result.objects_only_in_other),
        "base": {"rollout": base, "world": base_world.id, "horizon": first.horizon, "status": first.status},
        "edited": {"rollout": edited, "world": world.id, "horizon": second.horizon, "status": second.status},
        "covers": span.shown(),
        "tolerance": tolerance,
    }
    return Answer(
        summary=f"until {span.end:.4g} s: "
        + (f"displaced: {changed}" if changed else f"nothing displaced by more than {tolerance:g} m")
        + (f". Events {told}" if told else ". The same events"),
        data=data,
        case=case.id,
        world=world.id,
        rollout=edited,
        objects=tuple(chosen),
        interval=span.seconds,
        status="diverged" if "diverged" in (first.status, second.status) else "completed",
    )


def _read(
    app: App, rollout: str, interval: list[float] | None, frames: list[int] | None
) -> tuple[Case, World, Rollout, Span]:
    case, world, result = stored_rollout(app, rollout)
    span = chosen_span(
        interval,
        frames,
        covered=(0.0, _end(result)),
        seconds_per_frame=world.time.seconds_per_frame,
        further="Next: Rollout with a longer horizon_seconds covers more",
    )
    return case, world, result, span


def _end(result: Rollout) -> float:
    """The last time that was really simulated."""
    return float(result.trajectory.times[-1]) if len(result.trajectory.times) else 0.0


def _diverged(result: Rollout) -> str:
    if result.status != "diverged":
        return ""
    return f" (the rollout diverged at {result.diverged_time:.4g} s: nothing after that is known)"


def _takes_part(participants: set[str], chosen: set[str], together: bool) -> bool:
    return chosen <= participants if together else bool(chosen & participants)
