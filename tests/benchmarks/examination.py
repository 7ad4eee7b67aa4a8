"""Let a scripted agent answer questions about clips: `python -m tests.benchmarks.examination [--clips scene_1 ...]`.

The policy is fixed and has no language model: ModelVideo with what is known, CommitWorld, one Ask with all eight
questions, Finish. A string over a pulley begins where the weights are seen to begin: ModelVideo and BuildWorld come
before it. What moves at a rope or a cloth is taken to stay in the plane y = 0, as all that the scene states of it does.
Clips, tasks and keys are those of ../shared/data/sliding (README there), or with --scenes FOLDER those that
`tests.benchmarks.examination_scenes` wrote. Of each clip: yes/no questions that are right, errors of places [m], calls,
characters returned (3 a token), wall seconds; in all also errors over that of staying at the last frame, and how many
intervals hold. Clips that end in an error count as wrong.
"""

from __future__ import annotations

import argparse
import json
import re
import tempfile
import time
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import anyio
import numpy as np
from mcp import Client

from atw_mcp.server import build_server
from tests.benchmarks.sliding import FOLDER

Key = dict[str, Any]
WORDS = r"the (\w+ \w+ (?:cube|cylinder|sphere))"
AT_REST = 0.05  # [m/s], as the tasks define it
TURNING = 1e3  # [rad/s], which nothing exceeds
LINKS = 10  # of a rope, or along each edge of a cloth
CELL = 0.02  # [m] of the grid of water
LIGHT = 0.002  # [kg/m], of a string whose mass does not count


def question_of(text: str, end: float) -> dict[str, Any]:
    """Return a question of a task as one of Ask. end: time of the clip's last frame [s]."""
    edits: list[dict[str, Any]] = []
    named = [m.replace(" ", "_") for m in re.findall(WORDS, text)]
    if "had not been there" in text:
        edits = [{"action": "remove", "object": named.pop(0)}]
    elif "had been halved" in text:
        edits = [{"action": "scale_velocity", "object": named.pop(0), "factor": 0.5}]
    late = re.search(r"([\d.]+) s after the (?:moment of the )?clip's last frame|within the next ([\d.]+) s", text)
    early = re.search(r"([\d.]+) s after the first frame|within ([\d.]+) s of the first frame", text)
    if late is not None:
        at, since = end + float(late[1] or late[2]), end
    else:
        assert early is not None, text
        at, since = float(early[1] or early[2]), 0.0
    instant, pair = [at, at], {"a": named[0], "b": named[-1]}
    asked: dict[str, Any]
    if text.lower().startswith("where is") or "where would" in text:
        asked = {"ask": "where", "object": named[0], "at": at}
    elif "collide" in text:
        asked = {"ask": "whether", "predicate": {"predicate": "collides", **pair}, "interval": [since, at]}
    elif "apart" in text:
        distance = float(re.findall(r"less than ([\d.]+) m", text)[0])
        asked = {"predicate": {"predicate": "nearer_than", **pair, "distance": distance}}
        asked |= {"ask": "whether", "interval": instant}
    elif "rest" in text:
        asked = {"predicate": {"predicate": "at_rest", "object": named[0], "speed": AT_REST}}
        asked |= {"ask": "whether", "interval": instant}
    else:
        distance = float(re.findall(r"more than ([\d.]+) m", text)[0])
        asked = {"predicate": {"predicate": "moved_by_more_than", "object": named[0], "distance": distance}}
        asked["predicate"]["since"] = since
        asked |= {"ask": "whether", "interval": instant}
    return {**asked, **({"edits": edits} if edits else {})}


@dataclass(frozen=True)
class Task:
    """A clip with what is known of it, its questions as of Ask, and what is true: yes, no, or places by axis [m].

    stays: for places, how far they are from that in the last frame; empty where not known. scene: of one with a pulley.
    """

    name: str
    clip: Path
    known: dict[str, Any]
    questions: list[dict[str, Any]]
    answers: list[str | dict[str, float]]
    stays: list[float]
    scene: Key | None = None


