"""Let a scripted agent answer questions about clips: `python -m tests.benchmarks.examination [--clips scene_1 ...]`.

The policy is fixed and has no language model: OpenCase with ModelVideo (what task.md says is known), CommitWorld, one
Ask with all eight questions, Finish. Clips, tasks and keys are those of ../shared/data/sliding (README there). Of each
clip: yes/no questions that are right, errors of places [m], calls, characters returned (3 a token), wall seconds.
"""

from __future__ import annotations

import argparse
import json
import re
import tempfile
import time
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


async def examine(clip: str, key: Key, folder: Path) -> dict[str, Any]:
    """Answer the questions of a clip, and score them."""
    sizes: list[int] = []
    began = time.perf_counter()
    async with Client(build_server(folder / f"{clip}.db", allow=[FOLDER])) as agent:

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
            return body

        objects = [
            {"name": o["name"], "shape": o["shape"], "mass": o["mass"], "material": o["material"],
             "color": o["name"].split("_")[0]}
            for o in key["objects"]
        ]  # fmt: skip
        points = [{"pixel": [c - 0.5 for c in p["pixel"]], "world": p["world"]} for p in key["calibration"]]
        made = await call(
            "ModelVideo", video=str(FOLDER / clip / "clip.mp4"), name=clip, objects=objects, points=points,
            seconds_per_frame=key["seconds_per_frame"],
        )  # fmt: skip
        await call("CommitWorld", case=clip, world=made["data"]["world"])
        end = (key["clip_frames"] - 1) * key["seconds_per_frame"]
        asked = [question_of(q["question"], end) for q in key["questions"].values()]
        answers = (await call("Ask", case=clip, questions=asked))["data"]["answers"]
        await call("Finish", case=clip, question=clip, answer="see evidence", evidence=[a["evidence"] for a in answers])
    right, errors, inside = [], [], []
    for given, (name, asked_of) in zip(answers, key["questions"].items(), strict=True):
        if name.startswith("n"):
            place = [given["place"][axis] for axis in "xy"]
            errors.append(
                float(np.linalg.norm([p["median"] - t for p, t in zip(place, asked_of["answer"], strict=True)]))
            )
            inside += [p["80%"][0] <= t <= p["80%"][1] for p, t in zip(place, asked_of["answer"], strict=True)]
        else:
            right.append((given.get("probability", 0.5) > 0.5) == (asked_of["answer"] == "yes"))
    return {
        "right": right, "errors": errors, "inside": inside, "calls": len(sizes), "characters": sum(sizes),
        "seconds": time.perf_counter() - began,
    }  # fmt: skip


def main() -> None:
    """Examine all clips and print a line for each."""
    parser = argparse.ArgumentParser(description=__doc__)
    if not (FOLDER / "truth.json").exists():
        parser.exit(1, f"the clips are not there: {FOLDER}\n")
    keys = json.loads((FOLDER / "truth.json").read_text())
    parser.add_argument("--clips", nargs="*", default=list(keys), choices=list(keys))
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for clip in parser.parse_args().clips:
            row = anyio.run(examine, clip, keys[clip], Path(folder))
            rows.append(row)
            places = " ".join(f"{e:.3f}" for e in row["errors"])
            print(f"{clip}: {sum(row['right'])} of {len(row['right'])}, places {places} m, {row['calls']} calls, "
                  f"{row['characters']} characters, {row['seconds']:.0f} s", flush=True)  # fmt: skip
    right, errors, inside = ([x for row in rows for x in row[name]] for name in ("right", "errors", "inside"))
    print(f"all: {sum(right)} of {len(right)}, places {np.median(errors):.3f} m, inside 80% {np.mean(inside):.2f}")


if __name__ == "__main__":
    main()
