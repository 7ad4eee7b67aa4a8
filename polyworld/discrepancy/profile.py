"""Least squares on all runs at once, with every run's initial state eliminated.

Levenberg-Marquardt (Marquardt 1963) on simulated trajectories. The normal equations of shared unknowns and of the
initial states of R runs are block-bordered: a Schur complement leaves a system of the shared unknowns alone.
Derivatives are difference quotients from one batch of rollouts, with steps that are a fraction of standard errors.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.discrepancy.design import Design, RunDesign
from polyworld.discrepancy.forward import Forward, Settings
from polyworld.discrepancy.noise import Noise
from polyworld.representations.fluid import Fluid
from polyworld.world import World

Array = NDArray[np.float64]

STEP = 0.2  # of a standard error, for difference quotients
FIRST_STEP = 1e-3  # of a typical change, while no standard error is known
STEPS = (1e-5, 1e-2)  # bounds of steps, in typical changes
ROUGH_STEP = 0.3  # of a typical change: no less where a liquid splashes, whose motion jumps a little at any change
TRIALS = 10.0 ** np.array([-2.0, -1.0, 0.0, 1.0, 2.0])  # dampings tried at once, as factors of the last successful one
HORIZONS = (0.35, 0.65, 1.0)  # growing, so that a bounce that comes too early does not trap the fit
# Where bodies meet: about one more collision at a time.
FINE_HORIZONS = (0.08, 0.15, 0.22, 0.3, 0.38, 0.46, 0.54, 0.62, 0.7, 0.8, 0.9, 1.0)
LEASH = 1.0  # typical changes, that a value may stray by where the data do not tell it yet
OPENING = 0.4  # part of a run's time in which its first velocities are decided
OTHER_VELOCITIES = np.linspace(-1.0, 1.0, 9)  # of the highest speed in the run
WORSE = 2.0  # times chi2 per measurement of the better runs, beyond which a run's first velocities are tried anew
NO_NEARER = 0.1  # of the distance to its target that a step of a fit has to gain
STUCK = 0.05  # of chi2: a fit that no step betters, though slopes foretell a greater fall, has not converged
ILL = 1.2  # chi2 per measurement of a run beyond which its spins are tried the other way
TURN_ITERATIONS = 4
OTHER_SPINS = np.array([-1.5, -0.75, 0.75, 1.5])  # of its spread, that a spin is tried at besides the other way round
SWEEPS = 2  # through all spins
LONGEST = 20.0  # typical changes: an initial state goes no further in one step
PRIOR = 1e-4  # weight of an ordinary change in the curvature, so that what the data do not tell stays where it is


@dataclass(frozen=True)
class Linearised:
    """Whitened residuals r[run] (m,), slopes by shared unknowns a[run] (m, S), initial states b[run] (m, N)."""

    r: tuple[Array, ...]
    a: tuple[Array, ...]
    b: tuple[Array, ...]

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals."""
        return float(sum(float(r @ r) for r in self.r))


@dataclass(frozen=True)
class Fit:
    """A fitted hypothesis.

    values (S,): shared unknowns. states[run] (N,): initial-state coordinates. chi2: sum of squared whitened residuals
    at the minimum. covariance (S, S) of the shared unknowns, initial states profiled out; infinite variance where the
    data say nothing. linear: residuals and derivatives there. converged: False where the iterations
    ran out, or no step brought what the slopes foretold.
    """

    values: Array
    states: tuple[Array, ...]
    chi2: float
    covariance: Array
    linear: Linearised
    converged: bool
    iterations: int
    rollouts: int


