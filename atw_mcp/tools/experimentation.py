"""World experimentation: run the committed world, or a changed copy of it, and read what happened."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field, WithJsonSchema

from atw_mcp.calls.app import App
from atw_mcp.calls.flat_unions import flat_schema
from atw_mcp.calls.forms import read_form, tagged
from atw_mcp.calls.intervals import Span
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.names import with_own_names
from atw_mcp.calls.results import Answer, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.probing import readouts
from atw_mcp.probing.ensemble_answers import rollout_answer, rollout_in_words
from atw_mcp.probing.ensembles import EnsembleSize, compute_ensemble, lineage
from atw_mcp.results.experimentation import RolloutMade
from atw_mcp.worlds.rollout_cost import cost, size_in_words
from atw_mcp.worlds.rollouts import (
    checked_horizon,
    compute_rollout,
    evidence_status,
    find_rollout,
)
from atw_mcp.worlds.sizes import check_additions, check_sizes
from evidence_store import Case
from polyworld.edits.interventions import Add, Intervention, branch
from polyworld.model.notes import model_notes
from polyworld.probing.overlaps import overlaps
from polyworld.probing.query import sampled_every
from polyworld.trajectory import Rollout
from polyworld.world import World

GROUP = ToolGroup("world experimentation")

CaseId = Annotated[str, Field(description="case id")]
RolloutId = Annotated[str, Field(description="rollout id", pattern=r"^rollout-[0-9a-f]+$")]
Objects = Annotated[list[str] | None, Field(description="names of objects; default: all", max_length=64)]
# Checked after names have been replaced, so that a name of a binding may be any text.
Edit = Annotated[Any, WithJsonSchema(flat_schema(Intervention, "action"))]
EDIT_EXAMPLE = {"action": "remove", "object": "red"}
PATIENCE = 40.0  # [s]
ALONE = 0.1  # share of the work that the best fit's own rollout is beside its ensemble's


@dataclass(frozen=True)
class _Plan:
    """One branch to run. horizon, sample_seconds [s]."""

    world: World
    edits: tuple[dict[str, Any], ...]
    horizon: float
    sample_seconds: float | None

    @property
    def size(self) -> str:
        """Describe in words what makes it long."""
        return size_in_words(self.world, self.horizon)


@GROUP.tool("Rollout", title="Run a world forward", read_only=False, returns=RolloutMade)
def roll_out(
    app: App,
    case: CaseId,
    edits: Annotated[
        list[Edit] | None,
        Field(
            description="changes made before the start, in order; all that was fitted is kept. Default: none, which "
            "continues the world as it was observed",
            max_length=32,
            examples=[[EDIT_EXAMPLE, {"action": "set_velocity", "object": "blue", "velocity": [1, 0, 0]}]],
        ),
    ] = None,
    horizon_seconds: Annotated[
        float | None, Field(description="time to run to, from 0 [s]; default: the last observed frame", gt=0)
    ] = None,
    horizon_frames: Annotated[int | None, Field(description="the same in frames", gt=0)] = None,
    world: Annotated[str, Field(description="'committed', or the id of a branch, to edit further")] = "committed",
    sample_seconds: Annotated[
        float | None,
        Field(description="time between samples [s]; default: a frame", gt=0),
    ] = None,
    ensemble: EnsembleSize = None,
) -> Answer | LongWork:
    """Run the committed world forward from time 0 and return a rollout id for ReadEvents, ReadTrajectory, ReadTimeline,
    QueryWorld, CompareWorlds and InspectRollout.

    Without edits it replays the observed stretch and, with a horizon beyond it, predicts what comes next. With edits
    it runs a branch in which they hold from the beginning. The same request is never computed twice. With ensemble=40
    it also runs 40 worlds that the data allow, edited alike: in how many of them each event happens, and medians with
    90% intervals of when, where, and of every object's place at the end.
    """
    found, committed = app.case_to_probe(case, "Rollout", None if world == "committed" else world)
    base = committed if world == "committed" else app.world(found, world)
    if horizon_seconds is not None and horizon_frames is not None:
        raise ToolError("give horizon_seconds or horizon_frames, not both")
    wanted = read_edits(app, found, base, edits or [], "")
    with explained(f"InspectWorld(case={found.id!r}, world={base.id!r}) lists objects, statics and effects"):
        check_additions(base, wanted, app.limits)
        branched = branch(base, wanted)
    seconds = horizon_seconds
    if horizon_frames is not None:
        seconds = horizon_frames * branched.time.seconds_per_frame
    with explained("Rollout with a shorter horizon"):
        horizon = checked_horizon(branched, seconds, sample_seconds)
        check_sizes(branched, app.limits, horizon)
    edited = tuple(edit.model_dump(mode="json", exclude_none=True) for edit in wanted)
    plan = _Plan(branched, edited, horizon, sample_seconds)
    if branched.id != base.id:
        app.keep_world(found, branched, how="intervention", parent=base, detail={"edits": list(edited)})
    if ensemble is not None:
        lineage(app, found, branched)  # refused before any work
    else:
        known = find_rollout(app, branched, horizon, sample_seconds)
        if known is not None:
            return _rollout_answer(found, base, branched, list(edited), *known)

    def work(progress: Progress) -> Answer:
        return _run(app, found, base, plan, ensemble, lambda share, message: progress.report(share, 1.0, message))

    draft = Answer(
        summary=f"running {branched.id} for {horizon:g} s{plan.size}",
        data={},
        case=found.id,
        world=branched.id,
        objects=branched.moving_names,
        interval=(0.0, horizon),
    )
    return LongWork(f"rollout {branched.id} {horizon!r} {sample_seconds!r} {ensemble}", work, draft, PATIENCE)


def _run(
    app: App, case: Case, base: World, plan: _Plan, ensemble: int | None, report: Callable[[float, str], None]
) -> Answer:
    """Run one branch, and its ensemble."""
    message = f"running {len(plan.world.moving_names)} objects for {plan.horizon:g} s{plan.size}"
    report(0.0, message)
    alone = 1.0 if ensemble is None else ALONE
    with explained():
        made = compute_rollout(
            app,
            plan.world,
            plan.horizon,
            lambda share: report(alone * share, f"{message}, {share * plan.horizon:.3g} s done"),
            plan.sample_seconds,
        )
        answer = _rollout_answer(case, base, plan.world, list(plan.edits), *made)
        if ensemble is None:
            return answer
        together = f"running {ensemble} members for {plan.horizon:g} s{plan.size}"
        report(alone, together)
        members = compute_ensemble(
            app,
            case,
            plan.world,
            plan.horizon,
            plan.sample_seconds,
            ensemble,
            lambda share: report(alone + (1.0 - alone) * share, together),
        )
    about = rollout_answer(members, plan.horizon)
    summary = f"{answer.summary}. Of the ensemble, {rollout_in_words(about)}"
    return replace(answer, summary=summary, data={**answer.data, "ensemble": about})


def read_edits(app: App, case: Case, base: World, given: list[Any], where: str) -> list[Intervention]:
    """Edits of `base` as exact types; what one adds, the later ones may name."""
    wanted: list[Intervention] = []
    added: set[str] = set()
    for number, item in enumerate(given, start=1):
        what = f"{where}edit {number}"
        edit = tagged(item, Intervention, "action", what=what, example=EDIT_EXAMPLE)
        read = read_form(with_own_names(app, case, base, edit, added), Intervention, "action", what=what)
        if isinstance(read, Add):
            parts = (read.object, read.static, read.deformable)
            added |= {part.name for part in parts if part is not None}
        wanted.append(read)
    return wanted


def _timeline_in_words(rows: list[dict[str, Any]], observed: float, span: Span) -> str:
    """Return the timeline in words: what lies beyond the observed frames first, since it is what was asked for."""
    if not 0.0 < observed < span.end - 1e-6 * span.seconds_per_frame:
        return readouts.in_words(rows)
    beyond = [row for row in rows if row["time"] > observed]
    within = [row for row in rows if row["time"] <= observed]
    return (
        f"after the last observed frame ({observed:.4g} s) {readouts.in_words(beyond, most=12)}. "
        f"Before it {readouts.in_words(within)}"
    )


def _rollout_answer(
    case: Case, base: World, world: World, edits: list[dict[str, Any]], identifier: str, result: Rollout
) -> Answer:
    span = Span(0.0, end_of(result), world.time.seconds_per_frame)
    rows = readouts.timeline(world, result, span)
    what = "the committed world" if not edits else f"a branch with {len(edits)} edit{'s' * (len(edits) > 1)}"
    observed = (world.time.frame_count - 1) * world.time.seconds_per_frame
    summary = f"{identifier}: {what}, 0 to {span.end:.4g} s: {_timeline_in_words(rows, observed, span)}"
    ended = result.why_ended()
    if ended is not None:
        summary = f"{identifier} {ended[0].upper()}{ended[1:]}. It is valid only before. {summary}"
    inside = overlaps(world, result)
    if inside:
        rest = f", and {len(inside) - 3} pairs more" if len(inside) > 3 else ""
        summary += f". Warning: {'; '.join(o.in_words() for o in inside[:3])}{rest}. The engine pushes them apart"
    for note in filter(None, (result.why_no_contacts(), *model_notes(world))):
        summary += f" Note: {note}"
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
                "time": result.diverged_time if result.truncated is None else result.truncated.time,
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
        status=evidence_status(result),
    )


def end_of(result: Rollout) -> float:
    """The last time that was really simulated."""
    return float(result.trajectory.times[-1]) if len(result.trajectory.times) else 0.0
