"""Six clips of sliding and colliding bodies, fitted from true tracks with noise, and where bodies are up to 2 s later.

    python -m tests.benchmarks.sliding [--noise 5mm] [--ablations] [--json]

Data: ../shared/data/sliding (README there): another engine's scenes, 12 to 22 frames before the collisions that are
asked about; of every clip four places, also of the clip without one of its bodies. Errors are medians over the 24
places: of the posterior's median, of the committed world, and of bodies that stay. inside: part of the coordinates
within their 80% intervals. Ablations are of the pooled fit.
"""

from __future__ import annotations

import argparse
import csv
import json
import re
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from polyworld.data.tracks import ObservedTracks
from polyworld.edits.removal import without
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.fit_settings import FitSettings, LinkSettings
from polyworld.estimation.fitted import FittedRun
from polyworld.estimation.study import Study, StudyRun
from polyworld.solver.rollout import simulator
from polyworld.world import Environment, MotionPlane, TimeBase, World
from polyworld.world.description import Appearance
from polyworld.world.parameters import parameter_paths
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder, Sphere

FOLDER = Path(__file__).resolve().parents[2].parent / "shared" / "data" / "sliding"
NOISES = ("5mm", "20mm")
SHAPES: dict[str, tuple[Callable[..., Any], int]] = {"sphere": (Sphere, 0), "box": (Box, 4), "cylinder": (Cylinder, 0)}


def _clip(name: str, truth: dict[str, Any], noise: str, by_object: bool = False) -> StudyRun:
    """Return a clip: its world, of which shapes, masses and, unless `by_object`, materials are given; its tracks."""
    names = [o["name"] for o in truth["objects"]]
    frames, n, step = truth["clip_frames"], len(names), truth["seconds_per_frame"]
    places, turns = np.full((frames, n, 3), np.nan), np.full((frames, n, 4), np.nan)
    sigma = np.zeros((frames, n))
    for row in csv.DictReader((FOLDER / name / f"tracks_{noise}.csv").read_text().splitlines()):
        i, j = int(row["frame"]), names.index(row["object"])
        places[i, j], turns[i, j] = [float(row[c]) for c in "xyz"], [float(row[f"q{c}"]) for c in "wxyz"]
        sigma[i, j] = float(row["sigma"])
    seen = np.isfinite(places[..., 0]).astype(float)
    kinds = [o["shape"]["kind"] for o in truth["objects"]]
    alike = tuple(SHAPES[k][1] for k in kinds)
    tracks = ObservedTracks(tuple(names), np.arange(frames), step, places, sigma, turns, seen, seen, alike)
    objects = []
    for o, kind in zip(truth["objects"], kinds, strict=True):
        shape = SHAPES[kind][0](**{k: v for k, v in o["shape"].items() if k != "kind"})
        look = Appearance(material=None if by_object else o["material"])
        given = {"name": o["name"], "shape": shape, "mass": o["mass"], "appearance": look}
        objects.append(RigidObject(representation="rigid_planar", position=(0.0, 0.0, 0.167), **given))
    time_base, plane = TimeBase(seconds_per_frame=step, frame_count=frames), MotionPlane(friction=0.7)
    world = World(objects=tuple(objects), time=time_base, environment=Environment(motion_plane=plane))
    return StudyRun(name, world, tracks)


def _errors(run: FittedRun, truth: dict[str, Any]) -> list[tuple[float, ...]]:
    """Errors [m] of the posterior's median, the committed world and bodies that stay, and what is inside, by place."""
    end, found = (truth["clip_frames"] - 1) * truth["seconds_per_frame"], []
    for key, asked in truth["questions"].items():
        if not key.startswith("n"):
            continue
        text, answer = asked["question"], np.array(asked["answer"])
        seconds = float(re.findall(r"([\d.]+) s after", text)[0])
        name = re.findall(r"centre of the (.*?) (?:\(|be )", text)[0].replace(" ", "_")
        gone = re.findall(r"If the (.*?) had not", text)
        ends = []
        for world, sample in ((run.start, run.sample), (run.world, {})):
            left = without(world, gone[0].replace(" ", "_")) if gone else world
            known = parameter_paths(left)
            own = {path: v for path, v in sample.items() if path in known}
            count = len(next(iter(own.values()))) if own else 1
            batch = simulator(left, np.array([end + seconds]), n_worlds=count).run(own or None)
            ends.append(batch.positions[:, 0, batch.names.index(name), :2])
        low, high = np.quantile(ends[0], (0.1, 0.9), axis=0)
        places = (np.median(ends[0], axis=0), ends[1][0], np.array(asked["stays"]))
        errors = [float(np.linalg.norm(p - answer)) for p in places]
        found.append((*errors, float(np.mean((low <= answer) & (answer <= high)))))
    return found


def rows(noise: str, ablations: bool) -> list[dict[str, Any]]:
    """Fit all clips together, and each alone; with parts of the method left out, where asked for."""
    truths = json.loads((FOLDER / "truth.json").read_text())
    clips, plain = ([_clip(name, truth, noise, by) for name, truth in truths.items()] for by in (False, True))
    whole, usual, hard = FitOptions(share=0.0), FitSettings(), FitSettings(links=LinkSettings(gain=1e12))
    without_priors = replace(whole, edit=lambda found: [replace(u, prior=None) for u in found])
    coulomb = replace(whole, edit=lambda found: [u for u in found if "damping" not in u.name])
    ways = [("pooled", [clips], whole, usual), ("alone", [[c] for c in clips], whole, usual)]
    if ablations:
        ways += [("impacts hard", [clips], whole, hard), ("constants by object", [plain], whole, usual)]
        ways += [("no priors", [clips], without_priors, usual), ("Coulomb alone", [clips], coulomb, usual)]
    found = []
    for name, studies, options, settings in ways:
        began = time.process_time()
        fits = [fit(Study(tuple(study)), options, settings=settings) for study in studies]
        seconds = (time.process_time() - began) / len(clips)
        errors = np.array([e for f in fits for run in f.runs for e in _errors(run, truths[run.name])])
        middle = dict(zip(("median", "committed", "stays"), np.median(errors[:, :3], axis=0).tolist(), strict=True))
        found.append({"noise": noise, "way": name, **middle, "inside": float(errors[:, 3].mean()), "seconds": seconds})
    return found


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--noise", choices=NOISES, action="append", help="default: all")
    parser.add_argument("--ablations", action="store_true", help="also with parts of the method left out")
    parser.add_argument("--json", action="store_true")
    asked = parser.parse_args()
    if not FOLDER.exists():
        raise SystemExit(f"no data: {FOLDER} is absent")
    line = "{noise:>5}  {way:<20} {median:.3f} m  committed {committed:.3f} m  stays {stays:.2f} m  inside {inside:.2f}"
    for noise in asked.noise or NOISES:
        for row in rows(noise, asked.ablations):
            print(json.dumps(row) if asked.json else f"{line}  {{seconds:.2f}} s a clip".format(**row), flush=True)


if __name__ == "__main__":
    main()
