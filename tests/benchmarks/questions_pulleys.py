"""Questions of ContPhy's rope and pulley group about one video, answered from a world's masses and branches."""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import anyio
import numpy as np
from mcp import Client

from atw_mcp.server import build_server
from tests.benchmarks.clevrer_tools import Caller
from tests.benchmarks.pulley_worlds import BRANCH, MUCH, Layout, Pulled, modelled
from tests.benchmarks.question_folders import AskedPulleys, Source
from tests.benchmarks.question_scores import Judged, Question, SceneRun

GROUP = "ContPhy"
KINDS = {
    "mass": "property",
    "tension": "property",
    "color": "property",
    "shape": "property",
    "existence": "property",
    "rope_predictive": "predictive",
    "rope_counterfactual": "counterfactual",
    "rope_counterfactual2": "counterfactual",
    "rope_goaldriven": "goal-driven",
}
EQUAL = 0.04  # share by which masses that count as equal may differ: half the least difference that is drawn
MOVES = 0.01  # m from which a thing moves
LAST = 8  # observed frames to whose end a straight line is fitted


def run_pulleys(scene: AskedPulleys, source: Source, store: Path | None = None) -> SceneRun:
    """Model a video and answer its questions; where there is no world, every option counts as not answered.

    store: where its evidence is kept, so that asking again fits nothing again.
    """
    run = SceneRun(scene.number, GROUP, source)
    begin = time.perf_counter()
    anyio.run(_work, scene, source, run, store)
    run.seconds = time.perf_counter() - begin
    return run


def unanswered(scene: AskedPulleys, source: Source, why: str) -> SceneRun:
    """Return a video of which no question was answered."""
    run = SceneRun(scene.number, GROUP, source, failed=why)
    anyio.run(_ask, scene, run, None)
    return run


async def _work(scene: AskedPulleys, source: Source, run: SceneRun, store: Path | None) -> None:
    allow = [p for p in (scene.outputs, scene.video) if p is not None]
    with tempfile.TemporaryDirectory() as scratch:
        server = build_server(store or Path(scratch) / "atw.db", allow=[Path(scratch), *allow])
        async with Client(server) as client:
            call = Caller(client)
            answering: Answering | None = None
            try:
                answering = Answering(call, await modelled(call, scene, source, Path(scratch)))
                run.figures["rmse"] = answering.world.rmse
            except (RuntimeError, KeyError) as error:
                run.failed = str(error)[:500]
            await _ask(scene, run, answering)
            run.calls = call.calls


async def _ask(scene: AskedPulleys, run: SceneRun, answering: Answering | None) -> None:
    for family, items in scene.questions.items():
        for item in items:
            run.questions.append(await _judged(scene.number, family, item, answering, run.failed or ""))


async def _judged(number: str, family: str, item: dict[str, Any], answering: Answering | None, failed: str) -> Question:
    program = item.get("program")
    options = []
    if item["answer_type"] == "open_ended":
        said, line, note = await _tried(answering, family, program, None, failed)
        options.append(Judged(said, item["answer"], line, note))
    else:
        right = item["answer"].split()
        for letter, feature in program["choices"].items():
            said, line, note = await _tried(answering, family, program, feature, failed)
            options.append(Judged(said, letter in right, line, note))
    question = Question(number, GROUP, KINDS.get(family, family), item["question"], tuple(options), "", family)
    why = "" if question.correct else "no world" if answering is None else _cause(question, family)
    return Question(number, GROUP, question.kind, question.text, question.options, why, family)


def _cause(question: Question, family: str) -> str:
    if any(o.said is None for o in question.options):
        return "program"
    return {"mass": "fit", "color": "observation", "existence": "observation"}.get(family, "prediction")


async def _tried(
    answering: Answering | None, family: str, program: Any, feature: Any, failed: str
) -> tuple[Any, Any, str]:
    if answering is None:
        return None, None, failed
    try:
        return await answering.said(family, program, feature), answering.line(family, program, feature), ""
    except (RuntimeError, KeyError, NotImplementedError) as error:
        return None, None, f"{type(error).__name__}: {error}"


