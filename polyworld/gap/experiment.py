"""The experiment that would decide between hypotheses: which object, started how, and what to watch.

Starts are tried on a grid that reaches beyond what was measured: at rest, three times the speeds seen, all headings,
another height, spin reversed. For each, every hypothesis predicts the motion. Two of them are separated by what no
change of the new run's initial state, and of the unknowns within what is known of them, can make up: the length of the
difference of their forecasts in standard deviations, with those directions projected out (a linearised form of the
criterion of Box & Hill 1967, Technometrics 9, 57).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.problem import LOST
from polyworld.estimation.readout import CHANNELS
from polyworld.gap.cross_validation import reduced
from polyworld.gap.fitting import Fitted, independent_share
from polyworld.gap.ground import Ground
from polyworld.gap.settings import GapSettings

Array = NDArray[np.float64]

SPEEDS = (0.0, 1.0, 3.0)  # times the fastest start seen: laws that agree at one speed part at a multiple of it
SLOWEST = 0.5  # [m/s] that counts as the fastest start where nothing was thrown
RISES = (0.0, np.pi / 4)  # [rad] of the start above the horizontal
LIFTS = (0.0, 1.0)  # heights of the start above that of the first run, in extents of the motion seen
REACH = 10.0  # ordinary changes within which unknowns lie that the data do not show
STEP = 0.1  # of a standard deviation of the unknowns, for derivatives
TRIAL = "trial"  # name of the new run
VECTORS = ("position", "velocity", "angular_velocity")
KINDS = ("position", "rotation", "spin")


@dataclass(frozen=True)
class Separation:
    """How far the forecasts of two contenders are separated, in standard deviations of what fits leave."""

    first: tuple[str, ...]
    second: tuple[str, ...]
    sigmas: float


@dataclass(frozen=True)
class Experiment:
    """A run to be made. position [m], velocity [m/s], angular_velocity [rad/s] (3,) at its start, world axes.

    duration, interval [s]: of its samples. watch: component and instant at which the first two contenders differ most,
    as they stand and once their starts are adjusted; forecasts: what each contender expects there. decides: whether
    every pair is separated by enough to exclude one of the two.
    """

    object: str
    position: tuple[float, ...]
    velocity: tuple[float, ...]
    angular_velocity: tuple[float, ...]
    duration: float
    interval: float
    watch: str
    forecasts: dict[str, float]
    separations: tuple[Separation, ...]
    decides: bool

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self)


def propose_experiment(contenders: Sequence[Fitted], settings: GapSettings) -> Experiment | None:
    """Find the start of a grid that decides between most pairs of contenders and separates the nearest pair most.

    contenders: fitted to one recording, the likeliest first. One free rigid object is started differently; the others
    start as in the first run. None where no object can be, or where fewer than two contenders are given.
    """
    if len(contenders) < 2:
        return None
    names, labels = contenders[0].ground.recording.runs[0].names, contenders[0].ground.states[0].labels
    free = [name for name in names if any(label.startswith(f"{name}.position.") for label in labels)]
    found = [_best_for(contenders, name, settings) for name in free]
    return max(found, key=lambda e: (e.decides, min(s.sigmas for s in e.separations)), default=None)


def _best_for(contenders: Sequence[Fitted], name: str, settings: GapSettings) -> Experiment:
    trial = _laid_out(contenders[0].ground, name)
    grid, pairs = _grid(contenders[0], trial, name), list(combinations(range(len(contenders)), 2))
    starts, run = np.array(list(grid)), trial.recording.runs[0]
    forecasts = [_forecast(trial, c, starts) for c in contenders]
    sigmas = np.array([[_separation(forecasts[i], forecasts[j], e) for i, j in pairs] for e in range(len(starts))])
    enough = float(np.sqrt(2.0 * settings.excluded))
    best = int(np.lexsort((sigmas.min(axis=1), (sigmas >= enough).sum(axis=1)))[-1])
    place, velocity, spin = (tuple(v.tolist()) for v in grid[tuple(starts[best].tolist())])
    watch, expected = _watched(trial, [f.motion[best] for f in forecasts], forecasts[0].by_start[best])
    names = _names(contenders)
    titles = [" + ".join(own) or c.hypothesis.title for own, c in zip(names, contenders, strict=True)]
    return Experiment(
        name,
        place,
        velocity,
        spin,
        float(run.times[-1] - run.times[0] + run.lead),
        float(np.median(np.diff(run.times))),
        watch,
        dict(zip(titles, expected.tolist(), strict=True)),
        tuple(Separation(names[i], names[j], float(s)) for (i, j), s in zip(pairs, sigmas[best], strict=True)),
        bool(sigmas[best].min() >= enough),
    )


def _names(contenders: Sequence[Fitted]) -> list[tuple[str, ...]]:
    """Return the names of each contender's effects, with labels where others have the same effects."""
    found = []
    for c in contenders:
        alike = sum(other.hypothesis.names == c.hypothesis.names for other in contenders) > 1
        each = [(p.candidate.name, f" ({p.variant.label})" if p.variant.label else "") for p in c.hypothesis.parts]
        found.append(tuple(name + label if alike else name for name, label in each))
    return found