def fit(
    forward: Forward,
    noise: Noise,
    values: Array,
    states: Sequence[Array],
    *,
    horizons: Sequence[float] = (1.0,),
    iterations: int = 12,
    tolerance: float = 1e-2,
    target: float | None = None,
) -> Fit:
    """Fit shared unknowns and initial states from the values given.

    horizons: parts of each run's time fitted one after another; the result is that of the last, so end with 1 for the
    whole. tolerance: a fit has converged when chi2 falls by less than this, absolutely: differences of 10 decide
    between hypotheses. target: chi2 below which the fit is of interest; a fit far above it that comes no nearer is
    given up.
    """
    at = _Point(np.array(values, dtype=float), tuple(np.array(s, dtype=float) for s in states))
    start = at.values
    before = forward.rollouts
    total = 0
    converged = False
    steps = _first_steps(forward)
    for horizon in horizons:
        loose = tolerance if horizon >= 1.0 else 10.0
        aim = target if horizon >= 1.0 else None
        hold = _held(forward, start, horizon)
        at, steps, used, converged = _descend(forward, noise, at, horizon, steps, iterations, loose, aim, hold)
        total += used
        if len(horizons) > 1:
            if horizon <= OPENING:
                worse = 0.0 if horizon == horizons[0] else WORSE
                at = _thrown_anew(forward, noise, at, horizon, steps, worse)
            for _ in range(SWEEPS):
                at = _turned_over(forward, noise, at, horizon, steps, ILL)
    linear = _linearise(forward, noise, at, horizons[-1], steps)
    covariance, _ = _covariances(forward, linear)
    return Fit(at.values, at.states, linear.chi2, covariance, linear, converged, total, forward.rollouts - before)


def horizons_for(design: Design) -> tuple[float, ...]:
    """Parts of the runs' time to be fitted one after another: the finer, the more bodies may meet."""
    return FINE_HORIZONS if len(design.world.objects) > 1 else HORIZONS


def start_states(design: Design) -> tuple[Array, ...]:
    """Initial states as the first samples of each run suggest them."""
    return tuple(r.start for r in design.runs)


def linearise(
    forward: Forward, noise: Noise, values: Array, states: Sequence[Array], fitted: Fit | None = None
) -> Linearised:
    """Whitened residuals and their derivatives by the shared unknowns; those by the states are taken from `fitted`.

    For the score test: states are the fit's own, and the shared unknowns those of an effect that does nothing yet.
    """
    point = _Point(np.asarray(values, dtype=float), tuple(states))
    shared, own = _first_steps(forward)
    if fitted is None:
        return _linearise(forward, noise, point, 1.0, (shared, own))
    return _linearise_shared(forward, noise, point, fitted.linear.b, shared)


@dataclass(frozen=True)
class _Point:
    values: Array
    states: tuple[Array, ...]


_Steps = tuple[Array, tuple[Array, ...]]


@dataclass(frozen=True)
class _Hold:
    """Values (S,) that shared unknowns are drawn to, with weights (S,) [1/unit^2]."""

    values: Array
    weight: Array

    def cost(self, values: Array) -> float:
        """What is added to chi2."""
        return float(self.weight @ (values - self.values) ** 2)


def _held(forward: Forward, start: Array, horizon: float) -> _Hold:
    """While only parts of the runs are fitted, values stay near their start but for what these parts tell of them: a
    place that no body has come to yet would stray."""
    typical = np.array([u.typical for u in forward.unknowns])
    return _Hold(start, (1.0 / (LEASH * typical)) ** 2 if horizon < 1.0 else np.zeros(len(start)))


def _first_steps(forward: Forward) -> _Steps:
    first = max(FIRST_STEP, least_step(forward.world))
    shared = np.array([first * u.typical for u in forward.unknowns])
    return shared, tuple(first * r.typical for r in forward.design.runs)


def least_step(world: World) -> float:
    """Least step of a difference quotient, in typical changes, that shows beyond the roughness of a world's motion."""
    return ROUGH_STEP if any(isinstance(d, Fluid) for d in world.deformables) else 0.0