def sliding_task(clip: str, key: Key) -> Task:
    """Return a task of the six sliding clips."""
    objects = [
        {"name": o["name"], "shape": o["shape"], "mass": o["mass"], "material": o["material"],
         "color": o["name"].split("_")[0]}
        for o in key["objects"]
    ]  # fmt: skip
    known = {"objects": objects, "points": _points(key["calibration"]), "seconds_per_frame": key["seconds_per_frame"]}
    end = (key["clip_frames"] - 1) * key["seconds_per_frame"]
    questions = [question_of(q["question"], end) for q in key["questions"].values()]
    given = [q["answer"] for q in key["questions"].values()]
    answers = [a if isinstance(a, str) else dict(zip("xy", a, strict=True)) for a in given]
    return Task(clip, FOLDER / clip / "clip.mp4", known, questions, answers, [])


def scene_task(folder: Path) -> Task:
    """Return a task of `tests.benchmarks.examination_scenes`."""
    scene = json.loads((folder / "scene.json").read_text())
    fields = ("ask", "predicate", "object", "at", "interval", "edits")
    questions = [{name: q[name] for name in fields if q.get(name)} for q in scene["questions"]]
    answers: list[str | dict[str, float]] = [
        q["answer"] if isinstance(q["answer"], str) else dict(zip(q["axes"], q["answer"], strict=True))
        for q in scene["questions"]
    ]
    for predicate in (q["predicate"] for q in questions if "predicate" in q):
        predicate |= {"spin": TURNING} if predicate["predicate"] == "at_rest" else {}  # slower, however it turns
    wheels = scene if any(f["kind"] == "pulley" for f in scene["known"]["fixed"]) else None
    stays = list(scene["stays"].values())
    return Task(folder.name, folder / "clip.mp4", _known(scene), questions, answers, stays, wheels)


def _known(scene: Key) -> dict[str, Any]:
    """Return what is known of a scene as arguments of ModelVideo."""
    known, build = scene["known"], dict[str, Any]()
    solids = [f for f in known["fixed"] if f["kind"] == "box"]
    if solids:
        build["obstacles"] = [
            {"name": f["name"], "shape": {"kind": "box", "half_extents": f["half_extents"]}, "position": f["position"],
             "orientation": [float(np.cos(f["slope_about_y"] / 2)), 0.0, float(np.sin(f["slope_about_y"] / 2)), 0.0]}
            for f in solids
        ]  # fmt: skip
    pivots = {f["name"]: f["position"] for f in known["fixed"] if f["kind"] == "pivot"}
    if pivots:
        build["parts"] = [
            {"part": "hinge", "name": f"{s['over']}_{name}", "object": name, "anchor": pivots[s["over"]],
             "axis": [0, 1, 0]}
            for s in known["strings"] for name in s["objects"]
        ]  # fmt: skip
    objects = [{name: o[name] for name in ("name", "shape", "color", "material", "mass")} for o in known["objects"]]
    found = {"objects": objects, "points": _points(known["calibration"])}
    found |= {"seconds_per_frame": scene["seconds_per_frame"]}
    if "soft" in known:
        soft, (x, y, z) = known["soft"], known["soft"]["top"]
        long, mass = soft["length"], soft["mass"]
        if soft["name"] == "rope":
            thing = {
                "part": "rope",
                "points": [[x, y, z], [x, y, z - long]],
                "segments": LINKS,
                "linear_density": mass / long,
            }
            held = [{"end": "start"}, {"end": "end", "to": soft["bead_at_end"]}]
        else:
            sheet = {"corner": [x, y - long / 2, z - long], "edge_u": [0, long, 0], "edge_v": [0, 0, long]}
            thing = {"part": "cloth", "geometry": {"kind": "sheet", **sheet, "divisions": [LINKS, LINKS]}}
            thing["areal_density"] = mass / long**2
            held = [{"region": {"lower": [x - 0.01, y - long, z - 0.01], "upper": [x + 0.01, y + long, z + 0.01]}}]
            build["representation"] = "spatial"
        ends = [{"part": "attachment", "name": f"end_{k}", "object": soft["name"], **end} for k, end in enumerate(held)]
        build["parts"] = [{"name": soft["name"], **thing}, *ends]
        found["fit"] = {"materials": []}
    if "water" in known:
        water, build["representation"] = known["water"], "planar"
        sides = [water["tank"][axis] for axis in "xyz"]
        filled = [water["at_first"]["x"], water["tank"]["y"], water["at_first"]["z"]]
        volume = {"shape": {"kind": "box", "half_extents": [(high - low) / 2 for low, high in filled]},
                  "position": [(high + low) / 2 for low, high in filled]}  # fmt: skip
        grid = {"lower": [low for low, _ in sides], "upper": [high for _, high in sides], "cell": CELL}
        build["parts"] = [
            {"part": "fluid", "name": "water", "density": water["density"], "volumes": [volume]},
            {"part": "fluid_grid", **grid},
        ]
        found["objects"] = [o | {"across": True} if o["shape"]["kind"] == "cylinder" else o for o in objects]
    if build:
        found["build"] = build
    if known["side_view"] or "soft" in known:
        found |= {"motion_plane": {"point": [0, 0, 0], "normal": [0, -1, 0]}, "floor": known["floor_height"]}
    return found


