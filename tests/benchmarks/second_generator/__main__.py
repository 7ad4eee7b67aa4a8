"""python -m second_generator --out DIR --seed N|os [--style a|b|both] [--section S ...] [--count K | S=K ...]"""

import argparse
import secrets
import time
from pathlib import Path

import numpy as np

from .cases import Plan, Rejected, build
from .sections import SECTIONS, plans
from .write import write_case


def main() -> None:
    """Draw the plans of the sections asked for and write their cases under opaque names."""
    parser = argparse.ArgumentParser(prog="second_generator", description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--seed", default="0", help="integer, or 'os' for one drawn from the operating system")
    parser.add_argument("--style", choices=["a", "b", "both"], default="a")
    parser.add_argument("--section", nargs="+", choices=SECTIONS, default=list(SECTIONS))
    parser.add_argument("--count", nargs="+", default=["6"], help="cases per section and style: K, or S=K ...")
    parser.add_argument("--quiet", action="store_true", help="do not print sections and names")
    args = parser.parse_args()
    seed = secrets.randbits(63) if args.seed == "os" else int(args.seed)
    counts = {s: next((int(c) for c in args.count if "=" not in c), 6) for s in SECTIONS}
    counts.update({c.split("=")[0]: int(c.split("=")[1]) for c in args.count if "=" in c})
    styles = ["a", "b"] if args.style == "both" else [args.style]
    todo: list[Plan] = []
    for style in styles:
        for section in args.section:
            rng = np.random.default_rng([seed, ord(style), SECTIONS.index(section)])
            todo.extend(plans(section, style, counts[section], rng))
    names = [f"case_{i:04d}" for i in np.random.default_rng([seed, 99]).permutation(9999)[: len(todo)]]
    for k, (plan, name) in enumerate(zip(todo, names, strict=True)):
        start = time.monotonic()
        for attempt in range(200):
            rng = np.random.default_rng([seed, ord(plan.style), SECTIONS.index(plan.section), k, attempt])
            if attempt % 25 == 24:  # this plan cannot be met: draw another of the same section
                plan = plans(plan.section, plan.style, 1, rng)[0]
            try:
                write_case(args.out, name, build(plan, rng), plan, rng)
                break
            except Rejected:
                continue
        else:
            print(f"{k}: no usable draw for {plan.section} {plan.rig}", flush=True)
        if not args.quiet:
            print(
                f"{k:3d} {name} {plan.section:17s} {plan.style} {plan.rig:9s} {time.monotonic() - start:5.1f} s",
                flush=True,
            )


if __name__ == "__main__":
    main()
