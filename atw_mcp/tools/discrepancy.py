"""The gap: where a fitted world and measured motion disagree, which effect is missing, what adding it is worth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Annotated, Any

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from numpy.typing import NDArray
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress
from atw_mcp.calls.results import Answer, explained, plain
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.fitting.verdict import cure, verdict_of
from atw_mcp.gap import work as gap_work
from atw_mcp.gap.numbers import GapNumbers
from atw_mcp.gap.shown import next_step, shown_discrepancy, shown_proposals
from atw_mcp.gap.unknowns import base_unknowns
from atw_mcp.gap.work import Outcome
from atw_mcp.observation.recording_records import CaseRecording, case_recording
from atw_mcp.results.discrepancy import AddedEffect, FoundDiscrepancy, ProposedEffects
from atw_mcp.tools.world_arguments import CaseId, EffectArgument, Patience
from evidence_store import Case, Content, UnknownRecord
from polyworld.estimation.unknown import Unknown
from polyworld.gap import GapSettings
from polyworld.gap.candidate import with_parts
from polyworld.gap.catalogue import catalogue, named
from polyworld.world import World

GROUP = ToolGroup("gap")
KIND = "gap"  # of stored outcomes
METHOD = 2  # counts changes of what outcomes hold
DOING = {"examine": "examining", "propose": "looking for what is missing in", "add": "adding an effect to"}

WorldId = Annotated[str | None, Field(description="world id; default: the committed, else the latest")]
Fitted = Annotated[
    list[Annotated[str, Field(max_length=200)]] | None,
    Field(
        max_length=64,
        description="parameter paths refitted too; default: those of FitWorld; []: none, the world's numbers are "
        "known. Initial states always are",
    ),
]


@GROUP.tool(
    "FindDiscrepancy",
    title="Find where world and data disagree",
    read_only=True,
    pictures=True,
    viewer=True,
    returns=FoundDiscrepancy,
)
def find_discrepancy(
    app: App,
    case: CaseId,
    world: WorldId = None,
    base: Fitted = None,
    power: Annotated[bool, Field(description="also list how strong each effect had to be to be seen")] = False,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Ask whether a world explains what was measured, to the noise. Initial states and the base parameters are
    refitted, and each run (of few runs, each stretch) is predicted from a fit without it; the noise is measured before
    any fit. Residuals in units of the noise are listed by object, run, time, phase of motion, place, speed and axis,
    with pictures and with sudden changes of velocity that nothing known explains. If the data are explained, nothing is
    missing. The last quarter of the data (or the runs sealed at import) is not looked at. Next: ProposeEffects where
    they are not explained."""
    found = app.case(case)
    start = _not_poor(app, found, app.world(found, world))
    with explained():
        recording = case_recording(app, found, start)
        unknowns = base_unknowns(app, start, base)

    def answer(outcome: Outcome) -> Answer:
        steps = f"ProposeEffects(case={found.id!r}, world={start.id!r})"
        context = {**_recording_used(recording), "next": "nothing to add" if outcome.data["explained"] else steps}
        return Answer(
            summary=f"{start.id}: {outcome.summary}",
            data={**outcome.data, **context},
            shown={**shown_discrepancy(outcome.data), **context},
            case=found.id,
            world=start.id,
            observation=recording.id,
            objects=start.moving_names,
            pictures=outcome.pictures,
        )

    return _found_or_computed(
        app,
        _Question("examine", found, start, recording, {"base": _plain(unknowns), "power": power}),
        lambda progress: gap_work.examine(start, recording.parts, unknowns, power, progress),
        answer,
        patience_seconds,
    )


