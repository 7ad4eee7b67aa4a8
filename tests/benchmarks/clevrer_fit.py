"""Fits of CLEVRER scenes by every method, each judged against the annotations.

    python -m tests.benchmarks.clevrer_fit

fits the annotations themselves by least squares: all frames, and without the last quarter; each scene alone, and all
as one study of one laboratory, whose constants are those of its materials.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.accuracy import accuracy
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.fitted import Method, StudyFit
from polyworld.estimation.study import Study, StudyRun
from polyworld.solver.rollout import simulator
from polyworld.world import World
from tests.polyworld.synthetic import of_one
from tests.scenes.clevrer_data import Collision, available_scenes, default_folder, default_world, read_scene
from tests.scenes.clevrer_events import EventScore, score_collisions, simulated_collisions

METHODS: dict[str, Method] = {"random search": "random_search", "CEM": "cem", "least squares": "least_squares"}


@dataclass(frozen=True)
class Row:
    """One line of the table: RMSE against the annotations on the fitted and on the left-out frames [m].

    seconds: of the processor.
    """

    scene: str
    source: str
    fitted: str
    method: str
    rmse: float
    held_out: float
    events: EventScore
    rollouts: int
    seconds: float


@dataclass(frozen=True)
class Budget:
    """Rollouts of one search: generations times population."""

    generations: int = 240
    population: int = 320


def fitted(
    world: World, tracks: ObservedTracks, method: str, budget: Budget, holdout_from: int | None
) -> tuple[StudyFit, float]:
    """Fit one scene by a method of `METHODS`; returns the processor's seconds too."""
    options = FitOptions(
        method=METHODS[method],
        share=0.0,
        holdout=holdout_from,
        generations=budget.generations,
        population=budget.population,
    )
    started = time.process_time()
    found = fit(of_one(world, tracks), options)
    return found, time.process_time() - started


def rows(
    scene: str,
    source: str,
    world: World,
    tracks: ObservedTracks,
    truth: ObservedTracks,
    collisions: tuple[Collision, ...],
    budget: Budget,
    holdout_from: int | None,
    say: Callable[[str], None],
    methods: tuple[str, ...] = tuple(METHODS),
) -> list[Row]:
    """Return rows of default parameters and of every method."""
    made: list[Row] = []
    for method in ("default", *methods):
        candidate, rollouts, seconds = world, 0, 0.0
        if method != "default":
            found, seconds = fitted(world, tracks, method, budget, holdout_from)
            candidate, rollouts = found.runs[0].world, found.rollouts
        inside, outside = judge(candidate, truth, holdout_from)
        events = score_collisions(simulated_collisions(candidate, int(truth.frames[-1])), list(collisions))
        part = "all" if holdout_from is None else f"0-{holdout_from - 1}"
        made.append(Row(scene, source, part, method, inside, outside, events, rollouts, seconds))
        errors = f"{method} rmse {inside:.4f} m, held out {outside:.4f} m"
        say(f"{scene} {source} {part}: {errors}, {rollouts} rollouts, {seconds:.1f} s")
    return made


def judge(world: World, truth: ObservedTracks, holdout_from: int | None) -> tuple[float, float]:
    """Position RMSE [m] against the annotations before and from `holdout_from` on; NaN where there is nothing."""
    batch = simulator(world, truth.frames * world.time.seconds_per_frame, threads=1).run()
    if batch.diverged[0]:
        return float("inf"), float("inf")
    if holdout_from is None:
        return accuracy(world, truth, batch.world(0)).position, float("nan")
    result = []
    for keep in (truth.frames < holdout_from, truth.frames >= holdout_from):
        part = replace(truth, confidence=np.where(keep[:, None], truth.confidence, 0.0))
        result.append(accuracy(world, part, batch.world(0)).position)
    return result[0], result[1]


def main() -> None:
    """Fit the annotations of every scene and print root mean square errors [m], and their medians over scenes."""
    folder, every = default_folder(), []
    for number in available_scenes(folder):
        scene = read_scene(folder, number)
        world = default_world(scene.tracks, scene.kinds)
        for cut in (None, int(0.75 * len(scene.tracks.frames))):
            every += rows(number, "annotations", world, scene.tracks, scene.tracks, scene.collisions, Budget(), cut,
                          print, ("least squares",))  # fmt: skip
    fits = [r for r in every if r.method != "default"]
    whole = float(np.median([r.rmse for r in fits if r.fitted == "all"]))
    held = float(np.nanmedian([r.held_out for r in fits]))
    print(f"medians: all frames {whole:.4f} m, held out {held:.4f} m")
    scenes = [read_scene(folder, number) for number in available_scenes(folder)]
    study = Study(tuple(StudyRun(s.number, default_world(s.tracks, s.kinds), s.tracks) for s in scenes))
    for cut in (None, min(int(0.75 * len(s.tracks.frames)) for s in scenes)):
        found = fit(study, FitOptions(share=0.0, holdout=cut))
        errors = [judge(run.world, s.tracks, cut) for run, s in zip(found.runs, scenes, strict=True)]
        print(f"one study, frames before {cut}:", *(f"{a:.4f} {b:.4f} m;" for a, b in errors))
        print("medians: fitted {:.4f} m, held out {:.4f} m".format(*np.median(errors, axis=0)))


if __name__ == "__main__":
    main()
