"""Report what a fit found: constants with intervals, runs with members of the posterior, how they follow the data."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.core.reported import Reported, json_ready
from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.accuracy import Accuracy, Prediction, errors
from polyworld.estimation.declared import Rolling
from polyworld.estimation.least_squares import Minimum, Problem
from polyworld.estimation.posterior import Posterior, SamplingSettings, sample
from polyworld.estimation.readout import sample_times, tracks_readout
from polyworld.estimation.unknown import Unknown
from polyworld.solver.rollout import simulator
from polyworld.world import World
from polyworld.world.parameters import parameter_paths, read_parameter, with_parameters

Array = NDArray[np.float64]

Method = Literal["least_squares", "cem", "random_search"]
TINY = 1e-15  # below which a number is rounding
SKIDS_RARELY = 4.6  # minus twice the logarithm of one in ten: few balls slide and never begin to roll
WEAK = 12.0  # difference of twice the log-evidence beyond which a mode of rolling has less than three in a thousand


@dataclass(frozen=True)
class FittedConstant:
    """A constant: its value at the minimum, its standard deviation, and an interval of it and 80% of the posterior.

    prior: mean and standard deviation, of the natural logarithm where the scale is "log"; None where there is none.
    informed: part of the prior's variance that the data took away; below a half the value is the prior's. draws (N,):
    of the posterior.
    """

    unknown: Unknown
    value: float
    standard_error: float
    interval: tuple[float, float]
    informed: float
    draws: Array

    @property
    def at_bound(self) -> bool:
        """Whether the value lies on a bound that is no physical zero."""
        u = self.unknown
        ends = np.array([u.lower, self.value, u.upper])
        low, value, high = np.log(np.maximum(ends, TINY)) if u.scale == "log" else ends
        near = 0.01 * (high - low)
        return bool(value > high - near or (value < low + near and u.lower > 0.0))

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values, without the draws."""
        return {
            "name": self.unknown.name,
            "paths": list(self.unknown.paths),
            "value": self.value,
            "unit": self.unknown.unit,
            "standard_error": self.standard_error,
            "interval80": list(self.interval),
            "informed": self.informed,
            "at_bound": self.at_bound,
        }


@dataclass(frozen=True)
class FittedRun:
    """One run of a fitted study.

    start: the world as the run's initial state was first guessed, to which `sample` refers. sample: parameter path ->
    values (N,) of the posterior, the minimum first. slack: by collision, standard deviations by which the state after
    it departs from what the model predicts.
    """

    name: str
    world: World
    start: World
    sample: dict[str, Array]
    accuracy: Accuracy | None
    accuracy_start: Accuracy | None
    held_out: Accuracy | None
    prediction: Prediction | None
    slack: tuple[float, ...]
    frames: tuple[int, int]

    def to_dict(self) -> dict[str, Any]:
        """Return the fitted world and how it follows the data as JSON-ready values."""
        judged = {"accuracy": self.accuracy, "held_out": self.held_out, "prediction": self.prediction}
        return {
            "run": self.name,
            "world": self.world.model_dump(mode="json"),
            "frames": list(self.frames),
            **{name: None if found is None else found.to_dict() for name, found in judged.items()},
        }

    def __repr__(self) -> str:
        return f"FittedRun({self.name!r}: {self.world.id}, frames {self.frames[0]} to {self.frames[1]})"


