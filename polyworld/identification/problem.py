"""A fitting problem made ready: the fitted window, the forward model on it, and the report at its end."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.identification.accuracy import Accuracy, accuracy
from polyworld.identification.determinable import reasons_undeterminable
from polyworld.identification.forward import ForwardModel, MakeSimulator
from polyworld.identification.free_parameters import FitParameter, SearchSpace
from polyworld.identification.objective import DIVERGED, Objective, ObjectiveSettings
from polyworld.identification.result import FitResult, FittedValue, LossPoint, Method, Undetermined
from polyworld.identification.sensitivity import Sensitivity, sensitivity
from polyworld.parameters import specification, with_parameters
from polyworld.tracks import ObservedTracks
from polyworld.trajectory import BatchTrajectory, Trajectory
from polyworld.world import World

Array = NDArray[np.float64]


@dataclass
class Problem:
    """World, tracks and unknowns, checked; `forward` evaluates candidates over the fitted window."""

    world: World
    tracks: ObservedTracks
    window: ObservedTracks
    space: SearchSpace
    forward: ForwardModel
    make_simulator: MakeSimulator
    started: float

    @classmethod
    def of(
        cls,
        world: World,
        tracks: ObservedTracks,
        parameters: Sequence[FitParameter],
        *,
        objective: ObjectiveSettings,
        holdout_from: int | None,
        batch: int,
        prior_weight: float,
        make_simulator: MakeSimulator,
    ) -> Problem:
        """Check everything and build the simulator.

        holdout_from: first frame number left out of the fit. Raises ValueError when no observed frame is left
        on either side of it, or a parameter does not suit the world.
        """
        started = time.perf_counter()
        space = SearchSpace.of(world, parameters)
        window = tracks
        if holdout_from is not None:
            if len(tracks.frames) == 0 or not tracks.frames[0] < holdout_from <= tracks.frames[-1]:
                span = f"{int(tracks.frames[0]) + 1}..{int(tracks.frames[-1])}" if len(tracks.frames) else "no frame"
                raise ValueError(f"holdout_from must lie in {span}, got {holdout_from}")
            window = tracks.window(int(tracks.frames[0]), holdout_from - 1)
        forward = ForwardModel(
            world, Objective(world, window, objective), space, make_simulator, batch=batch, prior_weight=prior_weight
        )
        return cls(world, tracks, window, space, forward, make_simulator, started)

    def loss(self, coordinates: Array) -> float:
        """Loss of one candidate (P,) over the fitted window."""
        return float(self.forward.losses(coordinates[None], self.forward.samples)[0])

    def starting_loss(self) -> float:
        """Loss of the world as given, without any parameter changed."""
        objective = self.forward.objective
        return float(objective.losses(self._simulate(self.world, objective.tracks))[0])

    def fitted_world(self, coordinates: Array) -> World:
        """The world with the values of one candidate (P,)."""
        return with_parameters(self.world, self.space.assignments(coordinates))

    def finish(
        self,
        method: Method,
        status: Literal["completed", "cancelled"],
        coordinates: Array,
        spread: Array | None,
        history: Sequence[LossPoint],
        seed: int,
        seconds_before: float = 0.0,
    ) -> FitResult:
        """Standard errors, what is undetermined, accuracies before and after, and everything counted."""
        search_rollouts = self.forward.rollouts
        samples = self.forward.samples
        loss = self.loss(coordinates)
        laplace = sensitivity(self.forward, coordinates, samples) if loss < DIVERGED else None
        fitted = self.fitted_world(coordinates)
        start_window, start_rest = self._accuracies(self.world)
        end_window, end_rest = self._accuracies(fitted)
        objective = self.forward.objective
        return FitResult(
            method=method,
            status=status,
            world=fitted,
            loss=loss,
            loss_start=self.starting_loss(),
            values=self._values(coordinates, spread, laplace),
            undetermined=self._undetermined(laplace),
            accuracy_start=start_window,
            accuracy=end_window,
            held_out_start=start_rest,
            held_out=end_rest,
            noise_factor=laplace.noise_factor if laplace else float("nan"),
            correlation_time=laplace.correlation_time if laplace else float("nan"),
            rollouts=search_rollouts,
            rollouts_for_errors=self.forward.rollouts - search_rollouts,
            seconds=seconds_before + time.perf_counter() - self.started,
            seed=seed,
            history=tuple(history),
            fitted_frames=(int(self.window.frames[0]), int(self.window.frames[-1])),
            unobserved=objective.readout.unobserved,
            unmodelled=objective.readout.unmodelled,
        )

    def _accuracies(self, world: World) -> tuple[Accuracy | None, Accuracy | None]:
        batch = self._simulate(world, self.tracks)
        if batch.diverged[0]:
            return None, None
        whole = batch.world(0)
        count = len(self.window.frames)
        keep = slice(0, count)
        fitted = accuracy(world, self.window, _cut(whole, keep))
        if count == len(self.tracks.frames):
            return fitted, None
        rest = self.tracks.window(int(self.tracks.frames[count]), int(self.tracks.frames[-1]))
        return fitted, accuracy(world, rest, _cut(whole, slice(count, None)))

    def _simulate(self, world: World, tracks: ObservedTracks) -> BatchTrajectory:
        times = tracks.frames.astype(np.float64) * world.time.seconds_per_frame
        return self.make_simulator(world, times, n_worlds=1).run()

    def _values(self, at: Array, spread: Array | None, laplace: Sensitivity | None) -> tuple[FittedValue, ...]:
        values = self.space.values(at)
        width = self.space.upper - self.space.lower
        # Nearer to a bound than the value is known: the data may well want it beyond.
        near = 0.01 * width
        if laplace is not None:
            near = np.maximum(near, laplace.standard_error)
        on_bound = np.minimum(at - self.space.lower, self.space.upper - at) < near
        # d value / d coordinate: the value itself on a logarithmic scale.
        slope = np.where(self.space.logarithmic, values, 1.0)
        return tuple(
            FittedValue(
                name=p.name,
                value=float(values[i]),
                unit=specification(self.world, p.paths[0]).unit,
                lower=p.lower,
                upper=p.upper,
                spread=None if spread is None else float(spread[i] * slope[i]),
                standard_error=float("nan") if laplace is None else float(laplace.standard_error[i] * slope[i]),
                at_bound=bool(on_bound[i]),
                paths=p.paths,
            )
            for i, p in enumerate(self.space.parameters)
        )

    def _undetermined(self, laplace: Sensitivity | None) -> tuple[Undetermined, ...]:
        parameters = self.space.parameters
        reasons = reasons_undeterminable(self.world, self.window)
        found: list[Undetermined] = []
        if laplace is None:
            found.append(Undetermined(tuple(p.name for p in parameters), "the fitted world's rollout diverges"))
        else:
            combined = {i for group in laplace.combinations for i in group}
            for i, p in enumerate(parameters):
                known = [reasons[path] for path in p.paths if path in reasons]
                if laplace.insensitive[i]:
                    reason = "; ".join(known) or "no observation within the fitted frames changes with it"
                    found.append(Undetermined((p.name,), reason))
                elif laplace.undetermined[i] and i not in combined:
                    reason = "the observations narrow its range by less than a third"
                    found.append(Undetermined((p.name,), reason))
            for group in laplace.combinations:
                names = tuple(parameters[i].name for i in group)
                found.append(Undetermined(names, "only combinations of these are determined, not each alone"))
        fitted = {path for p in parameters for path in p.paths}
        for path, reason in reasons.items():
            if path not in fitted and path.rsplit(".", 1)[1] in ("friction", "restitution", "mass"):
                found.append(Undetermined((path,), f"not fitted: {reason}"))
        return tuple(found)


def _cut(trajectory: Trajectory, keep: slice) -> Trajectory:
    return Trajectory(
        names=trajectory.names,
        times=trajectory.times[keep],
        positions=trajectory.positions[keep],
        orientations=trajectory.orientations[keep],
        velocities=trajectory.velocities[keep],
        angular_velocities=trajectory.angular_velocities[keep],
        active=trajectory.active[keep],
        deformables={name: motion.select(keep) for name, motion in trajectory.deformables.items()},
    )
