"""World experimentation, third part: a list of questions in one call."""

from __future__ import annotations

import json
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field, WithJsonSchema

from atw_mcp.calls.app import App
from atw_mcp.calls.flat_unions import flat_schema
from atw_mcp.calls.forms import read_form, tagged
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.names import object_name
from atw_mcp.calls.results import Answer, explained
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.probing.asking import answered, brief, disagree, in_words
from atw_mcp.probing.candidates import counts, mixture, weights
from atw_mcp.probing.ensembles import LEAST, MEMBERS, Ensemble, compute_ensemble, lineage, most_members
from atw_mcp.probing.questions import AGGREGATIONS, SCANNED, Asked, HowFar, Question, scanned
from atw_mcp.results.asking import AnswersToAll
from atw_mcp.tools.experimentation import PATIENCE, CaseId, read_edits
from atw_mcp.tools.querying import read_statement
from atw_mcp.worlds.rollouts import checked_horizon, compute_rollout, evidence_status
from atw_mcp.worlds.sizes import check_additions, check_sizes
from evidence_store import Case
from polyworld.edits.interventions import branch
from polyworld.solver.work import affordable, work_of
from polyworld.trajectory import Rollout
from polyworld.world import World

GROUP = ToolGroup("world experimentation")

QUESTIONS = flat_schema(Question, "ask")
One = Annotated[Any, WithJsonSchema(QUESTIONS)]
EXAMPLE = {
    "ask": "whether",
    "predicate": {"predicate": "collides", "a": "red", "b": "blue"},
    "edits": [{"action": "remove", "object": "green"}],
}
MOST = 32  # answers in one call
WORK = 3e7  # of the members of a call with deformable objects, see `polyworld.solver.work`: most of a minute of a core


@dataclass(frozen=True)
class _Plan:
    """A changed copy of each candidate world, and the numbers of the questions that are asked of them."""

    worlds: tuple[World, ...]
    edits: tuple[dict[str, Any], ...]
    numbers: tuple[int, ...]


