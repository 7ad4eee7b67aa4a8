"""Ropes, sheets, soft bodies and fluids with one number that is wrong: is the gap found, and called by its name?

    python -m tests.benchmarks.hidden_materials [--quick] [--json] [--only NAME] [--seed S]

Data come from SciPy or closed forms that share no code with the engine: a chain of point masses on springs (a rope, a
sheet that swings), a bar that rings along its length (a sheet, a soft block), a flat sheet that falls through air, a
box that fills, honey that sinks between plates, water that sways in a box. What generator and world share are the
scene's numbers and the laws of their material (springs that are linear in strain, Kelvin-Voigt damping, quadratic
drag), and in the chains also the number of links: a rope of ten straight links is what is given, and what is true.
What is observed are markers on the bodies, or the centre of a fluid, with video-like noise. Where a marker sits on its
body is known from a hundred frames before it is let go. The noise of fluids is above what their coarse grids err.

Runs last 0.2 to 2 s, of bodies of few nodes, so that all rows take some minutes; `--quick` takes one row with an effect
and one without of each kind of body.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np

from polyworld.executors import Executor, add_executor_argument, executor_from, print_progress, results
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import catalogue
from tests.scenes.fluids import filling_case, sinking_case, swaying_case
from tests.scenes.materials import Case, falling_case, rope_case, soft_case, strip_case, swinging_case

CASES: tuple[tuple[Callable[[np.random.Generator, str | None], Case], str | None], ...] = (
    (rope_case, None),
    (rope_case, "air_drag"),
    (rope_case, "stretch_stiffness"),
    (rope_case, "material_damping"),
    (rope_case, "bending_stiffness"),
    (soft_case, None),
    (soft_case, "stretch_stiffness"),
    (soft_case, "material_damping"),
    (strip_case, None),
    (strip_case, "stretch_stiffness"),
    (strip_case, "material_damping"),
    (falling_case, None),
    (falling_case, "air_drag"),
    (swinging_case, None),
    (swinging_case, "bending_stiffness"),
    (swinging_case, "air_drag"),
    (filling_case, None),
    (filling_case, "source_rate"),
    (sinking_case, None),
    (sinking_case, "viscosity"),
    (swaying_case, None),
    (swaying_case, "surface_tension"),
)

QUICK = (
    (rope_case, None),
    (rope_case, "bending_stiffness"),
    (soft_case, None),
    (soft_case, "material_damping"),
    (strip_case, "stretch_stiffness"),
    (falling_case, None),
    (filling_case, None),
    (sinking_case, "viscosity"),
)


def solved(case: Case, rng: np.random.Generator) -> dict[str, Any]:
    """Return the row of a case: its verdict, whether that is right, what it cost."""
    data, held_out = case.recordings(rng)
    offered = [catalogue()[n] for n in case.candidates]
    before, cpu = time.perf_counter(), time.process_time()
    settings = GapSettings(null_control=False, experiment=False)
    report = find_gap(case.world, data, held_out=held_out, candidates=offered, settings=settings)
    summary = report.to_dict()
    sets = [frozenset(names) for names in summary["credible_set"]]
    if case.truth is None:
        right = summary["verdict"] == "nothing_missing"
    else:
        right = summary["verdict"] in ("identified", "ambiguous") and any(s and s <= case.same for s in sets)
    return {
        "case": case.name,
        "code": case.code,
        "verdict": summary["verdict"],
        "credible_set": [sorted(s) for s in sets],
        "truth": case.truth,
        "value": case.value,
        "found": {k: [v["value"], *v["interval95"]] for e in summary["effects"] for k, v in e["unknowns"].items()},
        "right": right,
        "decisive_wrong": summary["verdict"] == "identified" and not right,
        "sealed": summary["sealed"],
        "seconds": time.perf_counter() - before,
        "cpu_seconds": time.process_time() - cpu,
    }


def row(seed: int, index: int) -> dict[str, Any]:
    """Return the row of one of `CASES`, drawn with a seed."""
    draw, truth = CASES[index]
    rng = np.random.default_rng([seed, index])
    found = solved(draw(rng, truth), rng)
    print(_line(found), file=sys.stderr, flush=True)
    return found


def rows(seed: int, chosen: Sequence[int], executor: Executor) -> list[dict[str, Any]]:
    """Return rows of some of `CASES`, several at a time, printed on the standard error as they come."""
    pieces = {str(index): index for index in chosen}
    return list(results(executor.map(partial(row, seed), pieces, progress=print_progress("rows"))).values())


def _line(row: dict[str, Any]) -> str:
    closed = row["sealed"]["closed"] if row["sealed"] else None
    credible = " | ".join("+".join(s) or "nothing" for s in row["credible_set"]) or "-"
    found = ", ".join(f"{k} {v[0]:.4g} [{v[1]:.4g}, {v[2]:.4g}]" for k, v in row["found"].items())
    numbers = f"{found}; true {row['value']:.4g}" if row["truth"] else found
    share = "-" if closed is None else f"{100 * closed:.0f}%"
    return (
        f"{'ok ' if row['right'] else 'NO '} {row['case']:<34} {row['verdict']:<16} {credible} ({numbers}) sealed gap "
        f"closed {share}, {row['seconds']:.0f} s, {row['cpu_seconds']:.0f} s CPU"
    )


def main() -> None:
    """Run the cases and print their rows."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--json", action="store_true")
    parser.add_argument("--quick", action="store_true", help="one row with an effect and one without of each kind")
    parser.add_argument("--only", default="", help="part of the name of a case")
    parser.add_argument("--seed", type=int, default=0)
    add_executor_argument(parser)
    parser.add_argument("--jobs", type=int, default=2, help="rows at a time")
    asked = parser.parse_args()
    named = [i for i, (d, t) in enumerate(CASES) if asked.only in f"{d.__name__} {t or 'nothing'}"]
    kept = [i for i in named if not asked.quick or CASES[i] in QUICK]
    with executor_from(asked.executor, asked.jobs) as executor:
        found = rows(asked.seed, kept, executor)
    if asked.json:
        print(json.dumps(found, indent=1))
    print(f"{sum(r['right'] for r in found)} of {len(found)} right", file=sys.stderr)


if __name__ == "__main__":
    main()