@GROUP.tool("ProposeEffects", title="Name the missing effect", read_only=True, returns=ProposedEffects)
def propose_effects(
    app: App,
    case: CaseId,
    world: WorldId = None,
    base: Fitted = None,
    effects: Annotated[
        list[Annotated[str, Field(max_length=64)]] | None,
        Field(max_length=64, description=f"effects to consider; default all: {', '.join(catalogue())}"),
    ] = None,
    max_effects: Annotated[int, Field(ge=1, le=3, description="most effects that may be missing at once")] = 3,
    time_limit: Annotated[
        float | None,
        Field(gt=0.0, le=86400.0, description="longest search [s]; it ends with the best verdict so far"),
    ] = None,
    seed: Annotated[int, Field(ge=0, le=2**31 - 1, description="random seed of the bootstrap")] = 0,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Search the catalogue for what a world lacks: contenders are added one by one, fitted together with initial states
    and base parameters on simulated trajectories, and judged by what they predict of runs left out of the fit. The
    verdict is one of: identified (what is left out is predicted to the noise, and no other effect does as well),
    identified_with_remainder (something is left, but these effects close most of the gap in bootstraps over runs),
    ambiguous (several would do; with the experiment that would decide), unexplained (no effect may be named; with the
    residual force as an expression), nothing_missing. Runs that no effect predicts are set aside and reported. Plain
    laws (drag, friction, restitution, gravity), alone and in pairs, are always reported beside a richer answer. Sealed
    data are looked at once the verdict stands, and can only lower it. Next: AddEffect with this result's evidence
    id."""
    found = app.case(case)
    start = _not_poor(app, found, app.world(found, world))
    with explained():
        chosen = named(effects) if effects else None
        recording = case_recording(app, found, start)
        unknowns = base_unknowns(app, start, base)

    settings = GapSettings(depth=max_effects, time_limit=time_limit, seed=seed)

    def answer(outcome: Outcome) -> Answer:
        context = {**_recording_used(recording), "next": next_step(found.id, outcome.data)}
        return Answer(
            summary=f"{start.id}: {outcome.summary}",
            data={**outcome.data, **context},
            shown={**shown_proposals(outcome.data), **context},
            case=found.id,
            world=start.id,
            observation=recording.id,
            objects=start.moving_names,
        )

    inputs = {
        "base": _plain(unknowns),
        "effects": sorted(set(effects)) if effects else None,
        "max_effects": max_effects,
        "time_limit": time_limit,
        "seed": seed,
    }
    return _found_or_computed(
        app,
        _Question("propose", found, start, recording, inputs),
        lambda progress: gap_work.propose(start, recording.parts, unknowns, chosen, settings, progress),
        answer,
        patience_seconds,
    )


@GROUP.tool(
    "AddEffect",
    title="Add an effect and show what it is worth",
    read_only=False,
    pictures=True,
    viewer=True,
    returns=AddedEffect,
)
def add_effect(
    app: App,
    case: CaseId,
    proposal: Annotated[str | None, Field(max_length=64, description="evidence id of ProposeEffects")] = None,
    hypothesis: Annotated[int, Field(ge=0, le=63, description="which of its proposals; 0 is the best")] = 0,
    effect: Annotated[
        EffectArgument | None,
        Field(
            description="instead of a proposal: a law as of BuildWorld's effects. Its parameters are fitted from the "
            "values given"
        ),
    ] = None,
    world: Annotated[str | None, Field(description="that gets effect; default: the latest draft")] = None,
    base: Fitted = None,
    patience_seconds: Patience = 40.0,
) -> Answer | LongWork:
    """Make a child world with an effect in it, usable by every tool; the effect can be switched off by an edit. Its
    worth is shown before and after on the data that were fitted, and then on the sealed data, which no step has seen:
    the gap in metres, the noise floor, the share closed. A gap that shrinks does not prove the name: the verdict of
    ProposeEffects does. Next: InspectRollout, CommitWorld."""
    found = app.case(case)
    if (proposal is None) == (effect is None):
        raise ToolError("AddEffect takes a proposal (evidence id of ProposeEffects) or an effect, one of the two")
    if proposal is not None:
        parent, made = _proposed(app, found, proposal, hypothesis)
        with explained():
            recording = case_recording(app, found, parent)

        detail: dict[str, Any] = {"proposal": proposal, "hypothesis": hypothesis}
        asked = {"title": made["title"], "after": World.model_validate(made["world"]).id}
        return _found_or_computed(
            app,
            _Question("add", found, parent, recording, asked),
            lambda progress: gap_work.worth(made, recording.parts, progress),
            lambda outcome: _added(app, found, parent, outcome, recording, detail),
            patience_seconds,
        )
    assert effect is not None
    parent = _not_poor(app, found, app.draft(found, world))
    with explained(f"InspectWorld(case={found.id!r}, world={parent.id!r}) lists objects and effects"):
        law = effect.to_effect()
        with_parts(parent, effects=(*parent.effects, law))  # refused here, before any work
        recording = case_recording(app, found, parent)
        unknowns = base_unknowns(app, parent, base)

    def fit(progress: Progress) -> Outcome:
        given = gap_work.fitted_effect(parent, law, recording.parts.fitted, unknowns, progress)
        return gap_work.worth(given, recording.parts, progress)

    described = {"effect": law.model_dump(mode="json")}
    return _found_or_computed(
        app,
        _Question("add", found, parent, recording, {**described, "base": _plain(unknowns)}),
        fit,
        lambda outcome: _added(app, found, parent, outcome, recording, described),
        patience_seconds,
    )


def _not_poor(app: App, case: Case, world: World) -> World:
    """The world; raises ToolError where its fit is poor: what it lacks is then not what its errors show."""
    judged = verdict_of(app, world.id)
    if judged is not None and judged["verdict"] == "poor":
        raise ToolError(
            f"the fit of {world.id} is poor ({judged['why']}), so what is missing is indistinguishable from what is "
            f"wrong. Next: {cure(case.id, world.id)}"
        )
    return world


def _added(
    app: App, case: Case, parent: World, outcome: Outcome, recording: CaseRecording, detail: dict[str, Any]
) -> Answer:
    child = outcome.world
    assert child is not None
    modelled = app.store.cases.modelled_observation(case.id, parent.id)
    app.keep_world(case, child, how="effect_added", parent=parent, detail=detail, observation=modelled)
    before = {effect.name for effect in parent.effects}
    laws = [effect.name for effect in child.effects if effect.name not in before]
    switch = f"; without it: edits=[{{action: 'toggle_effect', effect: {laws[0]!r}, enabled: false}}]" if laws else ""
    return Answer(
        summary=f"world {child.id} with {outcome.summary}",
        data={
            "world": child.id,
            "from_world": parent.id,
            "laws": laws,
            **outcome.data,
            **_recording_used(recording),
            "next": f"InspectRollout(case={case.id!r}, world={child.id!r}), CommitWorld, Rollout{switch}",
        },
        case=case.id,
        world=child.id,
        observation=recording.id,
        objects=child.moving_names,
        pictures=outcome.pictures,
    )


def _proposed(app: App, case: Case, evidence: str, index: int) -> tuple[World, dict[str, Any]]:
    try:
        record = app.store.read_evidence(evidence)
    except UnknownRecord as error:
        raise ToolError(f"{error}. Next: ProposeEffects(case={case.id!r})") from error
    if record.tool != "ProposeEffects" or record.case != case.id:
        raise ToolError(
            f"{evidence} is a result of {record.tool} in case {record.case!r}. Next: ProposeEffects(case={case.id!r})"
        )
    if record.status != "completed":
        raise ToolError(f"{evidence} is {record.status}. Next: ReadEvidence(evidence={evidence!r})")
    proposals = record.payload["data"]["proposals"]
    if not proposals:
        raise ToolError(f"{evidence} found {record.payload['data']['verdict']}: it proposes no effect to add")
    if index >= len(proposals):
        titles = [p["title"] for p in proposals]
        raise ToolError(f"{evidence} has {len(proposals)} proposals {titles}; hypothesis must be below that")
    assert record.world is not None
    return app.world(case, record.world), proposals[index]


def _recording_used(recording: CaseRecording) -> dict[str, Any]:
    return {"recording": recording.id, "sealed_data": recording.parts.summary}


def _plain(unknowns: tuple[Unknown, ...]) -> list[dict[str, Any]]:
    return [plain(vars(unknown)) for unknown in unknowns]


@dataclass(frozen=True)
class _Question:
    """Question to a world and data: equal questions have equal answers."""

    what: str
    case: Case
    world: World
    recording: CaseRecording
    inputs: dict[str, Any]

    @property
    def whole(self) -> dict[str, Any]:
        """Everything that determines the answer."""
        return {
            "method": METHOD,
            "what": self.what,
            "world": self.world.id,
            "recording": self.recording.id,
            **self.inputs,
        }


def _found_or_computed(
    app: App,
    question: _Question,
    compute: Callable[[Progress], Outcome],
    answer: Callable[[Outcome], Answer],
    patience: float,
) -> Answer | LongWork:
    """The stored outcome of an equal question, else the work that finds it."""
    key = app.store.fits.key(KIND, question.whole)
    kept = app.store.fits.find(KIND, question.whole)
    if kept is not None:
        return replace(answer(_outcome(kept)), record=key)

    def work(progress: Progress) -> Answer:
        with explained():
            outcome = compute(progress)
        document = {
            "summary": outcome.summary,
            "data": plain(outcome.data),
            "world": None if outcome.world is None else outcome.world.model_dump(mode="json"),
        }
        arrays: dict[str, NDArray[Any]] = {
            name: np.frombuffer(content, np.uint8) for name, content in outcome.pictures.items()
        }
        if outcome.numbers is not None:
            document["numbers"], numbers = outcome.numbers.to_record()
            arrays |= numbers
        app.store.fits.put(KIND, question.whole, document, arrays)
        return replace(answer(outcome), record=key)

    return LongWork(
        key=key + question.case.id,
        work=work,
        draft=Answer(
            summary=f"{DOING[question.what]} {question.world.id} on {question.recording.id}",
            data={},
            case=question.case.id,
            world=question.world.id,
            observation=question.recording.id,
            objects=question.world.moving_names,
        ),
        patience=patience,
    )


def _outcome(kept: Content) -> Outcome:
    made = kept.document["world"]
    numbers = kept.document.get("numbers")
    return Outcome(
        kept.document["summary"],
        kept.document["data"],
        {name: content.tobytes() for name, content in kept.arrays.items() if name.endswith(".png")},
        None if made is None else World.model_validate(made),
        None if numbers is None else GapNumbers.of_record(numbers, kept.arrays),
    )
