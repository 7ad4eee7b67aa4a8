"""A CLEVRER scene by tool calls: its objects, its events, what comes next, and what happens without each object."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from tests.benchmarks.clevrer_programs import Happening, Known, Thing
from tests.benchmarks.clevrer_tools import Caller, happenings, thing_of
from tests.benchmarks.question_folders import Asked, Source
from tests.scenes.clevrer_data import HALF_SIZE, SECONDS_PER_FRAME

Floats = NDArray[np.float64]

# What is known beforehand of every CLEVRER scene: three shapes of one size.
SHAPES: dict[str, dict[str, Any]] = {
    "cube": {"kind": "box", "half_extents": [HALF_SIZE] * 3},
    "cylinder": {"kind": "cylinder", "radius": HALF_SIZE, "half_height": HALF_SIZE},
    "sphere": {"kind": "sphere", "radius": HALF_SIZE},
}
FUTURE = 50  # frames after the clip in which a predicted event may fall
MOVING = 0.1  # m/s from which an object moves, as in the executor of CLEVRER's authors
LINE = 10  # frames at a track's start or end to which a straight line is fitted
MEETING = 2.2 * HALF_SIZE  # m between centres of objects that touch, of a ball and a cube on average
PICTURE = (480, 320)


@dataclass(frozen=True)
class Track:
    """Observed places (T, 2) [m] of one object, NaN where it was not seen."""

    name: str
    places: Floats


@dataclass(frozen=True)
class Facts:
    """What the tools say of a scene (`known`), the observed tracks, and the rollout's RMSE beside them [m]."""

    known: Known
    tracks: tuple[Track, ...]
    rmse: float


async def facts(call: Caller, scene: Asked, source: Source) -> Facts:
    """Observe or import the scene, fit a planar world, and roll out it and its branches."""
    given = scene.video if source == "video" else scene.annotation
    opened = await call("OpenCase", **{"video" if source == "video" else "data": str(given)})
    case = str(opened["case"])
    if opened["data"]["committed_world"] is None:
        await _model(call, case, scene, source)
    looked = await call("InspectWorld", case=case)
    things = [thing_of(item) for item in looked["data"]["objects"]]
    tracks = tuple([await _track(call, case, t.name) for t in things])
    last = len(tracks[0].places) - 1
    rolled = await call("Rollout", case=case, horizon_frames=last + FUTURE)
    rollout = str(rolled["data"]["rollout"])
    events = await _events(call, rollout)
    without: dict[str, list[Happening]] = {}
    for thing in things:
        removed = [{"action": "remove", "object": thing.name}]
        branch = await call("Rollout", case=case, edits=removed, horizon_frames=last)
        without[thing.name] = await _events(call, branch["data"]["rollout"])
    plane = np.asarray(json.loads(scene.camera.read_text())["H"])
    motion: dict[str, tuple[NDArray[np.bool_], NDArray[np.bool_]]] = {}
    missed: list[Floats] = []
    for track in tracks:
        places, speeds = await _path(call, rollout, track.name, last)
        motion[track.name] = _in_view(places, plane), speeds > MOVING
        missed.append((places - track.places)[~np.isnan(track.places[:, 0])])
    if source == "annotation":  # its world has no camera, and so no entries and exits among its events
        events = sorted([*events, *_passages({n: seen for n, (seen, _) in motion.items()})], key=lambda e: e.frame)

    def moving(name: str, frame: float | None) -> bool | None:
        seen, fast = motion[name]
        if frame is None:
            return bool((fast & seen).any()) if seen.any() else None
        place = min(round(frame), last)
        return bool(fast[place]) if seen[place] else None

    known = Known(
        things,
        [e for e in events if e.frame <= last],
        [e for e in events if e.frame > last],
        float(last),
        moving,
        lambda name: without[name],
    )
    return Facts(known, tracks, float(np.sqrt(np.nanmean(np.concatenate(missed) ** 2))))


