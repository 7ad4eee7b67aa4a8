"""The experiment that would decide between hypotheses: which object, started how, and what to watch.

Starts are tried on a grid that reaches beyond what was measured: at rest, three times the speeds seen, opposite
headings, other heights, spin reversed. For each, every hypothesis foretells the motion. How far two of them are apart
is what no change of the new run's initial state, and no change of the parameters within what is known of them, can make
up: the length of the difference of the two forecasts, whitened, with those directions projected out (a linearised form
of the criterion of Box & Hill 1967, Technometrics 9, 57).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import Design, RunDesign, design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import Noise
from polyworld.estimation.unknown import Unknown
from polyworld.recording import Recording, Run
from polyworld.world import World

Array = NDArray[np.float64]

ENOUGH = 5.0  # separation in noise units that decides: an odds ratio of e^12 in a Gaussian likelihood
SPEEDS = (0.0, 1.0, 3.0)  # of the fastest start seen
HEADINGS = np.arange(4) * (np.pi / 2)
RISES = (0.0, np.pi / 4)
LIFTS = (0.0, 1.0)  # of the extent of the motion seen, upwards
SPINS = (1.0, -1.0)
STATE_STEP = 1e-4  # of a typical change, for difference quotients


@dataclass(frozen=True)
class Contender:
    """A fitted hypothesis: names of its effects, its child world, unknowns, their values (S,) and covariance (S, S)."""

    names: tuple[str, ...]
    world: World
    unknowns: tuple[Unknown, ...]
    values: Array
    covariance: Array


@dataclass(frozen=True)
class Separation:
    """How far two contenders' forecasts are apart, in standard deviations of the noise."""

    first: tuple[str, ...]
    second: tuple[str, ...]
    sigmas: float


@dataclass(frozen=True)
class Experiment:
    """A run to be made. position [m], velocity [m/s], angular_velocity [rad/s] at its start, world axes.

    watch: component and instant at which the two likeliest contenders differ most, as they stand and once their starts
    are adjusted;
    forecasts: what each contender expects there. decides: whether every pair is separated by at least `ENOUGH`.
    """

    object: str
    position: tuple[float, float, float]
    velocity: tuple[float, float, float]
    angular_velocity: tuple[float, float, float]
    duration: float
    interval: float
    separations: tuple[Separation, ...]
    watch: str
    forecasts: dict[str, float]
    decides: bool

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "object": self.object,
            "position": list(self.position),
            "velocity": list(self.velocity),
            "angular_velocity": list(self.angular_velocity),
            "duration": self.duration,
            "interval": self.interval,
            "watch": self.watch,
            "forecasts": self.forecasts,
            "separations": [
                {"first": list(s.first), "second": list(s.second), "sigmas": s.sigmas} for s in self.separations
            ],
            "decides": self.decides,
        }


def propose_experiment(plan: Design, noise: Noise, contenders: Sequence[Contender]) -> Experiment | None:
    """The start, among those of a grid, at which the least separated pair of contenders is separated most.

    Only one free rigid object is started anew; the others start as in the first run. None where no object can be (all
    are held by joints or deformable) or where fewer than two contenders are given.
    """
    if len(contenders) < 2:
        return None
    best: Experiment | None = None
    for name in dict.fromkeys(s.name for s in plan.runs[0].states if s.kind == "free" and "position.x" in s.labels):
        found = _best_for(plan, noise, contenders, name)
        if found is not None and (best is None or _least(found) > _least(best)):
            best = found
    return best


def _least(experiment: Experiment) -> float:
    return min(s.sigmas for s in experiment.separations)


