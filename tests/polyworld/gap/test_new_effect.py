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

LAW = '''
"""A push along x in one half of space: nothing for x < 0, constant beyond."""

import warp as wp

from polyworld.effects.absence import Absence, Way, strength
from polyworld.effects.conditions import Conditions
from polyworld.effects.law import EffectLaw, EffectParameter, Motion, Vec8, wrench


@wp.func
def force(p: Vec8, b: Motion) -> wp.spatial_vectord:
    if b.x[0] < wp.float64(0.0):
        return wp.spatial_vectord()
    return wrench(wp.vec3d(p[0], wp.float64(0.0), wp.float64(0.0)), wp.vec3d())


LAW = EffectLaw(
    kind="half_space_push",
    summary="F_x = f where x > 0, else 0",
    parameters={"push": EffectParameter("N", -1e3, 1e3, (-1.0, 1.0), 0.0, "force beyond x = 0")},
    force=force,
    reference="made up",
    work=None,
)


def ways(found: Conditions) -> list[Way]:
    return [Way({"push": strength(found.force, found.weight)})] if 0 in found.axes else []


ABSENCE = Absence(
    ways,
    signature="residual along x that sets in at x = 0",
)
'''

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
