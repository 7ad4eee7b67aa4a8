"""Effects of kind expression: what worlds take, how they move, held against motion that SciPy integrated."""

from types import SimpleNamespace

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from polyworld.edits.interventions import ToggleEffect, branch
from polyworld.solver.rollout import simulator
from polyworld.world import World
from polyworld.world.parameters import parameter_paths, read_parameter, with_parameters

TIMES = np.linspace(0.0, 1.0, 11)
SPIN = np.array([5.0, -20.0, 30.0])
G = np.array([0.0, 0.0, -9.81])


def law(expression, **parameters):
    """An effect from an expression and its parameters as (value, unit)."""
    return {
        "name": "law",
        "kind": "expression",
        "expression": expression,
        "parameters": {n: v for n, (v, _) in parameters.items()},
        "parameter_units": {n: u for n, (_, u) in parameters.items() if u != "1"},
    }


def ball_world(effect, **changes):
    ball = {
        "name": "ball",
        "shape": {"kind": "sphere", "radius": 0.05},
        "mass": 0.2,
        "position": [0.1, -0.2, 1.0],
        "velocity": [4.0, 1.0, 5.0],
        "angular_velocity": SPIN.tolist(),
    }
    return World.model_validate({"objects": [ball], "effects": [effect], "time": {"substep": 0.002}, **changes})


def integrated(acceleration, x, v):
    """Positions (T, 3) under an acceleration, a function of t, x and v, by SciPy."""
    solution = solve_ivp(
        lambda t, y: np.concatenate([y[3:], acceleration(SimpleNamespace(t=t, x=y[:3], v=y[3:]))]),
        (0.0, TIMES[-1]),
        np.concatenate([x, v]),
        t_eval=TIMES,
        rtol=1e-10,
        atol=1e-12,
    )
    return solution.y[:3].T


LAWS = {
    "speed to a power": (
        law("-k*(speed/1[m/s])^p*unit(v)", k=(0.3, "m/s^2"), p=(1.5, "1")),
        lambda s: -0.3 * np.linalg.norm(s.v) ** 0.5 * s.v,
    ),
    "position": (
        law({"x": "-k*x.x*x.z", "z": "c*x.y^2"}, k=(2.0, "1/(m s^2)"), c=(1.5, "1/(m s^2)")),
        lambda s: np.array([-2.0 * s.x[0] * s.x[2], 0.0, 1.5 * s.x[1] ** 2]),
    ),
    "time": (
        law("a*exp(-t/tau)*ex + b*sin(6.283185307179586*f*t)*ey", a=(3.0, "m/s^2"), tau=(0.4, "s"), b=(2.0, "m/s^2"))
        | {"parameters": {"a": 3.0, "tau": 0.4, "b": 2.0, "f": 1.5}}
        | {"parameter_units": {"a": "m/s^2", "tau": "s", "b": "m/s^2", "f": "Hz"}},
        lambda s: np.array([3.0 * np.exp(-s.t / 0.4), 2.0 * np.sin(2 * np.pi * 1.5 * s.t), 0.0]),
    ),
    "spin across velocity": (
        law("s*cross(omega, v) - k*spin*v", s=(0.02, "1"), k=(0.005, "1")),
        lambda s: 0.02 * np.cross(SPIN, s.v) - 0.005 * np.linalg.norm(SPIN) * s.v,
    ),
    "force over mass": (law("-c*v/mass + 0.1*g", c=(0.1, "kg/s")), lambda s: -0.5 * s.v + 0.1 * G),
}


@pytest.mark.parametrize("name", LAWS)
def test_ball_moves_as_scipy_integrates_the_expression(name):
    effect, acceleration = LAWS[name]
    world = ball_world(effect)
    ball = world.objects[0]
    found = simulator(world, TIMES).run().positions[0, :, 0]
    expected = integrated(lambda s: G + acceleration(s), np.array(ball.position), np.array(ball.velocity))
    np.testing.assert_allclose(found, expected, atol=3e-5)


@pytest.mark.parametrize("name", ["speed to a power", "time"])
def test_disc_moves_as_scipy_integrates_the_expression(name):
    effect, acceleration = LAWS[name]
    disc = {
        "name": "disc",
        "representation": "rigid_planar",
        "shape": {"kind": "cylinder", "radius": 0.05, "half_height": 0.01},
        "friction": 0.0,
        "position": [0.0, 0.0, 0.0],
        "velocity": [2.0, 1.0, 0.0],
    }
    world = World.model_validate({"objects": [disc], "effects": [effect], "time": {"substep": 0.002}})
    found = simulator(world, TIMES).run().positions[0, :, 0]
    expected = integrated(acceleration, np.zeros(3), np.array([2.0, 1.0, 0.0]))
    np.testing.assert_allclose(found[:, :2], expected[:, :2], atol=3e-5)


