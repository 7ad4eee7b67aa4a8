"""Fits of CLEVRER scenes by every method at equal budget, each judged against the annotations."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import (
    CemSettings,
    FitProblem,
    FitResult,
    ObjectiveSettings,
    SearchSettings,
    Unknown,
    accuracy,
    default_unknowns,
    fit,
    fit_by_random_search,
    refine,
)
from polyworld.solver.rollout import simulator
from polyworld.world import World
from tests.scenes.clevrer_data import MODEL_TOLERANCE, Collision
from tests.scenes.clevrer_events import EventScore, score_collisions, simulated_collisions


@dataclass(frozen=True)
class Row:
    """One line of the table: RMSE against the annotations on the fitted and on the left-out frames [m]."""

    scene: str
    source: str
    fitted: str
    method: str
    rmse: float
    held_out: float
    events: EventScore
    rollouts: int
    seconds: float
    undetermined: int


@dataclass(frozen=True)
class Budget:
    """Rollouts of one search: generations times population."""

    generations: int = 240
    population: int = 320

    @property
    def rollouts(self) -> int:
        """Total number."""
        return self.generations * self.population


def unknowns(world: World, tracks: ObservedTracks) -> list[Unknown]:
    """Return the default unknowns, with one spinning-friction radius for all, and without sliding friction of balls."""
    found = default_unknowns(world, tracks, shared=("linear_damping", "angular_damping", "torsional_radius"))
    balls = {f"{o.name}.friction" for o in world.objects if o.shape.kind == "sphere"}
    return [p for p in found if p.name not in balls]


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
) -> tuple[list[Row], World]:
    """Default parameters, random search, CEM, and CEM followed by `refine`; returns the last one's world too."""
    # What is left out must not show where the search begins either.
    seen = tracks if holdout_from is None else tracks.window(int(tracks.frames[0]), holdout_from - 1)
    parameters = unknowns(world, seen)
    objective = ObjectiveSettings(position_tolerance=MODEL_TOLERANCE)
    settings = SearchSettings(
        generations=budget.generations,
        cem=CemSettings(population=budget.population, elites=max(8, budget.population // 5)),
        horizon=tuple(np.round((np.arange(16) + 1) / 16, 4)),
        final_share=0.35,
    )
    problem = FitProblem(world, tracks, parameters, objective=objective, holdout_from=holdout_from)
    fitted = "all" if holdout_from is None else f"0-{holdout_from - 1}"
    made: list[Row] = []

    def add(method: str, candidate: World, result: FitResult | None, seconds: float, rollouts: int) -> None:
        inside, outside = judge(candidate, truth, holdout_from)
        found = simulated_collisions(candidate, int(truth.frames[-1]))
        unknown = 0 if result is None else sum("not fitted" not in u.reason for u in result.undetermined)
        made.append(
            Row(
                scene,
                source,
                fitted,
                method,
                inside,
                outside,
                score_collisions(found, list(collisions)),
                rollouts,
                seconds,
                unknown,
            )
        )
        say(f"{scene} {source} {fitted}: {method} rmse {inside:.4f} m, {rollouts} rollouts, {seconds:.1f} s")

    add("default", world, None, 0.0, 0)
    random = fit_by_random_search(problem, settings)
    add("random search", random.world, random, random.seconds, random.rollouts)
    searched = fit(problem, settings)
    add("CEM", searched.world, searched, searched.seconds, searched.rollouts)
    started = time.perf_counter()
    polished = refine(problem, searched.by_name, iterations=30)
    seconds = searched.seconds + time.perf_counter() - started
    add("CEM + refine", polished.world, polished, seconds, searched.rollouts + polished.rollouts)
    return made, polished.world


def judge(world: World, truth: ObservedTracks, holdout_from: int | None) -> tuple[float, float]:
    """Position RMSE [m] against the annotations before and from `holdout_from` on; NaN where there is nothing."""
    times = truth.frames * world.time.seconds_per_frame
    batch = simulator(world, times, threads=1).run()
    if batch.diverged[0]:
        return float("inf"), float("inf")
    result: list[float] = []
    whole = accuracy(world, truth, batch.world(0))
    if holdout_from is None:
        return whole.position, float("nan")
    for keep in (truth.frames < holdout_from, truth.frames >= holdout_from):
        confidence = np.where(keep[:, None], truth.confidence, 0.0)
        part = ObservedTracks(
            names=truth.names,
            frames=truth.frames,
            seconds_per_frame=truth.seconds_per_frame,
            positions=truth.positions,
            position_sigma=truth.position_sigma,
            orientations=truth.orientations,
            confidence=confidence,
            orientation_confidence=truth.orientation_confidence,
            symmetry=truth.symmetry,
        )
        result.append(accuracy(world, part, batch.world(0)).position)
    return result[0], result[1]