def _best_for(plan: Design, noise: Noise, contenders: Sequence[Contender], name: str) -> Experiment | None:
    run = plan.runs[0]
    interval = float(np.median(np.diff(run.run.times)))
    count = len(run.run.times)
    times = np.arange(count, dtype=np.float64) * interval
    # A fall, so that no body is taken for one at rest, which has fewer coordinates.
    fall = 0.5 * np.asarray(plan.world.environment.gravity) * times[:, None] ** 2
    blank = Run(
        "trial",
        run.run.names,
        times,
        np.repeat(fall[:, None], len(run.run.names), axis=1),
        np.where(np.isfinite(run.run.orientations), run.run.orientations, np.nan),
        symmetry=run.run.symmetry,
    )
    blank = _with_measured_axes(blank, run)
    trial = design(plan.world, Recording((blank,)))
    own = trial.runs[0]
    starts = _starts(plan, own, name)
    if not len(starts):
        return None
    sigma = _sigma(noise, plan, own)
    forecasts = [_forecast(trial, c, starts, sigma) for c in contenders]
    pairs = list(combinations(range(len(contenders)), 2))
    separation = np.array([[_separation(forecasts[i], forecasts[j], e) for i, j in pairs] for e in range(len(starts))])
    separation = np.where(np.isfinite(separation), separation, 0.0)
    chosen = int(np.argmax(separation.min(axis=1)))
    watched, expected = _watch(own, contenders, forecasts, chosen, sigma)
    state = dict(zip(own.labels, starts[chosen], strict=True))
    item = plan.world.object(name)

    def vector(label: str, default: Sequence[float]) -> tuple[float, float, float]:
        x, y, z = (float(state.get(f"{name}.{label}.{a}", default[i])) for i, a in enumerate("xyz"))
        return x, y, z

    return Experiment(
        object=name,
        position=vector("position", item.position),
        velocity=vector("velocity", item.velocity),
        angular_velocity=vector("angular_velocity", item.angular_velocity),
        duration=float(own.times[-1]),
        interval=interval,
        separations=tuple(
            Separation(contenders[i].names, contenders[j].names, float(separation[chosen, p]))
            for p, (i, j) in enumerate(pairs)
        ),
        watch=watched,
        forecasts=expected,
        decides=bool(separation[chosen].min() >= ENOUGH),
    )


def _with_measured_axes(blank: Run, own: RunDesign) -> Run:
    """The blank run with those components alone that the first run measured."""
    for column, name in enumerate(blank.names):
        axes = {s.axis for s in own.series if s.name == name and s.kind == "position"}
        blank.positions[:, column, [a for a in range(3) if a not in axes]] = np.nan
        if not any(s.name == name and s.kind == "rotation" for s in own.series):
            blank.orientations[:, column] = np.nan
        spins = [s.axis for s in own.series if s.name == name and s.kind == "spin"]
        blank.angular_velocities[:, column, spins] = 0.0
    return blank


def _sigma(noise: Noise, plan: Design, own: RunDesign) -> Array:
    """Noise levels (m,) of the new run: those of the same series of the first one."""
    first = noise.sigma[0]
    sigma = np.empty(own.length)
    levels = {(s.name, s.kind, s.axis): float(np.median(first[s.where])) for s in plan.runs[0].series}
    for s in own.series:
        sigma[s.where] = levels[s.name, s.kind, s.axis]
    return sigma


def _starts(plan: Design, own: RunDesign, name: str) -> Array:
    """Initial-state coordinates (E, N) of the experiments tried with one object."""
    labels = list(own.labels)
    at_rest = [{f"{s.name}.{k}": v for s in r.states for k, v in s.at_rest.items()} for r in plan.runs]
    states = [known | dict(zip(r.labels, r.start, strict=True)) for known, r in zip(at_rest, plan.runs, strict=True)]
    first = np.array([states[0].get(label, 0.0) for label in labels])
    speeds = [np.linalg.norm([s.get(f"{name}.velocity.{a}", 0.0) for a in "xyz"]) for s in states]
    fastest = max(float(np.max(speeds)), 0.5)
    spins = [np.array([s.get(f"{name}.angular_velocity.{a}", 0.0) for a in "xyz"]) for s in states]
    spin = spins[int(np.argmax([np.linalg.norm(s) for s in spins]))]
    seen = [r.run.positions[:, r.run.names.index(name)] for r in plan.runs if name in r.run.names]
    everywhere = np.concatenate(seen)
    extent = float(np.nanmax(np.ptp(np.nan_to_num(everywhere, nan=0.0), axis=0)))
    middle = np.nan_to_num(np.nanmedian(everywhere, axis=0))
    flat = f"{name}.position.z" not in labels
    found = []
    for speed in SPEEDS:
        for heading in HEADINGS if speed > 0.0 else HEADINGS[:1]:
            for rise in (0.0,) if flat or speed == 0.0 else RISES:
                for lift in (0.0,) if flat else LIFTS:
                    for turn in SPINS if np.any(spin) else (1.0,):
                        velocity = speed * fastest * _direction(heading, rise)
                        place = middle + np.array([0.0, 0.0, lift * extent])
                        found.append(_placed(first, labels, name, place, velocity, turn * spin))
    return np.array(found)


def _direction(heading: float, rise: float) -> Array:
    return np.array([np.cos(heading) * np.cos(rise), np.sin(heading) * np.cos(rise), np.sin(rise)])


