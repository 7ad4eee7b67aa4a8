"""Verdicts of the gap on data with known answers: `python -m tests.benchmarks.gaps SET [SET ...]`.

Sets: real (15 sets that nobody here made), one_ball, third, second, hidden (four generators that share no code with the
engine, the second and third written by others), materials (ropes, sheets, soft bodies, fluids). Every verdict is
written as it comes, one JSON object a line, with what explains it where it is not right; the counts are printed at the
end. `score` says what the outcomes mean.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path

import numpy as np

from polyworld.executors import Failure, add_executor_argument, executor_from
from tests.benchmarks.gaps.judge import SETS, Piece, judged
from tests.benchmarks.gaps.score import table

FIXED = ("real", "materials")  # sets with the noise that they have
LEVELS = (0.001, 0.01, 0.03)


def pieces(args: argparse.Namespace) -> dict[str, Piece]:
    """Return the cases asked for; of each set, level and seed `count`, spread over its list."""
    found: dict[str, Piece] = {}
    for of in args.sets:
        names = SETS[of].listed()
        kept = [i for i, name in enumerate(names) if not args.only or any(o in name for o in args.only)]
        kept = kept[args.skip :]
        if args.count is not None and args.count < len(kept):
            kept = [kept[i] for i in np.linspace(0, len(kept) - 1, args.count).round().astype(int)]
        for seed in (0,) if of == "real" else args.seeds:
            for level in (None,) if of in FIXED else args.levels:
                found |= {f"{of} {level} {seed} {i}": (of, i, level, seed, args.seconds) for i in kept}
    return found


def main() -> None:
    """Judge cases, write a record of each, print the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", nargs="+", choices=SETS, metavar="SET", help=", ".join(SETS))
    parser.add_argument("--levels", type=float, nargs="+", default=LEVELS, help="noise over the range of motion")
    parser.add_argument("--seeds", type=int, nargs="+", default=[0])
    parser.add_argument("--count", type=int, help="cases of a set, level and seed (default: all)")
    parser.add_argument("--skip", type=int, default=0, help="cases at the beginning of each list")
    parser.add_argument("--only", nargs="+", help="parts of the names of cases")
    parser.add_argument("--seconds", type=float, default=120.0, help="time limit of a case (default: %(default)s)")
    parser.add_argument("--out", type=Path, help="file to which records are added; those in it are not judged again")
    add_executor_argument(parser)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    args = parser.parse_args()
    os.environ |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    rows = [json.loads(x) for x in args.out.read_text().splitlines()] if args.out and args.out.exists() else []
    known = {(r["set"], r["case"], r["asked"]) for r in rows}
    asked = {k: p for k, p in pieces(args).items() if (p[0], f"{p[1]}/{p[3]}", p[2]) not in known}
    with executor_from(args.executor, args.jobs) as executor:
        for key, row in executor.run(judged, asked):
            if isinstance(row, Failure):
                print(f"{key}: not drawn: {row.error}", file=sys.stderr, flush=True)
                continue
            rows.append(row)
            if args.out:
                with args.out.open("a") as file:
                    file.write(json.dumps(row) + "\n")
            text = f"{key} {row['name']}: {row['outcome']}: {row.get('verdict')} {row.get('named')}"
            print(f"{text} {row['seconds']:.0f} s", file=sys.stderr, flush=True)
    lines = table(rows)
    print("\n".join("\t".join(str(x) for x in line) for line in (list(lines[0]), *(r.values() for r in lines))))


if __name__ == "__main__":
    main()
