"""Residuals of planar motion, read off the plane's own coordinates.

Most of the time of a fit goes into comparing many short rollouts. Where nothing observes awry, the places and angles
that the solver has are what was measured but for constants, and no orientation need be made of an angle and taken
apart again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import RunDesign
from polyworld.estimation.rotation_counting import counted_angles
from polyworld.solver.planar.plane_motion import PlaneMotion
from polyworld.symmetry import turn_about

Array = NDArray[np.float64]
Ints = NDArray[np.int64]


@dataclass(frozen=True)
class _Turn:
    """A series of angles: where the residual has them, and how many turns look alike, 0 where all do."""

    where: slice
    order: int


@dataclass(frozen=True)
class _Table:
    """Where the residuals of a run come from, up to some instant.

    where (P,): entries of the residual that are simulated. take (P,): where poses (T n 3,), followed by their rates if
    `rates`, have them; of a coordinate along a world's axis, the one along the plane's axis nearest to it. factor (P,):
    what they count. across: what else counts, None where the plane's axes are the world's. turns: series of angles.
    """

    where: Ints
    take: Ints
    factor: Array
    across: _Across | None
    turns: tuple[_Turn, ...]
    rates: bool


@dataclass(frozen=True)
class _Across:
    """What else counts (P,) where the plane's axes are not the world's: the plane's other axis, and the height."""

    take: Ints
    factor: Array
    body: Ints
    height_factor: Array


class InPlane:
    """Comparison of planar motion with the runs of a design; what is the same every time is kept."""

    def __init__(self) -> None:
        self._tables: dict[tuple[int, int], _Table] = {}
        self._seen: dict[int, Array] = {}

    def compare(self, designs: Sequence[RunDesign], motion: PlaneMotion, worlds: Ints) -> Array:
        """Residuals (R, k, m) of R k worlds against R runs of the same layout, k worlds each: simulated less observed,
        0 beyond what was simulated, NaN where a rollout diverged."""
        first = designs[0]
        count = motion.pose.shape[1]
        key = (first.index, count)
        if key not in self._tables:
            self._tables[key] = _table(first, motion, count)
        table = self._tables[key]
        seen = np.array([self._observed(d, motion) for d in designs])
        all_worlds = np.array_equal(worlds, np.arange(len(motion.pose)))  # most often; then none need be picked
        moved = (motion.pose, motion.rate) if table.rates else (motion.pose,)
        parts = [np.ascontiguousarray(m if all_worlds else m[worlds]).reshape(len(worlds), -1) for m in moved]
        flat = np.concatenate(parts, axis=1) if table.rates else parts[0]
        found = np.take(flat, table.take, axis=1) * table.factor
        if table.across is not None:
            found += flat[:, table.across.take] * table.across.factor
            found += motion.height[worlds][:, table.across.body] * table.across.height_factor
        residual: Array = found.reshape(len(designs), -1, len(table.where)) - seen[:, None, table.where]
        if len(table.where) < first.length:
            early, residual = residual, np.zeros((*residual.shape[:2], first.length))
            residual[..., table.where] = early
        for turn in table.turns:
            angles = residual[..., turn.where].reshape(len(worlds), -1)
            folded = np.zeros_like(angles)
            if turn.order:
                period = 2.0 * np.pi / turn.order
                angles = angles - period * np.round(angles / period)
                folded = counted_angles(angles, np.full(angles.shape[1], 0.5 * period))
            residual[..., turn.where] = folded.reshape(len(designs), -1, angles.shape[1])
        residual[motion.diverged[worlds].reshape(residual.shape[:2])] = np.nan
        return residual

    def _observed(self, design: RunDesign, motion: PlaneMotion) -> Array:
        """What a run measured (m,): places, angles from the described orientation to the measured one, and spins."""
        if design.index not in self._seen:
            own, run = np.zeros(design.length), design.run
            for s in design.series:
                column = run.names.index(s.name)
                if s.kind == "position":
                    own[s.where] = run.positions[s.rows, column, s.axis]
                    continue
                if s.kind == "spin":
                    own[s.where] = run.angular_velocities[s.rows, column, s.axis]
                    continue
                measured = run.orientations[s.rows, column]
                described = np.broadcast_to(motion.described[:, motion.names.index(s.name)], measured.shape)
                one = np.ones(len(s.rows), dtype=np.int64)
                own[s.where] = -turn_about(described[None], measured, motion.axes[2], one)[0]
            self._seen[design.index] = own
        return self._seen[design.index]


def _table(design: RunDesign, motion: PlaneMotion, count: int) -> _Table:
    parts: list[tuple[Ints, Ints, Array, Ints, Array, Ints, Array]] = []
    turns = []
    rates_from = count * len(motion.names) * 3
    for s in design.series:
        own = motion.names.index(s.name)
        rows = s.rows[s.rows < count]
        first = (rows * len(motion.names) + own) * 3
        where = np.arange(s.where.start, s.where.start + len(rows))
        x, y, height = (np.full(len(rows), part) for part in motion.axes[:, s.axis])
        bodies, none = np.full(len(rows), own), np.zeros(len(rows))
        if s.kind == "spin":
            parts.append((where, rates_from + first + 2, height, first, none, bodies, none))
        elif s.kind == "rotation":
            order = design.run.symmetry[design.run.names.index(s.name)]
            turns.append(_Turn(slice(s.where.start, s.where.start + len(rows)), int(order)))
            parts.append((where, first + 2, none + 1.0, first, none, bodies, none))
        elif abs(motion.axes[0, s.axis]) >= abs(motion.axes[1, s.axis]):
            parts.append((where, first, x, first + 1, y, bodies, height))
        else:
            parts.append((where, first + 1, y, first, x, bodies, height))
    where, take, factor, other, least, body, heights = (np.concatenate(p) for p in zip(*parts, strict=True))
    oblique = bool(np.any(least) or np.any(heights))
    across = _Across(other, least, body, heights) if oblique else None
    return _Table(where, take, factor, across, tuple(turns), any(s.kind == "spin" for s in design.series))
