"""Fit a world's unknowns to observed tracks by the cross-entropy method over a growing horizon."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.identification import cem, random_search
from polyworld.identification.cem import CemSettings, CemState
from polyworld.identification.forward import MakeSimulator
from polyworld.identification.free_parameters import FitParameter
from polyworld.identification.horizon import Stage, stages
from polyworld.identification.objective import ObjectiveSettings
from polyworld.identification.problem import Problem
from polyworld.identification.result import FitResult, LossPoint
from polyworld.rollout import simulator
from polyworld.tracks import ObservedTracks
from polyworld.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class FitSettings:
    """How to search.

    generations x cem.population rollouts are spent per restart; restarts differ in their seed and the best one
    counts. horizon: shares of the sample times that the stages of the search reach, of which the last gets
    `final_share` of the generations. reopen: at the start of a stage, standard deviations are raised to at least
    this share of their initial value, so that what the new observations tell can still move them. holdout_from:
    first frame left out of the fit and used to judge it. prior_weight: lambda of the parameter priors.
    """

    generations: int = 60
    cem: CemSettings = field(default_factory=CemSettings)
    horizon: tuple[float, ...] = (0.125, 0.25, 0.375, 0.5, 0.625, 0.75, 0.875, 1.0)
    final_share: float = 0.4
    reopen: float = 0.15
    restarts: int = 1
    seed: int = 0
    objective: ObjectiveSettings = field(default_factory=ObjectiveSettings)
    prior_weight: float = 1.0
    holdout_from: int | None = None

    def __post_init__(self) -> None:
        if self.restarts < 1:
            raise ValueError(f"restarts must be at least 1, got {self.restarts}")
        if not 0.0 <= self.reopen <= 1.0:
            raise ValueError(f"reopen must lie in 0..1, got {self.reopen}")
        if self.prior_weight < 0.0:
            raise ValueError(f"prior_weight must be >= 0, got {self.prior_weight}")
        stages(100, self.horizon, self.generations, self.final_share)


@dataclass(frozen=True)
class FitProgress:
    """Where a fit stands after a generation; checkpoint resumes it exactly there."""

    done: int
    total: int
    restart: int
    samples: int
    loss: float
    rollouts: int
    checkpoint: dict[str, Any]


Progress = Callable[[FitProgress], None]
Cancelled = Callable[[], bool]


@dataclass
class _Run:
    """What a fit has done so far: finished generations, the present search, and the winner of each restart."""

    done: int
    state: CemState | None
    winners: list[tuple[Array, Array, float]]
    history: list[LossPoint]
    rollouts: int
    seconds: float

    def to_dict(self, seconds: float, rollouts: int) -> dict[str, Any]:
        return {
            "done": self.done,
            "state": None if self.state is None else self.state.to_dict(),
            "winners": [[x.tolist(), sd.tolist(), loss] for x, sd, loss in self.winners],
            "history": [vars(p).copy() for p in self.history],
            "rollouts": rollouts,
            "seconds": seconds,
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> _Run:
        return cls(
            done=int(data["done"]),
            state=None if data["state"] is None else CemState.from_dict(data["state"]),
            winners=[(np.asarray(x), np.asarray(sd), float(loss)) for x, sd, loss in data["winners"]],
            history=[LossPoint(**p) for p in data["history"]],
            rollouts=int(data["rollouts"]),
            seconds=float(data["seconds"]),
        )


def fit(
    world: World,
    tracks: ObservedTracks,
    parameters: Sequence[FitParameter],
    *,
    settings: FitSettings | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    resume: dict[str, Any] | None = None,
    make_simulator: MakeSimulator = simulator,
) -> FitResult:
    """Search the parameters by CEM; the result does not depend on interruptions.

    progress is called after every generation; cancelled is asked before every generation, and a cancelled fit
    returns the best found so far. resume: the checkpoint of an earlier run with the same arguments. Raises
    ValueError and KeyError for unsuitable tracks or parameters.
    """
    settings = settings or FitSettings()
    problem = _problem(world, tracks, parameters, settings, make_simulator)
    space, forward = problem.space, problem.forward
    plan = stages(forward.samples, settings.horizon, settings.generations, settings.final_share)
    schedule = [stage for stage in plan for _ in range(stage.generations)]
    total = settings.restarts * len(schedule)
    run = _Run.from_dict(resume) if resume is not None else _Run(0, None, [], [], 0, 0.0)
    forward.rollouts = run.rollouts
    floor = settings.cem.floor * space.sd
    status = "completed"
    while run.done < total:
        if cancelled is not None and cancelled():
            status = "cancelled"
            break
        restart, index = divmod(run.done, len(schedule))
        stage = schedule[index]
        if index == 0:
            run.state = CemState.start(space.mean, space.sd, settings.seed + restart)
        state = _opened(run.state, schedule, index, settings.reopen * space.sd)
        horizon = float(forward.objective.sample_times[stage.samples - 1])
        samples = stage.samples

        def evaluate(candidates: Array, samples: int = samples) -> Array:
            return forward.losses(candidates, samples)

        state = cem.generation(
            state, evaluate, space.lower, space.upper, floor, settings.cem, free=space.entered(horizon)
        )
        run.state = state
        best, middle = float(state.elite_losses[0]), float(np.median(state.elite_losses))
        run.history.append(LossPoint(run.done, restart, samples, best, middle))
        run.done += 1
        if index + 1 == len(schedule):
            run.winners.append((state.elite[0], state.elite_sd, best))
        if progress is not None:
            spent = run.seconds + time.perf_counter() - problem.started
            checkpoint = run.to_dict(spent, forward.rollouts)
            progress(FitProgress(run.done, total, restart, samples, best, forward.rollouts, checkpoint))
    best_x, spread = _best(problem, run)
    return problem.finish(
        "cem",
        "completed" if status == "completed" else "cancelled",
        best_x,
        spread,
        run.history,
        settings.seed,
        run.seconds,
    )


def fit_by_random_search(
    world: World,
    tracks: ObservedTracks,
    parameters: Sequence[FitParameter],
    *,
    settings: FitSettings | None = None,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
    make_simulator: MakeSimulator = simulator,
) -> FitResult:
    """Search the same box by uniform random samples over the full horizon, with the budget `fit` would spend."""
    settings = settings or FitSettings()
    problem = _problem(world, tracks, parameters, settings, make_simulator)
    space, forward = problem.space, problem.forward
    rng = np.random.default_rng(settings.seed)
    best, losses = np.zeros((0, len(space.mean))), np.zeros(0)
    history: list[LossPoint] = []
    total = settings.restarts * settings.generations
    population, keep = settings.cem.population, settings.cem.elites
    stopped = False
    for number in range(total):
        if cancelled is not None and cancelled():
            stopped = True
            break
        best, losses = random_search.generation(
            rng, lambda c: forward.losses(c, forward.samples), space.lower, space.upper, population, keep, best, losses
        )
        history.append(LossPoint(number, 0, forward.samples, float(losses[0]), float(np.median(losses))))
        if progress is not None:
            progress(FitProgress(number + 1, total, 0, forward.samples, float(losses[0]), forward.rollouts, {}))
    found = best[0] if len(best) else space.mean
    spread = best.std(axis=0) if len(best) else space.sd
    return problem.finish(
        "random_search", "cancelled" if stopped else "completed", found, spread, history, settings.seed
    )


def _problem(
    world: World,
    tracks: ObservedTracks,
    parameters: Sequence[FitParameter],
    settings: FitSettings,
    make_simulator: MakeSimulator,
) -> Problem:
    return Problem.of(
        world,
        tracks,
        parameters,
        objective=settings.objective,
        holdout_from=settings.holdout_from,
        batch=settings.cem.population,
        prior_weight=settings.prior_weight,
        make_simulator=make_simulator,
    )


def _opened(state: CemState | None, schedule: list[Stage], index: int, least: Array) -> CemState:
    if state is None:
        raise ValueError("the checkpoint holds no search state for a generation that continues one")
    if index == 0 or schedule[index].samples == schedule[index - 1].samples:
        return state
    return CemState(
        generation=state.generation,
        mean=state.mean,
        sd=np.maximum(state.sd, least),
        elite=state.elite,
        elite_losses=state.elite_losses,
        elite_sd=state.elite_sd,
        rng=state.rng,
    )


def _best(problem: Problem, run: _Run) -> tuple[Array, Array]:
    # The last search may have been cut short on a shorter horizon: judge all on the full one.
    contenders = [(x, sd) for x, sd, _ in run.winners]
    if run.state is not None and len(run.state.elite):
        contenders.append((run.state.elite[0], run.state.elite_sd))
        contenders.append((np.clip(run.state.mean, problem.space.lower, problem.space.upper), run.state.elite_sd))
    if not contenders:
        return problem.space.mean, problem.space.sd
    losses = problem.forward.losses(np.stack([x for x, _ in contenders]), problem.forward.samples)
    return contenders[int(np.argmin(losses))]
