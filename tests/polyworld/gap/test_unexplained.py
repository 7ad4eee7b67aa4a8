"""An unexplained force described, held against motion that SciPy integrated under laws outside the catalogue."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.expressions import Expression, compile_expression
from polyworld.gap.examine import fitted_base
from polyworld.gap.segment_context import segment_context
from polyworld.gap.settings import SymbolicSettings
from polyworld.gap.symbolic import Near, ResidualForce, describe_unexplained
from polyworld.gap.symbolic_law import Law
from polyworld.gap.symbolic_terms import Scales, library, scales_of
from polyworld.solver.rollout import simulator
from polyworld.world import World

Array = NDArray[np.float64]
SIGMA = 0.001
TIMES = np.arange(60) / 40.0


def puck_world() -> World:
    """A puck on a table without friction."""
    puck = {
        "name": "puck",
        "representation": "rigid_planar",
        "shape": {"kind": "cylinder", "radius": 0.05, "half_height": 0.01},
        "friction": 0.0,
        "position": [0.0, 0.0, 0.01],
    }
    return World.model_validate({"objects": [puck], "time": {"substep": 0.005}})


def recorded(acceleration: Callable[[float, Array, Array], Array], seed: int, runs: int = 5) -> Recording:
    """Runs of the puck from random starts, positions in the plane with noise of SIGMA."""
    rng = np.random.default_rng(seed)
    found = []
    for i in range(runs):
        heading, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0.8, 3.0)
        start = [*rng.uniform(-1, 1, 2), speed * np.cos(heading), speed * np.sin(heading)]
        motion = solve_ivp(
            lambda t, y: np.concatenate([y[2:], acceleration(t, y[:2], y[2:])]),
            (0.0, TIMES[-1]),
            start,
            t_eval=TIMES,
            rtol=1e-9,
            atol=1e-12,
        )
        places = np.full((len(TIMES), 1, 3), np.nan)
        places[:, 0, :2] = motion.y[:2].T + rng.normal(0, SIGMA, (len(TIMES), 2))
        found.append(Run(f"r{i}", ("puck",), TIMES, places, np.full((len(TIMES), 1, 4), np.nan)))
    return Recording(tuple(found))


def described(
    acceleration: Callable[[float, Array, Array], Array], seed: int = 4, settings: SymbolicSettings | None = None
) -> ResidualForce:
    ground = fitted_base(design(puck_world(), recorded(acceleration, seed)), ())
    return describe_unexplained(ground, settings=settings)


def power_drag(_t: float, _x: Array, v: Array) -> Array:
    return -0.3 * np.linalg.norm(v) ** 0.5 * v


def component_drag(_t: float, _x: Array, v: Array) -> Array:
    return -0.3 * np.abs(v) * v


@pytest.fixture(scope="module")
def along_velocity() -> ResidualForce:
    return described(power_drag)


@pytest.fixture(scope="module")
def by_components() -> ResidualForce:
    return described(component_drag)


def directions(found: ResidualForce) -> list[str]:
    direction: list[str] = found.to_json()["direction"]
    return direction


def test_drag_with_another_power_is_found_with_its_exponent(along_velocity: ResidualForce) -> None:
    found = along_velocity
    assert found.explains
    assert directions(found) == ["along the velocity"]
    low, high = found.numbers["p"].interval95
    assert low - 0.02 < 1.5 < high + 0.02
    assert high - low < 0.3
    assert found.to_json()["depends_on"] == ["speed"]


def test_drag_of_each_component_is_distinguished_from_drag_along_the_velocity(by_components: ResidualForce) -> None:
    found = by_components
    assert found.explains
    assert directions(found) == ["against each component by itself"]
    assert found.numbers["p"].value == pytest.approx(2.0, abs=0.1)


def test_drag_that_is_weaker_along_one_axis_is_found_with_the_exponent_of_the_force():
    found = described(lambda _t, _x, v: -np.array([0.15, 0.35]) * np.linalg.norm(v) ** 1.2 * v)
    assert found.explains
    assert directions(found) == ["against the velocity, by axes"]
    low, high = found.numbers["p"].interval95
    assert low - 0.02 < 2.2 < high + 0.02
    assert high - low < 0.5


def test_a_force_that_grows_with_the_place_is_found_with_its_components():
    found = described(lambda _t, x, _v: 0.9 * x[1] * np.array([0.8, -0.6]))
    assert found.explains
    assert "x.y" in found.expression
    assert "x.x" not in found.expression
    assert found.to_json()["depends_on"] == ["position"]
    assert found.chi2_before > found.trial.chi2 + 100.0
    length = float(found.expression.split("/")[1].split("[")[0])
    assert found.numbers["kx"].value / length == pytest.approx(0.9 * 0.8, rel=0.05)
    assert found.numbers["ky"].value / length == pytest.approx(-0.9 * 0.6, rel=0.05)


def test_a_force_that_dies_away_is_found_with_its_time():
    found = described(lambda t, _x, _v: 1.5 * np.exp(-t / 0.35) * np.array([0.6, 0.8]))
    assert found.explains
    assert found.expression.startswith("exp(-t/tau)")
    assert len(compile_expression(Expression((found.written,)))) > 1
    low, high = found.numbers["tau"].interval95
    assert low - 0.01 < 0.35 < high + 0.01


def test_the_child_world_moves_as_the_data_do(along_velocity: ResidualForce) -> None:
    found = along_velocity
    assert found.world is not None
    assert [e.kind for e in found.world.effects] == ["expression"]
    start = {"objects.puck.velocity.x": 2.0, "objects.puck.velocity.y": 1.0}
    batch = simulator(found.world, TIMES).run({p: np.array([v]) for p, v in start.items()})
    truth = solve_ivp(
        lambda t, y: np.concatenate([y[2:], power_drag(t, y[:2], y[2:])]),
        (0.0, TIMES[-1]),
        [0.0, 0.0, 2.0, 1.0],
        t_eval=TIMES,
        rtol=1e-9,
    )
    np.testing.assert_allclose(batch.positions[0, :, 0, :2], truth.y[:2].T, atol=3 * SIGMA)


def test_a_law_that_no_sum_of_terms_writes_is_not_said_to_explain():
    """Hills and hollows of potential, several of which every run crosses."""

    def hills(_t: float, x: Array, _v: Array) -> Array:
        return 2.0 * np.array([np.sin(3.0 * x[0]) * np.cos(3.0 * x[1]), np.cos(3.0 * x[0]) * np.sin(3.0 * x[1])])

    found = described(hills, settings=SymbolicSettings(max_terms=1))  # three take half a minute and more
    assert not found.explains
    assert "does not explain" in found.summary()
    assert found.to_json()["chi2_after"] > 1.5 * found.to_json()["data"]


def test_nothing_is_found_where_nothing_is_missing():
    found = described(lambda _t, _x, _v: np.zeros(2))
    assert found.expression == ""
    assert found.world is None
    assert found.to_json()["summary"] == "no term describes what is unexplained"


def test_equal_inputs_give_equal_answers(by_components: ResidualForce) -> None:
    assert described(component_drag).to_json() == by_components.to_json()


def test_signs_of_a_law_with_its_numbers_are_drawn_together():
    drag = next(t for t in library(Scales(2.0, 1.0, (0.0, 0.0, 0.0), 1.0, 0.01, 0.0, "xy")) if t.name == "drag")
    law = Law((drag, drag))
    values = {"k1": -0.5, "p1": 1.0, "k2": -0.25, "p2": 2.0}
    assert law.literal(values) == ("0.5[m/s^2]*(speed/2[m/s])^1*unit(v) + 0.25[m/s^2]*(speed/2[m/s])^2*unit(v)")


@pytest.mark.parametrize("axes", ["xyz", "xy", "z"])
def test_every_term_of_the_library_is_an_acceleration(axes):
    terms = library(Scales(3.2, 1.5, (0.0, 0.2, 1.0), 1.6, 0.01, 20.0, axes))
    assert len({t.name for t in terms}) == len(terms)
    for term in terms:
        law = Law((term,))
        compile_expression(Expression((law.text,), tuple((n, s.unit) for n, s in law.numbers.items())))


def test_scales_are_those_of_the_motion():
    scales = scales_of(fitted_base(design(puck_world(), recorded(lambda _t, _x, _v: np.zeros(2), 4)), ()))
    assert scales.axes == "xy"
    assert 0.8 < scales.speed < 3.0
    assert scales.duration == pytest.approx(TIMES[-1])
    assert scales.interval == pytest.approx(0.025)
    assert scales.spin == 0.0


def test_a_search_that_ends_at_its_limit_of_steps_says_so():
    law = lambda _t, x, v: 0.9 * x[1] * np.array([0.8, -0.6]) - 0.3 * np.linalg.norm(v) * v  # noqa: E731
    found = described(law, settings=SymbolicSettings(steps=1.0))
    assert not found.explains
    assert not found.complete
    assert "limit of integration steps" in found.summary()


def test_a_world_that_holds_an_unexplained_force_may_get_another():
    term = library(Scales(2.0, 1.0, (0.0, 0.0, 0.0), 1.0, 0.01, 0.0, "xy"))[0]
    once = Law((term,)).hypothesis(Hypothesis(puck_world(), ()))
    twice = Law((term,)).hypothesis(once)
    assert [e.name for e in twice.world.effects] == ["unexplained", "unexplained_2"]
    assert [{u.paths[0].split(".")[1] for u in p.variant.unknowns} for p in twice.parts] == [
        {"unexplained"},
        {"unexplained_2"},
    ]


def test_a_law_that_is_sought_on_segments_holds_on_whole_runs():
    """An attraction that bends paths by their own length, far from any straight line."""
    ground = fitted_base(design(puck_world(), recorded(lambda _t, x, _v: -9.0 * np.linalg.norm(x) * x, 4)), ())
    cut = segment_context(ground.context, 4)
    assert cut is not None
    on_segments = cut.fit_base(ground.hypothesis, ground.values)
    found = describe_unexplained(ground, near=Near(cut, on_segments.context.noise, on_segments.fit))
    assert found.explains
    assert len(found.trial.fit.states) == len(ground.fit.states)
    assert directions(found) == ["towards a point"]
    assert found.numbers["q"].value == pytest.approx(2.0, abs=0.05)
    assert [found.numbers["cx"].value, found.numbers["cy"].value] == pytest.approx([0.0, 0.0], abs=0.01)
