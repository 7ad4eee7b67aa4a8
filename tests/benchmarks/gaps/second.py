"""Cases of the second generator, which was written from a list of effects by someone who knew neither engine nor the
first: effects alone and in pairs, nothing, walls and places, contaminated runs, near misses of a form, discs."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.world import World
from tests.benchmarks.gaps.case import NOTHING, Case, Names, noncentrality
from tests.benchmarks.second_generator.cases import Plan, Rejected, build
from tests.benchmarks.second_generator.sections import SECTIONS, plans
from tests.benchmarks.second_generator.write import write_case

SUBSTEP = 0.002  # [s]
STYLES = ("a", "b")
COUNT = {"one": 28, "nothing": 6, "pairs": 12, "walls_and_places": 10, "contaminated": 7, "near_misses": 9, "discs": 12}
ATTEMPTS = 200


def listed() -> list[str]:
    """Return sections with styles and numbers."""
    return [
        f"{s} {style} {k}" for k in range(max(COUNT.values())) for s in SECTIONS for style in STYLES if k < COUNT[s]
    ]


def drawn(index: int, level: float, seed: int) -> Case:
    """Return a case; of style b, walls and places the generator draws the noise itself."""
    section, style, number = listed()[index].split()
    turn = [seed, ord(style), SECTIONS.index(section)]
    plan = plans(section, style, COUNT[section], np.random.default_rng(turn))[int(number)]
    for attempt in range(ATTEMPTS):
        rng = np.random.default_rng([*turn, int(number), attempt])
        if attempt % 25 == 24:  # this plan cannot be met: draw another of the same section
            plan = plans(section, style, 1, rng)[0]
        try:
            made = build(_at(plan, level), rng)
        except Rejected:
            continue
        with TemporaryDirectory() as folder:
            write_case(Path(folder), "case", made, plan, rng)
            return read_case(Path(folder) / "public" / "case", Path(folder) / "private" / "case.json")
    raise Rejected(f"no usable draw of {section} {number}")


def _at(plan: Plan, level: float) -> Plan:
    return plan if plan.section == "walls_and_places" else replace(plan, levels=(level,))


def read_case(public: Path, private: Path) -> Case:
    """Return a case that was written: what the analyst gets, and the truth."""
    truth, scene = json.loads(private.read_text()), json.loads((public / "scene.json").read_text())
    recording = read_runs(public / "data.csv")
    tau = truth["noise"]["tau_samples"]
    each = [e["strength_in_sigma"] for e in truth["detail"]["each"].values()]
    rows = sum(len(r.times) * len(r.names) for r in recording.runs)
    name = f"{truth['section']} {'+'.join(truth['effects']) or 'nothing'}"
    return Case(
        name + (f" ({truth['detail']['options']['kind']})" if "kind" in truth["detail"]["options"] else ""),
        world_of(scene, recording),
        recording,
        accepted(truth),
        level=truth["noise"]["noise_level"],
        held_out=read_runs(public / "held_out.csv"),
        noncentrality=noncentrality(min([truth["strength_in_sigma"], *each]), rows, np.exp(-1.0 / tau) if tau else 0.0)
        if truth["effects"]
        else np.inf,
        contaminated=Names(f"r{b['run']}" for b in truth["detail"]["bad_runs"]),
    )


def accepted(truth: dict[str, Any]) -> tuple[Names, ...]:
    """Return all sets of names that are right."""
    if not truth["effects"]:
        return NOTHING
    if isinstance(truth["accepted"], list):
        return tuple(Names(item.split("+")) for item in truth["accepted"])
    each = [(e, *truth["accepted"].get(e, ())) for e in truth["effects"]]
    return tuple(dict.fromkeys(Names(names) for names in product(*each)))


def read_runs(path: Path) -> Recording:
    """Return all runs of a table; blank cells were not measured."""
    by_run: dict[str, list[dict[str, str]]] = {}
    with path.open() as file:
        for row in csv.DictReader(file):
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
    time = {"seconds_per_frame": float(np.median(np.diff(first.times))), "substep": SUBSTEP}
    fields = {"objects": objects, "statics": statics, "environment": environment, "time": time}
    return World.model_validate(fields)


def _object(item: dict[str, Any], first: Run, planar: bool) -> dict[str, Any]:
    seen = first.positions[:, first.names.index(item["name"])]
    start = np.nan_to_num(seen[np.isfinite(seen).any(axis=1)][0])
    made: dict[str, Any] = {k: item[k] for k in ("name", "mass", "restitution")}
    made["position"] = [float(v) for v in start]
    shape = item["shape"]
    if not planar:
        return made | {"shape": {"kind": "sphere", "radius": shape["radius"]}, "friction": item["friction"]}
    return made | {
        "representation": "rigid_planar",
        "shape": {"kind": "cylinder", "radius": shape["radius"], "half_height": shape["height"] / 2.0},
        "friction": item["rim_friction"],
        "torsional_radius": 2.0 * shape["radius"] / 3.0,
    }
