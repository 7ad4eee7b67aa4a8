"""Damped Gauss-Newton steps for chains of segments: block-bordered normal equations (Levenberg 1944, Marquardt 1963).

Unknowns are the values shared by all runs and every segment's initial state. Residuals are the whitened differences
between simulation and measurement, and the jumps between consecutive segments divided by their tolerance. Runs share
nothing but the shared values, so a Schur complement leaves a system of these alone; each run has a damping of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.continuity import Continuity, jumps
from polyworld.estimation.noise import Noise
from polyworld.estimation.problem import Problem
from polyworld.estimation.segment_forward import Forward, Outcome, Settings

Array = NDArray[np.float64]
Ints = NDArray[np.int64]

STEP = 0.2  # of a standard error: step of difference quotients
FIRST_STEP = 1e-3  # of a typical change, while no standard error is known
STEPS = (1e-5, 1e-2)  # least and greatest step, in typical changes
PRIOR = 1e-4  # weight of a typical change in the curvature: keeps what the data do not determine
FLOOR = 0.3  # the same in the damping of states: at rest on friction, slopes by the speed nearly vanish
LONGEST = 20.0  # typical changes by which a state changes at most in one step
SHARED_DAMPINGS = 10.0 ** np.array([-1.5, 0.0, 1.5])  # tried at once, as factors of the last successful one
STATE_DAMPINGS = 10.0 ** np.array([-1.5, 0.0, 1.5])


@dataclass(frozen=True)
class Point:
    """Shared values (S,) and initial states[segment] (N,)."""

    values: Array
    states: tuple[Array, ...]


@dataclass(frozen=True)
class Linear:
    """A linearisation: residuals and slopes, whitened, run by run and segment by segment.

    r[run] (m,), a[run] (m, S): whitened residuals and their slopes by shared values. rows[segment] (q,), b[segment]
    (q, N): entries of the run's residuals that the segment's state moves, and their slopes. jump[boundary] (D,), and
    its slopes by shared values (D, S) and by the states before and after (D, N): in units of the boundary's scale.
    """

    r: tuple[Array, ...]
    a: tuple[Array, ...]
    rows: tuple[Ints, ...]
    b: tuple[Array, ...]
    jump: tuple[Array, ...]
    jump_a: tuple[Array, ...]
    jump_before: tuple[Array, ...]
    jump_after: tuple[Array, ...]

    @property
    def finite(self) -> bool:
        """Whether no rollout diverged."""
        return all(np.all(np.isfinite(x)) for x in (*self.r, *self.jump))


class Chains:
    """A forward model with its noise and the scales of jumps: evaluates costs, linearises, and proposes steps.

    scale[boundary] (D,): unit of each component of a jump.
    """

    def __init__(self, forward: Forward, noise: Noise, scale: Sequence[Array] | None = None) -> None:
        self.forward = forward
        self.problem: Problem = forward.problem
        self.noise = noise
        self.continuity = Continuity(self.problem, forward.world.planar)
        self.scale = scale if scale is not None else [np.ones(b.length) for b in self.continuity.boundaries]
        self.lower = np.array([u.lower for u in forward.unknowns])
        self.upper = np.array([u.upper for u in forward.unknowns])
        self.typical = np.array([u.typical for u in forward.unknowns])
        self._spill = [self._spilled(s) for s in range(len(self.problem.segments))]
        self._run_of_boundary = np.array(
            [self.problem.segments[b.after].run for b in self.continuity.boundaries], dtype=np.int64
        )

    def _spilled(self, segment: int) -> tuple[Ints, Ints]:
        """Entries of the run after a segment's own whose noise is correlated with one of its own, and which one."""
        own = self.problem.segments[segment]
        previous, rho = self.noise.previous[own.run], self.noise.rho[own.run]
        place = np.full(len(previous), -1, dtype=np.int64)
        place[own.own] = np.arange(len(own.own))
        later = np.flatnonzero((place < 0) & (rho != 0.0) & (place[previous] >= 0))
        return later, place[previous[later]]

    # -- costs ---------------------------------------------------------------------------------------------------

    def costs(self, points: Sequence[Point]) -> tuple[Array, Array]:
        """Return chi2 of the data (K, R) and squared jumps in units of their scales (K, R) at K points.

        Runs of which a rollout diverges have infinite chi2.
        """
        segments = self.problem.segments
        settings = [
            Settings(s.index, np.array([p.values for p in points]), np.array([p.states[s.index] for p in points]))
            for s in segments
        ]
        outcomes = self.forward.outcomes(settings)
        return self._costs_of(outcomes, settings)

    def _costs_of(self, outcomes: Sequence[Outcome], settings: Sequence[Settings]) -> tuple[Array, Array]:
        count = len(settings[0].shared)
        data = np.zeros((count, len(self.problem.chains)))
        for run, white in enumerate(self._whitened(outcomes, count)):
            with np.errstate(over="ignore"):
                total = np.einsum("km,km->k", white, white)
            data[:, run] = np.where(np.isfinite(total), total, np.inf)
        broken = np.zeros_like(data)
        for b, jump, scale in zip(
            self.continuity.boundaries,
            jumps(self.continuity, outcomes, [s.states for s in settings]),
            self.scale,
            strict=True,
        ):
            broken[:, self.problem.segments[b.after].run] += ((jump / scale) ** 2).sum(axis=1)
        return data, np.where(np.isfinite(broken), broken, np.inf)

    def _whitened(self, outcomes: Sequence[Outcome], count: int) -> list[Array]:
        found = []
        for run, chain in enumerate(self.problem.chains):
            raw = np.empty((count, self.problem.whole.runs[run].length))
            for k in chain:
                raw[:, self.problem.segments[k].own] = outcomes[k].residual
            found.append(self.noise.whiten(run, raw))
        return found

    # -- linearisation -------------------------------------------------------------------------------------------

    def linearise(self, at: Point, shared: Array, own: Sequence[Array]) -> Linear:
        """Return residuals and difference quotients with steps by shared values (S,) and states own[segment] (N,)."""
        s = len(shared)
        signed = np.where(at.values + shared > self.upper, -shared, shared)  # a step beyond a bound goes the other way
        settings = []
        for segment in self.problem.segments:
            n = segment.layout.count
            values = np.repeat(at.values[None], 1 + s + n, axis=0)
            states = np.repeat(at.states[segment.index][None], 1 + s + n, axis=0)
            values[1 + np.arange(s), np.arange(s)] += signed
            states[1 + s + np.arange(n), np.arange(n)] += own[segment.index]
            settings.append(Settings(segment.index, np.clip(values, self.lower, self.upper), states))
        outcomes = self.forward.outcomes(settings)
        raw_r, raw_a, rows, b = [], [], [], []
        for run, chain in enumerate(self.problem.chains):
            length = self.problem.whole.runs[run].length
            r, a = np.empty(length), np.empty((length, s))
            for k in chain:
                segment = self.problem.segments[k]
                residual = outcomes[k].residual
                r[segment.own] = residual[0]
                change = (residual[1:] - residual[0]).T
                change = np.where(np.isfinite(change), change, 0.0)
                a[segment.own] = change[:, :s] / signed
                rows.append(np.concatenate([segment.own, self._spill[k][0]]))
                b.append(self._white_columns(run, k, change[:, s:] / own[k]))
            raw_r.append(self.noise.whiten(run, r))
            raw_a.append(self.noise.whiten(run, a.T).T if s else a)
        found = self._linear_jumps(outcomes, settings, signed, own)
        return Linear(tuple(raw_r), tuple(raw_a), tuple(rows), tuple(b), *found)

    def _white_columns(self, run: int, segment: int, columns: Array) -> Array:
        """Whiten slopes (m, N) that are zero outside a segment; rows as in `Linear.rows`."""
        own = self.problem.segments[segment].own
        later, cause = self._spill[segment]
        sigma, rho, kept = self.noise.sigma[run], self.noise.rho[run], self.noise.kept[run]
        scaled = columns / sigma[own][:, None]
        if not np.any(rho):
            return scaled * kept[own][:, None]
        place = np.full(len(sigma), -1, dtype=np.int64)
        place[own] = np.arange(len(own))
        before = place[self.noise.previous[run][own]]
        earlier = np.where((before >= 0)[:, None], scaled[np.maximum(before, 0)], 0.0)
        first = (scaled - rho[own][:, None] * earlier) / np.sqrt(1.0 - rho[own] ** 2)[:, None] * kept[own][:, None]
        spilled = -(rho[later] / np.sqrt(1.0 - rho[later] ** 2) * kept[later])[:, None] * scaled[cause]
        result: Array = np.concatenate([first, spilled])
        return result

    def _linear_jumps(
        self, outcomes: Sequence[Outcome], settings: Sequence[Settings], signed: Array, own: Sequence[Array]
    ) -> tuple[tuple[Array, ...], tuple[Array, ...], tuple[Array, ...], tuple[Array, ...]]:
        s = len(signed)
        values, slopes, before, after = [], [], [], []
        for boundary, scale in zip(self.continuity.boundaries, self.scale, strict=True):
            one, two = outcomes[boundary.before], outcomes[boundary.after]
            x, y = settings[boundary.before].states, settings[boundary.after].states
            ends, begins = one.end, two.begin
            base = self.continuity.jump(boundary, ends.rows(FIRST), begins.rows(FIRST), x[:1], y[:1])[0]
            left = self.continuity.jump(boundary, ends, begins.rows(FIRST), x, y[:1]) - base
            right = self.continuity.jump(boundary, ends.rows(FIRST), begins, x[:1], y) - base
            left, right = (np.where(np.isfinite(v), v, 0.0) for v in (left, right))
            values.append(base / scale)
            by_values = (left[1 : 1 + s] + right[1 : 1 + s]).T / signed
            slopes.append(by_values / scale[:, None])
            before.append(left[1 + s :].T / own[boundary.before] / scale[:, None])
            after.append(right[1 + s :].T / own[boundary.after] / scale[:, None])
        return tuple(values), tuple(slopes), tuple(before), tuple(after)