@GROUP.tool("Ask", title="Ask a list of questions", read_only=False, returns=AnswersToAll)
def ask(
    app: App,
    case: CaseId,
    questions: Annotated[
        list[One],
        Field(
            description="each with what is asked and, for what if, edits (a list as factor or value: an answer each). "
            + QUESTIONS["description"],
            min_length=1,
            max_length=16,
            examples=[[EXAMPLE, {"ask": "where", "object": "red", "at": 2.0}]],
        ),
    ],
    horizon_seconds: Annotated[
        float | None,
        Field(
            description="time to run to, from 0 [s]; default: the latest time that a question names, at least to the "
            "last observed frame",
            gt=0,
        ),
    ] = None,
    worlds: Annotated[
        list[str] | None,
        Field(
            description="candidate worlds, weighted by their errors on frames left out; default: the committed one",
            min_length=1,
            max_length=8,
        ),
    ] = None,
) -> LongWork:
    """Answer several questions at once: whether, when, how often, which first, where, how fast, how far, each of the
    world as it is or with edits made before the start. Worlds with equal edits are run once. Every question is asked of
    the best fit and of 64 worlds that the data allow (with deformable objects fewer, at least 16): a probability, or a
    median with 80 and 95% intervals that include the model's own error, the parameter that decides the answer or that
    it goes with, and whether any frame shows that parameter. Each answer is evidence of its own and names the rollout
    to look at closer with ReadEvents, ReadTrajectory, QueryWorld, CompareWorlds and InspectRollout."""
    if worlds is None:
        found, committed = app.case_to_probe(case, "Ask")
        bases: tuple[World, ...] = (committed,)
    else:
        found = app.case(case)
        bases = tuple(app.world(found, one) for one in dict.fromkeys(worlds))
    for one_base in bases:
        lineage(app, found, one_base)  # refused before any work
    named, shares = bases, weights(app, found, bases)
    order = [int(k) for k in np.argsort(-shares, kind="stable")]
    bases = tuple(bases[k] for k in order)
    base = bases[0]
    read: list[Asked] = []
    each = [(k, one) for k, given in enumerate(questions, start=1) for one in scanned(given, f"question {k}")]
    if len(each) > MOST:
        raise ToolError(f"{len(each)} answers are asked for, with those of lists of numbers: ask for {MOST} at most")
    questions = [one for _, one in each]
    plans: dict[str, _Plan] = {}
    for place, (number, given) in enumerate(each):
        what = f"question {number}"
        try:
            branched, edits, one = _read(app, found, bases, given, what)
        except ToolError as error:
            said = str(error)
            raise ToolError(said if said.startswith(what) else f"{what}: {said}") from error
        read.append(one)
        key = json.dumps(edits, sort_keys=True)
        numbers = plans[key].numbers if key in plans else ()
        plans[key] = _Plan(branched, edits, (*numbers, place))
    observed = (base.time.frame_count - 1) * base.time.seconds_per_frame
    wanted = horizon_seconds or max([observed, *(one.latest for one in read)]) or None
    late = [(k, one.latest) for (k, _), one in zip(each, read, strict=True) if wanted and one.latest > wanted + 1e-9]
    if late:
        raise ToolError(f"question {late[0][0]} asks for {late[0][1]:g} s, after horizon_seconds {wanted:g}")
    for plan in plans.values():
        for parent, changed in zip(bases, plan.worlds, strict=True):
            with explained("Ask with a shorter horizon"):
                horizon = checked_horizon(changed, wanted)
                check_sizes(changed, app.limits, horizon)
            if changed.id != parent.id:
                app.keep_world(found, changed, how="intervention", parent=parent, detail={"edits": list(plan.edits)})

    kept = min(most_members(app, found, one) for one in bases)
    works = [work_of(changed, horizon) for plan in plans.values() for changed in plan.worlds]
    members = affordable(works, WORK * len(bases), min(kept, MEMBERS))
    sizes = counts(shares, members)

    def work(progress: Progress) -> Answer:
        rows: dict[int, dict[str, Any]] = {}
        for done, plan in enumerate(plans.values()):
            message = f"running {members} worlds for {horizon:g} s, {done + 1} of {len(plans)}"

            def report(share: float, done: int = done, message: str = message) -> None:
                progress.report(done + share, len(plans), message)

            report(0.0)
            with explained():
                rollout, best = compute_rollout(app, plan.worlds[0], horizon)
                parts = [
                    compute_ensemble(app, found, changed, horizon, None, max(sizes[k], LEAST), report)
                    for k, changed in zip(order, plan.worlds, strict=True)
                ]
                ensemble = mixture(parts, [shares[k] for k in order], [sizes[k] for k in order])
                for i in plan.numbers:
                    alone = _by_world(app, bases, [shares[k] for k in order], plan, parts, read[i], horizon)
                    rows[i] = _answer(app, found, plan, rollout, best, read[i], ensemble, alone, questions[i])
        weighed = None if worlds is None else {named[k].id: float(shares[k]) for k in range(len(named))}
        return _together(found, base, [rows[i] for i in range(len(read))], horizon, observed, weighed, members)

    return LongWork(
        f"ask {' '.join(w.id for w in named)} {horizon} {json.dumps(questions, sort_keys=True, default=str)}",
        work,
        Answer(
            summary=f"asking {len(read)} questions of {members} worlds over {horizon:g} s, {len(plans)} sets of edits",
            data={},
            case=found.id,
            world=base.id,
            interval=(0.0, horizon),
        ),
        PATIENCE,
    )


def _read(
    app: App, case: Case, bases: tuple[World, ...], given: Any, what: str
) -> tuple[tuple[World, ...], tuple[dict[str, Any], ...], Asked]:
    """Return the worlds that a question is asked of, its edits, and the question with the worlds' own names."""
    base = bases[0]
    question = read_form(tagged(given, Question, "ask", what=what, example=EXAMPLE), Question, "ask", what=what)
    edits = read_edits(app, case, base, question.edits, f"{what}, ")
    changed_worlds = []
    for one in bases:
        with explained(f"InspectWorld(case={case.id!r}, world={one.id!r}) lists objects, statics and effects"):
            check_additions(one, edits, app.limits)
            changed_worlds.append(branch(one, edits))
    branched = changed_worlds[0]
    given_statements = (
        question.predicates
        if hasattr(question, "predicates")
        else [question.predicate]
        if question.ask in AGGREGATIONS
        else []
    )
    statements = tuple(read_statement(app, case, branched, item, f"{what}, predicate") for item in given_statements)
    if hasattr(question, "object"):
        changed = {"object": object_name(app, case, question.object, list(branched.moving_names))}
        if isinstance(question, HowFar) and question.to is not None:
            known = [*branched.moving_names, *(s.name for s in branched.statics)]
            changed["to"] = object_name(app, case, question.to, known)
        question = question.model_copy(update=changed)
    interval = getattr(question, "interval", None)
    if interval is not None and interval[0] > interval[1]:
        raise ToolError(f"{what}: interval is start, end with start <= end, got {interval}")
    documents = tuple(edit.model_dump(mode="json", exclude_none=True) for edit in edits)
    return tuple(changed_worlds), documents, Asked(question, statements)


