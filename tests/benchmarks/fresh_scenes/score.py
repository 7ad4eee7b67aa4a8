"""Fit clips and score what is predicted beyond them: `python -m tests.benchmarks.fresh_scenes.score [--seeds 0-4]`.

A table by family: error of the posterior's median, and of the fitted world, 0.5, 1 and 2 s after the clip over that of
staying at the last frame (ratio of medians, and of means), coverage of 80% intervals with the model's error, and
processor seconds a clip. Heights count in coverage where they change. Sensitive bodies do not count. Scenes are written
to --folder when missing. Worlds are planar or spatial as BuildWorld chooses. Set OMP_NUM_THREADS=1, so that processor
seconds are those of one thread.
"""

import argparse
import csv
import itertools
import json
import tempfile
import time
from pathlib import Path
from typing import Any, Literal

import numpy as np

from atw_mcp.worlds.parts import Parts
from atw_mcp.worlds.representation_choice import choose
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.accuracy import travelled_by_axis, with_model_error
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.fitted import StudyFit
from polyworld.solver.rollout import simulator
from polyworld.world import Environment, MotionPlane, StaticObject, TimeBase, World
from polyworld.world.description import Appearance
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere
from tests.polyworld.synthetic import of_one

from .draw import FAMILIES, scenes
from .write import write

AFTER = (0.5, 1.0, 2.0)  # [s]
SHAPES = {"sphere": Sphere, "box": Box, "cylinder": Cylinder}
PACE = 0.05  # [s] between the places along which the distance travelled is measured
CHANGES = 0.02  # [m] by which a height must differ from the last seen to count in coverage


def shape(given: dict[str, Any]) -> Sphere | Box | Cylinder:
    """Return a shape by its kind and sizes."""
    made: Sphere | Box | Cylinder = SHAPES[given["kind"]](
        **{k: given[k] for k in ("radius", "half_height", "half_extents") if k in given}
    )
    return made


def world_of(task: dict[str, Any], tracks: ObservedTracks) -> World:
    """Return the world that a user builds of what is known: shapes, masses, materials, floor and ramp."""
    shapes = {o["name"]: shape(o["shape"]) for o in task["objects"]}
    others = [
        StaticObject(name=s["name"], shape=shape(s), position=tuple(s["position"]),
                     orientation=tuple(s["orientation"]), appearance=Appearance(material=s["material"]))
        for s in task["statics"]
    ]  # fmt: skip
    heights = {o["name"]: o["shape"].get("radius", 0.0) for o in task["objects"]}
    heights |= {n: getattr(s, "half_height", heights[n]) for n, s in shapes.items()}
    heights |= {n: s.half_extents[2] for n, s in shapes.items() if isinstance(s, Box)}
    chosen = choose("auto", tracks, heights, shapes, statics=tuple(others), plane=None, gravity=tuple(task["gravity"]),
                    parts=Parts(), heights_assumed=False)  # fmt: skip
    planar = chosen.kind == "planar"
    kind: Literal["rigid_planar", "rigid_spatial"] = "rigid_planar" if planar else "rigid_spatial"
    objects = tuple(
        RigidObject(name=o["name"], representation=kind, shape=shapes[o["name"]], mass=o["mass"],
                    position=(0, 0, 1), appearance=Appearance(material=o["material"]))
        for o in task["objects"]
    )  # fmt: skip
    clock = TimeBase(seconds_per_frame=task["seconds_per_frame"], frame_count=task["frames"])
    if planar:
        return World(objects=objects, time=clock, environment=Environment(motion_plane=MotionPlane(friction=0.7)))
    floor = StaticObject(name="floor", shape=Plane(), appearance=Appearance(material=task["floor"]["material"]))
    return World(objects=objects, time=clock, statics=(floor, *others))


def tracks_of(task: dict[str, Any], path: Path) -> ObservedTracks:
    """Read a table of tracks."""
    names = [o["name"] for o in task["objects"]]
    rows = list(csv.DictReader(path.read_text().splitlines()))
    numbers = np.array([[float(r[c]) for c in ("x", "y", "z", "qw", "qx", "qy", "qz", "sigma")] for r in rows])
    numbers = numbers.reshape(task["frames"], len(names), 8)
    seen = np.ones(numbers.shape[:2])
    return ObservedTracks(
        tuple(names), np.arange(task["frames"]), task["seconds_per_frame"], numbers[..., :3], numbers[..., 7],
        numbers[..., 3:7], seen, seen, (1,) * len(names),
    )  # fmt: skip


