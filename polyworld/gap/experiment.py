"""The experiment that would decide between hypotheses: which object, started how, and what to watch.

Starts are tried on a grid that reaches beyond what was measured: at rest, three times the speeds seen, opposite
headings, other heights, spin reversed. For each, every hypothesis predicts the motion. How far two of them are apart
is what no change of the new run's initial state, and no change of the parameters within what is known of them, can make
up: the length of the difference of the two forecasts, whitened, with those directions projected out (a linearised form
of the criterion of Box & Hill 1967, Technometrics 9, 57).
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import Design, RunDesign, design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import Noise
from polyworld.estimation.unknown import Unknown
from polyworld.gap.settings import ExperimentSettings
from polyworld.world import World

Array = NDArray[np.float64]

STATE_STEP = 1e-4  # of a typical change, for difference quotients
PARAMETER_STEP = 0.1  # of a standard deviation, likewise


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
    forecasts: what each contender expects there. decides: whether every pair is separated by enough noise.
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
        """Return JSON-ready values."""
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


def propose_experiment(
    plan: Design, noise: Noise, contenders: Sequence[Contender], settings: ExperimentSettings | None = None
) -> Experiment | None:
    """Find the start, among those of a grid, at which the least separated pair of contenders is separated most.

    One free rigid object is started differently; the others start as in the first run. None where no object can be (all
    are held by joints or deformable) or where fewer than two contenders are given.
    """
    if len(contenders) < 2:
        return None
    names = dict.fromkeys(s.name for s in plan.runs[0].states if s.kind == "free" and "position.x" in s.labels)
    found = [_best_for(plan, noise, contenders, name, settings or ExperimentSettings()) for name in names]
    return max(found, key=lambda e: min(s.sigmas for s in e.separations), default=None)


def _best_for(
    plan: Design, noise: Noise, contenders: Sequence[Contender], name: str, settings: ExperimentSettings
) -> Experiment:
    spins = _spins(plan, name)
    trials = design(plan.world, Recording(tuple(_blank_run(plan, name, spin, k) for k, spin in enumerate(spins))))
    own = trials.runs[0]
    starts = np.array([_starts(plan, r, name, spin, settings) for r, spin in zip(trials.runs, spins, strict=True)])
    sigma = _sigma(noise, plan, own)
    forecasts = [_forecast(trials, c, starts, sigma) for c in contenders]
    pairs = list(itertools.combinations(range(len(contenders)), 2))
    count = starts.shape[0] * starts.shape[1]
    separation = np.array([[_separation(forecasts[i], forecasts[j], e) for i, j in pairs] for e in range(count)])
    separation = np.where(np.isfinite(separation), separation, 0.0)
    chosen = int(np.argmax(separation.min(axis=1)))
    watched, expected = _watch(own, contenders, forecasts, chosen, sigma)
    of_spin, of_start = divmod(chosen, starts.shape[1])
    state = dict(zip(own.labels, starts[of_spin, of_start], strict=True))
    item = plan.world.object(name)

    def vector(label: str, default: Sequence[float]) -> tuple[float, float, float]:
        x, y, z = (float(state.get(f"{name}.{label}.{a}", default[i])) for i, a in enumerate("xyz"))
        return x, y, z

    return Experiment(
        object=name,
        position=vector("position", item.position),
        velocity=vector("velocity", item.velocity),
        angular_velocity=vector("angular_velocity", spins[of_spin].tolist()),
        duration=float(own.times[-1]),
        interval=float(own.times[1]),
        separations=tuple(
            Separation(contenders[i].names, contenders[j].names, float(separation[chosen, p]))
            for p, (i, j) in enumerate(pairs)
        ),
        watch=watched,
        forecasts=expected,
        decides=bool(separation[chosen].min() >= settings.enough),
    )


def _states(run: RunDesign) -> dict[str, float]:
    """Return all coordinates of a run's initial state by name, as the data suggest them."""
    known = {f"{s.name}.{label}": v for s in run.states for label, v in s.known.items()}
    return known | dict(zip(run.labels, run.start.tolist(), strict=True))