@dataclass(frozen=True, repr=False)
class StudyFit(Reported):
    """A fitted study. cost: robust chi-square with priors at the minimum, and where the fit started; misfit: mean
    robust chi-square of a measured component. rolling: how what can roll moves."""

    method: Method
    constants: tuple[FittedConstant, ...]
    runs: tuple[FittedRun, ...]
    cost: float
    cost_start: float
    misfit: float
    rolling: Rolling
    effective: float
    rollouts: int
    seconds: float
    cancelled: bool

    def summary(self) -> str:
        """Return constants with their 80% intervals, and of each run how it follows and predicts, a line each."""
        lines = [f"Fit of {len(self.runs)} runs by {self.method}: mean robust chi-square {self.misfit:.3g} a component"]
        for found in self.constants:
            low, high = found.interval
            prior = ", from the prior" if found.informed < 0.5 else ""
            unit = "" if found.unknown.unit == "1" else f" {found.unknown.unit}"
            lines.append(f"  {found.unknown.name}: {found.value:.4g}{unit}, 80% {low:.4g} to {high:.4g}{prior}")
        for run in self.runs:
            said = [] if run.accuracy is None else [f"off by {run.accuracy.position:.2g} m rms"]
            if run.prediction is not None:
                worst = max(b.error for b in run.prediction.bodies)
                said.append(f"predicts frames from {run.prediction.frame} on, left out at first, to {worst:.2g} m")
            lines.append(f"  run {run.name}: {'; '.join(said) or 'diverges'}")
        return "\n".join(lines)

    def to_dict(self) -> dict[str, Any]:
        """Return constants, and how each run follows and predicts, as JSON-ready values; draws are left out."""
        found: dict[str, Any] = json_ready(
            {
                "method": self.method,
                "misfit": self.misfit,
                "constants": [c.to_dict() for c in self.constants],
                "runs": [r.to_dict() for r in self.runs],
                "rolling": self.rolling,
                "effective": self.effective,
                "rollouts": self.rollouts,
                "cancelled": self.cancelled,
            }
        )
        return found

    def constant(self, name: str) -> FittedConstant:
        """Return a constant by name; raises KeyError naming the choices."""
        for found in self.constants:
            if found.unknown.name == name:
                return found
        raise KeyError(f"unknown constant {name!r}; fitted: {[c.unknown.name for c in self.constants]}")


@dataclass(frozen=True)
class Found:
    """A fit of one mode of rolling."""

    problem: Problem
    minimum: Minimum
    rolling: Rolling
    cost_start: float
    others: tuple[Found, ...] = ()

    @property
    def evidence(self) -> float:
        """Minus twice the log-evidence, up to a constant: the minimum, and the volume of the prior that it leaves."""
        rare = SKIDS_RARELY if self.rolling == "skids" else 0.0
        return self.problem.evidence(self.minimum) + rare

    @property
    def kept(self) -> tuple[Rolling, ...]:
        """Return the modes of rolling that the evidence leaves, the best first."""
        near = [f.rolling for f in self.others if f.evidence < self.evidence + WEAK]
        return (self.rolling, *near)

    @property
    def every(self) -> tuple[Found, ...]:
        """Return all modes of rolling, the best first."""
        return (self, *self.others)

    @property
    def shares(self) -> list[tuple[Found, float]]:
        """Return the modes of rolling that the evidence leaves, with their probabilities."""
        every = [self, *(f for f in self.others if f.rolling in self.kept)]
        weights = np.exp(-0.5 * (np.array([f.evidence for f in every]) - self.evidence))
        return list(zip(every, weights / weights.sum(), strict=True))

    def begins(self, r: int) -> float:
        """When the last stretch of a run begins [s]."""
        return float(sum(b.link.time for b in self.problem.runs[r] if b.link is not None))


Drawn = Sequence[tuple[Found, Posterior]]
"""The minimum as a sample of one, then members of the posterior of every mode of rolling that the evidence leaves."""


def drawn_from(found: Found, members: int, seed: int, sampling: SamplingSettings) -> Drawn:
    """Sample the posterior of the modes of rolling that the evidence leaves, in proportion to their probabilities."""
    at, shares = found.minimum.point, found.shares
    counts = [round(p * (members - 1)) for _, p in shares]
    counts[0] = members - 1 - sum(counts[1:])
    best = Posterior(at.shared[None], tuple(tuple(y[None] for y in run) for run in at.states), 1.0)
    drawn = [
        (f, sample(f.problem, f.minimum, n, seed, sampling)) for (f, _), n in zip(shares, counts, strict=True) if n
    ]
    return [(found, best), *drawn]