def _descend(
    forward: Forward,
    noise: Noise,
    at: _Point,
    horizon: float,
    steps: _Steps,
    iterations: int,
    tolerance: float,
    target: float | None,
    hold: _Hold,
) -> tuple[_Point, _Steps, int, bool]:
    if not len(at.values) and not any(len(s) for s in at.states):
        return at, steps, 0, True  # nothing to fit
    damping = 1e-4
    chi2 = np.inf
    for iteration in range(iterations):
        linear = _linearise(forward, noise, at, horizon, steps)
        chi2 = linear.chi2 + hold.cost(at.values)
        if not np.isfinite(chi2):
            return at, steps, iteration, False
        steps = _steps(forward, linear)
        dampings = damping * TRIALS
        normal = _Normal(forward, linear)
        normal.hold(hold, at.values)
        trials = [_step(forward, normal, at, d) for d in dampings]
        costs = _costs(forward, noise, trials, horizon, hold)
        best = int(np.argmin(costs))
        if not costs[best] < chi2:
            at_rest = _foretold(linear, at, trials[0]) < max(tolerance, STUCK * chi2)
            damping *= 1e4
            if damping > 1e10:
                return at, steps, iteration + 1, at_rest
            trials = [_step(forward, normal, at, d) for d in damping * TRIALS]
            costs = _costs(forward, noise, trials, horizon, hold)
            best = int(np.argmin(costs))
            if not costs[best] < chi2:
                return at, steps, iteration + 1, at_rest
            dampings = damping * TRIALS
        gain = chi2 - costs[best]
        at, chi2 = trials[best], float(costs[best])
        damping = float(np.clip(dampings[best], 1e-8, 1e8))
        if gain < tolerance + 1e-6 * chi2:
            return at, steps, iteration + 1, True
        if target is not None and gain < NO_NEARER * (chi2 - target):
            return at, steps, iteration + 1, False
    return at, steps, iterations, False


def _foretold(linear: Linearised, at: _Point, to: _Point) -> float:
    """The fall of chi2 that the slopes foretell for a step."""
    shared = to.values - at.values
    after = (
        r + a @ shared + b @ (new - old)
        for r, a, b, new, old in zip(linear.r, linear.a, linear.b, to.states, at.states, strict=True)
    )
    return linear.chi2 - float(sum(float(x @ x) for x in after))


def _linearise(forward: Forward, noise: Noise, at: _Point, horizon: float, steps: _Steps) -> Linearised:
    shared, own = steps
    lower, upper = _bounds(forward)
    s = len(shared)
    # A step that would leave the bounds goes the other way.
    signed = np.where(at.values + shared > upper, -shared, shared)
    settings = []
    for r in forward.design.runs:
        n = r.count
        values = np.repeat(at.values[None], 1 + s + n, axis=0)
        states = np.repeat(at.states[r.index][None], 1 + s + n, axis=0)
        values[1 + np.arange(s), np.arange(s)] += signed
        states[1 + s + np.arange(n), np.arange(n)] += own[r.index]
        settings.append(Settings(r.index, np.clip(values, lower, upper), states))
    rs, aa, bb = [], [], []
    for r, raw in zip(forward.design.runs, forward.residuals(settings, horizon), strict=True):
        white = noise.whiten(r.index, raw) * r.before(horizon)
        base = white[0]
        slopes = (white[1:] - base).T / np.concatenate([signed, own[r.index]])
        slopes = np.where(np.isfinite(slopes), slopes, 0.0)
        rs.append(base if np.all(np.isfinite(base)) else np.full_like(base, np.inf))
        aa.append(slopes[:, :s])
        bb.append(slopes[:, s:])
    return Linearised(tuple(rs), tuple(aa), tuple(bb))


def _linearise_shared(
    forward: Forward, noise: Noise, at: _Point, known: tuple[Array, ...], shared: Array
) -> Linearised:
    lower, upper = _bounds(forward)
    s = len(shared)
    signed = np.where(at.values + shared > upper, -shared, shared)
    settings = []
    for r in forward.design.runs:
        values = np.repeat(at.values[None], 1 + s, axis=0)
        values[1 + np.arange(s), np.arange(s)] += signed
        states = np.repeat(at.states[r.index][None], 1 + s, axis=0)
        settings.append(Settings(r.index, np.clip(values, lower, upper), states))
    rs, aa = [], []
    for r, raw in zip(forward.design.runs, forward.residuals(settings), strict=True):
        white = noise.whiten(r.index, raw)
        slopes = (white[1:] - white[0]).T / signed
        rs.append(white[0])
        aa.append(np.where(np.isfinite(slopes), slopes, 0.0))
    return Linearised(tuple(rs), tuple(aa), known)


