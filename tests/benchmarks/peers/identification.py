"""How well and how fast motion identifies a world: methods on one engine, and engines under one method.

    python -m tests.benchmarks.peers.identification [--quick] [--scenes N ...]

Data: the annotated motion of CLEVRER scenes (Yi et al., ICLR 2020), made by Bullet. Every scene is fitted twice: on
all frames, and on the first three quarters, which leaves the last quarter to be predicted.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import (
    CemSettings,
    FitProblem,
    FitResult,
    ObjectiveSettings,
    PrefixSettings,
    SearchSettings,
    Unknown,
    default_unknowns,
    fit,
    fit_by_prefixes,
    fit_by_random_search,
    refine,
    refit_with_wider_bounds,
)
from polyworld.estimation.world_fit.problem import MakeSimulator
from polyworld.executors import LocalExecutor, results
from polyworld.solver.rollout import simulator
from polyworld.world import World
from polyworld.world.parameters import read_parameter
from tests.benchmarks.peers.fit_backends import STEPS_OF_FRAME, Mujoco, Straight
from tests.benchmarks.peers.fit_watch import Watch
from tests.benchmarks.peers.markdown import markdown
from tests.benchmarks.peers.table import Table
from tests.scenes.clevrer_data import (
    MODEL_TOLERANCE,
    SECONDS_PER_FRAME,
    SUBSTEP,
    Collision,
    available_scenes,
    default_folder,
    default_world,
    read_scene,
)
from tests.scenes.clevrer_events import (
    TOLERANCE,
    EventScore,
    collisions_of_touches,
    score_collisions,
    simulated_collisions,
)

NEAR = 1.2  # times the final RMSE, the level to which the time is given
POPULATION = 64
# Rollouts of every method, and of every engine: MuJoCo's would take hours with the methods' budget.
METHODS, ENGINES = 7680, 2560
QUICK_METHODS, QUICK_ENGINES = 1920, 256
STARTS = 8  # of least squares at most, where the budget lasts
SEARCHED = 0.7  # share of the budget for them; the rest is for wider bounds
# What the paper gives for 100 scenes [m], each fitted on all frames.
PAPER = {
    "default": "0.292",
    "random search": "0.0350",
    "CEM": "0.0077",
    "CEM on MuJoCo": "0.0160",
    "CEM on straight lines": "0.0591",
    "CEM on PolyWorld": "0.0077",
}
# Scenes on which the choice of unknowns was made; the others were first opened by the finished benchmark.
DEVELOPMENT = ("00000", "02000", "03000")
THREADS = len(os.sched_getaffinity(0))


@dataclass(frozen=True)
class Fit:
    """A fit of one scene. rmse, held_out [m]: over all fitted frames and over those left out; seconds: of CPU.

    near: seconds to `NEAR` times the final RMSE.
    """

    scene: str
    method: str
    held_back: bool
    rmse: float
    held_out: float
    rollouts: int
    seconds: float
    near: float
    events: EventScore


Search = Callable[[FitProblem, Watch, int], FitResult]


def tables(quick: bool) -> list[Table]:
    """Return methods on PolyWorld, engines under the cross-entropy method, and the scenes of the best method."""
    folder = default_folder()
    scenes = available_scenes(folder)
    if not scenes:
        why = f"skipped: no annotation_NNNNN.json in {folder}"
        return [Table("Identification", why, ("scene",), ())]
    return scene_tables(scenes[:1] if quick else scenes, quick)


def scene_tables(scenes: Sequence[str], quick: bool) -> list[Table]:
    """Return the tables of some scenes."""
    budgets = (QUICK_METHODS, QUICK_ENGINES) if quick else (METHODS, ENGINES)
    # The slowest first. Each fit has one thread and a process of its own, so that its CPU time is its own.
    order = sorted(SEARCHES, key=lambda name: not name.endswith("MuJoCo"))
    asked = [(name, scene, back) for name in order for scene in scenes for back in (False, True)]
    with LocalExecutor(THREADS) as executor:
        found = executor.map(partial(fitted, budgets=budgets), {" ".join(map(str, a)): a for a in asked})
        fits = list(results(found).values())
    about = (
        f"{len(scenes)} annotated CLEVRER scenes ({', '.join(scenes)}; unknowns were chosen on "
        f"{', '.join(DEVELOPMENT)} alone), medians over scenes; RMSE of positions on the plane over all objects, those "
        f"that stand still included. Held out: the last quarter, predicted by a fit to the rest. Events: collisions "
        f"of all scenes together, within {TOLERANCE} frames ({TOLERANCE * SECONDS_PER_FRAME:.3f} s) of the annotated "
        f"one. Time: CPU, one thread. Paper: medians of 100 other scenes, budget not given."
    )
    methods = [name for name in SEARCHES if " on " not in name]
    engines = [name for name in SEARCHES if " on " in name]
    mujoco_step = 1e3 * SECONDS_PER_FRAME / STEPS_OF_FRAME
    return [
        _summary(
            "Methods on PolyWorld",
            f"{about} At most {budgets[0]:,} rollouts each, of a population of {POPULATION} where there is one.",
            fits,
            methods,
            None,
        ),
        _summary(
            "Engines under the same cross-entropy method",
            f"{budgets[1] // POPULATION or 1} generations of {min(POPULATION, budgets[1])} rollouts on each engine, "
            f"from the same box of unknowns. MuJoCo: `mujoco.batch`, free bodies on a floor, steps of "
            f"{mujoco_step:.1f} ms; PolyWorld: "
            f"{1e3 * SUBSTEP:.0f} ms. Straight lines: constant deceleration, no collisions (the "
            f"paper's simple model is another one, which it does not define). Otherwise as above.",
            fits,
            engines,
            "CEM on MuJoCo",
        ),
        _by_scene(fits),
    ]


def fitted(asked: tuple[str, str, bool], budgets: tuple[int, int]) -> Fit:
    """Fit a scene by one method on one engine, on all frames or with some held back."""
    name, scene, held_back = asked
    data = read_scene(default_folder(), scene)
    world, tracks = default_world(data.tracks, data.kinds), data.tracks
    first_left = int(0.75 * len(tracks.frames)) if held_back else None
    # What is left out must not show where the search begins either.
    seen = tracks if first_left is None else tracks.window(int(tracks.frames[0]), first_left - 1)
    make, search = SEARCHES[name]
    make(world, np.arange(2) * SECONDS_PER_FRAME, n_worlds=1).run()  # loads what is compiled
    watch = Watch(make, seen)
    problem = FitProblem(
        world,
        tracks,
        unknowns(world, seen),
        objective=ObjectiveSettings(position_tolerance=MODEL_TOLERANCE),
        holdout_from=first_left,
        make_simulator=watch,
    )
    result = search(problem, watch, budgets[1 if " on " in name else 0])
    rmse = np.inf if result.accuracy is None else result.accuracy.position
    held_out = np.nan if result.held_out is None else result.held_out.position
    last = int(tracks.frames[-1])
    found = EVENTS.get(name, simulated_collisions)(result.world, last)
    return Fit(
        scene,
        name,
        held_back,
        rmse,
        held_out,
        result.rollouts,
        watch.seconds(result.rollouts),
        watch.seconds_to(NEAR * rmse),
        score_collisions(found, list(data.collisions)),
    )


def unknowns(world: World, tracks: ObservedTracks) -> list[Unknown]:
    """Return the default unknowns with friction against spinning of each object; balls slide without friction."""
    each = ("friction", "restitution", "mass", "torsional_radius", "angular_damping")
    found = default_unknowns(world, tracks, shared=("linear_damping",), each=each)
    balls = [o.name for o in world.objects if o.shape.kind == "sphere"]
    left_out = {f"{ball}.{field}" for ball in balls for field in ("friction", "angular_damping")}
    return [u for u in found if u.name not in left_out]


def _unfitted(problem: FitProblem, _watch: Watch, _budget: int) -> FitResult:
    problem.begin()
    at = problem.space.coordinates({u.name: _own(problem.world, u) for u in problem.space.unknowns})
    return problem.finish("refine", "completed", at, None, (), 0)


def _own(world: World, unknown: Unknown) -> float:
    value = read_parameter(world, unknown.paths[0])
    return unknown.start if value is None else value


def _random(problem: FitProblem, _watch: Watch, budget: int) -> FitResult:
    return fit_by_random_search(problem, _settings(budget))


def _cem(problem: FitProblem, _watch: Watch, budget: int) -> FitResult:
    return fit(problem, _settings(budget))


def _cem_and_squares(problem: FitProblem, watch: Watch, budget: int) -> FitResult:
    """Half the budget for the search, what is left for least squares from its best candidate."""
    found = fit(problem, _settings(budget // 2))
    refined = refine(problem, found.by_name, iterations=100, cancelled=_spent(problem, watch, budget))
    return replace(refined, rollouts=watch.rollouts)


def _least_squares(problem: FitProblem, watch: Watch, budget: int) -> FitResult:
    """Least squares over growing stretches from several starts, then with wider bounds where a value lies on one."""
    searched = fit_by_prefixes(
        problem, PrefixSettings(starts=STARTS), cancelled=_spent(problem, watch, round(SEARCHED * budget))
    )
    finished = [start for start in searched if start.best.status == "completed"] or list(searched)
    _, start, _ = refit_with_wider_bounds(problem, finished[0], cancelled=_spent(problem, watch, budget))
    return replace(start.best, rollouts=watch.rollouts)


def _spent(problem: FitProblem, watch: Watch, budget: int) -> Callable[[], bool]:
    """Return whether a further iteration of least squares, and the errors at its end, might go beyond the budget."""
    needed = 4 * len(problem.space.unknowns) + 20
    return lambda: watch.rollouts + needed > budget


def _settings(budget: int) -> SearchSettings:
    population = min(POPULATION, budget // 16)
    return SearchSettings(
        generations=budget // population, cem=CemSettings(population=population, elites=max(4, population // 5))
    )


def _mujoco_collisions(world: World, last_frame: int) -> list[Collision]:
    simulation = Mujoco(world, np.arange(last_frame + 1) * SECONDS_PER_FRAME, n_worlds=1)
    return collisions_of_touches([(time / SECONDS_PER_FRAME, pair, True) for time, pair in simulation.contacts()])


def _no_collisions(_world: World, _last_frame: int) -> list[Collision]:
    return []


_POLYWORLD: MakeSimulator = partial(simulator, threads=1)
SEARCHES: dict[str, tuple[MakeSimulator, Search]] = {
    "default": (_POLYWORLD, _unfitted),
    "random search": (_POLYWORLD, _random),
    "CEM": (_POLYWORLD, _cem),
    "CEM + least squares": (_POLYWORLD, _cem_and_squares),
    "least squares over growing stretches": (_POLYWORLD, _least_squares),
    "CEM on PolyWorld": (_POLYWORLD, _cem),
    "CEM on MuJoCo": (Mujoco, _cem),
    "CEM on straight lines": (Straight, _cem),
}
EVENTS = {"CEM on MuJoCo": _mujoco_collisions, "CEM on straight lines": _no_collisions}


def _summary(title: str, note: str, fits: Sequence[Fit], names: Sequence[str], slowest: str | None) -> Table:
    """Medians over scenes of some methods; with how many times less time than the slowest they took."""
    rows = []
    for name in names:
        whole = [f for f in fits if f.method == name and not f.held_back]
        parts = [f for f in fits if f.method == name and f.held_back]
        events = sum((f.events for f in whole), EventScore(0, 0, 0))
        row = [
            name.replace("CEM on ", "") if slowest else name,
            f"{np.median([f.rmse for f in whole]):.4f}",
            f"{np.median([f.held_out for f in parts]):.4f}",
            PAPER.get(name, ""),
            f"{np.median([f.rollouts for f in whole]):.0f}",
            f"{np.median([f.near for f in whole]):.2f}",
            f"{np.median([f.seconds for f in whole]):.2f}",
            f"{events.precision:.2f}" if events.simulated else "none",
            f"{events.recall:.2f}",
        ]
        if slowest is not None:
            times = {f.scene: f.seconds for f in fits if f.method == slowest and not f.held_back}
            row.append(f"{np.median([times[f.scene] / f.seconds for f in whole]):.1f}")
        rows.append(tuple(row))
    columns = ["", "RMSE m", "held out m", "paper m", "rollouts", f"s to {NEAR} RMSE", "s", "events P", "R"]
    if slowest is not None:
        columns.append("times as fast")
    return Table(title, note, tuple(columns), tuple(rows))


def _by_scene(fits: Sequence[Fit]) -> Table:
    names = [name for name in SEARCHES if name != "default"]
    rows = []
    found = {(f.scene, f.method, f.held_back): f for f in fits}
    for scene in dict.fromkeys(f.scene for f in fits):
        pairs = [(found[scene, name, False].rmse, found[scene, name, True].held_out) for name in names]
        label = f"{scene} (development)" if scene in DEVELOPMENT else scene
        rows.append((label, *(f"{whole:.4f} / {held_out:.4f}" for whole, held_out in pairs)))
    return Table("Scenes", "RMSE of all frames fitted / of the last quarter held out [m].", ("", *names), tuple(rows))


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
