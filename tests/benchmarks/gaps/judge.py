"""Judge one case of a set: a module of its own, since a worker process imports what it runs by name."""

from __future__ import annotations

import time
import traceback
import warnings
from types import ModuleType
from typing import Any

from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import named
from tests.benchmarks.gaps import hidden, materials, one_ball, real, second, third
from tests.benchmarks.gaps.score import record

SETS: dict[str, ModuleType] = {
    m.__name__.rpartition(".")[2]: m for m in (real, one_ball, third, second, hidden, materials)
}
Piece = tuple[str, int, float | None, int, float]


def judged(piece: Piece) -> dict[str, Any]:
    """Return the record of one case: set, index, level of noise, seed, limit of time [s]."""
    of, index, level, seed, seconds = piece
    warnings.filterwarnings("ignore")
    case = SETS[of].drawn(index, level, seed)
    began, worked = time.perf_counter(), time.process_time()
    head = {"set": of, "case": f"{index}/{seed}", "asked": level}
    try:
        report = find_gap(
            case.world,
            case.recording,
            held_out=case.held_out,
            base=case.base,
            candidates=None if case.candidates is None else named(case.candidates),
            settings=GapSettings(time_limit=seconds),
        )
        found = record(case, report)
    except Exception:
        found = {"name": case.name, "level": level, "outcome": "crashed", "error": traceback.format_exc()}
    return head | found | {"seconds": time.perf_counter() - began, "cpu_seconds": time.process_time() - worked}
