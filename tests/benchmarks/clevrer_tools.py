"""CLEVRER scenes worked on by nothing but the MCP tools: video or annotation in, events and answers out."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import anyio
import numpy as np
from mcp import Client

from atw_mcp.server import build_server
from tests.benchmarks.clevrer_programs import Happening, Known, NotInScene, Thing, answer_choice
from tests.scenes.clevrer_data import SECONDS_PER_FRAME, Collision, Scene
from tests.scenes.clevrer_events import APART, EventScore, score_collisions

Say = Callable[[str], None]


@dataclass(frozen=True)
class Answer:
    """One choice of a question: what the tools' events say, and what is right; None: it cannot be answered."""

    question: str
    choice: str
    answered: bool | None
    right: bool
    note: str = ""


@dataclass(frozen=True)
class ToolRun:
    """A scene through the tools: RMSE as FitWorld reports it [m], its events against the annotated ones."""

    scene: str
    source: str
    rmse: float
    events: EventScore
    calls: int
    answers: tuple[Answer, ...] = field(default=())


class Caller:
    """A connected client that waits for long work and counts its calls."""

    def __init__(self, client: Client) -> None:
        self._client = client
        self.calls = 0

    async def __call__(self, tool: str, **arguments: Any) -> dict[str, Any]:
        """The result's body; raises RuntimeError with the tool's own words when it refuses."""
        body = await self._once(tool, arguments)
        while body["status"] == "running":
            body = await self._once("ReadEvidence", {"evidence": body["evidence"], "wait_seconds": 50})
        if body["status"] != "completed":
            raise RuntimeError(f"{tool}: {body['status']}: {body['summary']}")
        if body.get("shortened"):  # every item of a list counts here
            body = await self._once("ReadEvidence", {"evidence": body["evidence"], "detail": "full"})
        return body

    async def _once(self, tool: str, arguments: dict[str, Any]) -> dict[str, Any]:
        self.calls += 1
        result = await self._client.call_tool(tool, arguments)
        text = str(getattr(result.content[0], "text", ""))
        if result.is_error:
            raise RuntimeError(f"{tool}: {text}")
        body: dict[str, Any] = json.loads(text)
        return body


def through_tools(scene: Scene, folder: Path, say: Say) -> ToolRun:
    """Model the scene by tool calls, from its video if it has one, else from its annotation; then ask."""
    return anyio.run(_work, scene, folder, say)


async def _work(scene: Scene, folder: Path, say: Say) -> ToolRun:
    with tempfile.TemporaryDirectory() as store:
        allow = [folder] if scene.video is None else [folder, scene.video]
        async with Client(build_server(Path(store) / "atw.db", allow=allow)) as client:
            call = Caller(client)
            if scene.video is not None:
                case = (await call("OpenCase", video=str(scene.video)))["case"]
                await call("ObserveObjects", case=case)
                plane = json.loads((folder / "camera_homography_z0.2.json").read_text())
                await call("CalibrateCamera", case=case, homography=plane["H"], plane_z=0.2)
            else:
                annotation = str(folder / f"annotation_{scene.number}.json")
                case = (await call("OpenCase", data=annotation))["case"]
                await call("ImportObservation", case=case, kind="tracks", path=annotation)
            built = await call(
                "BuildWorld",
                case=case,
                seconds_per_frame=SECONDS_PER_FRAME,
                representation="planar",
                effects=[{"name": "air", "kind": "quadratic_damping"}],
            )
            fitted = await call("FitWorld", case=case, world=built["data"]["world"])
            await call("CommitWorld", case=case, world=fitted["data"]["world"])
            looked = await call("InspectWorld", case=case)
            rolled = await call("Rollout", case=case, horizon_frames=int(scene.tracks.frames[-1]))
            read = await call("ReadEvents", rollout=rolled["data"]["rollout"], limit=500)
    things = [thing_of(item) for item in looked["data"]["objects"]]
    rmse = float(fitted["data"]["position_rmse"])
    source = "annotation" if scene.video is None else "video"
    say(f"{scene.number} through the tools ({source}): {call.calls} calls, rmse {rmse:.4f} m")
    mine = happenings(read["data"]["events"])
    truth = true_happenings(scene)
    known = [Thing(name, *scene.kinds[name]) for name in scene.tracks.names]
    by_look = {(t.color, t.material, t.shape): t.name for t in known}
    names = {t.name: by_look.get((t.color, t.material, t.shape), t.name) for t in things}
    simulated = [
        Collision((first, second), round(e.frame))
        for e in mine
        if e.kind == "collision"
        for first, second in [sorted(names[n] for n in e.objects)]
    ]
    answers = _official(scene, folder, things, mine)
    if scene.video is not None:
        answers += _posed(scene, things, mine, known, truth)
    score = score_collisions(simulated, list(scene.collisions))
    return ToolRun(scene.number, source, rmse, score, call.calls, tuple(answers))