def _answer(
    app: App,
    case: Case,
    plan: _Plan,
    rollout: str,
    best: Rollout,
    asked: Asked,
    ensemble: Ensemble,
    alone: dict[str, Any],
    given: Any,
) -> dict[str, Any]:
    """Answer one question and record it as evidence of its own."""
    about = answered(asked, ensemble, best, plan.worlds[0]) | alone
    samples = [lineage(app, case, world).sample for world in plan.worlds]
    unseen = {name.removeprefix("objects.") for sample in samples for name in sample.document["from_prior"]}
    named = [about["decided_by"]["parameter"]] if about.get("decided_by") else []
    named += [row["parameter"] for row in about.get("goes_with") or []]
    row: dict[str, Any] = {"question": _with_edits(plan, asked.in_words(best.horizon))}
    late = asked.enters(plan.worlds[0])
    since = "" if late is None else f"; from {late[1]:.4g} s on, when {late[0]} enters"
    row |= {
        "answer": in_words(about, named, unseen, asked.latest or best.horizon) + since,
        "rollout": rollout,
        "edits": list(plan.edits) or None,
        **about,
    }
    row["from_prior"] = [name for name in dict.fromkeys(named) if name in unseen] or None
    row = {k: v for k, v in row.items() if k != "reason" and (k in ("best_fit", "unknown") or v not in (None, []))}
    record = app.store.evidence.add(
        Answer(
            summary=f"{row['question']}: {row['answer']}",
            data=row,
            case=case.id,
            world=plan.worlds[0].id,
            rollout=rollout,
            objects=asked.names,
            interval=(0.0, best.horizon),
            status=evidence_status(best),
        ).to_evidence("Ask", {"case": case.id, "questions": [given]})
    )
    return {**row, "evidence": record.id}


def _by_world(
    app: App,
    bases: tuple[World, ...],
    shares: list[float],
    plan: _Plan,
    parts: list[Ensemble],
    asked: Asked,
    until: float,
) -> dict[str, Any]:
    """Return what each of several candidates answers by itself, in words, and whether they disagree; empty for one."""
    if len(parts) < 2:
        return {}
    rows = [
        answered(asked, part, compute_rollout(app, world, until)[1], world)
        for world, part in zip(plan.worlds, parts, strict=True)
    ]
    kinds = {True: "planar: bodies slide and turn, and do not roll", False: "spatial"}
    named = [f"{base.id} (weight {share:.2g}, {kinds[base.planar]})" for base, share in zip(bases, shares, strict=True)]
    said = [in_words(row, [], set(), asked.latest or until) for row in rows]
    return {"by_world": dict(zip(named, said, strict=True)), "disagree": disagree(rows, shares) or None}


def _with_edits(plan: _Plan, question: str) -> str:
    if not plan.edits:
        return question
    named = ("action", "object", "name", "path", *SCANNED)
    made = [
        " ".join(f"{k}={edit[k]:.4g}" if k in SCANNED else str(edit[k]) for k in named if edit.get(k) is not None)
        for edit in plan.edits
    ]
    return f"with {', '.join(made)}: {question}"


def _together(
    case: Case,
    base: World,
    rows: list[dict[str, Any]],
    horizon: float,
    observed: float,
    weighed: dict[str, float] | None,
    members: int,
) -> Answer:
    whole: dict[str, Any] = {"members": members, "until": horizon, "observed_until": observed}
    whole |= {} if weighed is None else {"weights": weighed}
    summary = f"{len(rows)} answers of {members} worlds that the data allow, run to {horizon:.4g} s"
    if members < MEMBERS:
        summary += f", not {MEMBERS}, since rollouts of deformable objects are costly"
    if observed < horizon:
        summary += f"; after {observed:.4g} s, the last fitted frame, they allow for errors of prediction"
    return Answer(
        summary=summary,
        data={"answers": rows, **whole},
        shown={"answers": [brief(row) for row in rows], **whole},
        case=case.id,
        world=base.id,
        interval=(0.0, horizon),
    )