async def _model(call: Caller, case: str, scene: Asked, source: Source) -> None:
    """Observe or import, build, fit and commit."""
    shapes: list[dict[str, Any]] = []
    if source == "annotation":
        await call("ImportObservation", case=case, kind="tracks", path=str(scene.annotation))
    else:
        await call("ObserveObjects", case=case)
        plane = json.loads(scene.camera.read_text())
        await call("CalibrateCamera", case=case, homography=plane["H"], plane_z=HALF_SIZE)
        # By the camera BuildWorld reads shapes from silhouettes better than an observation without it.
        draft = await call("BuildWorld", case=case, seconds_per_frame=SECONDS_PER_FRAME, representation="planar")
        looked = await call("InspectWorld", case=case, world=draft["data"]["world"])
        seen = {t.name: t.shape for t in map(thing_of, looked["data"]["objects"])}
        kinds = {**seen, **named_shapes(seen, scene.questions)}
        shapes = [{"name": name, "shape": SHAPES[kind]} for name, kind in kinds.items() if kind in SHAPES]
    built = await call(
        "BuildWorld",
        case=case,
        **({"objects": shapes} if shapes else {}),
        seconds_per_frame=SECONDS_PER_FRAME,
        representation="planar",
        effects=[{"name": "air", "kind": "quadratic_damping"}],
    )
    fitted = await call("FitWorld", case=case, world=built["data"]["world"])
    await call("CommitWorld", case=case, world=fitted["data"]["world"], even_if_failed=True)


def named_shapes(seen: dict[str, str], questions: Sequence[dict[str, Any]]) -> dict[str, str]:
    """Return shapes that questions name of objects, known by their colour, whose shape was not made out."""
    said: dict[str, set[str]] = {}
    for asked in questions:
        for program in (asked["program"], *(c["program"] for c in asked.get("choices", ()))):
            for here, then, after, last in zip(program, program[1:], program[2:], program[3:], strict=False):
                if (then, last) == ("filter_color", "filter_shape"):
                    said.setdefault(here, set()).add(after)
    found = {}
    for name, kind in seen.items():
        color = name.split("_")[0]
        alone = sum(n.split("_")[0] == color for n in seen) == 1
        if kind not in SHAPES and alone and len(said.get(color, ())) == 1:
            (found[name],) = said[color]
    return found


async def _events(call: Caller, rollout: str) -> list[Happening]:
    read = await call("ReadEvents", rollout=rollout, limit=500)
    return happenings(read["data"]["events"])


async def _track(call: Caller, case: str, name: str) -> Track:
    data = (await call("InspectObservedMotion", case=case, object=name, limit=500))["data"]
    column = {c: n for n, c in enumerate(data["columns"])}
    frames = [int(r[column["frame"]]) for r in data["rows"]]
    places = np.full((max(frames) + 1, 2), np.nan)
    for frame, row in zip(frames, data["rows"], strict=True):
        x, y, trust = (row[column[c]] for c in ("x", "y", "position_confidence"))
        if x is not None and y is not None and trust:
            places[frame] = x, y
    return Track(name, places)


async def _path(call: Caller, rollout: str, name: str, last: int) -> tuple[Floats, Floats]:
    """Places (T, 2) [m] and speeds (T,) [m/s] of an object at each frame up to the last."""
    fields = ["frame", "speed", "x", "y"]
    read = await call("ReadTrajectory", rollout=rollout, object=name, frames=[0, last], limit=500, fields=fields)
    column = {c: n for n, c in enumerate(read["data"]["columns"])}
    places, speeds = np.full((last + 1, 2), np.nan), np.zeros(last + 1)
    for row in read["data"]["rows"]:
        frame = min(round(row[column["frame"]]), last)
        places[frame] = row[column["x"]], row[column["y"]]
        speeds[frame] = row[column["speed"]]
    return places, speeds


def _in_view(places: Floats, plane: Floats) -> NDArray[np.bool_]:
    u, v, depth = plane @ np.column_stack([places, np.ones(len(places))]).T
    return (depth > 0) & (u >= 0) & (u < PICTURE[0] * depth) & (v >= 0) & (v < PICTURE[1] * depth)


def annotated(annotation: dict[str, Any]) -> Known:
    """Return what an annotation says of its clip; nothing of what follows, or of what would be without an object."""
    kinds = {
        o["object_id"]: Thing(_words(o), o["color"], o["material"], o["shape"]) for o in annotation["object_property"]
    }
    frames = sorted(annotation["motion_trajectory"], key=lambda f: f["frame_id"])
    rows = [{o["object_id"]: o for o in f["objects"]} for f in frames]
    events = [
        Happening("collision", float(c["frame_id"]), frozenset(kinds[k].name for k in c["object_ids"]))
        for c in annotation["collision"]
    ]
    events += _passages({t.name: np.array([row[k]["inside_camera_view"] for row in rows]) for k, t in kinds.items()})
    by_name = {thing.name: k for k, thing in kinds.items()}

    def moving(name: str, frame: float | None) -> bool | None:
        own = [row[by_name[name]] for row in (rows if frame is None else [rows[round(frame)]])]
        speeds = [float(np.linalg.norm(o["velocity"])) for o in own if o["inside_camera_view"]]
        return any(s > MOVING for s in speeds) if speeds else None

    return Known(list(kinds.values()), sorted(events, key=lambda e: e.frame), last=float(len(rows) - 1), moving=moving)


