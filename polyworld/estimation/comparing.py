"""Compare simulated with measured motion: residuals of all worlds of a batch at once, runs filled up alike."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import RunDesign
from polyworld.estimation.rotation_counting import counted_angles, counted_vectors
from polyworld.solver.planar.plane_motion import PlaneMotion
from polyworld.world.symmetry import rotation_vector, smallest_rotation, turn_about

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]
Kind = Literal["position", "spin"]

KINDS: tuple[Kind, ...] = ("position", "spin")


@dataclass(frozen=True)
class Motion:
    """Motion of W worlds at up to T instants: positions, spins (W, T, n, 3), and orientations (W, T, n, 4) of bodies.

    names: of the n columns. diverged (W,).
    """

    names: tuple[str, ...]
    diverged: Bools
    positions: Array
    orientations: Array
    spins: Array


@dataclass(frozen=True)
class _Turned:
    """Measured orientations of one body in one run: their rows (m,), (m, 4), the look-alikes, the angles (m,) in the
    plane, and where the residual has them, by axis."""

    name: str
    rows: Ints
    observed: Array
    order: int
    angles: Array | None
    where: dict[int, slice]


@dataclass(frozen=True)
class _Components:
    """Measured positions, or spins, of one run: column, row, axis, value (p,), and where (p,) the residual has them."""

    where: Ints
    column: Ints
    row: Ints
    axis: Ints
    seen: Array


@dataclass(frozen=True)
class _Table:
    """One run as it is compared. turned: bodies whose orientations were measured. length: of the residual."""

    position: _Components
    spin: _Components
    turned: tuple[_Turned, ...]
    length: int


class Comparison:
    """Residuals, simulated less observed, of worlds that share the columns of their motion.

    axes (3, 3): rows x, y and normal of the plane of planar motion. described (1, n, 4): orientations that poses count
    from. sampled: of a run's index, the rows (T,) at which its instants are sampled.
    """

    def __init__(self, planar: bool, axes: Array, sampled: Callable[[RunDesign], Ints]) -> None:
        self._planar, self._axes, self._sampled = planar, axes, sampled
        self._level = bool(np.all(np.abs(np.abs(axes[2]).max() - 1.0) < 1e-12))  # heights do not enter what is compared
        self._as_it_is = bool(np.array_equal(axes, np.eye(3)))
        self._tables: dict[tuple[int, tuple[str, ...]], _Table] = {}
        self._stacks: dict[tuple[tuple[int, ...], tuple[str, ...]], _Stack] = {}

    def residuals(self, runs: Sequence[RunDesign], motion: Motion | PlaneMotion, reached: Ints) -> Array:
        """Return residuals (R, k, M) of R k worlds against R runs, k worlds each, runs filled up with zeros.

        reached (R,): rows simulated of each run; beyond them residuals are zero. NaN where a rollout diverged.
        """
        described = motion.described if isinstance(motion, PlaneMotion) else None
        key = (tuple(r.index for r in runs), motion.names)
        if key not in self._stacks:
            if len(self._stacks) >= KEPT:
                self._stacks.pop(next(iter(self._stacks)))
            self._stacks[key] = _Stack([self._table(r, motion.names, described) for r in runs], len(motion.names))
        stack = self._stacks[key]
        each = len(motion.diverged) // len(runs)
        found = np.zeros((len(runs), each, stack.length))
        for kind, components in stack.components.items():
            self._compare(found, components, self._source(kind, motion, len(runs)), reached)
        for turned in stack.turned:
            self._turns(found, turned, motion, reached)
        found[motion.diverged.reshape(len(runs), each)] = np.nan
        return found

    def _source(self, kind: Kind, motion: Motion | PlaneMotion, runs: int) -> Array:
        """Return positions or spins (R, k, T, n, 3), along the world's axes."""
        if isinstance(motion, Motion):
            found = motion.positions if kind == "position" else motion.spins
        elif kind == "spin":
            found = motion.rate[..., 2:] * self._axes[2]
        elif self._level:
            found = motion.pose if self._as_it_is else motion.pose[..., :2] @ self._axes[:2]
        else:
            found = motion.pose[..., :2] @ self._axes[:2] + motion.height[:, None, :, None] * self._axes[2]
        return found.reshape(runs, -1, *found.shape[1:])

    def _compare(self, found: Array, own: _StackedComponents, source: Array, reached: Ints) -> None:
        runs, each = source.shape[:2]
        there = own.there & (own.row < reached[:, None])
        take = np.where(there, own.take, 0)
        values = np.take_along_axis(source.reshape(runs, each, -1), take[:, None], axis=2)
        values = np.where(there[:, None], values - own.seen[:, None], 0.0)
        if own.leading:
            found[:, :, : values.shape[2]] = values
            return
        for i, where in enumerate(own.where):
            found[i][:, where] = values[i, :, : len(where)]

    def _turns(self, found: Array, turned: _StackedTurns, motion: Motion | PlaneMotion, reached: Ints) -> None:
        column = motion.names.index(turned.name)
        runs, each = len(turned.runs), found.shape[1]
        there = turned.there & (turned.rows < reached[turned.runs, None])
        rows = np.where(there, turned.rows, 0)
        if isinstance(motion, PlaneMotion):
            angle = motion.pose[:, :, column, 2].reshape(found.shape[0], each, -1)[turned.runs]
            angles = np.take_along_axis(angle, rows[:, None], axis=2) - turned.angles[:, None]
            vectors = np.zeros((runs, each, rows.shape[1], 3))
            vectors[..., 2] = self._folded(angles, turned.order, there)
        else:
            every = motion.orientations[:, :, column].reshape(found.shape[0], each, -1, 4)[turned.runs]
            simulated = np.take_along_axis(every, rows[:, None, :, None], axis=2)
            simulated = np.where(there[:, None, :, None], simulated, IDENTITY)
            observed = np.where(there[..., None], turned.observed, IDENTITY)
            vectors = self._vectors(simulated, observed, turned.order, there)
        vectors = np.where(there[:, None, :, None], vectors, 0.0)
        for i, (run, where) in enumerate(zip(turned.runs, turned.where, strict=True)):
            for axis, place in where.items():
                found[run][:, place] = vectors[i, :, : place.stop - place.start, axis]

    def _folded(self, angles: Array, order: int, there: Bools) -> Array:
        if not order:
            return np.zeros_like(angles)
        period = 2.0 * np.pi / order
        angles = np.where(there[:, None], angles - period * np.round(angles / period), 0.0)
        flat = angles.reshape(-1, angles.shape[2])
        counted: Array = counted_angles(flat, np.full(flat.shape[1], 0.5 * period)).reshape(angles.shape)
        return counted

    def _vectors(self, simulated: Array, observed: Array, order: int, there: Bools) -> Array:
        """Rotation vectors (R, k, m, 3) from observed (R, m, 4) to simulated (R, k, m, 4)."""
        shape = simulated.shape[:3]
        if self._planar:
            result = np.zeros((*shape, 3))
            if order:
                folds = np.full(shape[2], order, dtype=np.int64)
                angles = np.stack(
                    [turn_about(s, o, self._axes[2], folds) for s, o in zip(simulated, observed, strict=True)]
                )
                result[..., 2] = self._folded(angles, order, there)
            return result
        if order == 1:  # most often; one look-alike need not be compared with itself
            vectors = rotation_vector(simulated, observed[:, None])
            flat = counted_vectors(vectors.reshape(-1, shape[2], 3), simulated.reshape(-1, shape[2], 4), observed)
            counted: Array = flat.reshape(*shape, 3)
            return counted
        alike = np.full(shape[2], order, dtype=np.int64)
        return np.stack([smallest_rotation(s, o, alike) for s, o in zip(simulated, observed, strict=True)])

    def _table(self, run: RunDesign, names: tuple[str, ...], described: Array | None) -> _Table:
        key = (run.index, names)
        if key not in self._tables:
            self._tables[key] = _table(run, names, self._sampled(run), self._axes, described)
        return self._tables[key]