def _vector_of(state: dict[str, float], name: str, label: str, default: Sequence[float] = (0.0, 0.0, 0.0)) -> Array:
    return np.array([state.get(f"{name}.{label}.{a}", default[i]) for i, a in enumerate("xyz")])


def _spins(plan: Design, name: str) -> list[Array]:
    """Return the fastest spin (3,) of an object in any run, and its reverse; one where it does not spin."""
    described = plan.world.object(name).angular_velocity
    seen = [_vector_of(_states(r), name, "angular_velocity", described) for r in plan.runs]
    spin = max(seen, key=lambda w: float(np.linalg.norm(w)))
    return [spin, -spin] if np.any(spin) else [spin]


def _blank_run(plan: Design, name: str, spin: Array, number: int) -> Run:
    """Return a run sampled as the first one, in which an object has a spin."""
    first, run = plan.runs[0], plan.runs[0].run
    times: Array = np.arange(len(run.times), dtype=np.float64) * float(np.median(np.diff(run.times)))
    # A fall, so that no body is taken for one at rest, which has fewer coordinates.
    fall = 0.5 * np.asarray(plan.world.environment.gravity) * times[:, None] ** 2
    positions = np.repeat(fall[:, None], len(run.names), axis=1)
    orientations, spins = run.orientations.copy(), np.full(positions.shape, np.nan)
    for column, other in enumerate(run.names):
        measured = {(s.kind, s.axis) for s in first.series if s.name == other}
        positions[:, column, [a for a in range(3) if ("position", a) not in measured]] = np.nan
        if not any(kind == "rotation" for kind, _ in measured):
            orientations[:, column] = np.nan
        of_spin = [a for a in range(3) if ("spin", a) in measured]
        given = spin if other == name else _vector_of(_states(first), other, "angular_velocity")
        spins[:, column, of_spin] = given[of_spin]
    return Run(
        f"trial {number}",
        run.names,
        times,
        positions,
        orientations,
        symmetry=run.symmetry,
        angular_velocities=spins,
    )


def _sigma(noise: Noise, plan: Design, own: RunDesign) -> Array:
    """Return noise levels (m,) of the new run: those of the same series of the first one."""
    first = noise.sigma[0]
    sigma = np.empty(own.length)
    levels = {(s.name, s.kind, s.axis): float(np.median(first[s.where])) for s in plan.runs[0].series}
    for s in own.series:
        sigma[s.where] = levels[s.name, s.kind, s.axis]
    return sigma


def _starts(plan: Design, own: RunDesign, name: str, spin: Array, settings: ExperimentSettings) -> Array:
    """Return initial-state coordinates (E, N) of the experiments tried with one object and one spin."""
    states = [_states(r) for r in plan.runs]
    fastest = max(*(float(np.linalg.norm(_vector_of(s, name, "velocity"))) for s in states), settings.slowest)
    everywhere = np.concatenate([r.run.positions[:, r.run.names.index(name)] for r in plan.runs if name in r.run.names])
    extent = float(np.nanmax(np.ptp(np.nan_to_num(everywhere, nan=0.0), axis=0)))
    middle = np.nan_to_num(np.nanmedian(everywhere, axis=0))
    flat = f"{name}.position.z" not in own.labels
    found = []
    for speed, lift in itertools.product(settings.speeds, (0.0,) if flat else settings.lifts):
        place = middle + np.array([0.0, 0.0, lift * extent])
        rises = (0.0,) if flat else settings.rises
        directions = [_direction(h, r) for h in settings.headings for r in rises] if speed else [np.zeros(3)]
        for direction in directions:
            vectors = {"position": place, "velocity": speed * fastest * direction, "angular_velocity": spin}
            begin = {f"{name}.{k}.{a}": float(v[i]) for k, v in vectors.items() for i, a in enumerate("xyz")}
            found.append([begin.get(label, states[0].get(label, 0.0)) for label in own.labels])
    return np.array(found)


def _direction(heading: float, rise: float) -> Array:
    return np.array([np.cos(heading) * np.cos(rise), np.sin(heading) * np.cos(rise), np.sin(rise)])


@dataclass(frozen=True)
class _Forecast:
    """Whitened motion (E, m), its derivatives by the start (E, m, N), and by the parameters, in units of what is known
    of them (E, m, S)."""

    motion: Array
    by_start: Array
    by_parameter: Array


