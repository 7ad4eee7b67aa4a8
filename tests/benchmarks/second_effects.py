"""Hidden effects drawn by a second, independent generator: `python -m tests.benchmarks.second_effects`.

The generator was written from a list of effects alone by someone who had read neither the first one nor the engine. Its
sections: one effect, nothing, pairs, walls and places at 1 and 3% noise, contaminated runs, near misses of a form,
discs. Options: [--cases DIR] judges a folder that was drawn before, else cases are drawn: [--count K] of each
section and style, [--seed S], [--section NAME ...], [--keep DIR]. [--seconds S]: limit of a case, [--executor WHERE],
[--jobs N]. Every verdict is written as it comes, and printed; [--json] prints outcomes and table.
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
import traceback
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from polyworld.executors import (
    Executor,
    FailedPiecesError,
    Failure,
    add_executor_argument,
    executor_from,
    print_progress,
)
from polyworld.gap import GapSettings, find_gap
from tests.benchmarks.second_generator.sections import SECTIONS
from tests.benchmarks.second_scene import read_case

NAMED = ("identified", "identified_with_remainder")
# An effect with three unknowns is seen with a probability of 0.95 from about this noncentrality on.
NEEDED = 80.0


def judge(folder: Path, seconds: float) -> dict[str, Any]:
    """Return the report on a case, or what went wrong, with the seconds it took."""
    world, recording, held_out = read_case(folder)
    settings = GapSettings(null_control=False, experiment=False, time_limit=seconds)
    begin, worked = time.perf_counter(), time.process_time()
    try:
        found = find_gap(world, recording, held_out=held_out, settings=settings).to_dict()
    except Exception:
        found = {
            "verdict": "crashed",
            "effects": [],
            "credible_set": [],
            "set_aside": [],
            "error": traceback.format_exc(),
        }
    found.pop("history", None)
    rows = sum(len(r.times) * len(r.names) for r in recording.runs)
    spent = {"seconds": time.perf_counter() - begin, "cpu_seconds": time.process_time() - worked}
    return found | spent | {"rows": rows, "runs": [r.name for r in recording.runs]}


def outcome(found: dict[str, Any], truth: dict[str, Any]) -> dict[str, Any]:
    """Score of a verdict against the truth."""
    wanted = _accepted(truth)
    names = sorted(e["name"] for e in found["effects"]) if found["verdict"] in NAMED else []
    credible = [sorted(c) for c in found["credible_set"]] if found["verdict"] == "ambiguous" else [names]
    bad = {f"r{b['run']}" for b in truth["detail"].get("bad_runs", [])}
    aside = {o["run"] for o in found["set_aside"]}
    nothing = not truth["effects"]
    return {
        "case": truth["case"],
        "section": truth["section"],
        "noise": truth["noise"]["noise_level"],
        "effects": truth["effects"],
        "verdict": found["verdict"],
        "names": names,
        "detectable": nothing or _noncentrality(truth, found["rows"]) >= NEEDED,
        "right": found["verdict"] == "nothing_missing" if nothing else names in wanted,
        "covers": found["verdict"] == "nothing_missing" if nothing else any(c in wanted for c in credible),
        "wrong": bool(names) and (nothing or names not in wanted),
        "bad_runs": len(bad),
        "bad_named": len(bad & aside),
        "good_runs": len(found["runs"]) - len(bad),
        "good_aside": len(aside - bad),
        "seconds": found["cpu_seconds"],
    }


def _noncentrality(truth: dict[str, Any], rows: int) -> float:
    """Noncentrality of the weakest effect hidden, beside whatever else is.

    Of samples with correlation phi from one to the next, (1 - phi) / (1 + phi) are worth an independent one each, for
    motions that are slow beside the correlation time.
    """
    tau = truth["noise"]["tau_samples"]
    phi = float(np.exp(-1.0 / tau)) if tau else 0.0
    each = [e["strength_in_sigma"] for e in truth["detail"].get("each", {}).values()]
    return float(min([truth["strength_in_sigma"], *each]) ** 2 * rows * (1.0 - phi) / (1.0 + phi))


def _accepted(truth: dict[str, Any]) -> list[list[str]]:
    """Return all sets of names that are right."""
    accepted = truth["accepted"]
    if isinstance(accepted, list):
        return [sorted(item.split("+")) for item in accepted]
    sets: list[list[str]] = [[]]
    for effect in truth["effects"]:
        sets = [[*s, name] for s in sets for name in (effect, *accepted.get(effect, ()))]
    return [sorted(set(s)) for s in sets]


def table(outcomes: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return one row for each section and noise level (0.3% or less, up to 2%, above)."""
    rows = []
    for section in SECTIONS:
        for level, low, high in (("0.1%", 0.0, 0.003), ("1%", 0.003, 0.02), ("3%", 0.02, 1.0)):
            own = [o for o in outcomes if o["section"] == section and low <= o["noise"] < high]
            seen = [o for o in own if o["detectable"]]
            if not own:
                continue
            times = sorted(o["seconds"] for o in own)
            bad, good = sum(o["bad_runs"] for o in own), sum(o["good_runs"] for o in own)
            rows.append(
                {
                    "section": section,
                    "noise": level,
                    "cases": len(own),
                    "detectable": len(seen),
                    "right": sum(o["right"] for o in seen),
                    "covers": sum(o["covers"] for o in seen),
                    "wrong": sum(o["wrong"] for o in own),
                    "bad_runs": f"{sum(o['bad_named'] for o in own)}/{bad}",
                    "good_aside": f"{sum(o['good_aside'] for o in own)}/{good}",
                    "seconds_9_in_10": round(times[int(0.9 * (len(times) - 1))], 1),
                }
            )
    return rows


