"""World experimentation, second part: decide statements about rollouts, and compare rollouts."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Annotated, Any

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field, WithJsonSchema

from atw_mcp.calls.app import App
from atw_mcp.calls.flat_unions import flat_schema
from atw_mcp.calls.forms import read_form, tagged
from atw_mcp.calls.intervals import FrameRange, Span
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.names import chosen_names, with_own_names
from atw_mcp.calls.results import Answer, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.probing import readouts
from atw_mcp.probing.ensemble_answers import (
    compared_members,
    comparison_answer,
    comparison_in_words,
)
from atw_mcp.probing.ensembles import Ensemble, EnsembleSize, compute_ensemble, lineage
from atw_mcp.results.querying import Answered, AnsweredSeveral, ComparedRollouts
from atw_mcp.tools.experimentation import PATIENCE, Objects, RolloutId, end_of
from atw_mcp.tools.readings import diverged_in_words
from atw_mcp.worlds.rollouts import evidence_status, sample_seconds_of, stored_rollout
from evidence_store import Case
from polyworld.probing.compare import Comparison, compare
from polyworld.probing.predicates import Predicate, names_in
from polyworld.probing.query import Aggregation, QueryResult, query
from polyworld.trajectory import Rollout
from polyworld.world import World

GROUP = ToolGroup("world experimentation")

STATEMENTS = flat_schema(Predicate, "predicate")
Statement = Annotated[Any, WithJsonSchema(STATEMENTS)]
# The forms are listed at the single predicate: a list of tools has room for them once.
OneOfSeveral = Annotated[Any, WithJsonSchema({"type": "object", "description": "as predicate"})]
STATEMENT_EXAMPLE = {"predicate": "collides", "a": "red", "b": "blue"}


@dataclass(frozen=True)
class _Question:
    """Question asked of every predicate alike."""

    aggregation: Aggregation
    interval: list[float] | None
    frames: list[int] | None

    def asked(self, world: World) -> tuple[float, float] | None:
        """The interval in seconds of one world, whose frames may last otherwise."""
        if self.interval is not None:
            return self.interval[0], self.interval[1]
        frame = world.time.seconds_per_frame
        return None if self.frames is None else (self.frames[0] * frame, self.frames[1] * frame)

    def of(self, rollout: Rollout, world: World, predicate: Predicate) -> QueryResult:
        """Decide one predicate."""
        return query(rollout, world, predicate, self.asked(world), self.aggregation)


@GROUP.tool("QueryWorld", title="Ask whether something holds", returns=Answered | AnsweredSeveral)
def query_world(
    app: App,
    rollout: RolloutId,
    predicate: Annotated[
        Statement | None,
        Field(description="what to decide. " + STATEMENTS["description"], examples=[STATEMENT_EXAMPLE]),
    ] = None,
    predicates: Annotated[
        list[OneOfSeveral] | None,
        Field(
            description="several at once, instead of predicate",
            min_length=1,
            max_length=16,
        ),
    ] = None,
    aggregation: Annotated[
        Aggregation,
        Field(description="any: ever; all: throughout; first, last: when; count: how often; fraction: of the time"),
    ] = "any",
    interval: Annotated[
        list[float] | None,
        Field(
            description="[start, end] in seconds; default: while all objects named take part",
            min_length=2,
            max_length=2,
        ),
    ] = None,
    frames: FrameRange = None,
) -> Answer:
    """Decide a statement over a stretch of a rollout: true, false (or a time, a count, a share), or unknown with the
    reason. Unknown means that the rollout does not cover what is asked; it never means false. Of collides, in_contact
    and nearer_than it also gives the closest approach of the two surfaces: how narrow it was. Contacts are exact; the
    rest is judged on samples, sampled_every_s apart: Rollout with a smaller sample_seconds judges it finer.
    Ask says how sure an answer is."""
    case, world, result = stored_rollout(app, rollout)
    if interval is not None and frames is not None:
        raise ToolError("give interval (seconds) or frames, not both")
    if (predicate is None) == (predicates is None):
        raise ToolError("give predicate, or predicates for several at once")
    statements = [
        read_statement(app, case, world, item, "predicate" if predicates is None else f"predicate {number}")
        for number, item in enumerate([predicate] if predicates is None else predicates, start=1)
    ]
    question = _Question(aggregation, interval, frames)
    with explained():
        answers = [question.of(result, world, statement) for statement in statements]
    texts, rows = [], []
    for statement, answer in zip(statements, answers, strict=True):
        text, row = _answered(world, result, question, statement, answer)
        texts.append(text)
        rows.append(row)
    covered = [answer.covered for answer in answers if answer.covered is not None]
    return Answer(
        summary="; ".join(texts) + diverged_in_words(result),
        data=rows[0] if len(rows) == 1 else {"answers": rows},
        case=case.id,
        world=world.id,
        rollout=rollout,
        objects=tuple(dict.fromkeys(name for statement in statements for name in names_in(statement))),
        interval=(min(a for a, _ in covered), max(b for _, b in covered)) if covered else None,
        status=evidence_status(result),
    )


def read_statement(app: App, case: Case, world: World, given: Any, what: str) -> Predicate:
    statement = tagged(given, Predicate, "predicate", what=what, example=STATEMENT_EXAMPLE)
    read: Predicate = read_form(with_own_names(app, case, world, statement), Predicate, "predicate", what=what)
    both = [getattr(read, side, None) for side in ("a", "b")]
    if both[0] is not None and both[0] == both[1]:
        raise ToolError(f"{what}: a and b are both {both[0]!r}: name another object as b")
    return read


def _members(
    app: App, case: Case, world: World, rollout: str, result: Rollout, count: int, progress: Progress
) -> Ensemble:
    message = f"running {count} members for {result.horizon:g} s"
    progress.report(0, 1, message)
    with explained():
        return compute_ensemble(
            app,
            case,
            world,
            result.horizon,
            sample_seconds_of(app, rollout),
            count,
            lambda share: progress.report(0.5 * share, 1, message),
        )


def _answered(
    world: World, result: Rollout, question: _Question, statement: Predicate, answer: QueryResult
) -> tuple[str, dict[str, Any]]:
    """The answer of one rollout to one predicate, in words and as data."""
    aggregation = question.aggregation
    span = Span(*(answer.covered or (0.0, end_of(result))), world.time.seconds_per_frame)
    verdict = "unknown" if not answer.decided else "never" if answer.value is None else answer.value
    if isinstance(verdict, bool):
        verdict = "true" if verdict else "false"
    shown_value = f"{verdict:.5g} s" if aggregation in ("first", "last") and isinstance(verdict, float) else verdict
    why = f": {answer.reason}" if answer.reason else ""
    spoken = " ".join([statement.predicate, *names_in(statement)])
    text = (
        f"{spoken} ({aggregation}, {span.start:.4g} to {span.end:.4g} s"
        f"{_joining(world, statement, question.asked(world))}): {shown_value}{why}{_how_near(answer)}"
        + (f" (samples every {answer.sampled_every:.3g} s)" if answer.sampled_every is not None else "")
    )
    return text, {
        "verdict": verdict,
        **answer.to_dict(),
        "evidence": _grounds(answer.evidence),
        "predicate": statement.model_dump(mode="json", exclude_none=True),
        "aggregation": aggregation,
        "covers": None if answer.covered is None else span.shown(),
    }


def _grounds(evidence: dict[str, Any]) -> dict[str, Any]:
    """The numbers of a verdict, those of the quantity that a state compares under one name."""
    grounds: dict[str, Any] = {}
    for name, found in evidence.items():
        state = isinstance(found, dict) and "lowest" in found
        grounds |= {"extremes": {"quantity": name, **found}} if state else {name: found}
    return grounds


def _joining(world: World, predicate: Predicate, asked: tuple[float, float] | None) -> str:
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


@GROUP.tool("CompareWorlds", title="Compare two rollouts", viewer=True, returns=ComparedRollouts)
def compare_worlds(
    app: App,
    base: Annotated[RolloutId, Field(description="rollout id to compare with")],
    edited: Annotated[RolloutId, Field(description="rollout id of the changed world")],
    objects: Objects = None,
    tolerance: Annotated[float, Field(gt=0, description="distance that counts as a difference [m]")] = 0.01,
    ensemble: EnsembleSize = None,
) -> Answer | LongWork:
    """Compare two rollouts: how far each object ends up from where it would have been and from when on (of ropes,
    cloth and soft bodies also the rms distance of their points), and which events are new, gone or shifted. Both
    rollouts are compared over the time that both cover. With ensemble=40 each of 40 worlds that the data allow is
    compared with its own changed copy: in how many an object is displaced, by how much (median, 90% interval), what
    decides it, and in how many an event is new or gone."""
    base_case, base_world, first = stored_rollout(app, base)
    case, world, second = stored_rollout(app, edited)
    if base_case.content != case.content:
        raise ToolError(
            f"{base} belongs to case {base_case.id!r} and {edited} to {case.id!r}: they have nothing to share"
        )
    names = list(dict.fromkeys([*first.trajectory.names, *second.trajectory.names]))
    chosen = chosen_names(app, case, objects, names)
    with explained():
        # Reported events alone: what stands in one world and drops in the other is a new collision.
        result = compare(
            replace(first, events=readouts.reported_events(base_world, first)),
            replace(second, events=readouts.reported_events(world, second)),
            chosen if objects is not None else None,
            tolerance=tolerance,
        )
    best = _comparison_answer(case, (base, base_world, first), (edited, world, second), chosen, tolerance, result)
    if ensemble is None:
        return best
    if lineage(app, base_case, base_world).sample.id != lineage(app, case, world).sample.id:
        raise ToolError(f"{base} and {edited} descend from different fits: their members cannot be compared in pairs")

    def work(progress: Progress) -> Answer:
        one = _members(app, base_case, base_world, base, first, ensemble, progress)
        other = _members(app, case, world, edited, second, ensemble, progress)
        with explained():
            pairs = compared_members(one, other, chosen if objects is not None else None, tolerance)
        about = comparison_answer(one, other, pairs)
        summary = f"{best.summary}. Of the ensemble, {comparison_in_words(about)}"
        return replace(best, summary=summary, data={**best.data, "ensemble": about})

    draft = replace(best, summary=f"comparing {ensemble} members", data={})
    return LongWork(f"compare {base} {edited} {ensemble} {objects} {tolerance}", work, draft, PATIENCE)


def _comparison_answer(
    case: Case,
    before: tuple[str, World, Rollout],
    after: tuple[str, World, Rollout],
    chosen: list[str],
    tolerance: float,
    result: Comparison,
) -> Answer:
    base, base_world, first = before
    edited, world, second = after
    span = Span(0.0, result.horizon, world.time.seconds_per_frame)
    moved = [d for d in result.objects if d.apart_from is not None]
    rows = {
        "gone": readouts.in_order(result.events_only_in_base, first, span),
        "new": readouts.in_order(result.events_only_in_other, second, span),
    }
    # where things come to rest differs whenever they move differently: the summary leaves it to the data
    striking = {key: [row for row in found if row["what"] != "comes to rest"] for key, found in rows.items()}
    events = "; ".join(f"{key}: {readouts.in_words(found)}" for key, found in striking.items() if found)
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
        "base": {"rollout": base, "world": base_world.id, "horizon": first.horizon, "status": evidence_status(first)},
        "edited": {"rollout": edited, "world": world.id, "horizon": second.horizon, "status": evidence_status(second)},
        "covers": span.shown(),
        "tolerance": tolerance,
    }
    return Answer(
        summary=f"until {span.end:.4g} s: "
        + (f"displaced: {changed}" if changed else f"nothing displaced by more than {tolerance:g} m")
        + (f". Events {events}" if events else ". The same events"),
        data=data,
        case=case.id,
        world=world.id,
        rollout=edited,
        objects=tuple(chosen),
        interval=span.seconds,
        status="diverged" if "diverged" in map(evidence_status, (first, second)) else "completed",
    )