KEPT = 8  # combinations of runs that are kept laid out
IDENTITY = np.array([1.0, 0.0, 0.0, 0.0])


def _table(run: RunDesign, names: tuple[str, ...], sampled: Ints, axes: Array, described: Array | None) -> _Table:
    parts: dict[str, list[tuple[NDArray[Any], ...]]] = {"position": [], "spin": []}
    turned: dict[str, _Turned] = {}
    for s in run.series:
        own, column, count = run.run.names.index(s.name), names.index(s.name), len(s.rows)
        if s.kind != "rotation":
            measured = run.run.positions if s.kind == "position" else run.run.angular_velocities
            where = np.arange(s.where.start, s.where.stop)
            full = (np.full(count, column), sampled[s.rows], np.full(count, s.axis))
            parts[s.kind].append((where, *full, measured[s.rows, own, s.axis]))
            continue
        if s.name not in turned:
            observed = run.run.orientations[s.rows, own]
            angles = None
            if described is not None:
                base = np.broadcast_to(described[:, column], observed.shape)
                angles = -turn_about(base[None], observed, axes[2], np.ones(count, dtype=np.int64))[0]
            turned[s.name] = _Turned(s.name, sampled[s.rows], observed, int(run.run.symmetry[own]), angles, {})
        turned[s.name].where[s.axis] = s.where
    return _Table(_components(parts["position"]), _components(parts["spin"]), tuple(turned.values()), run.length)