def _placed(first: Array, labels: list[str], name: str, place: Array, velocity: Array, spin: Array) -> Array:
    state = first.copy()
    for field, vector in (("position", place), ("velocity", velocity), ("angular_velocity", spin)):
        for i, axis in enumerate("xyz"):
            label = f"{name}.{field}.{axis}"
            if label in labels:
                state[labels.index(label)] = vector[i]
    return state


@dataclass(frozen=True)
class _Forecast:
    """Whitened motion (E, m), its derivatives by the start (E, m, N), and by the parameters, in units of what is known
    of them (E, m, S)."""

    motion: Array
    by_start: Array
    by_parameter: Array


def _forecast(trial: Design, contender: Contender, starts: Array, sigma: Array) -> _Forecast:
    own = trial.runs[0]
    n, s, e = own.count, len(contender.unknowns), len(starts)
    # Directions in which the parameters are uncertain, one standard deviation long.
    values, vectors = np.linalg.eigh(contender.covariance) if s else (np.zeros(0), np.zeros((0, 0)))
    typical = np.array([u.typical for u in contender.unknowns])
    roots = vectors * np.sqrt(np.clip(values, 0.0, (10.0 * typical.max(initial=0.0)) ** 2))
    lower = np.array([u.lower for u in contender.unknowns])
    upper = np.array([u.upper for u in contender.unknowns])
    step = STATE_STEP * own.typical
    shared = np.repeat(contender.values[None, None], e, axis=0).repeat(1 + n + s, axis=1)
    states = np.repeat(starts[:, None], 1 + n + s, axis=1)
    states[:, 1 + np.arange(n), np.arange(n)] += step
    small = 0.1
    shared[:, 1 + n :] += small * roots.T
    shared = np.clip(shared, lower, upper)
    forward = Forward(trial, contender.world, contender.unknowns)
    flat = Settings(0, shared.reshape(-1, s), states.reshape(-1, n))
    motion = (forward.residuals([flat])[0] / sigma).reshape(e, 1 + n + s, -1)
    slopes = np.nan_to_num(motion[:, 1:] - motion[:, :1])
    return _Forecast(
        motion[:, 0],
        np.swapaxes(slopes[:, :n] / step[:, None], 1, 2),
        np.swapaxes(slopes[:, n:] / small, 1, 2),
    )


def _separation(a: _Forecast, b: _Forecast, experiment: int) -> float:
    """The part of the difference that neither start nor parameters can make up; the smaller of the two views."""
    difference = a.motion[experiment] - b.motion[experiment]
    if not np.all(np.isfinite(difference)):
        return 0.0
    lengths = []
    for own in (a, b):
        starts = own.by_start[experiment]
        basis, size, _ = np.linalg.svd(starts, full_matrices=False)
        basis = basis[:, size > 1e-9 * size.max(initial=0.0)]
        left = difference - basis @ (basis.T @ difference)
        # Parameters are known to one standard deviation: moving them so far costs as much as a residual of one.
        wide = np.concatenate([a.by_parameter[experiment], b.by_parameter[experiment]], axis=1)
        wide = wide - basis @ (basis.T @ wide)
        moves = np.linalg.solve(wide.T @ wide + np.eye(wide.shape[1]), wide.T @ left)
        lengths.append(float(np.sqrt(max(left @ (left - wide @ moves), 0.0))))
    return min(lengths)


def _watch(
    own: RunDesign, contenders: Sequence[Contender], forecasts: list[_Forecast], chosen: int, sigma: Array
) -> tuple[str, dict[str, float]]:
    """The component and instant of the first pair's greatest difference, and what each contender expects there.

    It counts as far as the forecasts are apart, and as far as another start cannot make that up.
    """
    difference = forecasts[0].motion[chosen] - forecasts[1].motion[chosen]
    starts = forecasts[0].by_start[chosen]
    basis, size, _ = np.linalg.svd(starts, full_matrices=False)
    basis = basis[:, size > 1e-9 * size.max(initial=0.0)]
    left = np.abs(np.nan_to_num(difference - basis @ (basis.T @ difference)))
    at = int(np.argmax(np.minimum(left, np.abs(np.nan_to_num(difference)))))
    series = next(s for s in own.series if s.where.start <= at < s.where.stop)
    time = own.times[series.rows[at - series.where.start]]
    label = f"{series.kind}.{'xyz'[series.axis]} of {series.name} at {time:.3g} s"
    return label, {
        " + ".join(c.names): float(f.motion[chosen, at] * sigma[at]) for c, f in zip(contenders, forecasts, strict=True)
    }