def turned_over(forward: Forward, noise: Noise, fitted: Fit) -> tuple[Array, ...]:
    """Initial states from which a fit may come out better: spins that were not measured, tried the other way."""
    at = _Point(fitted.values, fitted.states)
    return _turned_over(forward, noise, at, 1.0, _steps(forward, fitted.linear), 0.0).states


def _turned_over(forward: Forward, noise: Noise, at: _Point, horizon: float, steps: _Steps, ill: float) -> _Point:
    """Spins the other way, or of another size, for runs whose chi2 per measurement is above `ill`: one body at a time.
    The slope of a spin tells nothing of the other sign."""
    cost = _run_costs(forward, noise, at, horizon)
    limits = ill * _counts(forward, horizon)
    for slot in range(max((int(np.count_nonzero(r.spread)) for r in forward.design.runs), default=0)):
        options = {
            r.index: _other_spins(r, at.states[r.index], slot)
            for r in forward.design.runs
            if cost[r.index] > limits[r.index] and slot < np.count_nonzero(r.spread)
        }
        at, cost = _tried(forward, noise, at, horizon, steps, options, cost)
    return at


def _other_spins(run: RunDesign, own: Array, slot: int) -> Array:
    i = int(np.flatnonzero(run.spread)[slot])
    size = max(abs(own[i]), 0.5 * run.spread[i])
    others = np.array([-size if own[i] > 0.0 else size, *(OTHER_SPINS * run.spread[i])])
    options = np.repeat(own[None], len(others), axis=0)
    options[:, i] = others
    return options


def _thrown_anew(forward: Forward, noise: Noise, at: _Point, horizon: float, steps: _Steps, worse: float) -> _Point:
    """Other first velocities for runs that fit ill, and `worse` times worse than the better ones: a body that hits
    something right after the start was taken to begin with the velocity that it has behind the impact, and no slope
    leads back."""
    cost = _run_costs(forward, noise, at, horizon)
    relative = cost / _counts(forward, horizon)
    limit = max(ILL, worse * float(np.quantile(relative, 0.25)) if len(relative) > 1 else 0.0)
    options = {
        r.index: _other_velocities(r, at.states[r.index])
        for r in forward.design.runs
        if relative[r.index] > limit and r.reach.any()
    }
    return _tried(forward, noise, at, horizon, steps, options, cost)[0]


def _other_velocities(run: RunDesign, own: Array) -> Array:
    """One velocity changed at a time; and one body at a time, or all, as the very first samples suggest."""
    options = []
    for i in np.flatnonzero(run.reach):
        for share in OTHER_VELOCITIES:
            options.append(own.copy())
            options[-1][i] = share * run.reach[i]
    hasty = np.concatenate([state.hasty for state in run.states], axis=1)
    first = 0
    for state in run.states:
        mine = slice(first, first + len(state.labels))
        first = mine.stop
        for guess in hasty:
            options.append(own.copy())
            options[-1][mine] = guess[mine]
    return np.array([*options, *hasty])


def _tried(
    forward: Forward,
    noise: Noise,
    at: _Point,
    horizon: float,
    steps: _Steps,
    options: Mapping[int, Array],
    cost: Array,
) -> tuple[_Point, Array]:
    """Of other initial states (K, N) of some runs the nearest to the data, followed by a few iterations, and kept where
    the run then fits better; and chi2 (R,) of all runs."""
    if not options:
        return at, cost
    runs = [forward.design.runs[k] for k in options]
    settings = [Settings(k, np.repeat(at.values[None], len(o), axis=0), o) for k, o in options.items()]
    states = list(at.states)
    for r, raw in zip(runs, forward.residuals(settings, horizon), strict=True):
        white = noise.whiten(r.index, raw) * r.before(horizon)
        costs = np.where(np.all(np.isfinite(white), axis=1), (white**2).sum(axis=1), np.inf)
        states[r.index] = options[r.index][int(np.argmin(costs))]
    hold = _held(forward, at.values, horizon)
    start = _Point(at.values, tuple(states))
    trial, *_ = _descend(forward, noise, start, horizon, steps, TURN_ITERATIONS, 10.0, None, hold)
    other = _run_costs(forward, noise, _Point(at.values, trial.states), horizon)
    better = [k for k in options if other[k] < cost[k] - 1.0]
    kept = _Point(at.values, tuple(trial.states[k] if k in better else s for k, s in enumerate(at.states)))
    cost = cost.copy()
    cost[better] = other[better]
    return kept, cost


