"""A fit made ready: losses and residuals of many candidates by batches of rollouts, and the report at its end."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit.accuracy import Accuracy, errors
from polyworld.estimation.world_fit.determinable import reasons_undeterminable
from polyworld.estimation.world_fit.objective import DIVERGED, Judged, Objective, ObjectiveSettings
from polyworld.estimation.world_fit.observed import observed_entries, sample_times
from polyworld.estimation.world_fit.result import FitResult, FittedValue, LossPoint, Method, Status, Undetermined
from polyworld.estimation.world_fit.search_space import SearchSpace
from polyworld.estimation.world_fit.sensitivity import Sensitivity, sensitivity
from polyworld.estimation.world_fit.support_constraints import SupportConstraint
from polyworld.model import model_of
from polyworld.solver.rollout import Simulator, simulator
from polyworld.trajectory import BatchTrajectory
from polyworld.world import World
from polyworld.world.materials import PLANAR, material_of
from polyworld.world.parameters import specification, with_parameters

Array = NDArray[np.float64]
Measured = TypeVar("Measured")

MOST_BYTES = 500_000_000  # of the motion that one batch of rollouts keeps
BYTES_OF_BODY, BYTES_OF_POINT = 104, 48  # pose and rates, and position and velocity, of one sample


class MakeSimulator(Protocol):
    """Anything that makes a simulator as `polyworld.solver.rollout.simulator` does."""

    def __call__(self, world: World, sample_times: Array, *, n_worlds: int) -> Simulator: ...


@dataclass(frozen=True)
class DescentStep:
    """Where a descent by least squares stands after an iteration.

    number: of the iteration, from 1; `of` are made at most. samples: sample times compared. error: of the iteration's
    best trial, best_error: of the best so far, in `Objective.error_unit`; best_loss: the loss there.
    """

    number: int
    of: int
    samples: int
    error: float
    best_error: float
    best_loss: float


class FitProblem:
    """World, tracks and unknowns, checked: candidates in search coordinates in, losses or residuals out.

    window: the fitted frames. rollouts: simulated since `begin`. watch: called after each iteration of least squares.
    """

    watch: Callable[[DescentStep], None] | None = None

    def __init__(
        self,
        world: World,
        tracks: ObservedTracks,
        unknowns: Sequence[Unknown],
        *,
        objective: ObjectiveSettings | None = None,
        holdout_from: int | None = None,
        constraints: Sequence[SupportConstraint] = (),
        make_simulator: MakeSimulator = simulator,
    ) -> None:
        """Check everything.

        holdout_from: first frame left out of the fit and used to judge it. Raises ValueError when no observed frame is
        left on either side of it, ValueError or KeyError where an unknown or the tracks do not suit the world.
        """
        self.world, self.tracks, self.window = world, tracks, tracks
        self._holdout_from = holdout_from
        self.space = SearchSpace(world, unknowns, constraints)
        if holdout_from is not None:
            if len(tracks.frames) == 0 or not tracks.frames[0] < holdout_from <= tracks.frames[-1]:
                span = f"{int(tracks.frames[0]) + 1}..{int(tracks.frames[-1])}" if len(tracks.frames) else "no frame"
                raise ValueError(f"holdout_from must lie in {span}, got {holdout_from}")
            self.window = tracks.window(int(tracks.frames[0]), holdout_from - 1)
        self.objective = Objective(world, self.window, objective)
        self._make_simulator = make_simulator
        self._simulators: dict[int, Simulator] = {}
        self.begin()

    def with_unknowns(self, unknowns: Sequence[Unknown], world: World) -> FitProblem:
        """Return the same problem with other unknowns, in `world`, which may have more effects."""
        other = FitProblem(
            world,
            self.tracks,
            unknowns,
            objective=self.objective.settings,
            holdout_from=self._holdout_from,
            constraints=self.space.constraints,
            make_simulator=self._make_simulator,
        )
        other.watch = self.watch
        return other

    @property
    def samples(self) -> int:
        """Number of sample times of the full horizon."""
        return len(self.objective.sample_times)

    def begin(self) -> None:
        """Restart the counts of rollouts and time, for a search of its own."""
        self.rollouts = 0
        self._started = time.perf_counter()

    def losses(self, candidates: Array, samples: int) -> Array:
        """Return the loss (N,) of candidates (N, P) over the first `samples` sample times.

        With the prior: D + R, where R is the sum of squared prior residuals over the same normaliser as the data's, so
        that the minimum is the most probable value.
        """
        return self.judged(candidates, samples).losses

    def judged(self, candidates: Array, samples: int) -> Judged:
        """Return the losses as `losses` does, and the errors that a person reads beside them."""
        prior = (self.space.prior_residuals(candidates) ** 2).sum(axis=1)
        parts = self._over(candidates, samples, self.objective.judged)
        losses = np.concatenate([part.losses for part in parts])
        errors = np.concatenate([part.errors for part in parts])
        return Judged(losses + prior / self.objective.weight(samples), errors)

    def loss(self, at: Array) -> float:
        """Return the loss of one candidate (P,) over the full horizon."""
        return float(self.losses(at[None], self.samples)[0])

    def residuals(self, candidates: Array, samples: int | None = None) -> Array:
        """Weighted standardised residuals (N, r) of candidates (N, P), the prior's last; NaN rows where diverged.

        samples: over the first of them; default all.
        """
        data = np.concatenate(self._over(candidates, samples or self.samples, self.objective.residuals))
        return np.concatenate([data, self.space.prior_residuals(candidates)], axis=1)

    def huber_weights(self, at: Array, samples: int | None = None) -> Array:
        """Return weights (r,) of iterated least squares at one candidate (P,), 1 for the prior's residuals."""
        (data,) = self._over(at[None], samples or self.samples, self.objective.huber_weights)[0]
        return np.concatenate([data, np.ones(self.space.prior_residuals(at[None]).shape[1])])

    def difference_quotients(
        self, at: Array, steps: Array, samples: int | None = None, only: NDArray[np.bool_] | None = None
    ) -> Array:
        """Jacobian (r, P) of the residuals by central differences, one-sided where a bound is in the way.

        samples: over the first of them; default all. only (P,): columns that are computed, the others are zero; default
        all. Entries whose rollouts diverged are zero: nothing can be said about them.
        """
        up = np.minimum(at + steps, self.space.upper)
        down = np.maximum(at - steps, self.space.lower)
        columns = np.arange(len(at)) if only is None else np.flatnonzero(only)
        count, index = len(columns), np.arange(len(columns))
        candidates = np.repeat(at[None], 2 * count, axis=0)
        candidates[index, columns], candidates[count + index, columns] = up[columns], down[columns]
        residuals = self.residuals(candidates, samples)
        jacobian = np.zeros((residuals.shape[1], len(at)))
        jacobian[:, columns] = (residuals[:count] - residuals[count:]).T / (up - down)[columns]
        return np.where(np.isfinite(jacobian), jacobian, 0.0)

    def _over(self, candidates: Array, samples: int, measure: Callable[[BatchTrajectory], Measured]) -> list[Measured]:
        """Measure candidates (N, P) in batches of as many as may be kept."""
        most = most_worlds(self.world, self.objective.sample_times)
        parts: list[Measured] = []
        for first in range(0, len(candidates), most):
            part = candidates[first : first + most]
            if len(part) not in self._simulators:
                times = self.objective.sample_times
                self._simulators[len(part)] = self._make_simulator(self.world, times, n_worlds=len(part))
            batch = self._simulators[len(part)].run(self.space.overrides(part), samples=samples)
            parts.append(measure(batch))
            self.rollouts += len(part)
        return parts

    def finish(
        self, method: Method, status: Status, at: Array, spread: Array | None, history: Sequence[LossPoint], seed: int
    ) -> FitResult:
        """Report candidate `at` (P,): standard errors, what is undetermined, accuracies before and after."""
        search_rollouts = self.rollouts
        loss = self.loss(at)
        laplace = sensitivity(self, at) if loss < DIVERGED else None
        fitted = with_parameters(self.world, {path: float(v[0]) for path, v in self.space.overrides(at[None]).items()})
        start_window, start_rest = self._accuracies(self.world)
        end_window, end_rest = self._accuracies(fitted)
        observed, moving = self.tracks.observed_names, self.world.moving_names
        return FitResult(
            method=method,
            status=status,
            world=fitted,
            loss=loss,
            loss_start=float(self.objective.losses(self._rollout(self.world, self.window))[0]),
            values=self._values(at, spread, laplace),
            undetermined=self._undetermined(laplace),
            accuracy_start=start_window,
            accuracy=end_window,
            held_out_start=start_rest,
            held_out=end_rest,
            noise_factor=laplace.noise_factor if laplace else float("nan"),
            correlation_time=laplace.correlation_time if laplace else float("nan"),
            rollouts=search_rollouts,
            rollouts_for_errors=self.rollouts - search_rollouts,
            seconds=time.perf_counter() - self._started,
            seed=seed,
            history=tuple(history),
            fitted_frames=(int(self.window.frames[0]), int(self.window.frames[-1])),
            unobserved=tuple(n for n in moving if n not in observed),
            unmodelled=tuple(n for n in observed if n not in moving),
        )

    def _accuracies(self, world: World) -> tuple[Accuracy | None, Accuracy | None]:
        """Over the fitted frames and over those held out."""
        batch = self._rollout(world, self.tracks)
        if batch.stopped[0]:
            return None, None
        entries, fitted, every = observed_entries(world, self.tracks), self.samples, len(self.tracks.frames)
        rest = errors(entries, batch, fitted, every) if fitted < every else None
        return errors(entries, batch, 0, fitted), rest

    def run_one(self, result: FitResult) -> BatchTrajectory:
        """Return the fitted world's motion at the fitted frames."""
        return self._rollout(result.world, self.window)

    def _rollout(self, world: World, tracks: ObservedTracks) -> BatchTrajectory:
        return self._make_simulator(world, sample_times(world, tracks), n_worlds=1).run()

    def _values(self, at: Array, spread: Array | None, laplace: Sensitivity | None) -> tuple[FittedValue, ...]:
        space, values = self.space, self.space.values(at)
        error = np.full(len(at), np.nan) if laplace is None else laplace.standard_error
        # Nearer to a bound than the value is known: the data may well want it beyond.
        on_bound = np.minimum(at - space.lower, space.upper - at) < np.fmax(0.01 * space.width, error)
        # d value / d coordinate: the value itself on a logarithmic scale.
        slope = np.where(space.logarithmic, values, 1.0)
        return tuple(
            FittedValue(
                name=u.name,
                value=float(values[i]),
                unit=specification(self.world, u.paths[0]).unit,
                bounds=(u.lower, u.upper),
                spread=None if spread is None else float(spread[i] * slope[i]),
                standard_error=float(error[i] * slope[i]),
                at_bound=bool(on_bound[i]),
                paths=u.paths,
            )
            for i, u in enumerate(space.unknowns)
        )

    def _undetermined(self, laplace: Sensitivity | None) -> tuple[Undetermined, ...]:
        unknowns = self.space.unknowns
        reasons = reasons_undeterminable(self.world, self.window)
        found: list[Undetermined] = []
        if laplace is None:
            found.append(Undetermined(tuple(u.name for u in unknowns), "the fitted world's rollout diverges"))
        else:
            combined = {i for group in laplace.combinations for i in group}
            for i, u in enumerate(unknowns):
                if laplace.insensitive[i]:
                    known = [reasons[path] for path in u.paths if path in reasons]
                    reason = "; ".join(known) or "no observation within the fitted frames changes with it"
                    found.append(Undetermined((u.name,), reason))
                elif laplace.undetermined[i] and i not in combined:
                    reason = "the observations narrow its range by less than a third"
                    found.append(Undetermined((u.name,), reason))
            for group in laplace.combinations:
                names = tuple(unknowns[i].name for i in group)
                found.append(Undetermined(names, "only combinations of these are determined, not each alone"))
        fitted = {path for u in unknowns for path in u.paths}
        for path, reason in reasons.items():
            if path not in fitted and path.rsplit(".", 1)[1] in ("friction", "restitution", "mass"):
                found.append(Undetermined((path,), f"not fitted: {reason}"))
        return tuple(found)


def most_worlds(world: World, times: Array) -> int:
    """Return of how many worlds one batch of rollouts may keep the motion: at least 1."""
    bytes_of_sample = BYTES_OF_BODY * len(world.moving_names)
    for item in world.deformables:
        points = len(model_of(world).mesh(item.name).nodes)
        if (
            material_of(item).form == "liquid" and world.fluid_grid is not None
        ):  # particles of all fluids are kept together
            volume = (world.fluid_grid.cell / 2.0) ** (2 if item.representation.endswith(PLANAR) else 3)
            points = sum(len(model_of(world).mesh(d.name).nodes) for d in world.of_form("liquid"))
            points += int(sum(e.rate for e in world.emitters) * float(times[-1]) / volume)
        bytes_of_sample += BYTES_OF_POINT * points
    return max(MOST_BYTES // max(bytes_of_sample * len(times), 1), 1)