def run(public: Path, private: Path, verdicts: Path, *, seconds: float, executor: Executor) -> list[dict[str, Any]]:
    """Judge every case of a folder, which workers must see, each verdict written as it comes; the outcomes."""
    verdicts.mkdir(parents=True, exist_ok=True)
    names = {p.name: p.name for p in sorted(public.iterdir())}
    outcomes, failures = [], []
    judged = partial(_kept, where=(public.resolve(), verdicts.resolve(), seconds))
    for name, found in executor.map(judged, names, progress=print_progress("cases")):
        if isinstance(found, Failure):
            failures.append(found)
            continue
        truth = json.loads((private / f"{name}.json").read_text())
        outcomes.append(outcome(found, truth))
        last = outcomes[-1]
        mark = "right" if last["right"] else "covers" if last["covers"] else "WRONG" if last["wrong"] else "missed"
        text = f"{name} {truth['section']} {' + '.join(truth['effects']) or 'nothing'}: {found['verdict']}"
        print(f"{text} {' + '.join(last['names'])} {mark} {last['seconds']:.0f} s", file=sys.stderr, flush=True)
    if failures:
        raise FailedPiecesError(failures)
    return outcomes


def _kept(name: str, where: tuple[Path, Path, float]) -> dict[str, Any]:
    public, verdicts, seconds = where
    file = verdicts / f"{name}.json"
    if not file.exists():
        file.write_text(json.dumps(judge(public / name, seconds)))
    found: dict[str, Any] = json.loads(file.read_text())
    return found


def main() -> None:
    """Run the benchmark."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--cases", type=Path, metavar="DIR", help="judge cases drawn before (public and private inside)"
    )
    parser.add_argument("--count", type=int, default=2, help="cases per section and style (default: %(default)s)")
    parser.add_argument("--section", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--seed", type=int, help="default: from the operating system")
    parser.add_argument("--seconds", type=float, default=120.0, help="time limit of a case (default: %(default)s)")
    add_executor_argument(parser)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--keep", type=Path, metavar="DIR", help="draw and judge in this new folder, and keep it")
    parser.add_argument("--json", action="store_true")
    chosen = parser.parse_args()
    seed = secrets.randbits(32) if chosen.seed is None else chosen.seed
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    with tempfile.TemporaryDirectory() as made:
        folder = chosen.cases or chosen.keep or Path(made)
        if chosen.cases is None:
            draw = [
                sys.executable,
                "-m",
                "tests.benchmarks.second_generator",
                "--out",
                str(folder),
                "--seed",
                str(seed),
            ]
            draw += ["--style", "both", "--quiet", "--count", str(chosen.count), "--section", *chosen.section]
            subprocess.run(draw, check=True, cwd=Path(__file__).parents[2])
        verdicts = (chosen.keep or Path(made)) / "verdicts"
        with executor_from(chosen.executor, chosen.jobs) as executor:
            outcomes = run(folder / "public", folder / "private", verdicts, seconds=chosen.seconds, executor=executor)
    rows = table(outcomes)
    if chosen.json:
        print(json.dumps({"seed": seed, "table": rows, "outcomes": outcomes}))
        return
    head = list(rows[0]) if rows else []
    print("\t".join(head))
    for row in rows:
        print("\t".join(str(row[k]) for k in head))
    print(f"seed {seed}")


if __name__ == "__main__":
    main()