def _counts(forward: Forward, horizon: float) -> Array:
    """Measurements (R,) of each run before a horizon, at least 1."""
    return np.array([max(int(np.count_nonzero(r.before(horizon))), 1) for r in forward.design.runs])


def _run_costs(forward: Forward, noise: Noise, at: _Point, horizon: float) -> Array:
    settings = [Settings(r.index, at.values[None], at.states[r.index][None]) for r in forward.design.runs]
    costs = []
    for r, raw in zip(forward.design.runs, forward.residuals(settings, horizon), strict=True):
        white = noise.whiten(r.index, raw[0]) * r.before(horizon)
        costs.append(float(white @ white) if np.all(np.isfinite(white)) else np.inf)
    return np.array(costs)


def _bounds(forward: Forward) -> tuple[Array, Array]:
    return np.array([u.lower for u in forward.unknowns]), np.array([u.upper for u in forward.unknowns])


def _costs(forward: Forward, noise: Noise, trials: Sequence[_Point], horizon: float, hold: _Hold) -> Array:
    settings = [
        Settings(r.index, np.array([t.values for t in trials]), np.array([t.states[r.index] for t in trials]))
        for r in forward.design.runs
    ]
    total = np.array([hold.cost(t.values) for t in trials])
    for r, raw in zip(forward.design.runs, forward.residuals(settings, horizon), strict=True):
        white = noise.whiten(r.index, raw) * r.before(horizon)
        total += np.where(np.all(np.isfinite(white), axis=1), (white**2).sum(axis=1), np.inf)
    return total


class _Normal:
    """The normal equations at a linearisation, run by run, filled up with zeros to the longest initial state N.

    bb (R, N, N), ba (R, N, S), br (R, N): products of slopes by states, with those by shared unknowns and residuals.
    aa (S, S), ar (S,): of shared unknowns, all runs together. typical (R, N), shared (S,): ordinary changes.
    """

    def __init__(self, forward: Forward, linear: Linearised) -> None:
        runs = forward.design.runs
        self.shared = np.array([u.typical for u in forward.unknowns])
        self.counts = [r.count for r in runs]
        s, n = len(self.shared), max(self.counts, default=0)
        self.bb, self.ba = np.zeros((len(runs), n, n)), np.zeros((len(runs), n, s))
        self.br, self.typical = np.zeros((len(runs), n)), np.ones((len(runs), n))
        self.aa, self.ar = np.zeros((s, s)), np.zeros(s)
        for i, (r, a, b, res) in enumerate(zip(runs, linear.a, linear.b, linear.r, strict=True)):
            own = slice(0, r.count)
            self.bb[i, own, own], self.ba[i, own], self.br[i, own] = b.T @ b, b.T @ a, b.T @ res
            self.typical[i, own] = r.typical
            self.aa += a.T @ a
            self.ar += a.T @ res

    def hold(self, hold: _Hold, values: Array) -> None:
        """Draw shared unknowns to where they are held."""
        self.aa += np.diag(hold.weight)
        self.ar += hold.weight * (values - hold.values)

    def reduced(self, damping: float) -> tuple[Array, Array, Array]:
        """Inverses (R, N, N) of the states' blocks, and the Schur complement (S, S) with its right side (S,)."""
        inverse = _inverse(self.bb, self.typical, damping)
        carried = inverse @ self.ba
        matrix = self.aa - np.einsum("rns,rnt->st", self.ba, carried)
        vector = self.ar - np.einsum("rns,rn->s", carried, self.br)
        return inverse, matrix, vector


