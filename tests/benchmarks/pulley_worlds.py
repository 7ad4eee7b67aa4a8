"""A rope and pulley scene by tool calls: loads observed, ropes and wheels as the picture shows them, masses fitted.

What a reader of the first picture sees is taken from `outputs.json`: which rope runs over what, where wheels and fixed
points are, and a box round each load. Masses and motion are not. Of each rope the mass of one load is the unit: a video
shows only ratios.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from polyworld.data.tracks import ObservedTracks
from tests.benchmarks.clevrer_tools import Caller
from tests.benchmarks.question_folders import AskedPulleys, Source

NOISE = 0.002  # m, of positions from an annotation
MUCH = 5.0  # by what factor a much heavier thing is heavier
BRANCH = 12  # frames of a branch from whose end directions are read
NEARER = 1.05  # by how much the side that is seen of a load is larger than in the plane of the ropes
SEGMENTS = 8  # of a rope between its ends: straight strands need few
LIGHT = 0.002  # kg/m of rope, of loads of about a kilogram
SEARCH = (0.2, 5.0)  # bounds of a fitted mass over the unit of its rope


@dataclass(frozen=True)
class Layout:
    """What the picture shows. ropes: names that each passes, end to end; kinds, places (x, z) [m], radii by name.

    hung: the load under a movable wheel. offset (x, z) [m]: from these coordinates to those of the tracks.
    """

    ropes: tuple[tuple[str, ...], ...]
    kinds: dict[str, str]
    places: dict[str, tuple[float, float]]
    radii: dict[str, float]
    hung: dict[str, str]
    half_size: float
    seconds_per_frame: float
    offset: tuple[float, float]

    def loads(self, rope: tuple[str, ...]) -> list[str]:
        """Loads of a rope: at its ends and under its movable wheels."""
        return [n for n in rope if self.kinds[n] in ("cube", "sphere")] + [self.hung[n] for n in rope if n in self.hung]


@dataclass(frozen=True)
class Pulled:
    """A committed world. masses by load [units of its rope]; observed: names in the tools by names in questions;
    listed: all in the picture, ropes and wheels too; tracks: (frame, height [m]) rows by load."""

    case: str
    layout: Layout
    masses: dict[str, float]
    rmse: float
    frames: int
    observed: dict[str, str]
    listed: tuple[str, ...]
    tracks: dict[str, Any]


def layout_of(outputs: dict[str, Any], source: Source) -> Layout:
    """Read what the picture shows; raises RuntimeError where a folder lacks the radii and the scale (`made`)."""
    if "made" not in outputs:
        raise RuntimeError(
            "outputs.json has no 'made' (kinds, radius, hung, half_size, seconds_per_frame, heights, camera): "
            "add it as tests.benchmarks.question_clips.write_pulleys writes it"
        )
    made = outputs["made"]
    ropes = tuple(tuple(group[::2]) for group in outputs["relatedGroups"])
    camera = made["camera"]
    scale = camera["pixels_per_m"]
    flat = (camera["pixel"][0] / scale - camera["at"][0], camera["pixel"][1] / scale - camera["at"][1])
    return Layout(
        ropes,
        made["kinds"],
        {n: (float(x), float(z)) for n, (x, z) in outputs["metaSamplingData"]["name2position"].items()},
        made["radius"],
        made["hung"],
        float(made["half_size"]),
        float(made["seconds_per_frame"]),
        flat if source == "video" else (0.0, 0.0),
    )


async def modelled(call: Caller, scene: AskedPulleys, source: Source, scratch: Path) -> Pulled:
    """Observe, build, fit and commit."""
    outputs = json.loads(scene.outputs.read_text())
    layout = layout_of(outputs, source)
    loads = [n for rope in layout.ropes for n in layout.loads(rope)]
    if source == "annotation":
        case, names, frames = await _imported(call, layout, outputs, loads, scratch, scene.number)
    else:
        case, names, frames = await _seen(call, outputs, loads, scene)
    listed = tuple({n for group in outputs["relatedGroups"] for n in group} | set(loads))
    objects, parts, free = _described(layout, names)
    built = await call(
        "BuildWorld",
        case=case,
        seconds_per_frame=layout.seconds_per_frame,
        representation="spatial",
        objects=objects,
        parts=parts,
        only=[names[n] for n in loads],
        floor="none",
    )
    fitted = await call(
        "FitWorld",
        case=case,
        world=built["data"]["world"],
        materials=[],  # two or three masses, each seen in how fast its rope runs
        parameters=[{"paths": [f"objects.{n}.mass"], "lower": SEARCH[0], "upper": SEARCH[1]} for n in free],
        fit_initial_states=False,
    )
    await call("CommitWorld", case=case, world=fitted["data"]["world"], even_if_failed=True)
    masses = {}
    for n in loads:
        read = await call("ReadProperty", case=case, objects=[names[n]], property="mass")
        masses[n] = float(read["data"]["values"][0]["value"])
    tracks = {n: await _heights(call, case, names[n]) for n in loads}
    return Pulled(case, layout, masses, float(fitted["data"]["position_rmse"]), frames, names, listed, tracks)


async def _imported(
    call: Caller, layout: Layout, outputs: dict[str, Any], loads: list[str], scratch: Path, number: str
) -> tuple[str, dict[str, str], int]:
    rng = np.random.default_rng([int(number), 32])
    heights = np.array([outputs["made"]["heights"][n] for n in loads]).T
    x = np.array([layout.places[n][0] for n in loads])
    places = np.stack([np.broadcast_to(x, heights.shape), np.zeros(heights.shape), heights], axis=-1)
    shape = heights.shape
    tracks = ObservedTracks(
        names=tuple(_tool_name(n) for n in loads),
        frames=np.arange(shape[0]),
        seconds_per_frame=layout.seconds_per_frame,
        positions=places + rng.normal(0.0, NOISE, (*shape, 3)) * [1.0, 0.0, 1.0],
        position_sigma=np.full(shape, NOISE),
        orientations=np.full((*shape, 4), np.nan),
        confidence=np.ones(shape),
        orientation_confidence=np.zeros(shape),
        symmetry=(0,) * len(loads),
    )
    file = scratch / "tracks.json"
    file.write_text(json.dumps(tracks.to_dict()))
    case = str((await call("OpenCase", data=str(file)))["case"])
    await call("ImportObservation", case=case, kind="tracks", path=str(file))
    return case, {n: _tool_name(n) for n in loads}, shape[0]


async def _seen(
    call: Caller, outputs: dict[str, Any], loads: list[str], scene: AskedPulleys
) -> tuple[str, dict[str, str], int]:
    opened = await call("OpenCase", video=str(scene.video))
    case = str(opened["case"])
    await call("ObserveObjects", case=case)  # takes a load and its rope for one object
    names = {n: f"{_tool_name(n)}_load" for n in loads}
    seeds = [{"kind": "add", "object": names[n], "frame": 0, "box": _box(outputs, n)} for n in loads]
    await call("ObserveObjects", case=case, corrections=seeds)
    scale = outputs["made"]["camera"]["pixels_per_m"]
    length = {"first_pixel": [0, 100], "second_pixel": [scale, 100], "length": 1.0, "view": "side"}
    await call("CalibrateCamera", case=case, known_length=length)
    return case, names, len(outputs["made"]["heights"][loads[0]])


def _box(outputs: dict[str, Any], name: str) -> list[float]:
    """Left, top, width, height [px] of a load in the first frame."""
    made = outputs["made"]
    x, z = outputs["metaSamplingData"]["name2position"][name]
    camera, scale = made["camera"], made["camera"]["pixels_per_m"]
    half = float(made["half_size"]) * scale * NEARER
    u, v = camera["pixel"][0] + (x - camera["at"][0]) * scale, camera["pixel"][1] - (z - camera["at"][1]) * scale
    return [u - half, v - half, 2 * half, 2 * half]


def _described(layout: Layout, names: dict[str, str]) -> tuple[list[dict[str, Any]], list[dict[str, Any]], list[str]]:
    """Loads, and ropes with wheels and fastenings, for BuildWorld; which loads' masses are to be fitted."""
    dx, dz = layout.offset
    half = layout.half_size

    def at(name: str, up: float = 0.0) -> list[float]:
        x, z = layout.places[name]
        return [x + dx, 0.0, z + dz + up]

    objects, parts, free = [], [], []
    for n, rope in enumerate(layout.ropes):
        cord = f"rope_{n}"
        loads = layout.loads(rope)
        free += [names[m] for m in loads[1:]]
        for name in loads:
            cube = layout.kinds[name] == "cube"
            shape = {"kind": "box", "half_extents": [half] * 3} if cube else {"kind": "sphere", "radius": half}
            heavy = 2.0 if name in layout.hung.values() else 1.0
            objects.append({"name": names[name], "shape": shape, "mass": heavy})
            along = {"part": "slider", "name": f"guide_{names[name]}", "object": names[name], "axis": [0.0, 0.0, 1.0]}
            parts.append({**along, "anchor": at(name)})
        points, wheels = [], []
        for k, name in enumerate(rope):
            kind = layout.kinds[name]
            if kind in ("pulley", "movable"):
                if wheels and layout.kinds[rope[k - 1]] in ("pulley", "movable"):
                    before = rope[k - 1]
                    points.append(_between(at(before), layout.radii[before], at(name), layout.radii[name]))
                wheel = {"part": "pulley", "name": _tool_name(name), "rope": cord, "radius": layout.radii[name]}
                wheel |= {"centre": at(name), "after": len(points) - 1, "turns_positive": kind == "pulley"}
                if kind == "movable":
                    wheel["object"] = names[layout.hung[name]]
                wheels.append(wheel)
            else:
                points.append(at(name, 0.0 if kind == "fixed" else half))
        line = {"part": "rope", "name": cord, "points": points, "segments": SEGMENTS, "linear_density": LIGHT}
        parts += [line, *wheels]
        for end, name in (("start", rope[0]), ("end", rope[-1])):
            held = {"part": "attachment", "name": f"{cord}_{end}", "object": cord, "end": end}
            parts.append(held if layout.kinds[name] == "fixed" else {**held, "to": names[name]})
    return objects, parts, free


def _between(first: list[float], radius: float, second: list[float], other: float) -> list[float]:
    """Return a point of the rope between two wheels: above both, or on the upright strand beside a movable one."""
    if abs(first[2] - second[2]) < 1e-6:
        return [(first[0] + second[0]) / 2, 0.0, first[2] + max(radius, other)]
    return [first[0] + radius, 0.0, (first[2] + second[2]) / 2]


async def _heights(call: Caller, case: str, name: str) -> list[tuple[int, float]]:
    data = (await call("InspectObservedMotion", case=case, object=name, limit=500))["data"]
    column = {c: n for n, c in enumerate(data["columns"])}
    return [(int(r[column["frame"]]), float(r[column["z"]])) for r in data["rows"] if r[column["z"]] is not None]


def _tool_name(name: str) -> str:
    return name.replace(" ", "_")