FIRST = slice(0, 1)


class NormalEquations:
    """The normal equations of a linearisation with jumps weighted by 1 / tolerance^2 (in units of their scales).

    Of every run: h (n, n) states by states, g (n, S) states by shared values, v (n,) states by residuals, d (n,) the
    data's own curvature, without continuity, from which dampings take their scale.
    """

    def __init__(self, chains: Chains, linear: Linear, tolerance: float) -> None:
        problem = chains.problem
        s = len(chains.typical)
        self.chains = chains
        self.a, self.u = np.zeros((s, s)), np.zeros(s)
        self.h, self.g, self.v, self.d, self.typical = [], [], [], [], []
        self.offsets: list[dict[int, slice]] = []
        for run, chain in enumerate(problem.chains):
            at, offsets = 0, {}
            for k in chain:
                n = problem.segments[k].layout.count
                offsets[k] = slice(at, at + n)
                at += n
            self.offsets.append(offsets)
            h, g, v = np.zeros((at, at)), np.zeros((at, s)), np.zeros(at)
            r, a = linear.r[run], linear.a[run]
            for i, k in enumerate(chain):
                rows, b = linear.rows[k], linear.b[k]
                own = offsets[k]
                h[own, own] += b.T @ b
                g[own] += b.T @ a[rows]
                v[own] += b.T @ r[rows]
                spill = len(rows) - len(problem.segments[k].own)
                if spill and i + 1 < len(chain):  # correlated noise links neighbours
                    after = chain[i + 1]
                    place = np.full(len(r), -1, dtype=np.int64)
                    place[linear.rows[after]] = np.arange(len(linear.rows[after]))
                    where = place[rows[-spill:]]
                    known = where >= 0
                    cross = b[-spill:][known].T @ linear.b[after][where[known]]
                    h[own, offsets[after]] += cross
                    h[offsets[after], own] += cross.T
            self.d.append(np.maximum(np.diag(h), 0.0).copy())
            self.typical.append(np.concatenate([problem.segments[k].layout.typical for k in chain]))
            self.a += a.T @ a
            self.u += a.T @ r
            self.h.append(h)
            self.g.append(g)
            self.v.append(v)
        weight = 1.0 / tolerance**2
        for i, boundary in enumerate(chains.continuity.boundaries):
            run = problem.segments[boundary.after].run
            j, ja, jb, jc = linear.jump[i], linear.jump_a[i], linear.jump_before[i], linear.jump_after[i]
            one, two = self.offsets[run][boundary.before], self.offsets[run][boundary.after]
            h, g, v = self.h[run], self.g[run], self.v[run]
            h[one, one] += weight * jb.T @ jb
            h[two, two] += weight * jc.T @ jc
            cross = weight * jb.T @ jc
            h[one, two] += cross
            h[two, one] += cross.T
            g[one] += weight * jb.T @ ja
            g[two] += weight * jc.T @ ja
            v[one] += weight * jb.T @ j
            v[two] += weight * jc.T @ j
            self.a += weight * ja.T @ ja
            self.u += weight * ja.T @ j

    def factor(self, run: int, damping: float, floor: float) -> Array:
        """Inverse (n, n) of a run's damped block."""
        h, typical = self.h[run], self.typical[run]
        diagonal = damping * (self.d[run] + (PRIOR / typical) ** 2) + (floor / typical) ** 2
        matrix = h + np.diag(diagonal)
        scale = 1.0 / np.sqrt(np.diag(matrix))
        inverse: Array = np.linalg.inv(matrix * scale[:, None] * scale) * scale[:, None] * scale
        return inverse

    def reduced(self, inverses: Sequence[Array]) -> tuple[Array, Array]:
        """Schur complement (S, S) and right side (S,) of the shared values."""
        matrix, vector = self.a.copy(), self.u.copy()
        for g, v, inverse in zip(self.g, self.v, inverses, strict=True):
            carried = inverse @ g
            matrix -= g.T @ carried
            vector -= carried.T @ v
        return matrix, vector

    def shared_step(self, matrix: Array, vector: Array, values: Array, damping: float) -> Array:
        """The damped step (S,); values at a bound that it would leave take no part."""
        chains = self.chains
        diagonal = damping * np.maximum(np.diag(matrix), 0.0) + ((damping + 1.0) * PRIOR / chains.typical) ** 2
        free = np.ones(len(values), dtype=bool)
        step = np.zeros(len(values))
        for _ in range(len(values) + 1):
            step = np.zeros(len(values))
            if not free.any():
                break
            block = (matrix + np.diag(diagonal))[np.ix_(free, free)]
            scale = 1.0 / np.sqrt(np.maximum(np.diag(block), 1e-300))
            step[free] = -np.linalg.lstsq(block * scale[:, None] * scale, vector[free] * scale, rcond=1e-14)[0] * scale
            out = free & (((values <= chains.lower) & (step < 0)) | ((values >= chains.upper) & (step > 0)))
            if not out.any():
                break
            free &= ~out
        clipped: Array = np.clip(values + step, chains.lower, chains.upper) - values
        return clipped

    def state_step(self, run: int, inverse: Array, step: Array) -> Array:
        """The change (n,) of a run's states that goes with a step (S,) of the shared values."""
        change = -inverse @ (self.v[run] + self.g[run] @ step)
        clipped: Array = np.clip(change, -LONGEST * self.typical[run], LONGEST * self.typical[run])
        return clipped