def rows_of(found: StudyFit, task: dict[str, Any], key: dict[str, Any], planar: bool) -> list[dict[str, Any]]:
    """Return for every body that is not sensitive, at every instant, errors [m] and whether intervals hold."""
    step, last = task["seconds_per_frame"], task["frames"] - 1
    run, axes = found.runs[0], slice(0, 2 if planar else 3)
    times = last * step + np.arange(round(AFTER[-1] / PACE) + 1) * PACE
    count = len(next(iter(run.sample.values())))
    batch = simulator(run.start, times, n_worlds=count).run(run.sample)
    kept = ~batch.stopped
    rows = []
    for (name, own), h in itertools.product(key["bodies"].items(), AFTER):
        path = np.array(own["positions"])
        at = last + h / step
        truth = path[int(at)] + (at - int(at)) * (path[min(int(at) + 1, len(path) - 1)] - path[int(at)])
        far = batch.positions[:, :, batch.names.index(name)]
        row = round(h / PACE)
        places, walked = far[:, row], travelled_by_axis(far, np.array([0.0, 0.0, 1.0]) if planar else None)[:, row]
        every = with_model_error(places[kept], walked[kept])
        low, high = np.quantile(every, (0.1, 0.9), axis=0) if kept.any() else np.full((2, 3), np.nan)
        counted = [c for c in range(axes.stop) if c < 2 or abs(truth[2] - path[last, 2]) > CHANGES]
        apart = [np.median(places[kept], axis=0) - truth, places[0] - truth, path[last] - truth]
        error, first, stays = (float(np.linalg.norm(a[axes])) for a in apart)
        held, sensitive = [bool(low[c] <= truth[c] <= high[c]) for c in counted], own["sensitive"]
        rows.append(dict(body=name, after=h, error=error, first=first, stays=stays, held=held, sensitive=sensitive))
    return rows


def summary(rows: list[dict[str, Any]]) -> str:
    """Return a line of figures of all rows."""
    cells = []
    for h in AFTER:
        own = [r for r in rows if r["after"] == h and not r["sensitive"]]
        error, first, stays = (np.nan_to_num([r[k] for r in own], nan=99.0) for k in ("error", "first", "stays"))
        ratios = [np.median(error) / np.median(stays), error.mean() / stays.mean(), np.median(first) / np.median(stays)]
        held = np.concatenate([r["held"] for r in own])
        cells.append("{:.3f} {:.3f} {:.3f} {:.3f} {:3.0f}%".format(np.median(error), *ratios, 100 * held.mean()))
    return " | ".join(cells)


def main() -> None:
    """Fit and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--families", nargs="*", default=FAMILIES, choices=FAMILIES)
    parser.add_argument("--seeds", default="0-4", help="first-last")
    parser.add_argument("--noise", default="5mm", choices=("5mm", "20mm"))
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "fresh")
    parser.add_argument("--json", action="store_true", help="a line for every clip, with its rows")
    given = parser.parse_args()
    first, last = map(int, given.seeds.split("-"))
    print("family: at 0.5, 1, 2 s median error, over stays, of means, of the fitted world, inside 80%; cpu a clip")
    every: list[dict[str, Any]] = []
    spent: list[float] = []
    for family in given.families:
        own, seconds = every[:0], spent[:0]
        for seed in range(first, last + 1):
            folder = given.folder / f"{family}_{seed:03d}"
            if not (folder / "key.json").exists():
                write(scenes(family, seed), folder)
            task, key = (json.loads((folder / f"{n}.json").read_text()) for n in ("task", "key"))
            tracks = tracks_of(task, folder / f"tracks_{given.noise}.csv")
            study = of_one(world_of(task, tracks), tracks)
            began = time.process_time()
            found = fit(study, FitOptions())
            seconds.append(time.process_time() - began)
            rows = rows_of(found, task, key, study.runs[0].world.planar)
            own += rows
            if given.json:
                values = {c.unknown.name: round(c.value, 3) for c in found.constants}
                line = {"family": family, "seed": seed, "seconds": seconds[-1], "rolling": found.rolling}
                print(json.dumps({**line, "misfit": found.misfit, "constants": values, "rows": rows}), flush=True)
        every, spent = every + own, spent + seconds
        print(f"{family:14s} {summary(own)}; {np.mean(seconds):.1f} s", flush=True)
    print(f"{'all':14s} {summary(every)}; {np.mean(spent):.1f} s")


if __name__ == "__main__":
    main()
