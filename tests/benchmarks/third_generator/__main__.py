"""python -m tests.benchmarks.third_generator --out DIR --seeds 0-4 [--noise 1]; without --noise: 0.1, 1 and 3 %."""

import argparse
import json
from pathlib import Path

import numpy as np

from tests.benchmarks.third_generator.generator import cases

parser = argparse.ArgumentParser(description=__doc__)
parser.add_argument("--out", type=Path, required=True)
parser.add_argument("--seeds", default="0")
parser.add_argument("--noise", type=float, nargs="+", default=[0.1, 1.0, 3.0])
given = parser.parse_args()
given.out.mkdir(parents=True, exist_ok=True)
first, _, last = given.seeds.partition("-")
for one in (case for s in range(int(first), int(last or first) + 1) for n in given.noise for case in cases(s, n)):
    np.savetxt(given.out / f"{one.name}.csv", one.data, "%.9g", ",", header=",".join(one.columns), comments="")
    for end, content in (("json", one.stated), ("key.json", one.key)):
        text = json.dumps(content, indent=1, default=lambda x: x.tolist()) + "\n"
        (given.out / f"{one.name}.{end}").write_text(text, encoding="utf-8")
