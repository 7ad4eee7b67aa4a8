"""How well and how fast motion identifies a world: least squares beside the searches of the paper.

    python -m tests.benchmarks.peers.identification [--quick] [--scenes N ...]

Data: the annotated motion of CLEVRER scenes (Yi et al., ICLR 2020), made by Bullet. Every scene is fitted twice: on
all frames, and on the first three quarters, which leaves the last quarter to be predicted.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from functools import partial

import numpy as np

from polyworld.executors import LocalExecutor, results
from polyworld.solver.rollout import simulator
from tests.benchmarks.clevrer_fit import METHODS, Budget, Row, rows
from tests.benchmarks.peers.markdown import markdown
from tests.benchmarks.peers.table import Table
from tests.scenes.clevrer_data import SECONDS_PER_FRAME, available_scenes, default_folder, default_world, read_scene
from tests.scenes.clevrer_events import TOLERANCE, EventScore

POPULATION = 64
ROLLOUTS, QUICK = 7680, 1920  # of a search
# What the paper gives for 100 scenes [m], each fitted on all frames.
PAPER = {"default": "0.292", "random search": "0.0350", "CEM": "0.0077"}
THREADS = len(os.sched_getaffinity(0))


def tables(quick: bool) -> list[Table]:
    """Return the methods, and the scenes."""
    folder = default_folder()
    scenes = available_scenes(folder)
    if not scenes:
        why = f"skipped: no annotation_NNNNN.json in {folder}"
        return [Table("Identification", why, ("scene",), ())]
    return scene_tables(scenes[:1] if quick else scenes, quick)


def scene_tables(scenes: Sequence[str], quick: bool) -> list[Table]:
    """Return the tables of some scenes."""
    budget = QUICK if quick else ROLLOUTS
    # Each fit has one thread and a process of its own, so that its CPU time is its own.
    asked = [(name, scene, back) for name in METHODS for scene in scenes for back in (False, True)]
    with LocalExecutor(THREADS) as executor:
        found = executor.map(partial(fitted, budget=budget), {" ".join(map(str, a)): a for a in asked})
        fits = [row for pair in results(found).values() for row in pair]
    about = (
        f"{len(scenes)} annotated CLEVRER scenes ({', '.join(scenes)}), medians over scenes; RMSE of positions on the "
        f"plane over all objects, those that stand still included. Held out: the last quarter, predicted by a fit to "
        f"the rest. Events: collisions of all scenes together, within {TOLERANCE} frames "
        f"({TOLERANCE * SECONDS_PER_FRAME:.3f} s) of the annotated one. Time: CPU, one thread. Paper: medians of 100 "
        f"other scenes, budget not given. Searches: {budget:,} rollouts, of a population of {POPULATION}."
    )
    return [_summary(about, fits), _by_scene(fits)]


def fitted(asked: tuple[str, str, bool], budget: int) -> tuple[Row, Row]:
    """Return the rows of the default parameters and of a fit of a scene, on all frames or with some held out."""
    name, scene, held_out = asked
    data = read_scene(default_folder(), scene)
    world = default_world(data.tracks, data.kinds)
    simulator(world, np.arange(2) * SECONDS_PER_FRAME, n_worlds=1).run()  # loads what is compiled
    left = int(0.75 * len(data.tracks.frames)) if held_out else None
    size = Budget(max(budget // POPULATION, 1), POPULATION)
    tracks = data.tracks
    found = rows(scene, "annotation", world, tracks, tracks, data.collisions, size, left, lambda _: None, (name,))
    return found[0], found[1]


def _summary(note: str, fits: Sequence[Row]) -> Table:
    """Medians over scenes."""
    table = []
    for name in dict.fromkeys(f.method for f in fits):
        whole = {f.scene: f for f in fits if f.method == name and f.fitted == "all"}.values()
        parts = {f.scene: f for f in fits if f.method == name and f.fitted != "all"}.values()
        events = sum((f.events for f in whole), EventScore(0, 0, 0))
        table.append(
            (
                name,
                f"{np.median([f.rmse for f in whole]):.4f}",
                f"{np.median([f.held_out for f in parts]):.4f}",
                PAPER.get(name, ""),
                f"{np.median([f.rollouts for f in whole]):.0f}",
                f"{np.median([f.seconds for f in whole]):.2f}",
                f"{events.precision:.2f}",
                f"{events.recall:.2f}",
            )
        )
    columns = ("", "RMSE m", "held out m", "paper m", "rollouts", "s", "events P", "R")
    return Table("Identification", note, columns, tuple(table))


def _by_scene(fits: Sequence[Row]) -> Table:
    found = {(f.scene, f.method, f.fitted != "all"): f for f in fits}
    table = []
    for scene in dict.fromkeys(f.scene for f in fits):
        pairs = [(found[scene, name, False].rmse, found[scene, name, True].held_out) for name in METHODS]
        table.append((scene, *(f"{whole:.4f} / {held_out:.4f}" for whole, held_out in pairs)))
    return Table(
        "Scenes", "RMSE of all frames fitted / of the last quarter held out [m].", ("", *METHODS), tuple(table)
    )


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--quick", action="store_true", help="one scene and small budgets")
    parser.add_argument("--scenes", nargs="+", metavar="N", help="five-digit scene numbers (default: all there are)")
    options = parser.parse_args()
    found = scene_tables(options.scenes, options.quick) if options.scenes else tables(options.quick)
    print("\n\n".join(markdown(table) for table in found))


if __name__ == "__main__":
    main()
