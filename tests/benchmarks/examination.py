"""Let a scripted agent answer questions about clips: `python -m tests.benchmarks.examination [--clips scene_1 ...]`.

The policy is fixed and has no language model: ModelVideo with what is known, CommitWorld, one Ask with all eight
questions, Finish. Clips, tasks and keys are those of ../shared/data/sliding (README there), or with --scenes FOLDER
those that `tests.benchmarks.examination_scenes` wrote. Of each clip: yes/no questions that are right, errors of places
[m], calls, characters returned (3 a token), wall seconds; in all also errors over that of staying at the last frame,
and how many intervals hold. Scenes without a policy (pulleys, ropes, cloth) and clips that end in an error count as
wrong.
"""

from __future__ import annotations

import argparse
import json
import re
import tempfile
import time
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

    stays: for places, how far they are from that in the last frame; empty where not known.
    """

    name: str
    clip: Path
    known: dict[str, Any] | None
    questions: list[dict[str, Any]]
    answers: list[str | dict[str, float]]
    stays: list[float]


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
    return Task(folder.name, folder / "clip.mp4", _known(scene), questions, answers, list(scene["stays"].values()))


def _known(scene: Key) -> dict[str, Any] | None:
    """Return what is known of a scene as arguments of ModelVideo; None where the policy has no words for it."""
    known, build = scene["known"], {}
    if "soft" in known or any(f["kind"] == "pulley" for f in known["fixed"]):
        return None
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
    found |= {"seconds_per_frame": scene["seconds_per_frame"]} | ({"build": build} if build else {})
    if known["side_view"]:
        found |= {"motion_plane": {"point": [0, 0, 0], "normal": [0, -1, 0]}, "floor": known["floor_height"]}
    return found


def _points(calibration: list[Key]) -> list[dict[str, Any]]:
    """Return calibration points with 0, 0 at the centre of the first pixel."""
    return [{"pixel": [c - 0.5 for c in p["pixel"]], "world": p["world"]} for p in calibration]


async def answered(task: Task, folder: Path, sizes: list[int]) -> list[dict[str, Any]]:
    """Return the answers that the policy gets. sizes: takes the number of characters of each result."""
    assert task.known is not None, "no policy for what it shows"
    async with Client(build_server(folder / f"{task.name}.db", allow=[task.clip.parent])) as agent:

        async def call(tool: str, **arguments: Any) -> dict[str, Any]:
            result = await agent.call_tool(tool, arguments)
            text = result.content[0].text
            assert not result.is_error, text
            sizes.append(len(text))
            body: dict[str, Any] = json.loads(text)
            while body["status"] == "running":
                result = await agent.call_tool("ReadEvidence", {"evidence": body["evidence"], "wait_seconds": 50})
                sizes.append(len(result.content[0].text))
                body = json.loads(result.content[0].text)
            assert body["status"] == "completed", body["summary"]
            return body

        made = await call("ModelVideo", video=str(task.clip), name=task.name, **task.known)
        await call("CommitWorld", case=task.name, world=made["data"]["world"], even_if_failed=True)
        there = {*made["objects"], *(o["name"] for o in task.known.get("build", {}).get("obstacles", []))}
        asked = [q for q in task.questions if _names(q) <= there]  # the others cannot be answered
        given = iter((await call("Ask", case=task.name, questions=asked))["data"]["answers"])
        answers: list[dict[str, Any]] = [next(given) if q in asked else {} for q in task.questions]
        cited = [a["evidence"] for a in answers if a]
        await call("Finish", case=task.name, question=task.name, answer="see evidence", evidence=cited)
        return answers


def _names(question: dict[str, Any]) -> set[str]:
    """Return the objects that a question names."""
    parts = [question, question.get("predicate", {}), *question.get("edits", [])]
    return {part[key] for part in parts for key in ("object", "a", "b") if key in part}


async def examine(task: Task, folder: Path) -> dict[str, Any]:
    """Answer the questions of a clip, and score them."""
    sizes: list[int] = []
    began, failed = time.perf_counter(), ""
    try:
        answers = await answered(task, folder, sizes)
    except (AssertionError, BaseExceptionGroup) as error:
        while isinstance(error, BaseExceptionGroup):
            error = error.exceptions[0]
        if not isinstance(error, AssertionError):
            raise
        answers, failed = [{}] * len(task.questions), str(error)[:200]
    right, errors, inside = [], [], []
    for given, true in zip(answers, task.answers, strict=True):
        if isinstance(true, str):
            right.append("probability" in given and (given["probability"] > 0.5) == (true == "yes"))
            continue
        place = given.get("place")
        off = [np.inf if place is None else place[axis]["median"] - t for axis, t in true.items()]
        errors.append(float(np.linalg.norm(off)))
        inside += [place["80%"][0] <= t <= place["80%"][1] for place, t in
                   ((place[axis], t) for axis, t in true.items())] if place else []  # fmt: skip
    return {
        "right": right, "errors": errors, "inside": inside, "calls": len(sizes), "characters": sum(sizes),
        "stays": task.stays, "seconds": time.perf_counter() - began, "failed": failed,
    }  # fmt: skip


def main() -> None:
    """Examine all clips and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=Path, help="folder that examination_scenes wrote; default: the sliding clips")
    parser.add_argument("--clips", nargs="*", help="names of some clips; default: all")
    asked = parser.parse_args()
    if asked.scenes is not None:
        tasks = [scene_task(path.parent) for path in sorted(asked.scenes.glob("*/scene.json"))]
    elif (FOLDER / "truth.json").exists():
        tasks = [sliding_task(*item) for item in json.loads((FOLDER / "truth.json").read_text()).items()]
    else:
        parser.exit(1, f"the clips are not there: {FOLDER}\n")
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for task in tasks:
            if asked.clips and task.name not in asked.clips:
                continue
            row = anyio.run(examine, task, Path(folder))
            rows.append(row)
            places = " ".join(f"{e:.3f}" for e in row["errors"])
            print(f"{task.name}: {sum(row['right'])} of {len(row['right'])}, places {places} m, {row['calls']} calls, "
                  f"{row['characters']} characters, {row['seconds']:.0f} s {row['failed']}", flush=True)  # fmt: skip
    every = {name: [x for row in rows for x in row[name]] for name in ("right", "errors", "inside", "stays")}
    over = f", over stays {np.median(every['errors']) / np.median(every['stays']):.3f}" if every["stays"] else ""
    print(f"all: {sum(every['right'])} of {len(every['right'])}, places {np.median(every['errors']):.3f} m{over}, "
          f"inside 80% {np.mean(every['inside']):.2f}")  # fmt: skip


if __name__ == "__main__":
    main()
