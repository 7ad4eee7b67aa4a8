"""One case: modelled, committed and asked by the tools, as an agent does it, into a shard of its own."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from atw_mcp.batch.manifest import ASKS, Entry, ManifestCase, Question
from atw_mcp.batch.shards import CaseResult, keep_result, new_shard, shard_file
from atw_mcp.calls.app import App
from atw_mcp.calls.deferred import DeferredTool
from atw_mcp.calls.jobs import Progress
from atw_mcp.calls.limits import Limits
from atw_mcp.calls.steps import Step, StepFailed, Steps
from atw_mcp.tools import manifest as tools
from evidence_store import StoreError
from evidence_store.merge import copy_contents
from evidence_store.upkeep import prune

END = 3.0  # [s] for the threads of finished work to end before its store is closed
logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class CasePiece:
    """All that determines the shard of a case. allow: folders that may be read. limits: those set, by name."""

    case: ManifestCase
    digest: str
    shards: Path
    allow: tuple[Path, ...] = ()
    limits: dict[str, Any] = field(default_factory=dict)


def run_case(piece: CasePiece) -> CaseResult:
    """Model and ask a case and keep its shard; what fails is part of the result, and the rest goes on."""
    entry = piece.case.entry
    result = CaseResult(entry.id, piece.digest)
    begin = time.monotonic()
    with new_shard(piece.shards, entry.id) as store:
        app = App(store, piece.allow, Limits.model_validate(piece.limits))
        earlier = shard_file(piece.shards, entry.id)
        again = earlier.exists()
        try:
            if again:
                _reuse(app, earlier)
            app.tools = [DeferredTool.from_entry(item) for item in tools.entries()]
            app.store.evidence.number_from(piece.case.first_evidence)
            steps = Steps(app, Progress(), dict.fromkeys((tool.name for tool in app.tools), 1.0))
            with _failures(result, steps, None):
                _model(steps, piece.case, result)
                for question in entry.questions:
                    started = time.monotonic()
                    with _failures(result, steps, question):
                        result.answers.append(_asked(steps, entry, question, result))
                    result.question_seconds[question.id] = round(time.monotonic() - started, 3)
        finally:
            app.stop_work(END)
            app.close()
        if again:
            prune(store, worlds=True)
        result.seconds = round(time.monotonic() - begin, 3)
        keep_result(store, result)
    return result


def _reuse(app: App, earlier: Path) -> None:
    """Take over what was computed for the case before, so that a change of its questions alone repeats no fit."""
    try:
        copy_contents(app.store, earlier)
    except StoreError as error:
        logger.warning("%s; all of it is computed again", error)


@contextmanager
def _failures(result: CaseResult, steps: Steps, question: Question | None) -> Iterator[None]:
    """Turn what a step raises into a row of failures."""
    row: dict[str, Any] = {"case": result.case, "question": None if question is None else question.id}
    try:
        yield
    except StepFailed as error:
        result.failures.append({**row, "step": error.tool, "reason": str(error), "evidence": error.evidence})
    except Exception as error:
        logger.exception("case %s failed after %s", result.case, [step.tool for step in steps.done])
        reason = f"failed unexpectedly ({type(error).__name__}: {error}); the log has the details"
        after = f"after {steps.done[-1].tool}" if steps.done else "OpenCase"
        result.failures.append({**row, "step": after, "reason": reason, "evidence": None})


def _model(steps: Steps, case: ManifestCase, result: CaseResult) -> None:
    """From the entry to a committed world."""
    entry, name = case.entry, case.entry.id
    files = {field: str(path) for field, path in entry.files(case.folder).items()}
    modelling = {**entry.modelling, **_with_world(entry, files.get("world"))}
    fitting = {"seed": entry.seed, **entry.fit}
    opened = {"video": files.get("video"), "data": files.get("tracks")}
    questions = list(dict.fromkeys(question.text for question in entry.questions))
    steps.call(
        "OpenCase",
        name=name,
        **{key: value for key, value in opened.items() if value is not None},
        **({"questions": questions[:50]} if questions and entry.kind != "described" else {}),
    )
    if entry.tracks is not None:
        steps.call("ImportObservation", case=name, kind="tracks", path=files["tracks"], **entry.read)
    if entry.camera is not None:
        steps.call("ImportObservation", case=name, kind="camera", path=files["camera"])
    if entry.kind == "video":
        made = steps.call("ModelVideo", case=name, **modelling, fit=fitting)
        result.verdict, result.doubts = made.data["verdict"], made.data["doubts"]
    else:
        made = steps.call("BuildWorld", case=name, **modelling)
        result.doubts = list(made.data.get("left_out", []))
    if entry.kind == "tracks":
        made = steps.call("FitWorld", case=name, world=made.evidence.world, **fitting)
        result.verdict = made.data["verdict"]
        result.doubts += made.data["warnings"]
    steps.call(
        "CommitWorld",
        case=name,
        world=made.evidence.world,
        **({"even_if_poor": True} if entry.even_if_poor else {}),
    )


def _with_world(entry: Entry, world: str | None) -> dict[str, Any]:
    """Arguments in which the path of a world file is absolute."""
    if world is None:
        return {}
    return {"world": world} if "world" in entry.modelling else {"build": {**entry.modelling["build"], "world": world}}


def _asked(steps: Steps, entry: Entry, question: Question, result: CaseResult) -> dict[str, Any]:
    """Roll out, decide, record the answer; returns its row."""
    rolled = steps.call("Rollout", case=entry.id, **question.arguments("Rollout"))
    asked = steps.call("QueryWorld", rollout=rolled.evidence.rollout, **question.arguments("QueryWorld"))
    evidence, sure = [rolled.evidence.id, asked.evidence.id], None
    if question.how_sure:
        kind = ASKS[asked.data["aggregation"]]
        stated = {"ask": kind, "predicate": question.arguments("QueryWorld")["predicate"]}
        edits, interval = question.arguments("Rollout").get("edits"), asked.data["asked"]
        stated |= ({} if edits is None else {"edits": edits}) | ({} if interval is None else {"interval": interval})
        until = rolled.data["horizon"]["seconds"][1]
        sure = steps.call("Ask", case=entry.id, questions=[stated], horizon_seconds=until).data["answers"][0]
        evidence.append(sure["evidence"])
    row = _answer(asked, sure)
    missing = {"missing": row["missing"]} if row["missing"] else {}
    confident = {} if row["confidence"] is None else {"confidence": row["confidence"]}
    said = {} if row["answer"] is None else {"answer": _in_words(row["answer"], row["unit"])}
    finished = steps.call(
        "Finish", case=entry.id, question=question.text, evidence=evidence, **said, **confident, **missing
    )
    return {
        "case": entry.id,
        "question": question.id,
        "text": question.text,
        **{key: value for key, value in row.items() if key != "confidence"},
        "evidence": [*evidence, finished.evidence.id],
        "fit": result.verdict,
        "doubts": result.doubts,
    }


def _answer(asked: Step, sure: dict[str, Any] | None) -> dict[str, Any]:
    """Return what was found: of a statement what most of the probability says, where that is known, else the best fit.

    sure: the answer over the worlds that the data allow.
    """
    data, about = asked.data, sure or {}
    probability = about.get("probability")
    best = data["value"] if data["decided"] and data["value"] is not None else None
    never = data["verdict"] == "never"
    answer = probability >= 0.5 if probability is not None else "never" if never else best
    units = {"first": "s", "last": "s", "count": "times", "fraction": "1"}
    return {
        "answer": answer,
        "unit": None if isinstance(answer, bool | str | None) else units[data["aggregation"]],
        "probability": probability,
        "interval_80%": (about.get("value") or {}).get("80%"),
        "best_fit": "never" if never else best,
        "confidence": None if probability is None else max(probability, 1.0 - probability),
        "missing": None if answer is not None else data["reason"] or "nothing decides it",
    }


def _in_words(answer: Any, unit: str | None) -> str:
    if isinstance(answer, bool):
        return "true" if answer else "false"
    return f"{answer:.6g} {unit}" if isinstance(answer, int | float) else str(answer)
