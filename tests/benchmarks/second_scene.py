"""Read a case of the second generator: its scene as a world, its table as a recording."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.world import World

SUBSTEP = 0.002  # [s]


def read_case(folder: Path) -> tuple[World, Recording, Recording]:
    """Return the base world, the runs to fit and those held out."""
    scene = json.loads((folder / "scene.json").read_text())
    recording = read_runs(folder / "data.csv")
    return world_of(scene, recording), recording, read_runs(folder / "held_out.csv")


def read_runs(path: Path) -> Recording:
    """Return all runs of a table; blank cells were not measured."""
    with path.open() as file:
        rows = list(csv.DictReader(file))
    by_run: dict[str, list[dict[str, str]]] = {}
    for row in rows:
        by_run.setdefault(row["run"], []).append(row)
    return Recording(tuple(_run(name, own) for name, own in by_run.items()))


def _run(name: str, rows: list[dict[str, str]]) -> Run:
    objects = list(dict.fromkeys(row["object"] for row in rows))
    times = sorted({float(row["t"]) for row in rows})
    place = {t: i for i, t in enumerate(times)}
    positions = np.full((len(times), len(objects), 3), np.nan)
    orientations = np.full((len(times), len(objects), 4), np.nan)
    for row in rows:
        at = place[float(row["t"])], objects.index(row["object"])
        for axis, column in enumerate("xyz"):
            if row[column]:
                positions[(*at, axis)] = float(row[column])
        if row.get("qw"):
            orientations[at] = [float(row[c]) for c in ("qw", "qx", "qy", "qz")]
    return Run(f"r{name}", tuple(objects), np.array(times), positions, orientations)


def world_of(scene: dict[str, Any], recording: Recording) -> World:
    """Return the analyst's base model as a world; bodies start where the first run has them."""
    first = recording.runs[0]
    table = scene.get("table")
    objects = [_object(item, first, table is not None) for item in scene["objects"]]
    environment: dict[str, Any] = {"gravity": scene["gravity"]}
    if table is not None:
        rim = scene["objects"][0]["rim_friction"]
        height = scene["objects"][0]["shape"]["height"] / 2.0
        environment["motion_plane"] = {"supports": True, "point": [0.0, 0.0, height]}
        if rim > 0.0:  # friction of a pair is the geometric mean
            environment["motion_plane"]["friction"] = table["friction"] ** 2 / rim
        else:
            objects = [item | {"friction": table["friction"]} for item in objects]
    statics: list[dict[str, Any]] = []
    if scene["floor"] and table is None:
        statics.append({"name": "floor", "shape": {"kind": "plane"}})
    for wall in scene["walls"]:
        shape = {"kind": "plane", "normal": wall["normal"]}
        statics.append({"name": wall["name"], "shape": shape, "position": wall["point"]})
    return World.model_validate(
        {
            "objects": objects,
            "statics": statics,
            "environment": environment,
            "time": {"seconds_per_frame": float(np.median(np.diff(first.times))), "substep": SUBSTEP},
        }
    )


def _object(item: dict[str, Any], first: Run, planar: bool) -> dict[str, Any]:
    seen = first.positions[:, first.names.index(item["name"])]
    start = np.nan_to_num(seen[np.isfinite(seen).any(axis=1)][0])
    made: dict[str, Any] = {
        "name": item["name"],
        "mass": item["mass"],
        "restitution": item["restitution"],
        "position": [float(v) for v in start],
    }
    shape = item["shape"]
    if not planar:
        return made | {"shape": {"kind": "sphere", "radius": shape["radius"]}, "friction": item["friction"]}
    return made | {
        "representation": "rigid_planar",
        "shape": {"kind": "cylinder", "radius": shape["radius"], "half_height": shape["height"] / 2.0},
        "friction": item["rim_friction"],
        "torsional_radius": 2.0 * shape["radius"] / 3.0,
    }
