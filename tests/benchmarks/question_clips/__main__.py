"""Draw scenes with questions: `python -m tests.benchmarks.question_clips --out DIR [--solids A-B] [--pulleys A-B]`.

A scene depends on its seed alone. What is there already is kept, so that a run that was stopped goes on.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from .write_pulleys import make_pulleys
from .write_solids import make_all


def seeds(text: str) -> list[int]:
    """Read "3", "0-4" or "0-4,9" as numbers, ends included; "" is none."""
    found: list[int] = []
    for part in filter(None, text.split(",")):
        first, _, last = part.partition("-")
        found += range(int(first), int(last or first) + 1)
    return found


def main() -> None:
    """Draw the scenes."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True, metavar="DIR")
    parser.add_argument("--solids", default="", metavar="A-B", help="seeds of scenes of CLEVRER's kind")
    parser.add_argument("--pulleys", default="", metavar="A-B", help="seeds of rope and pulley scenes")
    chosen = parser.parse_args()
    if chosen.solids:
        make_all(seeds(chosen.solids), chosen.out)
    for seed in seeds(chosen.pulleys):
        make_pulleys(seed, chosen.out)


if __name__ == "__main__":
    main()
