"""Cases of the second generator, which was written from a list of effects by someone who knew neither engine nor the
first: effects alone and in pairs, nothing, walls and places, contaminated runs, near misses of a form, discs."""

from __future__ import annotations

from dataclasses import replace
from itertools import product
from typing import Any

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.world import World
from tests.benchmarks.gaps import case as gaps
from tests.benchmarks.gaps.case import NOTHING, Names, noncentrality
from tests.benchmarks.second_generator.cases import Case, Plan, Rejected, build
from tests.benchmarks.second_generator.observe import Track
from tests.benchmarks.second_generator.scene import Array, Body, Launch, Scene
from tests.benchmarks.second_generator.sections import SECTIONS, plans

SUBSTEP = 0.002  # [s]
STYLES = ("a", "b")
COUNT = {"one": 28, "nothing": 6, "pairs": 12, "walls_and_places": 10, "contaminated": 7, "near_misses": 9, "discs": 12}
ATTEMPTS = 200


def listed() -> list[str]:
    """Return sections with styles and numbers."""
    return [
        f"{s} {style} {k}" for k in range(max(COUNT.values())) for s in SECTIONS for style in STYLES if k < COUNT[s]
    ]


def drawn(index: int, level: float, seed: int) -> gaps.Case:
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
        return as_recorded(plan, made)
    raise Rejected(f"no usable draw of {section} {number}")


def _at(plan: Plan, level: float) -> Plan:
    return plan if plan.section == "walls_and_places" else replace(plan, levels=(level,))


def as_recorded(plan: Plan, made: Case) -> gaps.Case:
    """Return a generated case as what the analyst gets, and the key."""
    early = bool(plan.options.get("spin_at_start_only"))
    recording = _recording(made.scene, made.rows, 0, early)
    tau = made.noise.tau if made.noise.kind == "ar1" else 0.0
    rows = sum(len(r.times) * len(r.names) for r in recording.runs)
    name = f"{plan.section} {'+'.join(made.effects) or 'nothing'}"
    weakest = min([made.strength, *made.each])
    return gaps.Case(
        name + (f" ({plan.options['kind']})" if "kind" in plan.options else ""),
        world_of(made.scene, recording),
        recording,
        accepted(made),
        level=made.level,
        held_out=_recording(made.scene, made.held_out, len(made.rows), early),
        noncentrality=noncentrality(weakest, rows, np.exp(-1.0 / tau) if tau else 0.0) if made.effects else np.inf,
        contaminated=Names(f"r{b['run']}" for b in made.bad),
    )


def accepted(made: Case) -> tuple[Names, ...]:
    """Return all sets of names that are right."""
    if not made.effects:
        return NOTHING
    if isinstance(made.accepted, list):
        return tuple(Names(item.split("+")) for item in made.accepted)
    each = [(e, *made.accepted.get(e, ())) for e in made.effects]
    return tuple(dict.fromkeys(Names(names) for names in product(*each)))


Rows = tuple[Track, Array, Launch]


def _recording(scene: Scene, runs: list[Rows], first: int, early: bool) -> Recording:
    """Return runs with six decimals; early: orientations in the first 0.1 s of a run alone."""
    return Recording(tuple(_run(f"r{k}", scene, early, *run) for k, run in enumerate(runs, start=first)))


def _run(name: str, scene: Scene, early: bool, track: Track, present: Array, launch: Launch) -> Run:
    kept, there = present.any(axis=0), present.any(axis=1)
    names = tuple(b.name for b, seen in zip(scene.bodies, there, strict=True) if seen)
    shown = present[there][:, kept].T[..., None]
    places, turns = (np.round(v[there][:, kept].swapaxes(0, 1), 6) for v in (track.x, track.q))
    if scene.planar:
        places[..., 1] = np.nan
    if scene.flat:
        places[..., 2] = np.round([b.height / 2 for b, seen in zip(scene.bodies, there, strict=True) if seen], 6)
    blank = (track.real[kept] - launch.t0 > 0.1)[:, None, None] & early | (not scene.orient)
    times = np.round(track.t[kept], 6)
    return Run(name, names, times, np.where(shown, places, np.nan), np.where(shown & ~blank, turns, np.nan))


def world_of(scene: Scene, recording: Recording) -> World:
    """Return the analyst's base model as a world; bodies start where the first run has them."""
    first, body = recording.runs[0], scene.bodies[0]
    environment: dict[str, Any] = {"gravity": [0.0, 0.0, -9.81]}
    objects = [_object(item, first, scene.flat) for item in scene.bodies]
    if scene.flat:
        environment["motion_plane"] = {"supports": True, "point": [0.0, 0.0, body.height / 2.0]}
        if body.rim_friction > 0.0:  # friction of a pair is the geometric mean
            environment["motion_plane"]["friction"] = body.friction**2 / body.rim_friction
        else:
            objects = [item | {"friction": body.friction} for item in objects]
    statics: list[dict[str, Any]] = []
    if scene.floor and not scene.flat:
        statics.append({"name": "floor", "shape": {"kind": "plane"}})
    for wall in scene.planes:
        if wall.normal[2] < 0.5:
            shape = {"kind": "plane", "normal": wall.normal.tolist()}
            statics.append({"name": wall.name, "shape": shape, "position": wall.point.tolist()})
    time = {"seconds_per_frame": float(np.median(np.diff(first.times))), "substep": SUBSTEP}
    fields = {"objects": objects, "statics": statics, "environment": environment, "time": time}
    return World.model_validate(fields)


def _object(item: Body, first: Run, planar: bool) -> dict[str, Any]:
    seen = first.positions[:, first.names.index(item.name)]
    start = np.nan_to_num(seen[np.isfinite(seen).any(axis=1)][0])
    made: dict[str, Any] = {"name": item.name, "mass": item.mass, "restitution": item.restitution}
    made["position"] = [float(v) for v in start]
    if not planar:
        return made | {"shape": {"kind": "sphere", "radius": item.radius}, "friction": item.friction}
    return made | {
        "representation": "rigid_planar",
        "shape": {"kind": "cylinder", "radius": item.radius, "half_height": item.height / 2.0},
        "friction": item.rim_friction,
        "torsional_radius": 2.0 * item.radius / 3.0,
    }