def _passages(seen: dict[str, NDArray[np.bool_]]) -> list[Happening]:
    """Entries and exits where an object's view flag (T,) changes."""
    found = []
    for name, view in seen.items():
        change, who = np.diff(view.astype(int)), frozenset({name})
        found += [Happening("in", float(f + 1), who) for f in np.flatnonzero(change > 0)]
        found += [Happening("out", float(f + 1), who) for f in np.flatnonzero(change < 0)]
    return found


def _words(item: dict[str, Any]) -> str:
    return f"{item['color']}_{item['material']}_{item['shape']}"


def straight(known: Known, tracks: tuple[Track, ...]) -> Known:
    """What the video alone says: touches between observed tracks, and straight lines where nothing is observed.

    After the clip each object goes on as in its last `LINE` observed frames; without an object, the others go as in
    their first.
    """
    last = int(known.last)
    ahead = {t.name: _line(t.places, last + 1, FUTURE, ending=True) for t in tracks}
    from_start = {t.name: _line(t.places, 0, last + 1, ending=False) for t in tracks}
    seen = {t.name: t.places for t in tracks}
    events = _touches(seen, 0)
    events += _passages({t.name: ~np.isnan(t.places[:, 0]) for t in tracks})

    def moving(name: str, frame: float | None) -> bool | None:
        places = seen[name]
        at = np.flatnonzero(~np.isnan(places[:, 0]))
        near = at if frame is None else at[np.abs(at - frame) <= LINE / 2]
        if len(near) < 2:
            return None
        steps = np.linalg.norm(np.diff(places[near], axis=0), axis=1) / np.diff(near)
        return bool(np.median(steps) / SECONDS_PER_FRAME > MOVING)

    def without(name: str) -> list[Happening]:
        return _touches({n: p for n, p in from_start.items() if n != name}, 0)

    ordered = sorted(events, key=lambda e: e.frame)
    return Known(known.things, ordered, _touches(ahead, last + 1), known.last, moving, without)


def _line(places: Floats, start: int, count: int, *, ending: bool) -> Floats:
    """Return places (count, 2) from frame `start` on a line through the first or last frames that were seen."""
    at = np.flatnonzero(~np.isnan(places[:, 0]))
    at = at[-LINE:] if ending else at[:LINE]
    if len(at) < 2:
        return np.full((count, 2), np.nan)
    slope, middle = np.polyfit(at, places[at], 1)
    return np.asarray(middle + np.arange(start, start + count)[:, None] * slope)


def _touches(paths: dict[str, Floats], start: int) -> list[Happening]:
    names = list(paths)
    found = []
    for i, first in enumerate(names):
        for second in names[i + 1 :]:
            frames = min(len(paths[first]), len(paths[second]))
            apart = np.linalg.norm(paths[first][:frames] - paths[second][:frames], axis=1)
            near = np.flatnonzero(apart < MEETING)
            if len(near):
                found.append(Happening("collision", float(start + near[0]), frozenset({first, second})))
    return sorted(found, key=lambda e: e.frame)


def matched(known: Known, truth: Known) -> dict[str, str] | None:
    """Return annotated names by observed ones; None where not each object was seen, in its colour and shape.

    A material that was misread shows where a question names it.
    """
    unlike = np.array(
        [[2.0 * ((t.color, t.shape) != (r.color, r.shape)) + (t.material != r.material) for r in truth.things]
         for t in known.things]
    ).reshape(len(known.things), len(truth.things))  # fmt: skip
    if len(known.things) != len(truth.things):
        return None
    mine, real = linear_sum_assignment(unlike)
    if (unlike[mine, real] >= 2.0).any():
        return None
    return {known.things[i].name: truth.things[j].name for i, j in zip(mine, real, strict=True)}
