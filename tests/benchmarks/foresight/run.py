"""A clip through the tools: a world from its video or its true tracks, its future, its edits, its questions."""

from __future__ import annotations

import json
import tempfile
import time
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any, Literal

import anyio
import numpy as np
from mcp import Client
from numpy.typing import NDArray

from atw_mcp.server import build_server
from tests.benchmarks.clevrer_tools import Caller
from tests.benchmarks.foresight.edits import Inexpressible, edits_of, question_of
from tests.benchmarks.foresight.scene import Clip, shape_of, surroundings, true_tracks, video_arguments

Floats = NDArray[np.float64]
Source = Literal["video", "tracks"]

STIRS = 0.01  # m of way, or m/s at the clip's end, from which a body counts as moving after the clip
FLOORED = 0.5  # of a body's height: where a straight line ends that would go through the floor


@dataclass(frozen=True)
class Ending:
    """Distances [m] from where a body truly ends, of the world's prediction and of two guesses; edit: None without.

    predicted: None where the world has no such body.
    """

    body: str
    edit: int | None
    stirs: bool
    predicted: float | None
    straight: float | None
    stays: float | None


@dataclass(frozen=True)
class Answered:
    """A yes/no question: the probability of yes that the ensemble gave, None where it could not be asked."""

    question: int
    kind: str
    group: str
    truth: bool
    probability: float | None
    note: str = ""


@dataclass
class ClipRun:
    """Outcome of one clip from one source. failed: why there is no world, in the tools' words."""

    clip: str
    kind: str
    source: Source
    seconds: float = 0.0
    calls: int = 0
    failed: str | None = None
    verdict: str = ""
    endings: list[Ending] = field(default_factory=list)
    answers: list[Answered] = field(default_factory=list)
    inexpressible: list[str] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self)


def run_clip(clip: Clip, source: Source, *, seed: int = 0, edits: bool = True) -> ClipRun:
    """Model a clip from its video or from its true tracks and ask what comes next; edits: also every edit."""
    found = ClipRun(clip.name, clip.kind, source)
    if clip.inexpressible is not None:
        found.failed = clip.inexpressible
        found.inexpressible.append(clip.inexpressible)
        _unanswered(clip, found)
        return found
    begin = time.perf_counter()
    anyio.run(_work, clip, found, seed, edits)
    found.seconds = time.perf_counter() - begin
    return found


async def _work(clip: Clip, found: ClipRun, seed: int, edits: bool) -> None:
    with tempfile.TemporaryDirectory() as folder:
        async with Client(build_server(Path(folder) / "atw.db", allow=[Path(folder), clip.folder])) as client:
            call = Caller(client)
            try:
                modelled = await _modelled(call, clip, found.source, Path(folder), seed)
            except RuntimeError as error:
                found.failed = str(error)
            else:
                await _probe(call, clip, found, modelled, edits)
            found.calls = call.calls
    if found.failed is not None:
        _unanswered(clip, found)


async def _modelled(call: Caller, clip: Clip, source: Source, folder: Path, seed: int) -> dict[str, Any]:
    """The answer of the fit, by one call from a video, or by import, BuildWorld and FitWorld from tracks."""
    if source == "video":
        return await call("ModelVideo", **video_arguments(clip))
    file = folder / "tracks.json"
    tracks = true_tracks(clip, np.random.default_rng([seed, *clip.name.encode()]))
    file.write_text(json.dumps(tracks.to_dict()))
    case = (await call("OpenCase", data=str(file)))["case"]
    await call("ImportObservation", case=case, kind="tracks", path=str(file))
    seen = {n for n, c in zip(tracks.names, tracks.confidence.T, strict=True) if np.count_nonzero(c) > 1}
    objects = [{"name": b["name"], "shape": shape_of(b)} for b in clip.bodies if b["name"] in seen]
    only = [b["name"] for b in clip.bodies if b["name"] in seen]
    built = await call("BuildWorld", case=case, objects=objects, only=only, **surroundings(clip))
    return await call("FitWorld", case=case, world=built["data"]["world"])


async def _probe(call: Caller, clip: Clip, found: ClipRun, modelled: dict[str, Any], edits: bool) -> None:
    case, world = modelled["case"], modelled["data"]["world"]
    found.verdict = str(modelled["data"]["verdict"])
    await call("CommitWorld", case=case, world=world, even_if_poor=True)  # what it says is scored all the same
    looked = (await call("InspectWorld", case=case, fields=["initial_state"]))["data"]
    names = {item["name"] for item in (*looked["objects"], *looked["statics"])}
    hidden = clip.hidden
    await _branch(call, clip, found, case, None, [], hidden["continuation"], names)
    for number, edit in enumerate(hidden["edits"] if edits else []):
        try:
            wanted = edits_of(clip, looked, edit)
        except Inexpressible as error:
            found.inexpressible.append(f"edit: {error}")
            _unanswered(clip, found, number, str(error))
            continue
        left = names - ({edit["body"]} if edit["op"] == "remove" else set())
        await _branch(call, clip, found, case, number, wanted, edit["outcome"], left)


