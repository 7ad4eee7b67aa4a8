"""python -m tests.benchmarks.blender_clips OUT [--count K] [--seed N|os] [--kind NAME ...] [--threads N] [--quiet]

Films the other generator's physics with Blender's path tracer. Needs the dependency group bench-blender (Python 3.11).
"""

import argparse
import secrets
import sys
import time
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from tests.benchmarks.video_clips.bodies import Rejected
from tests.benchmarks.video_clips.kinds import KINDS

from .setting import STYLES

ABSENT = (
    "Blender's Python module bpy is not installed. It has wheels for Python 3.11 only: "
    "uv sync --python 3.11 --group bench-blender, or pip install --no-deps bpy==5.0.1"
)


PUSHED = ("floor", "billiard", "tossed", "cart")  # kinds with a body that a hand may have pushed


def plan(seed: int, count: int, kinds: list[str]) -> list[tuple[str, str]]:
    """Return kind and leading style of each clip: both in shuffled full rounds, the hand where something is pushed."""
    rng = np.random.default_rng([seed, 11])
    todo: tuple[list[str], list[str]] = ([], [])
    for names, out in zip((kinds, list(STYLES)), todo, strict=True):
        while len(out) < count:
            out.extend(str(s) for s in rng.permutation(names))
    pairs = list(zip(todo[0][:count], todo[1][:count], strict=True))
    for i, (kind, style) in enumerate(pairs):
        if style == "hand" and kind not in PUSHED:
            for j, (other, theirs) in enumerate(pairs):
                if other in PUSHED and theirs != "hand":
                    pairs[i], pairs[j] = (kind, theirs), (other, style)
                    break
    return pairs


def main() -> None:
    """Draw the clips asked for and write them under opaque names."""
    parser = argparse.ArgumentParser(
        prog="blender_clips", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--count", type=int, default=12, help="number of clips over all kinds")
    parser.add_argument("--seed", default="0", help="integer, or 'os' for one drawn from the operating system")
    parser.add_argument("--kind", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--quiet", action="store_true", help="do not print kinds and names")
    args = parser.parse_args()
    if find_spec("bpy") is None:
        sys.exit(ABSENT)
    from .write import write_clip  # imports bpy

    seed = secrets.randbits(63) if args.seed == "os" else int(args.seed)
    numbers = np.random.default_rng([seed, 99]).permutation(9999)
    for i, (kind, style) in enumerate(plan(seed, args.count, args.kind)):
        name, start = f"clip_{numbers[i]:04d}", time.monotonic()
        seeds = [seed, list(KINDS).index(kind), STYLES.index(style), i]
        try:
            summary = write_clip(args.out, name, seeds, kind, style, args.threads)
        except Rejected as why:
            print(f"{i}: {why}", flush=True)
            continue
        if not args.quiet:
            wide, high = summary["size"]
            print(
                f"{i:3d} {name} {kind:9s} {style:14s} {wide}x{high} {summary['frames']:3d} frames "
                f"{summary['edits']:2d} edits {summary['questions']:2d} questions {time.monotonic() - start:5.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
