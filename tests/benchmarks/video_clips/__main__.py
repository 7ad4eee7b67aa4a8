"""python -m tests.benchmarks.video_clips --out DIR [--seed N|os] [--count K] [--kind NAME ...] [--quiet]"""

import argparse
import os
import secrets
import time
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "egl")

import numpy as np

from .bodies import Rejected
from .kinds import KINDS
from .looks import STYLES
from .write import write_clip


def plan(seed: int, count: int, kinds: list[str]) -> list[tuple[str, str]]:
    """Return kind and leading style of each clip: kinds in turn, styles in shuffled full rounds."""
    rng = np.random.default_rng([seed, 7])
    styles: list[str] = []
    while len(styles) < count:
        styles.extend(str(s) for s in rng.permutation(STYLES))
    return [(kinds[i % len(kinds)], styles[i]) for i in range(count)]


def main() -> None:
    """Draw the clips asked for and write them under opaque names."""
    parser = argparse.ArgumentParser(prog="video_clips", description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", default="0", help="integer, or 'os' for one drawn from the operating system")
    parser.add_argument("--count", type=int, default=60, help="number of clips over all kinds")
    parser.add_argument("--kind", nargs="+", choices=list(KINDS), default=list(KINDS))
    parser.add_argument("--quiet", action="store_true", help="do not print kinds and names")
    args = parser.parse_args()
    seed = secrets.randbits(63) if args.seed == "os" else int(args.seed)
    todo = plan(seed, args.count, args.kind)
    numbers = np.random.default_rng([seed, 99]).permutation(9999)
    for i, (kind, style) in enumerate(todo):
        name, start = f"clip_{numbers[i]:04d}", time.monotonic()
        try:
            summary = write_clip(args.out, name, [seed, list(KINDS).index(kind), STYLES.index(style), i], kind, style)
        except Rejected as why:
            print(f"{i}: {why}", flush=True)
            continue
        if not args.quiet:
            wide, high = summary["size"]
            print(
                f"{i:3d} {name} {kind:9s} {style:16s} {wide}x{high} {summary['frames']:3d} frames "
                f"{time.monotonic() - start:5.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
