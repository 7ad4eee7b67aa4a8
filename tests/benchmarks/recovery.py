"""Hidden parameters of every material, recovered from noisy readouts: `python -m tests.benchmarks.recovery [--quick]`.

The data come from a finer resolution and half the step of the model that is fitted (no inverse crime), so that the
discretisation of the model is part of the error. The search is the one FitWorld does: the cross-entropy method over a
growing horizon, then least squares from its best. Prints, for each parameter, hidden and recovered value, the error
and the standard error that the fit claims (which knows of the noise, not of the model's resolution).
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence

from polyworld.estimation.world_fit import (
    CemSettings,
    FitProblem,
    SearchSettings,
    Undetermined,
    fit,
    refine,
)
from tests.scenes.material_parameters import Scene, scenes

WIDTHS = (20, 36, 11, 11, 8, 9, 9, 8)
HEADER = ("scene", "parameter", "hidden", "recovered", "error", "claimed", "rollouts", "seconds")


def row(cells: Sequence[str]) -> str:
    """Return a line of the table."""
    return "  ".join(
        cell.ljust(width) if i < 2 else cell.rjust(width)
        for i, (cell, width) in enumerate(zip(cells, WIDTHS, strict=True))
    )


def recover(scene: Scene, *, generations: int, population: int, seed: int) -> list[str]:
    """Lines of the table for one scene."""
    begin = time.perf_counter()
    world, data = scene.build(False), scene.observed(seed)
    settings = SearchSettings(
        generations=generations,
        cem=CemSettings(population=population, elites=population // 4, carried=2),
        horizon=(0.25, 0.5, 1.0),
        seed=seed,
    )
    problem = FitProblem(world, data, scene.unknowns)
    searched = fit(problem, settings)
    polished = refine(problem, searched.by_name, iterations=8)
    best = polished if polished.loss < searched.loss else searched
    rollouts = searched.rollouts + searched.rollouts_for_errors + polished.rollouts + polished.rollouts_for_errors
    seconds = time.perf_counter() - begin
    lines = []
    for i, value in enumerate(best.values):
        hidden = scene.hidden[value.paths[0]]
        cost = (f"{rollouts}", f"{seconds:.1f}") if i == 0 else ("", "")
        error, claimed = value.value / hidden - 1.0, value.standard_error / hidden
        numbers = (f"{hidden:.4g}", f"{value.value:.4g}", f"{error:+.1%}", f"{claimed:.1%}")
        lines.append(row((scene.name if i == 0 else "", f"{value.name} [{value.unit}]", *numbers, *cost)))
    lines.append(
        row(("", f"  loss {best.loss:.3g} (start {best.loss_start:.3g}){_open(best.undetermined)}", *[""] * 6))
    )
    return lines


def _open(undetermined: tuple[Undetermined, ...]) -> str:
    open_ones = [u for u in undetermined if not u.reason.startswith("not fitted")]
    return "".join(f"; undetermined: {', '.join(u.parameters)}: {u.reason}" for u in open_ones)


def main() -> None:
    """Run all scenes, or those named."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--quick", action="store_true", help="half the search")
    parser.add_argument("--only", nargs="*", help="names of scenes")
    parser.add_argument("--seed", type=int, default=0)
    chosen = parser.parse_args()
    known = [scene.name for scene in scenes()]
    unknown = sorted(set(chosen.only or ()) - set(known))
    if unknown:
        parser.error(f"unknown scenes {unknown}; scenes: {known}")
    begin = time.perf_counter()
    print(row(HEADER))
    for scene in scenes():
        if chosen.only is None or scene.name in chosen.only:
            size = (6, 16) if chosen.quick else (12, 24)
            for line in recover(scene, generations=size[0], population=size[1], seed=chosen.seed):
                print(line, flush=True)
    print(f"{time.perf_counter() - begin:.0f} s in all")


if __name__ == "__main__":
    main()
