"""A law as a straight-line program of numbers: what an expression becomes, and what the engine runs.

Row 0 of the register file to INPUTS - 1 hold what the law knows (see `INPUT_SLOTS`); every instruction writes one
register. Instructions are rows (operation, register written, a, b) of float64, a and b being registers, or a the
value itself for CONSTANT. The last row is (END, x, y, z): the registers of the acceleration's components.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

(END, CONSTANT, ADD, SUB, MUL, DIV, RATIO, POW, NEG, SIN, COS, EXP, LOG, SQRT, ABS, TANH, MIN, MAX, STEP) = range(19)

_NAMES = ["x", "y", "z", "vx", "vy", "vz", "omega_x", "omega_y", "omega_z", "gx", "gy", "gz"]
INPUT_SLOTS: dict[str, int] = {n: i for i, n in enumerate([*_NAMES, "t", "contact", "mass", "radius"])}
PARAMETER_SLOT = len(INPUT_SLOTS)  # of the first of eight
INPUTS = PARAMETER_SLOT + 8
REGISTERS = 64
MAX_INSTRUCTIONS = 256


@dataclass
class Builder:
    """Collects instructions; equal ones are kept once, so that a repeated term is computed once.

    Values are numbered as registers are, without bound; `finish` puts them into the registers there are.
    """

    _rows: list[tuple[int, float, float]] = field(default_factory=list)
    _seen: dict[tuple[int, float, float], int] = field(default_factory=dict)

    def emit(self, operation: int, a: float, b: float = 0.0) -> int:
        """Number of the value that the operation makes of the values a and b (of the number a for CONSTANT)."""
        key = (operation, float(a), float(b))
        if key not in self._seen:
            self._seen[key] = INPUTS + len(self._rows)
            self._rows.append(key)
        return self._seen[key]

    def finish(self, outputs: tuple[int, int, int]) -> Array:
        """The program (rows, 4) that leaves the acceleration in `outputs`; raises ValueError where it is too large."""
        live = self._needed(outputs)
        if len(live) + 1 > MAX_INSTRUCTIONS:
            raise ValueError(f"the expression takes {len(live)} operations; at most {MAX_INSTRUCTIONS - 1} are run")
        last = {value: row for row in live for value in self._read(row)}
        last |= dict.fromkeys(outputs, len(self._rows))
        place = {i: i for i in range(INPUTS)}
        free = list(range(REGISTERS - 1, INPUTS - 1, -1))
        program = []
        for row in live:
            operation, a, b = self._rows[row]
            read = [value for value in self._read(row)]
            operands = (a, 0.0) if operation == CONSTANT else (place[int(a)], place[int(b)])
            free += [place[v] for v in dict.fromkeys(read) if v >= INPUTS and last[v] == row]
            if not free:
                raise ValueError(
                    f"the expression keeps more than {REGISTERS - INPUTS} intermediate results at a time; simplify it"
                )
            place[INPUTS + row] = free.pop()
            program.append((operation, place[INPUTS + row], *operands))
        program.append((END, *(place[value] for value in outputs)))
        return np.array(program, dtype=float)

    def _read(self, row: int) -> tuple[int, ...]:
        """Values that a row reads. Of a function of one argument b is value 0, an input, which is always there."""
        operation, a, b = self._rows[row]
        return () if operation == CONSTANT else (int(a), int(b))

    def _needed(self, outputs: tuple[int, int, int]) -> list[int]:
        """Rows that the outputs depend on, in order."""
        needed: set[int] = set()
        waiting = [v - INPUTS for v in outputs if v >= INPUTS]
        while waiting:
            row = waiting.pop()
            if row not in needed:
                needed.add(row)
                waiting += [v - INPUTS for v in self._read(row) if v >= INPUTS]
        return sorted(needed)