class Answering:
    """Answers features of questions from a world; branches are rolled out once each."""

    def __init__(self, call: Caller, world: Pulled) -> None:
        self.call, self.world = call, world
        self._ends: dict[tuple[str, str], dict[str, float]] = {}

    async def said(self, family: str, program: Any, feature: Any) -> Any:
        """Return what the world says: a word of an open question, or whether an option is right."""
        if family == "mass":
            return self._mass(program)
        if family in ("color", "shape", "existence"):
            return self._counted(family, program)
        if family == "rope_predictive":
            return await self._higher(*program)
        if family in ("rope_counterfactual", "rope_counterfactual2"):
            return self._way(await self._branch(*program["question"][:2]), feature[0], feature[1]) == feature[2]
        if family == "rope_goaldriven":
            name, what, way = program["question"]
            return self._way(await self._branch(*feature[:2]), name, what) == way
        raise NotImplementedError(f"questions of the family {family}")

    def line(self, family: str, program: Any, feature: Any) -> Any:
        """Return what straight lines through the tracks say: the observed direction, whatever is changed."""
        if family == "rope_predictive":
            first, _, second, ahead = program
            return "yes" if self._ahead(first, ahead) > self._ahead(second, ahead) else "no"
        if family in ("rope_counterfactual", "rope_counterfactual2"):
            return self._way(self._observed(), feature[0], feature[1]) == feature[2]
        if family == "rope_goaldriven":
            name, what, way = program["question"]
            return self._way(self._observed(), name, what) == way
        if family == "mass":  # what sinks is heavier than what balances it
            first, second = f"{program[0]} {program[1]}", f"{program[4]} {program[5]}"
            if not self._related(first, second):
                return "can not answer"
            rise = self._moved(first)
            seen = "equal to" if abs(rise) < MOVES else "less than" if rise > 0 else "greater than"
            return "yes" if seen == program[2] else "no"
        return None

    def _related(self, first: str, second: str) -> bool:
        layout = self.world.layout
        return any({first, second} <= set(layout.loads(rope)) for rope in layout.ropes)

    def _mass(self, program: list[str]) -> str:
        first, second = f"{program[0]} {program[1]}", f"{program[4]} {program[5]}"
        if not self._related(first, second):
            return "can not answer"
        factor = {"": 1.0, "twice ": 2.0, "half ": 0.5}[program[3]]
        found = self.world.masses[first] / (factor * self.world.masses[second])
        truth = "equal to" if abs(found - 1.0) < EQUAL else "greater than" if found > 1.0 else "less than"
        return "yes" if truth == program[2] else "no"

    def _counted(self, family: str, program: list[str]) -> str:
        names = self.world.listed
        if family == "color":
            return str(sum(n.split(" ")[0] == program[0] for n in names))
        if family == "shape":
            return str(sum(n.endswith(program[0]) for n in names))
        return "yes" if " ".join(program) in names else "no"

    async def _higher(self, first: str, _: str, second: str, ahead: float) -> str:
        world = self.world
        seconds = (world.frames - 1) * world.layout.seconds_per_frame + ahead
        rolled = await self.call("Rollout", case=world.case, horizon_seconds=seconds)
        ends = {item["object"]: item["end"][2] for item in rolled["data"]["objects"] if item.get("end")}
        return "yes" if ends[world.observed[first]] > ends[world.observed[second]] else "no"

    async def _branch(self, name: str, change: str) -> dict[str, float]:
        """Rise [m] of each load by the end of a branch in which one mass is much changed."""
        if (name, change) not in self._ends:
            world = self.world
            factor = MUCH if change == "increase" else 1 / MUCH
            path = f"objects.{world.observed[name]}.mass"
            edit = {"action": "scale_parameter", "path": path, "factor": factor}
            horizon = BRANCH - 1
            rolled = await self.call("Rollout", case=world.case, edits=[edit], horizon_frames=horizon)
            found = {}
            for load, own in world.observed.items():
                item = next(i for i in rolled["data"]["objects"] if i["object"] == own)
                found[load] = float(item["end"][2] - item["start"][2])
            self._ends[(name, change)] = found
        return self._ends[(name, change)]

    def _observed(self) -> dict[str, float]:
        return {name: self._moved(name) for name in self.world.observed}

    def _moved(self, name: str) -> float:
        heights = [z for _, z in self.world.tracks[name]]
        return float(np.mean(heights[-2:]) - np.mean(heights[:2]))

    def _ahead(self, name: str, ahead: float) -> float:
        rows = self.world.tracks[name][-LAST:]
        slope, middle = np.polyfit([f for f, _ in rows], [z for _, z in rows], 1)
        return float(middle + slope * (self.world.frames - 1 + ahead / self.world.layout.seconds_per_frame))

    def _way(self, rises: dict[str, float], name: str, what: str) -> str:
        return way_of(self.world.layout, rises, name, what)


def way_of(layout: Layout, rises: dict[str, float], name: str, what: str) -> str:
    """Return which way a load or wheel moves or turns, given the rises [m] of all loads."""
    if what == "motion":
        rise = rises.get(layout.hung.get(name, name), 0.0)  # a fixed wheel stays
        return "stationary" if abs(rise) < MOVES else "up" if rise > 0 else "down"
    rope = next(r for r in layout.ropes if name in r)
    paid = -rises[rope[-1]]  # rope that ran to the right end [m]
    if abs(paid) < MOVES:
        return "stationary"
    over = layout.kinds[name] == "pulley"  # the rope runs over a fixed wheel and under a movable one
    return "clockwise" if (paid > 0) == over else "anti-clockwise"
