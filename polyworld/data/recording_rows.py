"""Rows of a table of measured motion, sorted in time and merged to one a run, object and instant."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from decimal import Decimal

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording_columns import MEASURED, TURN
from polyworld.data.recording_header import Clock
from polyworld.data.table import Problems

Array = NDArray[np.float64]

SAME_INSTANT = 1e-9  # times that differ by less are one instant [s]
SAME_VALUE = 1e-9  # relative difference of numbers that are the same but for their last digits
_ROUNDED = 1.5  # mean spacing of rows, in units of the last digit of their times, below which rounding makes repeats


@dataclass(frozen=True)
class Row:
    """One row. stamp: its time as written, in the file's unit; time [s]; values (len(MEASURED),), NaN as usual."""

    line: int
    stamp: float
    time: float
    values: Array


def merge_rows(run: str, content: dict[str, list[Row]], clock: Clock, problems: Problems) -> tuple[Array, Array]:
    """Return the instants (T,) of a run, increasing [s], and the values (T, n, len(MEASURED)) of its objects there.

    Rows of one object at the same instant are merged where no value contradicts another; contradictions are noted as
    errors that name the likely cause: rounded times, another run, a wrong row.
    """
    times = np.unique([row.time for rows in content.values() for row in rows])
    times = times[np.concatenate([[True], np.diff(times) > SAME_INSTANT])]
    values = np.full((len(times), len(content), len(MEASURED)), np.nan)
    for column, (name, rows) in enumerate(content.items()):
        taken: dict[int, int] = {}
        cure = ""
        for place, row in enumerate(rows):
            at = int(np.searchsorted(times, row.time + SAME_INSTANT, side="right")) - 1
            if at not in taken:
                taken[at], values[at, column] = row.line, row.values
                continue
            here, new = values[at, column], _same_sign(values[at, column], row.values)
            unequal = np.isfinite(here) & np.isfinite(new) & ~np.isclose(here, new, rtol=SAME_VALUE, atol=1e-15)
            if unequal.any():
                cure = cure or _repeat_cure(rows, place, clock)  # that of the first one, for all of them
                problems.add(
                    "repeated",
                    row.line,
                    f"run {run!r} has object {name!r} at {clock.header} = {row.stamp:.15g} in line {taken[at]} "
                    f"already, with another {MEASURED[int(np.argmax(unequal))]}",
                    cure,
                )
            values[at, column] = np.where(np.isfinite(here), here, new)
    return times, values


def _same_sign(known: Array, new: Array) -> Array:
    """Return the new values with the sign of their quaternion chosen nearest to the known one: both are one turn."""
    turn = slice(MEASURED.index(TURN[0]), MEASURED.index(TURN[-1]) + 1)
    if known[turn] @ new[turn] < 0.0:
        new = new.copy()
        new[turn] *= -1.0
    return new


def _repeat_cure(rows: Sequence[Row], place: int, clock: Clock) -> str:
    stamps = np.array([row.stamp for row in rows])
    digits = max(-int(Decimal(repr(float(s))).normalize().as_tuple().exponent) for s in stamps)
    last = 10.0**-digits
    spacing = float(np.ptp(stamps)) / max(len(stamps) - 1, 1)
    runs_on = bool(np.all(np.diff(stamps) >= 0.0))
    if runs_on and not clock.frames and 0.0 < spacing < _ROUNDED * last:
        return (
            f"times are rounded to {last * clock.factor:.3g} s and rows are {spacing * clock.factor:.3g} s apart: "
            "write times with more digits, or number the rows in a column frame and give seconds_per_frame"
        )
    if place and rows[place].stamp < rows[place - 1].stamp:
        return "the time starts again there: if another run begins, distinguish the runs by a column run"
    return "correct the time or delete one of the rows; several objects need a column object"
