"""A new effect is one new file: its law acts in worlds, stands in the catalogue, and is proposed where it is missing.

Laws are compiled into the solvers when the engine is first imported, so a process of its own imports it with a folder
more to find laws in.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

PAGE = Path(__file__).parents[3] / ".docs" / "pages" / "effects.md"
LAW = PAGE.read_text(encoding="utf-8").partition("```python\n")[2].partition("```")[0]

# The engine is imported as always, but for the folder more that laws are looked for in.
PROGRAM = """
import importlib.util, json, sys

engine = importlib.util.find_spec("polyworld")
sys.modules["polyworld"] = importlib.util.module_from_spec(engine)
laws = importlib.util.find_spec("polyworld.effects")
laws.submodule_search_locations.append(sys.argv[1])
sys.modules["polyworld.effects"] = importlib.util.module_from_spec(laws)
importlib.import_module("polyworld.core.warp_settings")
laws.loader.exec_module(sys.modules["polyworld.effects"])
engine.loader.exec_module(sys.modules["polyworld"])

import numpy as np
from polyworld.gap import find_gap
from polyworld.gap.catalogue import catalogue, named
from polyworld.data.recording import Recording, Run
from polyworld.world import World

MASS, PUSH, G, SIGMA = 0.5, 0.4, 9.81, 1e-3
world = World.model_validate({
    "objects": [{"name": "ball", "shape": {"kind": "sphere", "radius": 0.05}, "position": (0, 0, 3), "mass": MASS}],
    "time": {"substep": 0.004},
})
rng, t = np.random.default_rng(0), np.arange(80) / 100.0
runs = []
for k in range(5):
    start, speed = -0.3 - 0.1 * k, 1.5 + 0.3 * k
    late = np.maximum(t + start / speed, 0.0)  # since x = 0 was crossed
    path = np.stack([start + speed * t + 0.5 * PUSH / MASS * late**2, 0.2 * k * t, 3.0 - 0.5 * G * t**2], axis=1)
    seen = path + rng.normal(0.0, SIGMA, path.shape)
    runs.append(Run(f"run{k}", ("ball",), t, seen[:, None], np.full((80, 1, 4), np.nan)))
candidate = catalogue()["half_space_push"]
(variant,) = candidate.variants(world, Recording(tuple(runs)))
report = find_gap(
    world,
    Recording(tuple(runs)),
    candidates=named(["tilt", "linear_drag", "half_space_push"]),
).to_dict()
print(json.dumps({
    "group": candidate.group,
    "law": candidate.law,
    "plausible": variant.unknowns[0].plausible / MASS / G,
    "verdict": report["verdict"],
    "effects": [e["name"] for e in report["effects"]],
    "push": report["effects"][0]["unknowns"]["push"],
}))
"""


@pytest.mark.benchmark
def test_an_effect_that_is_one_new_file_is_proposed_where_it_is_missing(tmp_path: Path) -> None:
    (tmp_path / "half_space_push.py").write_text(LAW)
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM, str(tmp_path)], capture_output=True, text=True, timeout=600, check=False
    )
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert (found["group"], found["law"]) == ("force", "F_x = f where x > 0, else 0")
    assert abs(found["plausible"] - 1.0) < 1e-6  # a push as strong as the weight
    assert found["verdict"] == "identified"
    assert found["effects"] == ["half_space_push"]
    low, high = found["push"]["interval95"]
    assert low < 0.4 < high
    assert abs(found["push"]["value"] - 0.4) < 0.02
