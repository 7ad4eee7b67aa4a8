"""CLEVRER's questions about one scene, answered by programs run on what the tools say of it."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import anyio
from mcp import Client

from atw_mcp.server import build_server
from tests.benchmarks.clevrer_programs import Happening, Known, NotInScene, answer_choice, answer_words
from tests.benchmarks.clevrer_tools import Caller
from tests.benchmarks.question_folders import Asked, Source
from tests.benchmarks.question_scores import Judged, Question, SceneRun
from tests.benchmarks.question_worlds import Facts, annotated, facts, matched, straight
from tests.scenes.clevrer_events import TOLERANCE

GROUP = "CLEVRER"


def run_clevrer(scene: Asked, source: Source, store: Path | None = None) -> SceneRun:
    """Model a scene and answer its questions; where there is no world, every option counts as not answered.

    store: where its evidence is kept, so that asking again fits nothing again.
    """
    run = SceneRun(scene.number, GROUP, source)
    begin = time.perf_counter()
    found = anyio.run(_work, scene, source, run, store)
    run.seconds = time.perf_counter() - begin
    truth = None if scene.annotation is None else annotated(json.loads(scene.annotation.read_text()))
    line = None if found is None else straight(found.known, found.tracks)
    for asked in scene.questions:
        run.questions.append(_judged(scene.number, asked, found, line, truth, run.failed or ""))
    if found is not None:
        run.figures["rmse"] = found.rmse
    return run


def unanswered(scene: Asked, source: Source, why: str) -> SceneRun:
    """Return a scene of which no question was answered."""
    run = SceneRun(scene.number, GROUP, source, failed=why)
    run.questions = [_judged(scene.number, asked, None, None, None, why) for asked in scene.questions]
    return run


async def _work(scene: Asked, source: Source, run: SceneRun, store: Path | None) -> Facts | None:
    given = scene.video if source == "video" else scene.annotation
    if given is None:
        run.failed = f"the folder has no {source} of scene {scene.number}"
        return None
    with tempfile.TemporaryDirectory() as scratch:
        async with Client(build_server(store or Path(scratch) / "atw.db", allow=[given])) as client:
            call = Caller(client)
            try:
                return await facts(call, scene, source)
            except (RuntimeError, LookupError, ValueError) as error:
                run.failed = f"{type(error).__name__}: {error}"[:500]
                return None
            finally:
                run.calls = call.calls


def _judged(
    number: str, asked: dict[str, Any], found: Facts | None, line: Known | None, truth: Known | None, failed: str
) -> Question:
    choices = asked.get("choices")
    kind = str(asked["question_type"])
    options = []
    for choice in [None] if choices is None else choices:
        right = asked["answer"] if choice is None else choice["answer"] == "correct"
        said, note = (None, failed) if found is None else _said(asked, choice, found.known)
        guess = None if line is None else _said(asked, choice, line)[0]
        options.append(Judged(said, right, guess, note))
    question = Question(number, GROUP, kind, asked["question"], tuple(options), "", _family(asked))
    if question.correct:
        return question
    why = "no world" if found is None else cause(asked, question, found.known, truth)
    return Question(number, GROUP, kind, question.text, question.options, why, question.family)


def _family(asked: dict[str, Any]) -> str:
    """What a majority is counted among: for open questions what is asked for, else the type."""
    return str(asked.get("question_subtype") or (asked["program"][-1] if "choices" not in asked else ""))


def _said(asked: dict[str, Any], choice: dict[str, Any] | None, known: Known) -> tuple[Any, str]:
    try:
        if choice is None:
            return answer_words(asked["program"], known), ""
        return answer_choice(asked["program"], choice["program"], known), ""
    except NotInScene as error:
        return None, str(error)


def cause(asked: dict[str, Any], question: Question, known: Known, truth: Known | None) -> str:
    """Return where a wrong answer comes from: program, observation, fit or prediction."""
    if truth is None:
        return "unknown: no annotation"
    kind = asked["question_type"]
    if kind in ("descriptive", "explanatory"):
        choices = asked.get("choices") or [None]
        by_truth = [_said(asked, c, truth)[0] for c in choices]
        if any(said != o.right for said, o in zip(by_truth, question.options, strict=True)):
            return "program"  # run on the annotation it fails too
    names = matched(known, truth)
    if names is None or any(o.note for o in question.options):
        return "observation"
    if not same_events(known, truth, names):
        return "fit"
    return "prediction" if kind in ("predictive", "counterfactual") else "fit"


def same_events(known: Known, truth: Known, names: dict[str, str]) -> bool:
    """Return whether the annotated collisions are simulated within `TOLERANCE`, and who enters and leaves, no others.

    names: annotated names by those in `known`. When a thing enters depends on whether its middle or its rim counts.
    """

    def listed(events: Sequence[Happening], rename: dict[str, str], kinds: set[str]) -> list[tuple[Any, ...]]:
        named = [(e.kind, tuple(sorted(rename.get(n, n) for n in e.objects)), e.frame) for e in events]
        return sorted(n for n in named if n[0] in kinds)

    mine, real = listed(known.events, names, {"collision"}), listed(truth.events, {}, {"collision"})
    crossing = [[c[:2] for c in listed(*of, {"in", "out"})] for of in ((known.events, names), (truth.events, {}))]
    return (
        crossing[0] == crossing[1]
        and len(mine) == len(real)
        and all(m[1] == r[1] and abs(m[2] - r[2]) <= TOLERANCE for m, r in zip(mine, real, strict=True))
    )
