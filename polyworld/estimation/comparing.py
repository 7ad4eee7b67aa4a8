"""Compare simulated with measured motion: residuals of all worlds of a batch at once, runs filled up to equal length."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import RunDesign
from polyworld.estimation.rotation_counting import counted_angles, counted_vectors
from polyworld.symmetry import rotation_vector, smallest_rotation, turn_about

Array = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Motion:
    """Motion of W worlds at up to T instants: positions (W, T, n, 3), and of bodies orientations (W, T, n, 4).

    Planar motion in the plane's own coordinates has poses (W, T, n, 3) in place of both, and heights (W, n).
    names: of the n columns. diverged (W,).
    """

    names: tuple[str, ...]
    diverged: Bools
    positions: Array | None = None
    orientations: Array | None = None
    pose: Array | None = None
    height: Array | None = None

    @property
    def instants(self) -> int:
        """Number T of instants."""
        there = self.positions if self.pose is None else self.pose
        assert there is not None
        return there.shape[1]


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
class _Table:
    """One run as it is compared.

    column, row, axis, seen (p,): of every measured position, and where (p,) the residual has it. turned: bodies whose
    orientations were measured. length: of the residual.
    """

    where: Ints
    column: Ints
    row: Ints
    axis: Ints
    seen: Array
    turned: tuple[_Turned, ...]
    length: int


class Comparison:
    """Residuals, simulated less observed, of worlds that share the columns of their motion.

    axes (3, 3): rows x, y and normal of the plane of planar motion. described (1, n, 4): orientations that poses count
    from. sampled: of a run's index, the rows (T,) at which its instants are sampled.
    """

    def __init__(self, planar: bool, axes: Array, sampled: Callable[[RunDesign], Ints]) -> None:
        self._planar, self._axes, self._sampled = planar, axes, sampled
        self._tables: dict[tuple[int, tuple[str, ...]], _Table] = {}
        self._stacks: dict[tuple[tuple[int, ...], tuple[str, ...]], _Stack] = {}

    def forget(self) -> None:
        """Let go of all tables: runs are sampled otherwise from now on."""
        self._tables.clear()
        self._stacks.clear()

    def residuals(self, runs: Sequence[RunDesign], motion: Motion, described: Array | None) -> Array:
        """Return residuals (R, k, M) of R k worlds against R runs, k worlds each, runs filled up with zeros.

        Zero at instants that were not simulated; NaN where a rollout diverged.
        """
        key = (tuple(r.index for r in runs), motion.names)
        if key not in self._stacks:
            if len(self._stacks) >= KEPT:
                self._stacks.pop(next(iter(self._stacks)))
            self._stacks[key] = _Stack([self._table(r, motion.names, described) for r in runs], len(motion.names))
        stack = self._stacks[key]
        each = len(motion.diverged) // len(runs)
        found = np.zeros((len(runs), each, stack.length))
        self._places(found, stack, motion)
        for turned in stack.turned:
            self._turns(found, turned, motion)
        found[motion.diverged.reshape(len(runs), each)] = np.nan
        return found

    def _places(self, found: Array, stack: _Stack, motion: Motion) -> None:
        runs, each = found.shape[:2]
        take, there = stack.take, stack.row < motion.instants
        source = motion.positions if motion.pose is None else motion.pose
        assert source is not None
        flat = source.reshape(runs, each, -1)
        take = np.where(there, take, 0)
        if motion.pose is None:
            values = np.take_along_axis(flat, take[:, None], axis=2)
        else:
            assert motion.height is not None
            values = np.zeros((runs, each, take.shape[1]))
            for part in range(2):
                factor = self._axes[part][stack.axis]
                if np.any(factor):
                    shift = np.where(there, stack.flat + part, 0)
                    values += np.take_along_axis(flat, shift[:, None], axis=2) * factor[:, None]
            factor = self._axes[2][stack.axis]
            if np.any(np.abs(factor) > 1e-12):
                heights = motion.height.reshape(runs, each, -1)
                values += np.take_along_axis(heights, stack.column[:, None], axis=2) * factor[:, None]
        values -= stack.seen[:, None]
        values *= (there & stack.there)[:, None]
        if stack.aligned:
            found[:, :, : values.shape[2]] = values
            return
        for i, (where, count) in enumerate(zip(stack.where, stack.counts, strict=True)):
            found[i][:, where] = values[i, :, :count]

    def _turns(self, found: Array, turned: _StackedTurns, motion: Motion) -> None:
        column = motion.names.index(turned.name)
        runs, each = len(turned.runs), found.shape[1]
        there = turned.there & (turned.rows < motion.instants)
        rows = np.where(there, turned.rows, 0)
        if motion.pose is not None:
            angle = motion.pose[:, :, column, 2].reshape(found.shape[0], each, -1)[turned.runs]
            angles = np.take_along_axis(angle, rows[:, None], axis=2) - turned.angles[:, None]
            vectors = np.zeros((runs, each, rows.shape[1], 3))
            vectors[..., 2] = self._folded(angles, turned.order, there)
        else:
            assert motion.orientations is not None
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
    where, column, row, axis, seen = [], [], [], [], []
    turned: dict[str, _Turned] = {}
    for s in run.series:
        own = run.run.names.index(s.name)
        if s.kind == "position":
            count = len(s.rows)
            where.append(np.arange(s.where.start, s.where.stop))
            column.append(np.full(count, names.index(s.name)))
            row.append(sampled[s.rows])
            axis.append(np.full(count, s.axis))
            seen.append(run.run.positions[s.rows, own, s.axis])
            continue
        if s.name not in turned:
            observed = run.run.orientations[s.rows, own]
            angles = None
            if described is not None:
                base = np.broadcast_to(described[:, names.index(s.name)], observed.shape)
                angles = -turn_about(base[None], observed, axes[2], np.ones(len(s.rows), dtype=np.int64))[0]
            turned[s.name] = _Turned(s.name, sampled[s.rows], observed, int(run.run.symmetry[own]), angles, {})
        turned[s.name].where[s.axis] = s.where
    none = np.zeros(0, dtype=np.int64)
    parts = [np.concatenate(p) if p else none for p in (where, column, row, axis)]
    places = np.concatenate(seen) if seen else np.zeros(0)
    return _Table(parts[0], parts[1], parts[2], parts[3], places, tuple(turned.values()), run.length)


class _Stack:
    """Tables of R runs, filled up to equal lengths P of positions."""

    def __init__(self, tables: Sequence[_Table], columns: int) -> None:
        self.length = max(t.length for t in tables)
        self.counts = [len(t.where) for t in tables]
        self.where = [t.where for t in tables]
        self.aligned = all(np.array_equal(t.where, np.arange(len(t.where))) for t in tables)
        most = max(self.counts)
        self.there = np.arange(most) < np.array(self.counts)[:, None]
        self.row, self.column, self.axis = (
            np.array([np.pad(getattr(t, name), (0, most - len(t.where))) for t in tables], dtype=np.int64)
            for name in ("row", "column", "axis")
        )
        self.seen = np.array([np.pad(t.seen, (0, most - len(t.seen))) for t in tables])
        self.flat = (self.row * columns + self.column) * 3
        self._tables = tables

    @cached_property
    def take(self) -> Ints:
        """Where positions (T, n, 3) have what was measured (R, P)."""
        found: Ints = self.flat + self.axis
        return found

    @cached_property
    def turned(self) -> list[_StackedTurns]:
        """Measured orientations, body by body."""
        found: dict[tuple[str, int], list[tuple[int, _Turned]]] = {}
        for i, table in enumerate(self._tables):
            for one in table.turned:
                found.setdefault((one.name, one.order), []).append((i, one))
        return [_StackedTurns(name, order, own) for (name, order), own in found.items()]


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