def thing_of(item: dict[str, Any]) -> Thing:
    """Return an object of InspectWorld as questions name it."""
    look = item.get("appearance") or item
    kind = item["shape"]["kind"] if isinstance(item["shape"], dict) else item["shape"]
    shape = "cube" if kind == "box" else kind
    return Thing(item["name"], str(look.get("color")), str(look.get("material")), str(shape))


def happenings(events: list[dict[str, Any]]) -> list[Happening]:
    """Return entries, exits and collisions of ReadEvents, touches within `APART` frames counted once."""
    kinds: dict[str, Literal["in", "out", "collision"]] = {"entry": "in", "exit": "out"}
    latest: dict[frozenset[str], float] = {}
    found: list[Happening] = []
    for event in sorted(events, key=lambda e: float(e["frame"])):
        who = frozenset(event["objects"])
        frame = float(event["frame"])
        if event["kind"] in kinds:
            found.append(Happening(kinds[event["kind"]], frame, who))
        elif event["kind"] in ("contact_begin", "contact_end") and len(who) == 2:
            if event["kind"] == "contact_begin" and frame - latest.get(who, -1e9) > APART:
                found.append(Happening("collision", frame, who))
            latest[who] = frame
    return found


def true_happenings(scene: Scene) -> list[Happening]:
    """Collisions of the annotation, and entries and exits where an object's view flag changes."""
    found = [Happening("collision", float(c.frame), frozenset(c.pair)) for c in scene.collisions]
    for column, name in enumerate(scene.tracks.names):
        change = np.diff(scene.visible[:, column].astype(int))
        found += [Happening("in", float(f + 1), frozenset({name})) for f in np.flatnonzero(change > 0)]
        found += [Happening("out", float(f + 1), frozenset({name})) for f in np.flatnonzero(change < 0)]
    return sorted(found, key=lambda e: e.frame)


def _official(scene: Scene, folder: Path, things: list[Thing], events: list[Happening]) -> list[Answer]:
    """Return the official explanatory questions of the scene, if the folder has any."""
    answers: list[Answer] = []
    for path in sorted(folder.glob("questions_*.json")):
        for question in json.loads(path.read_text()).get(str(int(scene.number)), {}).get("questions", []):
            if question["question_type"] != "explanatory":
                continue
            for choice in question["choices"]:
                right = choice["answer"] == "correct"
                try:
                    said = answer_choice(question["program"], choice["program"], Known(things, events))
                    answers.append(Answer(question["question"], choice["choice"], said, right))
                except NotInScene as error:
                    answers.append(Answer(question["question"], choice["choice"], None, right, str(error)))
    return answers


def _posed(
    scene: Scene, things: list[Thing], mine: list[Happening], known: list[Thing], truth: list[Happening]
) -> list[Answer]:
    """For every annotated collision: which objects' presence is responsible? Right is what the annotation gives."""
    looks = {t.name: t for t in known}
    answers: list[Answer] = []
    for collision in scene.collisions:
        first, second = (looks[n] for n in collision.pair)
        question = ["events", "events", *_meaning(first), "filter_collision", *_meaning(second), "filter_collision"]
        question += ["unique", "filter_ancestor", "belong_to"]
        text = f"responsible for the collision of {first.name} and {second.name}"
        for thing in known:
            if thing.name in collision.pair:
                continue
            right = answer_choice(question, _meaning(thing), Known(known, truth))
            try:
                said = answer_choice(question, _meaning(thing), Known(things, mine))
                answers.append(Answer(text, f"presence of {thing.name}", said, right))
            except NotInScene as error:
                answers.append(Answer(text, f"presence of {thing.name}", None, right, str(error)))
    return answers


def _meaning(thing: Thing) -> list[str]:
    return [
        "objects",
        thing.color,
        "filter_color",
        thing.material,
        "filter_material",
        thing.shape,
        "filter_shape",
        "unique",
    ]
