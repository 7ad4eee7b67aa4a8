"""Write scenes: `python -m tests.benchmarks.examination_scenes FOLDER [--kinds ...] [--count N] [--seed S]`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.examination_scenes.kinds import HORIZON, KINDS, VIEWS
from tests.benchmarks.examination_scenes.picture import Camera, calibration, draw_camera, film
from tests.benchmarks.examination_scenes.questions import Asker, Question
from tests.benchmarks.examination_scenes.water import DENSITY
from tests.benchmarks.examination_scenes.world import GRAVITY, SAMPLE, Array, Run, Scene, simulate

RATES = (24, 25, 30, 48, 50, 60)  # [1/s]
SHOWN = 10  # frames that every moving body is in the picture for
TRIES = 200


def known(scene: Scene, camera: Camera, points: list[dict[str, Any]], side: bool) -> dict[str, Any]:
    """Return what a person who filmed the scene would state."""
    objects = []
    for body in scene.named:
        colour, material, _ = body.name.split("_")
        objects.append(
            {"name": body.name, "shape": body.shape, "color": colour, "material": material, "mass": body.mass}
        )
    fixed: list[dict[str, Any]] = []
    for thing in scene.fixed:
        entry: dict[str, Any] = {"name": thing.name, "kind": thing.kind, "position": list(thing.position)}
        if thing.kind == "box":
            entry |= {"half_extents": list(thing.half), "slope_about_y": thing.slope}
        elif thing.kind == "pulley":
            entry |= {"radius": thing.half[0], "axis": [0, 1, 0]}
        fixed.append(entry)
    strings = [
        {"kind": "rod" if s.rigid else "string", "over": s.over, "objects": list(s.bodies), "length": s.length}
        for s in scene.strings
    ]
    result = {"objects": objects, "fixed": fixed, "strings": strings, "gravity": GRAVITY, "floor_height": 0.0}
    if scene.soft is not None:
        soft = scene.soft
        bead = {"bead_at_end": soft.bead.name} if soft.bead else {"normal": [1, 0, 0], "held_by": "its upper edge"}
        result["soft"] = {"name": soft.name, "top": list(soft.top), "length": soft.length, "mass": soft.mass, **bead}
    if scene.water is not None:
        (long, deep, tall), (x, z, far, high) = scene.water.size, scene.water.block
        result["water"] = {
            "tank": {"x": [0.0, long], "y": [-deep / 2, deep / 2], "z": [0.0, tall]}, "density": DENSITY,
            "at_first": {"x": [x, far], "z": [z, high]},
        }  # fmt: skip
    return {**result, "picture_size": list(camera.size), "calibration": points, "side_view": side}


def clip_frames(rng: np.random.Generator, kind: str, scene: Scene, run: Run, rate: int) -> int | None:
    """Return after how many frames the clip ends: before most contacts, after a bounce of a throw; or None."""
    firsts = [float(np.argmax(gap <= 0.0)) * SAMPLE for gap in run.gaps.values() if (gap <= 0.0).any()]
    if kind == "throw":
        paths = [(run.places[b.name][:, 2] - b.half[0] < 1e-3) for b in scene.bodies]
        firsts = [max(float(np.argmax(path)) * SAMPLE for path in paths) + 5 / rate + rng.uniform(0, 0.2)]
    elif kind == "water":
        firsts = [wetted(scene, run) + rng.uniform(0.1, 0.3)]
    elif kind == "soft":
        thrown = scene.bodies[0]
        firsts = [-thrown.position[0] / thrown.velocity[0] + rng.uniform(-0.02, 0.15)]
    first = min(firsts, default=1.0) + (rng.uniform(-0.03, 0.03) if kind in ("slide", "roll", "hang") else 0.0)
    count = int(min(first, rng.uniform(0.5, 1.2)) * rate) + 1
    return count if 12 <= count <= 40 else None


def wetted(scene: Scene, run: Run) -> float:
    """Return when a column of water comes to a first body, or a last body into a tank of water [s]."""
    assert scene.water is not None
    times, cell = [], scene.water.size[0] / len(run.filled[0])
    for body in scene.bodies:
        ends = ((run.places[body.name][:, [0, 2]] + s * body.half[0]) / cell for s in (-1, 1))
        boxes = zip(run.filled, *(e.astype(int).clip(0) for e in ends), strict=True)
        wet = [bool((f[low[0] : high[0] + 1, low[1] : high[1] + 1] > 0.5).any()) for f, low, high in boxes]
        times.append(float(np.argmax(wet)) * SAMPLE if any(wet) else np.inf)
    return max(times) if scene.water.block[2] == scene.water.size[0] else min(times)


def sound(scene: Scene, run: Run) -> bool:
    """Return whether energy does not grow (by over 1% of what moves), no weight meets its pulley, no water the lid."""
    kinetic = sum(b.mass * sum(v * v for v in b.velocity) / 2 + 0.05 * b.mass * GRAVITY for b in scene.bodies)
    tops = [f.position[2] - 0.2 for f in scene.fixed if f.kind == "pulley"]
    high = max(float(path[:, 2].max()) for path in run.places.values())
    kinetic += 0.5 * run.energy[0] if scene.water is not None else 0.0
    dry = all(float(filled[:, -1].max()) < 0.5 for filled in run.filled)
    return dry and bool(run.energy.max() <= run.energy[0] + 0.01 * kinetic and all(high < top for top in tops))


def draw(kind: str, seed: int, path: Path | None) -> dict[str, Any]:
    """Draw a scene with its questions, and film it into a folder if one is given."""
    rng = np.random.default_rng([list(KINDS).index(kind), seed])
    view, horizon = VIEWS[kind], HORIZON[kind]
    for _ in range(TRIES):
        scene, rate = KINDS[kind](rng, seed), int(rng.choice(RATES[3:] if kind == "water" else RATES))
        count = clip_frames(rng, kind, scene, simulate(scene, 1.5, 1), rate)
        if count is None:
            continue
        at = [k / rate for k in range(count)]
        asker = Asker(rng, scene, at[-1], horizon, "xy" if view == "above" else "xz")
        run = asker.fact.truth
        places = extent(scene, run, at)
        camera = draw_camera(rng, places, view)
        seen = all(camera.sees(np.array([run.place(b.name, t) for t in at])).sum() >= SHOWN for b in scene.named)
        if not seen or not sound(scene, run):
            continue
        questions = asker.draw()
        if questions is None or not all(sound(w.scene, w.truth) for w in asker.changed if "truth" in w.__dict__):
            continue
        points = calibration(rng, camera, places)
        if points is None:
            continue
        if path is not None:
            path.mkdir(parents=True, exist_ok=True)
            film(rng, scene, run, camera, at, path / "clip.mp4")
        return {
            "kind": kind, "seed": seed, "clip_frames": count, "seconds_per_frame": 1 / rate,
            "known": known(scene, camera, points, view == "side"), "questions": questions,
            "stays": {f"q{i + 1}": stay for i, q in enumerate(questions) if (stay := q_stays(q)) is not None},
        }  # fmt: skip
    raise RuntimeError(f"no {kind} scene of seed {seed} passed the checks in {TRIES} draws")


def q_stays(question: Question) -> float | None:
    """Take the distance from the last frame's place out of a question."""
    stay: float | None = question.pop("stays", None)
    return stay


def extent(scene: Scene, run: Run, at: list[float]) -> Array:
    """Return places (n, 3) that the picture must show: paths during the clip, fixed things, what hangs."""
    shown = [run.place(b.name, t) for b in scene.named for t in at]
    for thing in scene.fixed:
        along = np.array([np.cos(thing.slope), 0.0, -np.sin(thing.slope)]) * thing.half[0]
        shown += [np.array(thing.position) + s * along for s in (-1, 1)]
    if scene.soft is not None:
        shown.append(np.array(scene.soft.top))
    middle = np.mean([b.position for b in scene.bodies], axis=0)
    shown += [np.array([*middle[:2], 0.0])]
    return np.array(shown)


def main() -> None:
    """Write the scenes asked for."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=list(KINDS))
    parser.add_argument("--count", type=int, default=4)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    for kind in options.kinds:
        for seed in range(options.seed, options.seed + options.count):
            path = options.folder / f"{kind}_{seed}"
            scene = draw(kind, seed, path)
            (path / "scene.json").write_text(json.dumps(scene, indent=1))
            print(f"{path.name}: {scene['clip_frames']} frames of {scene['seconds_per_frame']:.4f} s", flush=True)


if __name__ == "__main__":
    main()
