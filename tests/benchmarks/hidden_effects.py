"""Hidden effects on a bouncing ball, and what the library makes of them: `python -m tests.benchmarks.hidden_effects`.

Options: [--quick] [--json] [--cases N] [--section NAME ...] [--effect NAME ...] [--executor WHERE] [--jobs N]
[--seed S] [--keep DIR].

Three processes that share files only: a generator that imports nothing of the project (SciPy and MuJoCo), a runner
that has workers call `find_gap` (here, or on a Dask cluster), and a scorer that alone reads the truths. Seeds come from
the operating system unless given, and are printed. Every failure is printed, then the table with bars and 95% Wilson
intervals.

Noise is a share of the path scale: the standard deviation of a coordinate about its run's mean, over all launches of
the base world (about 1 m); turns have the same share of a radian. An effect's strength is drawn so that, once every
launch's position and velocity are refitted in the base world, 2 to 10% of the path scale is left (log-uniform; the same
physics at all noise levels). --quick draws from all sections at random and begins no case after three minutes.
"""

from __future__ import annotations

import argparse
import json
import os
import secrets
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from polyworld.executors import add_executor_argument
from tests.benchmarks.hidden_cases import FULL, SECTIONS, Case
from tests.benchmarks.hidden_files import read_json, write_json
from tests.benchmarks.hidden_report import table, written

QUICK_CASES = 80
QUICK_SECONDS = 175.0
ROOT = Path(__file__).parents[2]


def chosen_cases(
    sections: list[str], effects: list[str] | None, count: int | None, quick: bool, seed: int
) -> list[Case]:
    """Return the cases to run, in random order; `count` of each section where given."""
    rng = np.random.default_rng(seed)
    listed: list[Case] = []
    for section in sections:
        cases = list(SECTIONS[section](FULL[section]))
        if effects:
            cases = [c for c in cases if set(effects) & set(c.effects)]
        keep = len(cases) if count is None else min(count, len(cases))
        if quick and count is None:
            keep = min(QUICK_CASES // len(sections), len(cases))
        order = rng.permutation(len(cases))[:keep]
        listed += [cases[i] for i in order]
    return [listed[i] for i in rng.permutation(len(listed))]


def run(
    cases: list[Case], *, seed: int, executor: str, jobs: int, until: float | None, folder: Path
) -> list[dict[str, object]]:
    """Generate, judge and score in separate processes; the outcomes."""
    begin = time.monotonic()
    public, private = folder / "public", folder / "private"
    public.mkdir(parents=True)
    private.mkdir()
    names = [c.name for c in cases]
    write_json(public / "order.json", names)
    write_json(folder / "cases.json", [c.to_dict() for c in cases])
    places = ["--public", str(public), "--private", str(private)]
    generate = [*_module("hidden_generate"), "--cases", str(folder / "cases.json"), "--seed", str(seed), *places]
    generator = subprocess.Popen(generate, cwd=ROOT, env=_one_thread())
    judge = [*_module("hidden_run"), "--public", str(public), "--executor", executor, "--jobs", str(jobs)]
    _judge(public, judge, until, generator)
    experiments = [n for n in names if (public / n / "verdict.json").exists() and n.startswith("poor_designs")]
    if experiments:
        made = subprocess.run([*generate, "--experiment"], cwd=ROOT, env=_one_thread(), check=False)
        if made.returncode:  # what was judged is scored all the same
            print(f"the experiments asked for could not be made (code {made.returncode})", file=sys.stderr)
        _judge(public, judge, None if until is None else until - (time.monotonic() - begin), None)
    scores = folder / "scores.json"
    subprocess.run([*_module("hidden_score"), *places, "--out", str(scores)], cwd=ROOT, check=True)
    outcomes: list[dict[str, object]] = read_json(scores)
    return outcomes


def _judge(public: Path, judge: list[str], until: float | None, generator: subprocess.Popen[bytes] | None) -> None:
    """Let the runner work through the cases, and notify it when the generator has ended."""
    limit = [] if until is None else ["--until", str(until)]
    runner = subprocess.Popen([*judge, *limit], cwd=ROOT, env=_one_thread())
    if generator is not None:
        while generator.poll() is None and runner.poll() is None:
            time.sleep(0.2)
        generator.terminate()
        generator.wait()
    (public / "complete").touch()
    if code := runner.wait():
        raise RuntimeError(f"the runner ended with code {code}")


def _module(name: str) -> list[str]:
    return [sys.executable, "-m", f"tests.benchmarks.{name}"]


def _one_thread() -> dict[str, str]:
    """One thread of linear algebra a process: the processes fill the machine."""
    return {**os.environ, "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--quick", action="store_true", help="a random sample in under five minutes")
    parser.add_argument("--json", action="store_true", help="outcomes and table as JSON")
    parser.add_argument("--cases", type=int, help="cases of each section, drawn at random")
    parser.add_argument("--section", action="append", choices=sorted(SECTIONS), help="default: all")
    parser.add_argument("--effect", action="append", help="only cases that hide one of these")
    add_executor_argument(parser)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, help="cases at a time")
    parser.add_argument("--seed", type=int, help="default: from the operating system")
    parser.add_argument("--keep", type=Path, help="keep all files in this new folder")
    chosen = parser.parse_args()
    seed = secrets.randbits(32) if chosen.seed is None else chosen.seed
    print(f"seed {seed}", file=sys.stderr)
    begin = time.monotonic()
    cases = chosen_cases(chosen.section or list(SECTIONS), chosen.effect, chosen.cases, chosen.quick, seed)
    until = QUICK_SECONDS if chosen.quick else None
    with tempfile.TemporaryDirectory() as made:
        folder = chosen.keep or Path(made) / "run"
        outcomes = run(cases, seed=seed, executor=chosen.executor, jobs=chosen.jobs, until=until, folder=folder)
    seconds = time.monotonic() - begin
    if chosen.json:
        rows = [row.to_dict() for row in table(outcomes)]
        payload = {"seed": seed, "seconds": seconds, "asked": len(cases), "table": rows, "outcomes": outcomes}
        print(json.dumps(payload))
        return
    print(written(outcomes))
    print(f"\nseed {seed}; {len(outcomes)} of {len(cases)} cases judged in {seconds:.0f} s")


if __name__ == "__main__":
    main()
