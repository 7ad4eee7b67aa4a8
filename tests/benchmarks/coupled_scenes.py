"""Eight scenes of coupled materials: do they stay finite, keep what must be kept, and look right?

    python -m tests.benchmarks.coupled_scenes --out DIR [--seconds 20] [--only WORDS]

Prints what each scene took and every check with its bound; writes one page of pictures, `scenes.png`, and the
scenes as JSON.
"""

from __future__ import annotations

import argparse
import time
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.looking.overlay import Canvas
from atw_mcp.worlds.marks import WorldMarks
from atw_mcp.worlds.rollout_cost import cost
from polyworld.pictures.contact_shadow import with_contact_shadows
from polyworld.pictures.render import default_camera, render
from polyworld.solver.rollout import rollout
from polyworld.trajectory import Rollout
from polyworld.world import World
from tests.benchmarks.coupled_checks import checks
from tests.benchmarks.coupled_worlds import SCENES

COLUMNS = 7
WIDTH = 420  # [px] of one picture on the page


def main() -> None:
    """Roll the scenes out and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", maxsplit=1)[0])
    parser.add_argument("--out", type=Path, required=True, help="folder for the page")
    parser.add_argument("--seconds", type=float, default=20.0, help="how far to run each scene [s]")
    parser.add_argument("--only", default="", help="run the scenes whose name has these words")
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for name, build in SCENES.items():
        if options.only not in name:
            continue
        world = build()
        (options.out / f"{name.replace(' ', '_')}.json").write_text(world.canonical_json() + "\n")
        start, cpu = time.perf_counter(), time.process_time()
        try:
            result = rollout(world, options.seconds)
        except RuntimeError as error:
            print(f"{name}: FAILED: {error}", flush=True)
            continue
        wall, cpu = time.perf_counter() - start, time.process_time() - cpu
        _report(name, world, result, wall, cpu)
        rows.append(_row(name, world, result))
        cv2.imwrite(str(options.out / "scenes.png"), np.concatenate(rows))


def _report(name: str, world: World, result: Rollout, wall: float, cpu: float) -> None:
    points = sum(cost(world, result.horizon).points.values())
    print(f"{name}: {result.status}, {points} points, {wall:.1f} s ({cpu:.1f} s of processor)", flush=True)
    if result.status == "diverged":
        print(f"    at {result.diverged_time} s, {result.diverged_object}, element {result.diverged_element}")
    for check in checks(world, result):
        mark = "  " if check.holds else "!!"
        print(f"  {mark} {check.name:<42} {check.value:>12.3g}   bound {check.bound:g}")


def _row(name: str, world: World, result: Rollout) -> NDArray[np.uint8]:
    """Pictures of a scene from its start to its end: early ones nearer to each other, since most happens then."""
    trajectory = result.trajectory
    count = len(trajectory.times)
    samples = np.unique(np.rint((count - 1) * np.linspace(0.0, 1.0, COLUMNS) ** 2.2).astype(int))
    places = [trajectory.positions[:, : len(world.objects)].reshape(-1, 3)]
    places += [m.points[samples].reshape(-1, 3) for m in trajectory.deformables.values()]
    camera = default_camera(world, np.concatenate(places))
    marks = WorldMarks(world, trajectory, camera)
    pictures = []
    for sample in samples:
        points = {item: motion.points[sample] for item, motion in trajectory.deformables.items()}
        visible = trajectory.active[sample].tolist()
        poses = trajectory.positions[sample], trajectory.orientations[sample]
        picture = render(world, *poses, camera, points=points, visible=visible)
        color = with_contact_shadows(world, *poses, camera, picture, points=points, visible=visible)
        canvas = Canvas.of(np.ascontiguousarray(color[..., ::-1]))
        marks.draw(canvas, int(sample))
        canvas.write(f"{name}   {trajectory.times[sample]:.2f} s", (8, 16))
        scale = WIDTH / canvas.image.shape[1]
        pictures.append(cv2.resize(canvas.image, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA))
    while len(pictures) < COLUMNS:
        pictures.append(np.full_like(pictures[0], 255))
    row: NDArray[np.uint8] = np.concatenate(pictures, axis=1)
    return row


if __name__ == "__main__":
    main()
