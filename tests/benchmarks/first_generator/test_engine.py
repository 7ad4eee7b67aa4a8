"""The engine against the generator of hidden motions, and that against closed forms: one physics, for every effect.

Where they disagreed, the benchmark would ask for the name of a law that the engine does not have.
"""

from __future__ import annotations

import ast
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from polyworld.solver.rollout import simulator
from polyworld.world import World
from tests.benchmarks.first_generator.cases import Case, Hidden, draw_hidden
from tests.benchmarks.first_generator.closed_form import base_positions, left_after_refit
from tests.benchmarks.first_generator.disc_cases import draw_discs
from tests.benchmarks.first_generator.generate import world_json
from tests.benchmarks.first_generator.laws import EFFECTS
from tests.benchmarks.first_generator.strength import flights, hidden_world
from tests.scenes.ball import Ball, Launch, UnusableCase, fly
from tests.scenes.discs import slide

# Effects whose law the engine keeps under another name, or in the base world's own numbers.
KINDS = {"tilt": "uniform_acceleration"}
EXACT = 1e-3  # [m]; the engine steps by 2 ms, the generator from event to event
TIMES = np.arange(193) / 120.0
BASE = {"radius": 0.1, "friction": 0.3, "restitution": 0.8, "gravity": 9.81}
FINE = 5e-4  # [s]: a collision that comes a hair later sends discs elsewhere


def true_world(hidden: Hidden) -> dict[str, Any]:
    """Return the base world with the true effect in it, as the engine describes it."""
    document = world_json(hidden)
    (effect,) = hidden.effects
    name, numbers, ball = effect.drawn.name, dict(effect.numbers), document["objects"][0]
    if name == "gravity_error":
        document["environment"]["gravity"][2] = numbers["gravity_z"]
    elif name in ("restitution_error", "friction_error"):
        field = name.removesuffix("_error")
        ball[field] = numbers[field]
    elif name == "rolling_resistance":
        ball["rolling_resistance"] = numbers["rolling_resistance"]
    elif name == "hidden_wall":
        place = effect.drawn.place
        assert place is not None
        shape = {"kind": "plane", "normal": [place["normal_x"], place["normal_y"], 0.0], "offset": place["offset"]}
        document["statics"].append({"name": "wall", "shape": shape})
    else:
        document["effects"] = [{"name": name, "kind": KINDS.get(name, name), "parameters": numbers}]
    return document


@pytest.mark.parametrize("name", [n for n in EFFECTS if not n.startswith("observer") and n != "dropped_frames"])
def test_engine_moves_as_the_generator_does(name: str) -> None:
    hidden = draw_hidden(Case("one_effect", 0, 1, (name,), 0.01, design=EFFECTS[name][1][0]), 5)
    if name == "periodic_forcing":
        pytest.skip("its phase and direction are not given")
    document = true_world(hidden)
    ball, fault = hidden_world(hidden.design.ball, hidden.effects)
    runs = (1, 2)
    try:
        motions = flights(hidden.design, ball, fault, runs)
    except UnusableCase:
        pytest.skip("lifted off")
    worst = []
    for k, motion in zip(runs, motions, strict=True):
        launch = hidden.design.launches[k]
        start = {"position": launch.position, "velocity": launch.velocity, "angular_velocity": launch.spin}
        world = World.model_validate(document | {"objects": [document["objects"][0] | start]})
        moved = simulator(world, hidden.design.stamps).run().positions[0, :, 0]
        worst.append(float(np.linalg.norm(moved - motion.positions, axis=1).max()))
    assert max(worst) < EXACT, worst


DISC_LAWS = [
    "",
    "tilt",
    "linear_drag",
    "quadratic_drag",
    "coriolis",
    "friction_error",
    "restitution_error",
    "mass_error",
    "friction_patch",
    "spring",
]


@pytest.mark.parametrize("name", DISC_LAWS)
def test_engine_moves_colliding_discs_as_the_generator_does(name: str) -> None:
    drawn = draw_discs(Case("bodies", 0, 2, (name,) if name else (), 0.01, design="discs", runs=1, bodies=3), 7)
    scene, document = drawn.scene, drawn.world_json()
    discs = scene.discs if drawn.effect is None else drawn.effect.apply(scene.discs, drawn.strength)
    for i, item in enumerate(document["objects"]):
        item |= {"mass": discs.masses[i], "friction": discs.frictions[i], "restitution": discs.restitution}
    if drawn.effect is not None and not name.endswith("_error"):
        numbers = drawn.effect.true_values(drawn.strength)
        document["effects"] = [{"name": name, "kind": KINDS.get(name, name), "parameters": numbers}]
    document["time"]["substep"] = FINE
    for start in scene.starts:
        for i, item in enumerate(document["objects"]):
            item["position"] = [*start.positions[i], 0.0]
            item["velocity"] = [*start.velocities[i], 0.0]
            item["angular_velocity"] = [0.0, 0.0, start.spins[i]]
        moved = simulator(World.model_validate(document), scene.stamps).run().positions[0]
        path = slide(discs, start, scene.stamps)
        np.testing.assert_allclose(moved[..., :2], path[..., :2], atol=EXACT)


@pytest.mark.parametrize("seed", range(4))
def test_base_world_moves_as_its_closed_form(seed: int) -> None:
    rng = np.random.default_rng(seed)
    spin = rng.normal(0.0, 15.0, 3)
    launch = Launch((0.0, 0.0, rng.uniform(0.1, 1.5)), tuple(rng.normal(0.0, 2.0, 3)), tuple(spin))
    np.testing.assert_allclose(fly(Ball(), launch, TIMES).positions, base_positions(launch, TIMES, **BASE), atol=1e-6)


def test_gravity_error_of_free_flight_alone_is_left_as_a_parabola_less_its_line() -> None:
    launch = Launch((0.0, 0.0, 30.0), (2.0, 0.0, 1.0))
    seen = base_positions(launch, TIMES, **(BASE | {"gravity": 9.91}))
    t = TIMES / TIMES[-1]
    line = np.polyval(np.polyfit(t, t**2, 1), t)
    left = 0.05 * TIMES[-1] ** 2 * (t**2 - line)
    assert left_after_refit(seen, launch, TIMES, **BASE) == pytest.approx(np.mean(left**2) / 3.0, rel=1e-6)


def imported(source: Path) -> set[str]:
    """Modules that a source file imports."""
    nodes = list(ast.walk(ast.parse(source.read_text())))
    names = {a.name for n in nodes if isinstance(n, ast.Import) for a in n.names}
    return names | {n.module for n in nodes if isinstance(n, ast.ImportFrom) and n.module}


def test_generator_imports_nothing_of_the_project() -> None:
    root = Path(__file__).parents[3]
    waiting = ["tests.benchmarks.first_generator.generate", "tests.benchmarks.first_generator.disc_cases"]
    seen: set[str] = set()
    while waiting:
        module = waiting.pop()
        names = imported(root / f"{module.replace('.', '/')}.py")
        tops = {n.split(".")[0] for n in names}
        assert not tops & {"polyworld", "atw_mcp", "evidence_store", "prompts", "warp"}, module
        seen.add(module)
        own = {n for n in names if n.startswith("tests.")}
        waiting += sorted(own - seen - set(waiting))
    assert "tests.scenes.ball" in seen