def _step(forward: Forward, normal: _Normal, at: _Point, damping: float) -> _Point:
    """The damped Gauss-Newton step; shared unknowns at a bound that the step would leave do not take part."""
    lower, upper = _bounds(forward)
    inverse, matrix, vector = normal.reduced(damping)
    free = np.ones(len(vector), dtype=bool)
    step = np.zeros(len(vector))
    for _ in range(len(vector) + 1):
        step = np.zeros(len(vector))
        step[free] = -_solve(matrix[np.ix_(free, free)], vector[free], normal.shared[free], damping)
        out = free & (((at.values <= lower) & (step < 0)) | ((at.values >= upper) & (step > 0)))
        if not out.any():
            break
        free &= ~out
    values = np.clip(at.values + step, lower, upper)
    step = values - at.values
    change = np.einsum("rnm,rm->rn", inverse, normal.br + normal.ba @ step)
    change = np.clip(change, -LONGEST * normal.typical, LONGEST * normal.typical)
    states = tuple(old - change[i, :n] for i, (old, n) in enumerate(zip(at.states, normal.counts, strict=True)))
    return _Point(values, states)


def _inverse(matrix: Array, typical: Array, damping: float) -> Array:
    """Inverses of damped matrices (..., N, N); typical (..., N)."""
    scale = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 0.0)) + PRIOR / typical
    outer = scale[..., :, None] * scale[..., None, :]
    diagonal = damping + (PRIOR / typical / scale) ** 2
    scaled = matrix / outer + diagonal[..., None] * np.eye(matrix.shape[-1])
    result: Array = np.linalg.inv(scaled) / outer
    return result


def _solve(matrix: Array, vector: Array, typical: Array, damping: float) -> Array:
    if not len(vector):
        return vector
    result: Array = _inverse(matrix, typical, damping) @ vector
    return result


def _covariances(forward: Forward, linear: Linearised) -> tuple[Array, tuple[Array, ...]]:
    """Covariance (S, S) of the shared unknowns, and standard deviations (N,) of each run's states for fixed ones."""
    normal = _Normal(forward, linear)
    inverse, matrix, _ = normal.reduced(1e-12)
    errors = np.sqrt(np.maximum(np.diagonal(inverse, axis1=-2, axis2=-1), 0.0))
    covariance = _inverse(matrix, normal.shared, 1e-12) if len(matrix) else matrix
    return covariance, tuple(errors[i, :n] for i, n in enumerate(normal.counts))


def _steps(forward: Forward, linear: Linearised) -> _Steps:
    covariance, own = _covariances(forward, linear)
    typical = np.array([u.typical for u in forward.unknowns])
    shortest, longest = (max(bound, least_step(forward.world)) for bound in STEPS)
    shared = np.clip(STEP * np.sqrt(np.maximum(np.diag(covariance), 0.0)), shortest * typical, longest * typical)
    return shared, tuple(
        np.clip(STEP * o, shortest * r.typical, longest * r.typical)
        for o, r in zip(own, forward.design.runs, strict=True)
    )


def project_out(fitted: Fit, directions: Linearised) -> tuple[Array, Array]:
    """Score of further directions at a fit: information (K, K) and gradient (K,), with all that was fitted taken out.

    directions.a (m, K) are derivatives by the further unknowns at the fit; its r is that of the fit. The score
    statistic of Rao (1948) is gradient^T information^+ gradient.
    """
    k = directions.a[0].shape[1]
    s = fitted.linear.a[0].shape[1]
    information, gradient = np.zeros((s + k, s + k)), np.zeros(s + k)
    for a, b, c, res in zip(fitted.linear.a, fitted.linear.b, directions.a, fitted.linear.r, strict=True):
        wide = np.concatenate([a, c], axis=1)
        if b.shape[1]:
            basis, size, _ = np.linalg.svd(b, full_matrices=False)
            basis = basis[:, size > 1e-10 * size.max(initial=0.0)]
            wide = wide - basis @ (basis.T @ wide)
            res = res - basis @ (basis.T @ res)
        information += wide.T @ wide
        gradient += wide.T @ res
    if not s:
        return information, gradient
    inner = np.linalg.pinv(information[:s, :s], rcond=1e-10, hermitian=True)
    cross = information[s:, :s]
    return information[s:, s:] - cross @ inner @ cross.T, gradient[s:] - cross @ inner @ gradient[:s]


def with_values(fitted: Fit, values: Array) -> Fit:
    """The same fit with other shared values, as a start for a further one."""
    return replace(fitted, values=np.asarray(values, dtype=float))