async def _branch(
    call: Caller,
    clip: Clip,
    found: ClipRun,
    case: str,
    edit: int | None,
    edits: list[dict[str, Any]],
    truth: dict[str, Any],
    names: set[str],
) -> None:
    """Roll one branch out and hold it against the truth; a refusal of the tools counts as not answered."""
    end = float(clip.hidden["continuation"]["end"])
    step, frame = 1.0 / float(clip.hidden["pose_rate"]), float(clip.known["seconds_per_frame"])
    step /= np.ceil(step / frame - 1e-9)  # samples at the times of the truth, no rarer than frames
    try:
        rolled = await call("Rollout", case=case, edits=edits, horizon_seconds=end, sample_seconds=float(step))
    except RuntimeError as error:
        found.inexpressible.append(f"edit {edit}: {error}")
        _unanswered(clip, found, edit, str(error))
        return
    world = rolled["data"]["world"]
    ends = {item["object"]: np.asarray(item["end"]) for item in rolled["data"]["objects"] if item.get("end")}
    for name in truth["names"]:
        if name in {b["name"] for b in clip.bodies}:
            found.endings.append(_ending(clip, name, edit, truth, ends.get(name)))
    for number, question in enumerate(clip.hidden["questions"]):
        if question["edit"] == edit:
            found.answers.append(await _asked(call, clip, case, world, number, question, names))


async def _asked(
    call: Caller, clip: Clip, case: str, world: str, number: int, question: dict[str, Any], names: set[str]
) -> Answered:
    def answered(probability: float | None, note: str = "") -> Answered:
        kind, group = str(question["type"]), str(question["group"])
        return Answered(number, kind, group, bool(question["answer"]), probability, note)

    try:
        asked, opposite = question_of(clip, question, names | {"floor"})
        rows = (await call("Ask", case=case, worlds=[world], questions=[{"ask": "whether", **asked}]))["data"][
            "answers"
        ]
    except (Inexpressible, RuntimeError) as error:
        return answered(None, str(error))
    if "probability" not in rows[0]:
        return answered(None, str(rows[0]["answer"]))
    share = float(rows[0]["probability"])
    return answered(1.0 - share if opposite else share)


def _ending(clip: Clip, name: str, edit: int | None, truth: dict[str, Any], place: Floats | None) -> Ending:
    """Return the errors of a prediction and, without an edit, of a straight line and of a body that stays."""
    poses = np.asarray(truth["poses"][name])[:, :3]
    goal = poses[-1]
    predicted = None if place is None else float(np.linalg.norm(place - goal))
    if edit is not None:
        return Ending(name, edit, True, predicted, None, None)
    frames = clip.hidden["frames"]
    last, velocity = np.asarray(frames["poses"][name])[-1, :3], np.asarray(frames["velocities"][name])[-1, :3]
    line = last + velocity * (float(clip.hidden["continuation"]["end"]) - clip.end)
    line[2] = max(line[2], min(float(last[2]), FLOORED * _height(clip, name)))
    way = np.linalg.norm(np.diff(poses[round(clip.end * clip.hidden["pose_rate"]) :], axis=0), axis=1).sum()
    stirs = bool(way > STIRS or np.linalg.norm(velocity) > STIRS)
    straight, stays = np.linalg.norm(line - goal), np.linalg.norm(last - goal)
    return Ending(name, None, stirs, predicted, float(straight), float(stays))


def _height(clip: Clip, name: str) -> float:
    body = next(b for b in clip.bodies if b["name"] == name)
    return float(body["size"][2] if "size" in body else body.get("length", body["diameter"]))


def _unanswered(clip: Clip, found: ClipRun, edit: int | Literal["all"] | None = "all", why: str = "") -> None:
    """Count questions that cannot be put to any world as unanswered."""
    for number, question in enumerate(clip.hidden["questions"]):
        if edit == "all" or question["edit"] == edit:
            kind, group = str(question["type"]), str(question["group"])
            found.answers.append(
                Answered(number, kind, group, bool(question["answer"]), None, why or found.failed or "")
            )