def _forecast(trials: Design, contender: Contender, starts: Array, sigma: Array) -> _Forecast:
    """Roll out all starts (K, E, N) of K runs, each also with every coordinate and parameter changed a little."""
    own = trials.runs[0]
    n, s, (k, e) = own.count, len(contender.unknowns), starts.shape[:2]
    # Directions in which the parameters are uncertain, one standard deviation long.
    values, vectors = np.linalg.eigh(contender.covariance) if s else (np.zeros(0), np.zeros((0, 0)))
    typical = np.array([u.typical for u in contender.unknowns])
    roots = vectors * np.sqrt(np.clip(values, 0.0, (10.0 * typical.max(initial=0.0)) ** 2))
    lower = np.array([u.lower for u in contender.unknowns])
    upper = np.array([u.upper for u in contender.unknowns])
    step = STATE_STEP * own.typical
    shared = np.tile(contender.values, (k, e, 1 + n + s, 1))
    states = np.repeat(starts[:, :, None], 1 + n + s, axis=2)
    states[:, :, 1 + np.arange(n), np.arange(n)] += step
    shared[:, :, 1 + n :] += PARAMETER_STEP * roots.T
    shared = np.clip(shared, lower, upper)
    forward = Forward(trials, contender.world, contender.unknowns)
    settings = [Settings(r.index, shared[r.index].reshape(-1, s), states[r.index].reshape(-1, n)) for r in trials.runs]
    motion = (np.concatenate(forward.residuals(settings)) / sigma).reshape(k * e, 1 + n + s, -1)
    slopes = np.nan_to_num(motion[:, 1:] - motion[:, :1])
    return _Forecast(
        motion[:, 0],
        np.swapaxes(slopes[:, :n] / step[:, None], 1, 2),
        np.swapaxes(slopes[:, n:] / PARAMETER_STEP, 1, 2),
    )


def _off_starts(forecast: _Forecast, experiment: int, vectors: Array) -> Array:
    """Return vectors (m,) or (m, K) less what another start of the run can make up."""
    basis, size, _ = np.linalg.svd(forecast.by_start[experiment], full_matrices=False)
    basis = basis[:, size > 1e-9 * size.max(initial=0.0)]
    rest: Array = vectors - basis @ (basis.T @ vectors)
    return rest


def _separation(a: _Forecast, b: _Forecast, experiment: int) -> float:
    """Return the part of the difference that neither start nor parameters can make up; the smaller of the two views."""
    difference = a.motion[experiment] - b.motion[experiment]
    if not np.all(np.isfinite(difference)):
        return 0.0
    lengths = []
    for own in (a, b):
        left = _off_starts(own, experiment, difference)
        # Parameters are known to one standard deviation: moving them so far costs as much as a residual of one.
        wide = np.concatenate([a.by_parameter[experiment], b.by_parameter[experiment]], axis=1)
        wide = _off_starts(own, experiment, wide)
        moves = np.linalg.solve(wide.T @ wide + np.eye(wide.shape[1]), wide.T @ left)
        lengths.append(float(np.sqrt(max(float(left @ (left - wide @ moves)), 0.0))))
    return min(lengths)


def _watch(
    own: RunDesign, contenders: Sequence[Contender], forecasts: list[_Forecast], chosen: int, sigma: Array
) -> tuple[str, dict[str, float]]:
    """Return the component and instant of the first pair's greatest difference, and what each contender expects there.

    It counts as far as the forecasts are apart, and as far as another start cannot make that up.
    """
    difference = forecasts[0].motion[chosen] - forecasts[1].motion[chosen]
    left = np.abs(np.nan_to_num(_off_starts(forecasts[0], chosen, difference)))
    at = int(np.argmax(np.minimum(left, np.abs(np.nan_to_num(difference)))))
    series = next(s for s in own.series if s.where.start <= at < s.where.stop)
    time = own.times[series.rows[at - series.where.start]]
    label = f"{series.kind}.{'xyz'[series.axis]} of {series.name} at {time:.3g} s"
    return label, {
        " + ".join(c.names): float(f.motion[chosen, at] * sigma[at]) for c, f in zip(contenders, forecasts, strict=True)
    }