def test_falling_rope_moves_as_scipy_integrates_the_expression():
    """All nodes of a straight rope move alike under a law of velocity and time: it falls as a point does."""
    effect = law("-k*(speed/1[m/s])^p*unit(v) + a*t/1[s]*ex", k=(0.4, "m/s^2"), p=(1.5, "1"), a=(1.0, "m/s^2"))
    rope = {
        "representation": "rope",
        "name": "rope",
        "points": [[0.0, 0.0, 2.0], [0.5, 0.0, 2.0]],
        "radius": 0.005,
        "segments": 6,
        "velocity": [0.5, 1.0, 0.0],
    }
    world = World.model_validate({"deformables": [rope], "effects": [effect], "time": {"substep": 0.005}})
    found = simulator(world, TIMES).run().deformables["rope"].points[0]
    moved = found - found[0]
    expected = integrated(
        lambda s: G - 0.4 * np.linalg.norm(s.v) ** 0.5 * s.v + np.array([s.t, 0, 0]), np.zeros(3), np.array([0.5, 1, 0])
    )
    np.testing.assert_allclose(moved, np.repeat(expected[:, None], moved.shape[1], axis=1), atol=2e-3)


def test_parameters_of_an_expression_have_paths_units_bounds_and_overrides():
    effect = law("-k*speed*v", k=(0.1, "1/m")) | {"parameter_bounds": {"k": (0.0, 2.0)}}
    world = ball_world(effect)
    spec = parameter_paths(world)["effects.law.k"]
    assert (spec.unit, spec.lower, spec.upper, spec.search) == ("1/m", 0.0, 2.0, (0.0, 2.0))
    assert read_parameter(world, "effects.law.k") == 0.1
    stronger = with_parameters(world, {"effects.law.k": 0.3})
    batch = simulator(world, TIMES, n_worlds=2).run({"effects.law.k": np.array([0.1, 0.3])})
    np.testing.assert_array_equal(batch.positions[0], simulator(world, TIMES).run().positions[0])
    np.testing.assert_array_equal(batch.positions[1], simulator(stronger, TIMES).run().positions[0])
    with pytest.raises(ValueError, match="outside its bounds"):
        with_parameters(world, {"effects.law.k": 3.0})


def test_a_switched_off_expression_does_nothing():
    world = ball_world(LAWS["position"][0])
    off = branch(world, [ToggleEffect(effect="law", enabled=False)])
    free = ball_world(LAWS["position"][0], effects=[])
    np.testing.assert_array_equal(simulator(off, TIMES).run().positions, simulator(free, TIMES).run().positions)


def test_two_expressions_act_beside_laws_of_the_catalogue():
    effects = [
        law("k*ex", k=(1.0, "m/s^2")) | {"name": "one"},
        {"name": "drag", "kind": "linear_drag", "parameters": {"coefficient": 0.1}},
        law("k*t/1[s]*ey", k=(2.0, "m/s^2")) | {"name": "two"},
    ]
    world = ball_world(effects[0], effects=effects)
    ball = world.objects[0]
    found = simulator(world, TIMES).run().positions[0, :, 0]
    expected = integrated(
        lambda s: G + np.array([1.0, 2.0 * s.t, 0.0]) - 0.5 * s.v, np.array(ball.position), np.array(ball.velocity)
    )
    np.testing.assert_allclose(found, expected, atol=3e-5)


def test_a_world_without_expressions_keeps_its_id():
    effect = {"name": "air", "kind": "linear_drag", "parameters": {"coefficient": 0.1}}
    text = World.model_validate({"effects": [effect]}).canonical_json()
    assert (
        '"effects":[{"enabled":true,"kind":"linear_drag","name":"air","objects":null,'
        '"parameters":{"coefficient":0.1}}]' in text
    )


def test_a_world_with_an_expression_comes_back_from_its_json():
    for effect, _ in LAWS.values():
        world = ball_world(effect)
        again = World.model_validate_json(world.canonical_json())
        assert again == world
        assert again.id == world.id


@pytest.mark.parametrize(
    ("effect", "message"),
    [
        ({"name": "law", "kind": "expression"}, "needs `expression`"),
        (law("-k*v"), "effect 'law': unknown word 'k'"),
        (law("-k*v", k=(1.0, "1")), "must be an acceleration"),
        (law("-k*v", k=(1.0, "1/s")) | {"parameter_units": {"q": "1/s"}}, r"parameter_units names \['q'\]"),
        (law("-k*v", k=(5.0, "1/s")) | {"parameter_bounds": {"k": (0.0, 1.0)}}, "k = 5.0 is outside 0.0 to 1.0 1/s"),
        ({"name": "law", "kind": "linear_drag", "expression": "g"}, r"\['expression'\] belong to effects of kind"),
        ({"name": "law", "kind": "magic"}, "unknown effect kind 'magic'; kinds: .*'expression'"),
    ],
)
def test_a_world_refuses_an_effect_that_makes_no_law(effect, message):
    with pytest.raises(ValidationError, match=message):
        World.model_validate({"effects": [effect]})
