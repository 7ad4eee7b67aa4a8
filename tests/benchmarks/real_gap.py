"""The gap on measurements that nobody here made: verdict, parameters against published values, held-out data.

    python -m tests.benchmarks.real_gap [--data DIR] [--json] [NAME...]

Cases: pooled drops of four balls, each ball's drops alone, stretches of a pendulum's swing, slides of CLEVRER objects
between collisions, flights of a tossed cube, and their heights alone. Every case is fitted on some runs and judged on
others that no step saw.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from polyworld.data.recording import Recording
from polyworld.estimation.unknown import Unknown
from polyworld.gap import GapSettings, find_gap
from polyworld.world import World
from tests import real_data

ANNOTATED = 1e-4  # [m] last digit of the CLEVRER annotations: what is taken for their accuracy


@dataclass(frozen=True)
class Measured:
    """Data on which a case is judged. base: unknowns that every hypothesis fits."""

    world: World
    recording: Recording
    held_out: Recording
    base: tuple[Unknown, ...] = ()


@dataclass(frozen=True)
class Case:
    """folder: of the data. published: what is known of it from elsewhere."""

    folder: str
    published: str
    read: Callable[[], Measured]


def drops(balls: Sequence[str] = tuple(real_data.BALLS)) -> Measured:
    """First drops of each ball; the second ones are held out."""
    world, recording = real_data.ball_drop(balls)
    first = tuple(r.name for r in recording.runs if r.name.endswith("-1"))
    second = tuple(r.name for r in recording.runs if r.name.endswith("-2"))
    return Measured(world, recording.select(first), recording.select(second))


def swings() -> Measured:
    """Large, middle and small swings of 1.2 s at 50 Hz; the held-out ones lie between them and after."""
    world, recording = real_data.pendulum_swings((1.0, 10.0, 24.0), 1.2, every=2)
    _, held_out = real_data.pendulum_swings((5.0, 17.0, 35.0), 1.2, every=2)
    return Measured(world, recording, held_out)


def slides() -> Measured:
    """Every third stretch between collisions in six scenes; every third other one is held out. Friction is fitted.

    Paths are right to one unit of their last digit: sliding cubes bend by as much, which no law of this world does.
    """
    numbers = ("00000", "02000", "03000", "04000", "05000", "06000")
    world, recording = real_data.clevrer_slides(numbers)
    names = [r.name for r in recording.runs]
    paths = ("objects.cube.friction", "objects.cylinder.friction")
    friction = Unknown("friction", paths, "1", 0.03, 0.0, 0.5, 0.01)
    recording = accurate_to(recording, ANNOTATED)
    return Measured(world, recording.select(tuple(names[::3])), recording.select(tuple(names[1::3])), (friction,))


def flights() -> Measured:
    """Twelve tosses of 150 up to the first touch; six others are held out."""
    world, recording = real_data.cube_flight(tuple(range(0, 60, 5)))
    _, held_out = real_data.cube_flight(tuple(range(2, 60, 10)))
    return Measured(world, recording, held_out)


def flown_heights() -> Measured:
    """Heights alone of the same flights, as accurate as forty more tosses say."""
    world, recording = real_data.cube_flight(tuple(range(0, 60, 5)))
    _, held_out = real_data.cube_flight(tuple(range(2, 60, 10)))
    _, others = real_data.cube_flight(tuple(range(60, 100)))
    accuracy = horizontal_accuracy(others)
    return Measured(world, accurate_to(heights(recording), accuracy), accurate_to(heights(held_out), accuracy))


def accurate_to(recording: Recording, sigma: float) -> Recording:
    """Return the same recording, which states the accuracy [m] of its positions."""
    return Recording(tuple(replace(run, sigma=sigma) for run in recording.runs))


def heights(recording: Recording) -> Recording:
    """Return the same recording, had nothing but z been measured."""
    runs = []
    for run in recording.runs:
        positions = run.positions.copy()
        positions[..., :2] = np.nan
        runs.append(replace(run, positions=positions, orientations=np.full_like(run.orientations, np.nan)))
    return Recording(tuple(runs))


def horizontal_accuracy(recording: Recording) -> float:
    """Return the RMS [m] of what the horizontal components of free flights, on which no force acts, are off
    straight lines. Errors of a capture are smooth, and larger than the scatter from one sample to the next."""
    squares, count = 0.0, 0
    for run in recording.runs:
        line = np.vander(run.times - run.times.mean(), 2)
        for axis in (0, 1):
            places = run.positions[:, 0, axis]
            off = places - line @ np.linalg.lstsq(line, places)[0]
            squares, count = squares + float(off @ off), count + len(places) - 2
    return float(np.sqrt(squares / count))


def _of_ball(ball: str) -> Callable[[], Measured]:
    return lambda: drops((ball,))


CASES: Mapping[str, Case] = {
    "balls": Case("ball_drop", "quadratic drag, C_d of 0.3 to 0.7 (spheres at these Reynolds numbers)", drops),
    **{
        f"ball_{ball}": Case("ball_drop", "too little to decide: ambiguous", _of_ball(ball)) for ball in real_data.BALLS
    },
    "pendulum": Case("pendulum", "damping: a rate of 0.055 1/s if viscous (the authors' model)", swings),
    "clevrer": Case("clevrer", "dv/dt = -0.04 v - 0.04 |v| v beside Coulomb friction of 0.0295", slides),
    "cube": Case("cube_toss", "flights bend sideways by 0.14 m/s^2, each its own way: unexplained", flights),
    "cube_heights": Case(
        "cube_toss",
        "free fall of 9.61 m/s^2: gravity, scale or clock, which flight alone cannot separate",
        flown_heights,
    ),
}


def judge(case: Case) -> dict[str, Any]:
    """Return the verdict on a case as plain data, with the seconds it took."""
    measured = case.read()
    began = time.perf_counter()
    report = find_gap(
        measured.world,
        measured.recording,
        held_out=measured.held_out,
        base=measured.base,
        settings=GapSettings(null_control=False),
    )
    summary = report.to_dict()
    kept = (
        *("verdict", "checks", "set_aside", "stability", "plain_laws", "remainder", "effects", "credible_set"),
        *("runner_up", "noise", "goodness", "sealed", "base", "residual_force"),
    )
    result = {key: summary[key] for key in kept}
    return result | {"published": case.published, "seconds": round(time.perf_counter() - began, 1)}


def table(results: Mapping[str, Mapping[str, Any]]) -> str:
    """Return one block of lines for each case."""
    lines = []
    for name, summary in results.items():
        held_out = summary["sealed"]
        lines.append(f"{name}: {summary['verdict']}, {summary['seconds']} s")
        lines.append(f"  published: {summary['published']}")
        for effect in summary["effects"]:
            label = f" ({effect['label']})" if effect["label"] else ""
            lines.append(f"  {effect['name']}{label}: {_numbers(effect['unknowns'])}")
        if summary["base"]["unknowns"]:
            lines.append(f"  base: {_numbers(summary['base']['unknowns'])}")
        lines.append(f"  credible: {'; '.join(' + '.join(names) for names in summary['credible_set']) or 'none'}")
        lines.append(f"  {summary['goodness']['summary']}")
        lines.append(f"  {summary['noise']['summary']}")
        if summary["residual_force"] is not None:
            lines.append(f"  residual force: {summary['residual_force'].get('expression')}")
        closed = "no gap" if held_out["closed"] is None else f"{100.0 * held_out['closed']:.0f}% closed"
        lines.append(
            f"  sealed: {held_out['gap_before']:.3g} -> {held_out['gap_after']:.3g} {held_out['unit']}, "
            f"noise {held_out['noise_floor']:.2g}: {closed}"
        )
    return "\n".join(lines)


def _numbers(unknowns: Mapping[str, Mapping[str, Any]]) -> str:
    return ", ".join(
        f"{name} = {u['value']:.4g} [{_end(u, 0)}, {_end(u, 1)}] {u['unit']}" for name, u in unknowns.items()
    )


def _end(unknown: Mapping[str, Any], side: int) -> str:
    interval = unknown["interval95"]
    return "?" if interval is None or interval[side] is None else f"{interval[side]:.4g}"


def main() -> None:
    """Judge the cases named, or all, and print what was found."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"cases, of {', '.join(CASES)}; default: all")
    parser.add_argument("--data", type=Path, default=real_data.FOLDER, help="folder of the data sets")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    chosen = parser.parse_args()
    wrong = sorted(set(chosen.names) - set(CASES))
    if wrong:
        parser.error(f"unknown cases {wrong}; choices: {list(CASES)}")
    real_data.FOLDER = chosen.data
    results: dict[str, dict[str, Any]] = {}
    for name in chosen.names or CASES:
        if not (chosen.data / CASES[name].folder).exists():
            print(f"{name}: skipped, {chosen.data / CASES[name].folder} is absent", file=sys.stderr)
            continue
        results[name] = judge(CASES[name])
        if not chosen.json:
            print(table({name: results[name]}), flush=True)
    if chosen.json:
        print(json.dumps(results, indent=1))


if __name__ == "__main__":
    main()