def _laid_out(ground: Ground, name: str) -> Ground:
    """Return a run like the first one but for an object that falls: what is at rest has fewer coordinates."""
    world, first = ground.world, ground.recording.runs[0]
    column, since = first.names.index(name), (first.times - first.times[0])[:, None]
    fall = np.asarray(world.object(name).position) + 0.5 * np.asarray(world.environment.gravity) * since**2
    places = first.positions.copy()
    places[:, column] = np.where(np.isfinite(places[:, column]), fall, np.nan)
    run = replace(first, name=TRIAL, positions=places)
    return ground.cut((run,), ground.noise[:1])


def _state(fitted: Fitted, run: int, name: str) -> dict[str, float]:
    """Return the initial state of a run as it was fitted, by coordinate, and that of an object in all components."""
    states, item = fitted.ground.states[run], fitted.ground.world.object(name)
    values = fitted.of_states()[run][: states.count]
    described = {f"{name}.{k}.{a}": v for k in VECTORS for a, v in zip("xyz", getattr(item, k), strict=True)}
    known = {path.removeprefix("objects."): float(v[0]) for path, v in states.overrides(values[None], {}).items()}
    return described | known | dict(zip(states.labels, values.tolist(), strict=True))


def _grid(fitted: Fitted, trial: Ground, name: str) -> dict[tuple[float, ...], tuple[Array, Array, Array]]:
    """Return the initial states (N,) that are tried, each with the place, velocity and spin (3,) of the object."""
    labels, gravity = trial.states[0].labels, np.asarray(trial.world.environment.gravity, dtype=float)
    runs = [(r, run) for r, run in enumerate(fitted.ground.recording.runs) if name in run.names]
    states = [_state(fitted, r, name) for r, _ in runs]
    place, *_ = vectors = [[np.array([s[f"{name}.{k}.{a}"] for a in "xyz"]) for s in states] for k in VECTORS]
    fastest, spin = (max(vectors[k], key=lambda v: float(np.linalg.norm(v))) for k in (1, 2))
    speed = max(float(np.linalg.norm(fastest)), SLOWEST)
    paths = np.concatenate([run.positions[:, run.names.index(name)] for _, run in runs])
    extent = max(float(np.ptp(p[np.isfinite(p)])) for p in paths.T if np.isfinite(p).any())
    axis = int(np.argmax(np.abs(gravity))) if gravity.any() else 2
    up = np.eye(3)[axis] * (-1.0 if gravity[axis] > 0.0 else 1.0)
    free = [a for a in range(3) if f"{name}.position.{'xyz'[a]}" in labels]
    rises, lifts = (RISES, LIFTS) if axis in free else (RISES[:1], LIFTS[:1])
    level = [sign * np.eye(3)[a] for a in free if a != axis for sign in (1.0, -1.0)]
    headings = [np.cos(r) * e + np.sin(r) * up for e in level for r in rises] or [up, -up]
    found: dict[tuple[float, ...], tuple[Array, Array, Array]] = {}
    for times, heading, lift, sign in product(SPEEDS, headings, lifts, (1.0, -1.0)):
        start = (place[0] + lift * extent * up, times * speed * heading, sign * spin)
        own = dict(zip([f"{name}.{k}.{a}" for k in VECTORS for a in "xyz"], np.concatenate(start), strict=True))
        found.setdefault(tuple(float((states[0] | own).get(label, 0.0)) for label in labels), start)
    return found


@dataclass(frozen=True)
class _Forecast:
    """Motion (E, m) in standard deviations of the noise, NaN where it diverges, and how it changes with each coordinate
    of the start (E, m, N), and along each direction (E, m, S) of the unknowns by a standard deviation of what is known.

    left: what the fit leaves in standard deviations of the noise, as far as it is independent.
    """

    motion: Array
    by_start: Array
    by_unknown: Array
    left: float


