"""Verdicts of the gap against keys: real sets, the one-ball generator of the prototypes, and the third generator.

    python -m tests.benchmarks.law_selection [--real NAME...] [--one-ball NOISE] [--third NOISE --seeds 0-0]
        [--kinds ball ...] [--only EFFECTS...]

right: the key's laws and no others are named (nulls: nothing missing). honest: named among others, or not decided.
decisive: identified, with or without remainder, and wrong. All else is wrong without being decisive.
"""

from __future__ import annotations

import argparse
import time
import warnings
from collections import Counter

from polyworld.gap_new import GapReport, find_gap
from polyworld.gap_new.verdict import intervals
from tests.benchmarks.law_selection_cases import ALIKE, Keyed, one_ball, real
from tests.benchmarks.law_selection_third import KINDS, third


def judged(given: Keyed, report: GapReport) -> str:
    """Return right, honest, decisive or wrong."""
    v = report.verdict
    answers = [frozenset(ALIKE.get(n, n) for n in f.hypothesis.names) for f in (v.best, *v.competitors)]
    decided = v.kind in ("identified", "identified_with_remainder", "nothing_missing")
    if decided:
        part = v.kind == "identified_with_remainder" and any(answers[0] < r for r in given.right)
        right = answers[0] in given.right
        return "right" if right else "honest" if part else "wrong" if v.kind == "nothing_missing" else "decisive"
    if v.kind == "unexplained":
        return "honest" if given.right else "right"
    return "honest" if not given.right or any(a in given.right for a in answers) else "wrong"


def shown(given: Keyed) -> tuple[str, float]:
    """Run the gap, print its verdict, and return the judgement and the processor seconds."""
    began = time.process_time()
    report = find_gap(given.world, given.recording, held_out=given.held_out, base=given.base)
    seconds, v = time.process_time() - began, report.verdict
    found = judged(given, report)
    others = ["+".join(sorted(f.hypothesis.names)) or "-" for f in v.competitors]
    sealed = "" if report.sealed is None else f" sealed {report.sealed.before:.2f} -> {report.sealed.after:.2f}"
    print(f"{given.name}: {found}: {v.kind} {'+'.join(sorted(v.best.hypothesis.names)) or '-'} or {others},", end=" ")
    print(f"error {v.before:.2f} -> {v.after:.2f}{sealed}, stable {v.stable:.2f}, {seconds:.0f} s {v.reasons or ''}")
    for u, x, (low, high) in zip(v.best.hypothesis.unknowns, v.best.values, intervals(v.best), strict=True):
        print(f"    {u.name} {x:.4g} [{low:.4g}, {high:.4g}] {u.unit}")
    print(f"    set aside {[(a.run, a.since) for a in report.set_aside]} key {given.key}", flush=True)
    return found, seconds


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--real", nargs="*", default=[])
    parser.add_argument("--one-ball", type=float, help="noise over the range, 0.01 for 1%%")
    parser.add_argument("--third", type=float, help="noise in per cent of the range")
    parser.add_argument("--seeds", default="0-0")
    parser.add_argument("--kinds", nargs="*", default=list(KINDS), choices=KINDS, help="of the third generator")
    parser.add_argument("--only", nargs="*", default=[], help="effects joined by +, or numbers of cases")
    given = parser.parse_args()
    first, _, last = given.seeds.partition("-")
    found = [shown(real(name)) for name in given.real]
    if given.one_ball is not None:
        found += [shown(one) for one in one_ball(given.one_ball, given.only)]
    if given.third is not None:
        found += [
            shown(one) for one in third(given.third, range(int(first), int(last or first) + 1), given.kinds, given.only)
        ]
    count = Counter(f for f, _ in found)
    print(dict(count), f"of {len(found)}, {sum(s for _, s in found):.0f} s of processor")


if __name__ == "__main__":
    warnings.filterwarnings("ignore")
    main()