def pulley(scene: Key, places: dict[str, list[float]]) -> dict[str, Any]:
    """Return a string over a pulley between the tops of two weights at these places, for ModelVideo."""
    known, (string,) = scene["known"], scene["known"]["strings"]
    (wheel,) = (f for f in known["fixed"] if f["kind"] == "pulley")
    half = {o["name"]: o["shape"]["half_height"] for o in known["objects"]}
    names = sorted(string["objects"], key=lambda name: places[name][0])
    tops = [[places[name][0], 0.0, places[name][2] + half[name]] for name in names]
    ends = [
        {"part": "attachment", "name": f"end_{k}", "object": "string", "end": end, "to": name}
        for k, (end, name) in enumerate(zip(("start", "end"), names, strict=True))
    ]
    rope = {"part": "rope", "name": "string", "points": tops, "segments": LINKS, "linear_density": LIGHT}
    over = {"part": "pulley", "name": "wheel", "rope": "string", "centre": wheel["position"], "radius": wheel["radius"],
            "after": 0, "axis": [0, 1, 0]}  # fmt: skip
    free = {"materials": [], "parameters": [{"paths": ["pulleys.wheel.bearing_friction"], "fixed": True}]}
    return {"build": {"parts": [rope, *ends, over]}, "fit": free}


def _points(calibration: list[Key]) -> list[dict[str, Any]]:
    """Return calibration points with 0, 0 at the centre of the first pixel."""
    return [{"pixel": [c - 0.5 for c in p["pixel"]], "world": p["world"]} for p in calibration]


class Agent:
    """Calls the tools of a server for a task, and counts the characters that each call returns."""

    def __init__(self, client: Client, task: Task) -> None:
        self._client, self.task = client, task
        self.sizes: list[int] = []
        self.seconds = 0.0
        self.made: dict[str, Any] = {}

    async def call(self, tool: str, **arguments: Any) -> dict[str, Any]:
        """Return the result of a tool, waited for."""
        began = time.perf_counter()
        result = await self._client.call_tool(tool, arguments)
        text = result.content[0].text
        assert not result.is_error, text
        self.sizes.append(len(text))
        body: dict[str, Any] = json.loads(text)
        while body["status"] == "running":
            result = await self._client.call_tool("ReadEvidence", {"evidence": body["evidence"], "wait_seconds": 50})
            self.sizes.append(len(result.content[0].text))
            body = json.loads(result.content[0].text)
        self.seconds += time.perf_counter() - began
        assert body["status"] == "completed", body["summary"]
        return body

    async def model(self) -> None:
        """Make a fitted world of the clip."""
        task = self.task
        self.made = await self.call("ModelVideo", video=str(task.clip), name=task.name, **task.known)
        if task.scene is not None:
            facts = {name: task.known[name] for name in ("objects", "motion_plane", "floor", "seconds_per_frame")}
            seen = await self.call("BuildWorld", case=task.name, **facts)
            places = {o["name"]: o["position"] for o in seen["data"]["objects"]}
            self.made = await self.call("ModelVideo", case=task.name, **pulley(task.scene, places))

    async def answer(self) -> list[dict[str, Any]]:
        """Commit the world last fitted, and ask everything."""
        task = self.task
        await self.call("CommitWorld", case=task.name, even_if_poor=True)
        built = task.known.get("build", {})
        described = [part.get("name", "") for key in ("obstacles", "parts") for part in built.get(key, [])]
        there = {*self.made["objects"], *described}
        asked = [q for q in task.questions if _names(q) <= there]  # the others cannot be answered
        given = iter((await self.call("Ask", case=task.name, questions=asked))["data"]["answers"])
        answers: list[dict[str, Any]] = [next(given) if q in asked else {} for q in task.questions]
        cited = [a["evidence"] for a in answers if a]
        await self.call("Finish", case=task.name, question=task.name, answer="see evidence", evidence=cited)
        return answers


