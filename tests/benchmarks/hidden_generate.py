"""The generator: hidden motions into files. It imports nothing of the project it examines.

`python -m tests.benchmarks.hidden_generate --cases CASES.json --seed S --public DIR --private DIR` writes the cases;
with `--experiment`, for cases whose verdict proposes one, the proposed run, made with the hidden laws, is appended as
`more.csv` in the public folder.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tests.benchmarks.hidden_cases import ON_PLANE, Case, Hidden, draw_hidden
from tests.benchmarks.hidden_design import GRAVITY, RESTITUTION
from tests.benchmarks.hidden_disc_cases import draw_discs
from tests.benchmarks.hidden_files import read_json, write_json, write_runs
from tests.benchmarks.hidden_observer import Fault, noisy
from tests.benchmarks.hidden_outside import OUTSIDE
from tests.benchmarks.hidden_strength import flights, hidden_world
from tests.scenes.ball import Launch, UnusableCase
from tests.scenes.ball import Path as Motion


def world_json(hidden: Hidden) -> dict[str, Any]:
    """Return the base world, given to the solver. The ball starts as the first launch does, as far as frames show."""
    ball, first = hidden.design.ball, hidden.design.launches[0]
    return {
        "objects": [
            {
                "name": "ball",
                "shape": {"kind": "sphere", "radius": ball.radius},
                "mass": ball.mass,
                "friction": ball.friction,
                "restitution": RESTITUTION,
                "position": [round(v, 2) for v in first.position],
                "velocity": [0.0, 0.0, 0.0],
            }
        ],
        "statics": [{"name": "floor", "shape": {"kind": "plane"}}],
        "environment": {"gravity": [0.0, 0.0, -GRAVITY]},
        "time": {"seconds_per_frame": float(hidden.design.stamps[1]), "substep": 0.002},
    }


def truth_json(hidden: Hidden, seed: int, sigma: float) -> dict[str, Any]:
    """Return what the scorer needs."""
    return {
        "case": hidden.case.to_dict(),
        "seed": seed,
        "effects": [
            {
                "name": e.drawn.name,
                "size": e.size,
                "numbers": e.numbers,
                "place": e.drawn.place,
                "form": OUTSIDE[e.drawn.name][1].to_dict() if e.drawn.name in OUTSIDE else None,
            }
            for e in hidden.effects
        ],
        "path_scale": hidden.design.path_scale,
        "sigma": sigma,
    }


def observed_runs(hidden: Hidden, rng: np.random.Generator, runs: Sequence[int]) -> list[tuple[str, Any, Any, Any]]:
    """Noisy runs as the hidden world's observer sees them."""
    ball, fault = hidden_world(hidden.design.ball, hidden.effects)
    motions = flights(hidden.design, ball, fault, runs)
    return [_observed(hidden, f"run{k}", motion, fault, rng) for k, motion in zip(runs, motions, strict=True)]


def _observed(
    hidden: Hidden, name: str, motion: Motion, fault: Fault, rng: np.random.Generator
) -> tuple[str, Any, Any, Any]:
    case = hidden.case
    places, turns = fault.seen(motion.positions[:, None], motion.orientations[:, None])
    sigma = case.noise * hidden.design.path_scale
    seen, turned, keep = noisy(places, turns, rng, sigma=sigma, angle=case.noise, kind=case.kind)
    return name, hidden.design.stamps[keep], seen[keep], turned[keep]


def generate(case: Case, seed: int, public: Path, private: Path) -> None:
    """Write one case."""
    rng = np.random.default_rng([seed, 1, *(ord(c) for c in case.name)])
    if case.section in ON_PLANE:
        discs = draw_discs(case, seed)
        names, world, truth = discs.names, discs.world_json(), discs.truth_json(seed)
        data = discs.runs(rng, range(case.runs))
        held_out = discs.runs(rng, range(case.runs, len(discs.scene.starts)))
    else:
        hidden = draw_hidden(case, seed)
        names, world = ["ball"], world_json(hidden)
        truth = truth_json(hidden, seed, case.noise * hidden.design.path_scale)
        data = observed_runs(hidden, rng, range(hidden.design.fitted))
        held_out = observed_runs(hidden, rng, range(hidden.design.fitted, len(hidden.design.launches)))
    public.mkdir(parents=True, exist_ok=True)
    private.mkdir(parents=True, exist_ok=True)
    write_runs(public / "sealed.csv", names, held_out)
    write_runs(public / "data.csv", names, data)
    write_json(private / "truth.json", truth)
    write_json(public / "world.json", world)  # the last: its presence shows the runner that the case is whole


def run_experiment(case: Case, seed: int, public: Path, asked: dict[str, Any]) -> None:
    """Make the run that a verdict asks for, with the hidden laws, and write it to `more.csv`.

    The ball is put where asked; on or above the floor, since it can be nowhere else.
    """
    hidden = draw_hidden(case, seed)
    x, y, z = (float(v) for v in asked["position"])
    vx, vy, vz = (float(v) for v in asked["velocity"])
    wx, wy, wz = (float(v) for v in asked.get("angular_velocity") or (0.0, 0.0, 0.0))
    radius = hidden.design.ball.radius
    start = Launch((x, y, max(z, radius + 1e-6)), (vx, vy, vz), (wx, wy, wz))
    interval = float(asked.get("interval") or hidden.design.stamps[1])
    duration = float(asked.get("duration") or hidden.design.stamps[-1])
    stamps = np.arange(round(min(duration, 10.0) / interval) + 1) * interval
    design = replace(hidden.design, launches=(start,), stamps=stamps, fitted=1)
    ball, fault = hidden_world(hidden.design.ball, hidden.effects)
    fault = replace(fault, lost=0)
    rng = np.random.default_rng([seed, 2, *(ord(c) for c in case.name)])
    (motion,) = flights(design, ball, fault, [0])
    places, turns = fault.seen(motion.positions[:, None], motion.orientations[:, None])
    sigma = case.noise * hidden.design.path_scale
    seen, turned, keep = noisy(places, turns, rng, sigma=sigma, angle=case.noise, kind=case.kind)
    write_runs(public / "more.csv", ["ball"], [("experiment", stamps[keep], seen[keep], turned[keep])])


def main() -> None:
    """Write all cases of a list, in its order; what cannot be drawn is printed and left out."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=Path, required=True, help="JSON list of cases")
    parser.add_argument("--seed", type=int, required=True)
    parser.add_argument("--public", type=Path, required=True)
    parser.add_argument("--private", type=Path, required=True)
    parser.add_argument("--experiment", action="store_true")
    chosen = parser.parse_args()
    for listed in read_json(chosen.cases):
        case = Case(**(listed | {"effects": tuple(listed["effects"])}))
        public, private = chosen.public / case.name, chosen.private / case.name
        try:
            if not chosen.experiment:
                generate(case, chosen.seed, public, private)
                continue
            if case.section in ON_PLANE or not (public / "verdict.json").exists():
                continue  # experiments are for one ball
            asked = read_json(public / "verdict.json").get("experiment")
            if asked and not (public / "more.csv").exists():
                run_experiment(case, chosen.seed, public, asked)
        except UnusableCase as reason:
            print(f"left out: {case.name}: {reason}", file=sys.stderr)


if __name__ == "__main__":
    main()