def members_of(drawn: Drawn, r: int, b: int) -> dict[str, Array]:
    """Return parameter path -> values (N,) of the minimum, then of the members, of one block."""
    parts = [f.problem.runs[r][b].overrides(p.shared, p.states[r][b]) for f, p in drawn]
    world, joint = drawn[0][0].problem.runs[r][b].world, dict[str, Array]()
    for path in dict.fromkeys(path for part in parts for path in part):
        own = read_parameter(world, path) or 0.0
        each = [part.get(path, np.full(len(p.shared), own)) for part, (_, p) in zip(parts, drawn, strict=True)]
        joint[path] = np.concatenate(each)
    return joint


def constants_of(drawn: Drawn) -> dict[str, Array]:
    """Return constants by name, coordinates (N,) of the minimum, then of the members; NaN where one has no such."""
    joint: dict[str, Array] = {}
    for name, u in {u.name: u for f, _ in reversed(drawn) for u in f.problem.shared}.items():
        columns = [[i for i, v in enumerate(f.problem.shared) if v.name == name] for f, _ in drawn]
        each = [
            p.shared[:, c[0]] if c else np.full(len(p.shared), np.nan) for (_, p), c in zip(drawn, columns, strict=True)
        ]
        joint[name] = np.concatenate(each) if u.scale == "log" else np.maximum(np.concatenate(each), u.lower)
    return joint


def fitted_constants(drawn: Drawn) -> tuple[FittedConstant, ...]:
    """Return the constants of the minimum with what the members say of them."""
    problem, minimum, named = drawn[0][0].problem, drawn[0][0].minimum, constants_of(drawn)
    found = []
    for i, u in enumerate(problem.shared):
        draws = named[u.name][1:]
        draws = draws[np.isfinite(draws)]
        spread = float(draws.std())
        flat = (problem.upper - problem.lower)[i] / np.sqrt(12.0)
        prior = problem.prior_sd[i] if np.isfinite(problem.prior_sd[i]) else flat
        if u.prior is not None and u.lower == 0.0 and u.prior[0] == 0.0:
            prior *= np.sqrt(0.5 - 0.5 / np.pi)  # of a normal variable, 0 where it is negative
        values = np.exp(draws) if u.scale == "log" else draws
        x = float(minimum.point.shared[i] if u.scale == "log" else max(minimum.point.shared[i], u.lower))
        low, high = np.quantile(values, [0.1, 0.9])
        informed = float(np.clip(1.0 - (spread / prior) ** 2, 0.0, 1.0))
        value = float(np.exp(x)) if u.scale == "log" else x
        interval = min(float(low), value), max(float(high), value)  # a minimum may lie in a tail
        found.append(FittedConstant(u, value, float(values.std()), interval, informed, values))
    return tuple(found)


def with_values(world: World, values: dict[str, float]) -> World:
    """Return a world with parameters (by path) of those it has, within their bounds."""
    known = parameter_paths(world)
    inside = {p: float(np.clip(v, known[p].lower, known[p].upper)) for p, v in values.items() if p in known}
    inside = {p: v if abs(v) > TINY else 0.0 for p, v in inside.items()}
    return with_parameters(world, inside)


def accuracy_of(world: World, tracks: ObservedTracks, cut: int | None = None) -> Accuracy | None:
    """Compare a world with tracks, from frame `cut` on; None where it diverges."""
    batch = simulator(world, sample_times(world, tracks), n_worlds=1).run()
    if batch.stopped[0]:
        return None
    first = 0 if cut is None else int(np.searchsorted(tracks.frames, cut))
    return errors(tracks_readout(world, tracks), batch, first, len(tracks.frames))