def _forecast(trial: Ground, fitted: Fitted, starts: Array) -> _Forecast:
    """Predict the motion from starts (E, N); laws that each run has by itself begin as in the first one."""
    first, parts = fitted.ground.recording.runs[0].name, []
    for part in fitted.hypothesis.parts:
        unknowns = tuple(replace(u, run=TRIAL) if u.run == first else u for u in part.variant.unknowns)
        parts.append(replace(part, variant=replace(part.variant, unknowns=unknowns)))
    problem, values = trial.problem(replace(fitted.hypothesis, parts=tuple(parts))), fitted.values
    ((block,),) = problem.runs
    own = fitted.of_states()[0][fitted.ground.states[0].count :]
    e, n, s = len(starts), block.states.count, len(values)
    states = np.concatenate([starts, np.repeat(own[None], e, axis=0)], axis=1)
    states = np.repeat(states[:, None], 1 + n + s, axis=1)
    states[:, 1 + np.arange(n), np.arange(n)] += problem.settings.step * block.states.typical
    ways = STEP * _uncertain(fitted)
    beyond = ((values + ways < problem.lower) | (values + ways > problem.upper)).any(axis=1, keepdims=True)
    shared = np.tile(values, (e, 1 + n + s, 1))
    shared[:, 1 + n :] += np.where(beyond, -ways, ways)
    job = (block, np.concatenate(shared), np.concatenate(states))
    residuals = problem.evaluate([job], 1.0)[0].residuals
    residuals[(residuals == LOST).all(axis=1)] = np.nan
    motion = residuals.reshape(e, 1 + n + s, -1)
    change = np.swapaxes(motion[:, 1:] - motion[:, :1], 1, 2)
    left = fitted.scale / np.sqrt(independent_share(fitted))
    return _Forecast(motion[:, 0], change[..., :n], change[..., n:] / STEP, float(left))


def _uncertain(fitted: Fitted) -> Array:
    """Return the principal directions (S, S), by rows, in which shared unknowns are uncertain, a standard deviation
    long."""
    typical, share = fitted.problem.typical, independent_share(fitted)
    information = reduced(fitted).information.sum(axis=0) * typical[:, None] * typical * share / fitted.scale**2
    size, vectors = np.linalg.eigh(information + np.eye(len(typical)) / REACH**2)
    found: Array = (vectors / np.sqrt(size)).T * typical
    return found


def _off_starts(by_start: Array, vectors: Array) -> Array:
    """Return vectors (m,) or (m, K) less what another start of the run can make up."""
    basis, size, _ = np.linalg.svd(by_start, full_matrices=False)
    basis = basis[:, size > 1e-9 * size.max(initial=0.0)]
    rest: Array = vectors - basis @ (basis.T @ vectors)
    return rest


def _separation(a: _Forecast, b: _Forecast, start: int) -> float:
    """Return the part of the difference that neither start nor unknowns can make up; the smaller of the two views."""
    left = max(a.left, b.left)
    wide = np.concatenate([a.by_unknown[start], b.by_unknown[start]], axis=1) / left
    difference = (a.motion[start] - b.motion[start]) / left
    if not all(np.isfinite(x).all() for x in (difference, wide, a.by_start[start], b.by_start[start])):
        return 0.0
    lengths = []
    for own in (a, b):
        rest, moves = (_off_starts(own.by_start[start], x) for x in (difference, wide))
        # Unknowns are known to one standard deviation: moving them so far costs as much as a residual of one.
        answer = np.linalg.solve(moves.T @ moves + np.eye(moves.shape[1]), moves.T @ rest)
        lengths.append(float(np.sqrt(max(float(rest @ (rest - moves @ answer)), 0.0))))
    return min(lengths)


def _watched(trial: Ground, motions: Sequence[Array], by_start: Array) -> tuple[str, Array]:
    """Return the component and instant of the first pair's greatest difference, and what contenders expect there.

    It counts as far as the forecasts differ, and as far as another start cannot make that up.
    """
    difference = np.nan_to_num(motions[0] - motions[1])
    left = np.abs(_off_starts(np.nan_to_num(by_start), difference))
    at = int(np.argmax(np.minimum(left, np.abs(difference))))
    run, readout = trial.recording.runs[0], trial.readouts[0]
    row, channel = int(readout.rows()[at]), int(readout.columns()[at])
    column, kind, axis = channel // CHANNELS, channel % CHANNELS // 3, channel % 3
    measured = (run.positions, np.zeros_like(run.positions), run.angular_velocities)[kind][row, column, axis]
    expected: Array = measured + readout.sigma[row, channel] * np.array([m[at] for m in motions])
    time = run.times[row] - run.times[0] + run.lead
    return f"{KINDS[kind]}.{'xyz'[axis]} of {run.names[column]} at {time:.3g} s", expected