def _components(parts: Sequence[tuple[NDArray[Any], ...]]) -> _Components:
    if not parts:
        none = np.zeros(0, dtype=np.int64)
        return _Components(none, none, none, none, np.zeros(0))
    return _Components(*(np.concatenate(p) for p in zip(*parts, strict=True)))


class _Stack:
    """Tables of R runs, filled up to equal lengths."""

    def __init__(self, tables: Sequence[_Table], columns: int) -> None:
        self.length = max(t.length for t in tables)
        self.components: dict[Kind, _StackedComponents] = {}
        for kind in KINDS:
            own = [getattr(t, kind) for t in tables]
            if any(len(c.where) for c in own):
                self.components[kind] = _StackedComponents(own, columns)
        turned: dict[tuple[str, int], list[tuple[int, _Turned]]] = {}
        for i, table in enumerate(tables):
            for one in table.turned:
                turned.setdefault((one.name, one.order), []).append((i, one))
        self.turned = [_StackedTurns(name, order, of_runs) for (name, order), of_runs in turned.items()]


class _StackedComponents:
    """Positions or spins of R runs, filled up to equal numbers P.

    take (R, P): where motion (T, n, 3) has them. there (R, P): which are measured. leading: whether they are the first
    entries of every run's residual, in order.
    """

    def __init__(self, own: Sequence[_Components], columns: int) -> None:
        most = max(len(c.where) for c in own)
        self.where = [c.where for c in own]
        self.leading = all(np.array_equal(w, np.arange(len(w))) for w in self.where)
        self.there = np.arange(most) < np.array([len(w) for w in self.where])[:, None]
        filled = {
            name: np.array([np.pad(getattr(c, name), (0, most - len(c.where))) for c in own])
            for name in ("row", "column", "axis", "seen")
        }
        self.row, self.seen = filled["row"], filled["seen"]
        self.take = (self.row * columns + filled["column"]) * 3 + filled["axis"]


class _StackedTurns:
    """Orientations of one body in some of R runs, filled up to equal lengths."""

    def __init__(self, name: str, order: int, own: Sequence[tuple[int, _Turned]]) -> None:
        self.name, self.order = name, order
        self.runs = np.array([i for i, _ in own])
        most = max(len(t.rows) for _, t in own)
        self.rows = np.array([np.pad(t.rows, (0, most - len(t.rows))) for _, t in own], dtype=np.int64)
        self.there = np.arange(most) < np.array([len(t.rows) for _, t in own])[:, None]
        self.observed = np.zeros((len(own), most, 4))
        self.angles = np.zeros((len(own), most))
        for i, (_, t) in enumerate(own):
            self.observed[i, : len(t.rows)] = t.observed
            if t.angles is not None:
                self.angles[i, : len(t.rows)] = t.angles
        self.where = [t.where for _, t in own]