def _names(question: dict[str, Any]) -> set[str]:
    """Return the objects that a question names."""
    parts = [question, question.get("predicate", {}), *question.get("edits", [])]
    return {part[key] for part in parts for key in ("object", "a", "b") if key in part}


async def examine(tasks: list[Task], folder: Path, pooled: bool) -> list[dict[str, Any]]:
    """Answer the questions of all clips, in one store, and score them. pooled: with constants shared by the clips."""
    store = folder / f"{tasks[0].name}.db"
    async with Client(build_server(store, allow=[task.clip.parent for task in tasks])) as client:
        agents = [Agent(client, task) for task in tasks]
        failed = {agent.task.name: (await attempted(agent.model))[1] for agent in agents}
        modelled = [agent for agent in agents if not failed[agent.task.name]]
        if pooled and len(modelled) > 1:
            others = [agent.task.name for agent in modelled[1:]]
            await modelled[0].call("FitWorld", case=modelled[0].task.name, cases=others)
        return [await scored(agent, failed[agent.task.name]) for agent in agents]


async def attempted(step: Callable[[], Awaitable[Any]]) -> tuple[Any, str]:
    """Return what a step gives, or None and the error that a tool returned."""
    try:
        return await step(), ""
    except (AssertionError, BaseExceptionGroup) as error:
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        if not isinstance(error, AssertionError):
            raise
        return None, str(error)[:200]


async def scored(agent: Agent, failed: str) -> dict[str, Any]:
    """Let an agent answer, and compare with the key."""
    task = agent.task
    answers, why = (None, failed) if failed else await attempted(agent.answer)
    right, errors, inside = [], [], []
    for given, true in zip(answers or [{}] * len(task.questions), task.answers, strict=True):
        if isinstance(true, str):
            right.append("probability" in given and (given["probability"] > 0.5) == (true == "yes"))
            continue
        place = given.get("place")
        off = [np.inf if place is None else place[axis]["median"] - t for axis, t in true.items()]
        errors.append(float(np.linalg.norm(off)))
        inside += [place["80%"][0] <= t <= place["80%"][1] for place, t in
                   ((place[axis], t) for axis, t in true.items())] if place else []  # fmt: skip
    return {
        "name": task.name, "right": right, "errors": errors, "inside": inside, "calls": len(agent.sizes),
        "characters": sum(agent.sizes), "stays": task.stays, "seconds": agent.seconds, "failed": why,
    }  # fmt: skip


def main() -> None:
    """Examine all clips and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=Path, help="folder that examination_scenes wrote; default: the sliding clips")
    parser.add_argument("--clips", nargs="*", help="names of some clips; default: all")
    parser.add_argument("--pooled", action="store_true", help="one study: FitWorld(cases=[...]) shares constants")
    asked = parser.parse_args()
    if asked.scenes is not None:
        tasks = [scene_task(path.parent) for path in sorted(asked.scenes.glob("*/scene.json"))]
    elif (FOLDER / "truth.json").exists():
        tasks = [sliding_task(*item) for item in json.loads((FOLDER / "truth.json").read_text()).items()]
    else:
        parser.exit(1, f"the clips are not there: {FOLDER}\n")
    tasks = [task for task in tasks if not asked.clips or task.name in asked.clips]
    sessions = [tasks] if asked.pooled else [[task] for task in tasks]
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for session in sessions:
            for row in anyio.run(examine, session, Path(folder), asked.pooled):
                rows.append(row)
                places = " ".join(f"{e:.3f}" for e in row["errors"])
                print(f"{row['name']}: {sum(row['right'])} of {len(row['right'])}, places {places} m, "
                      f"{row['calls']} calls, {row['characters']} characters, {row['seconds']:.0f} s {row['failed']}",
                      flush=True)  # fmt: skip
    every = {name: [x for row in rows for x in row[name]] for name in ("right", "errors", "inside", "stays")}
    over = f", over stays {np.median(every['errors']) / np.median(every['stays']):.3f}" if every["stays"] else ""
    print(f"all: {sum(every['right'])} of {len(every['right'])}, places {np.median(every['errors']):.3f} m{over}, "
          f"inside 80% {np.mean(every['inside']):.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
