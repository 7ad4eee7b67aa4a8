"""The law of an unexplained force, held against motion that SciPy integrated under laws outside the catalogue."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.expressions import Expression, compile_expression
from polyworld.gap.candidate import with_parts
from polyworld.gap.catalogue import named
from polyworld.gap.cross_validation import examined
from polyworld.gap.fitting import fit
from polyworld.gap.hypothesis import extended
from polyworld.gap.residual_force import ResidualForce, residual_force
from polyworld.gap.residual_terms import Number, Term, library, sum_text
from polyworld.gap.settings import GapSettings
from polyworld.solver.rollout import simulator
from polyworld.world import Effect, World

Array = NDArray[np.float64]
Law = Callable[[float, Array, Array], Array]
SIGMA = 0.003
TIMES = np.arange(60) / 40.0
DOWN = np.array([0.0, 0.0, -9.81])


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


def ball_world() -> World:
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.05}, "mass": 0.2, "position": [0, 0, 1]}
    return World.model_validate({"objects": [ball]})


def moved(acceleration: Law, start: Array, times: Array = TIMES) -> Array:
    """Return the path (T, d) from places and velocities (2 d,)."""
    d = len(start) // 2
    motion = solve_ivp(
        lambda t, y: np.concatenate([y[d:], acceleration(t, y[:d], y[d:])]),
        (0.0, times[-1]),
        start,
        t_eval=times,
        rtol=1e-9,
        atol=1e-12,
    )
    path: Array = motion.y[:d].T
    return path


def recorded(acceleration: Law, runs: int = 6, axes: tuple[int, ...] = (0, 1)) -> Recording:
    """Runs of the puck from random starts, positions in the plane, or along some axes, with noise of SIGMA."""
    rng = np.random.default_rng(4)
    found = []
    for i in range(runs):
        heading, speed = rng.uniform(0, 2 * np.pi), rng.uniform(0.8, 3.0)
        start = np.array([*rng.uniform(-1, 1, 2), speed * np.cos(heading), speed * np.sin(heading)])
        places = np.full((len(TIMES), 1, 3), np.nan)
        noisy = moved(acceleration, start) + rng.normal(0, SIGMA, (len(TIMES), 2))
        places[:, 0, list(axes)] = noisy[:, list(axes)]
        found.append(Run(f"r{i}", ("puck",), TIMES, places, np.full((len(TIMES), 1, 4), np.nan)))
    return Recording(tuple(found))


def thrown() -> Recording:
    """Return flights of a spinning ball under a wind that grows with height, whose spins, measured, die away."""
    rng, times = np.random.default_rng(2), np.arange(30) / 30.0
    found = []
    for i in range(4):
        start = np.array([*rng.uniform(-0.3, 0.3, 2), 1.0, *rng.uniform(-3.0, 3.0, 2), rng.uniform(2.0, 5.0)])
        path = moved(lambda _t, x, _v: DOWN + 1.2 * x[2] * np.array([0.8, 0.6, 0.0]), start, times)
        spins = rng.normal(0.0, 20.0, 3) * np.exp(-0.6 * times)[:, None]
        run = Run(
            f"r{i}",
            ("ball",),
            times,
            (path + rng.normal(0.0, SIGMA, path.shape))[:, None],
            np.full((len(times), 1, 4), np.nan),
            angular_velocities=(spins + rng.normal(0.0, 0.05, spins.shape))[:, None],
        )
        found.append(run)
    return Recording(tuple(found))


def described(acceleration: Law) -> ResidualForce | None:
    null = examined(puck_world(), recorded(acceleration))
    return residual_force(null.ground, null, null, GapSettings(), lambda: False)


def drag(_t: float, _x: Array, v: Array) -> Array:
    power: Array = -0.3 * np.linalg.norm(v) ** 0.4 * v
    return power


def drag_and_shear(_t: float, x: Array, v: Array) -> Array:
    both: Array = 0.9 * x[1] * np.array([0.8, -0.6]) - 0.3 * np.linalg.norm(v) * v
    return both


@pytest.fixture(scope="module")
def dragged() -> ResidualForce:
    found = described(drag)
    assert found is not None
    return found


@pytest.fixture(scope="module")
def two_terms() -> ResidualForce:
    found = described(drag_and_shear)
    assert found is not None
    return found


def test_drag_is_found_with_its_exponent(dragged: ResidualForce) -> None:
    summary = dragged.to_dict()
    assert summary["explains"]
    assert summary["direction"] == ["along the velocity"]
    assert summary["depends_on"] == ["speed"]
    (exponent,) = summary["speed_exponent"]
    low, high = exponent["interval95"]
    assert low < 1.4 < high < low + 0.1
    assert summary["chi2_after"] < 1.2 * summary["data"] < summary["chi2_before"]
    assert len(compile_expression(Expression((summary["written"],)))) > 1


def test_other_laws_are_listed_with_the_evidence_against_them(dragged: ResidualForce) -> None:
    listed = dragged.to_dict()["alternatives"]
    each = next(a for a in listed if "step(vx)" in a["expression"])
    assert each["behind"] > 100.0


def test_the_child_world_moves_as_the_data_do(dragged: ResidualForce) -> None:
    start = {"objects.puck.velocity.x": 2.0, "objects.puck.velocity.y": 1.0}
    batch = simulator(dragged.world, TIMES).run({p: np.array([v]) for p, v in start.items()})
    truth = moved(drag, np.array([0.0, 0.0, 2.0, 1.0]))
    np.testing.assert_allclose(batch.positions[0, :, 0, :2], truth, atol=3 * SIGMA)


def test_a_force_that_grows_with_the_place_is_found_with_its_components() -> None:
    found = described(lambda _t, x, _v: 0.9 * x[1] * np.array([0.8, -0.6]))
    assert found is not None
    assert found.explains
    assert found.to_dict()["depends_on"] == ["position"]
    length = float(found.expression.split("x.y/")[1].split("[")[0])
    assert found.numbers["kx"]["value"] / length == pytest.approx(0.9 * 0.8, rel=0.02)
    assert found.numbers["ky"]["value"] / length == pytest.approx(-0.9 * 0.6, rel=0.02)


def test_a_force_that_dies_away_is_found_with_its_time() -> None:
    found = described(lambda t, _x, _v: 1.5 * np.exp(-t / 0.35) * np.array([0.6, 0.8]))
    assert found is not None
    assert found.expression == "exp(-t/tau)*(kx*ex + ky*ey)"
    low, high = found.numbers["tau"]["interval95"]
    assert low < 0.35 < high < low + 0.1


def test_two_forces_neither_of_which_helps_alone_are_found_together(two_terms: ResidualForce) -> None:
    assert two_terms.explains
    assert two_terms.to_dict()["depends_on"] == ["position", "speed"]
    (exponent,) = two_terms.to_dict()["speed_exponent"]
    assert exponent["value"] == pytest.approx(2.0, abs=0.1)


def test_the_sum_as_one_effect_moves_a_world_as_its_terms_do(two_terms: ResidualForce) -> None:
    numbers = two_terms.numbers
    law = Effect(
        name="law",
        kind="expression",
        expression=two_terms.expression,
        parameters={name: n["value"] for name, n in numbers.items()},
        parameter_units={name: n["unit"] for name, n in numbers.items()},
    )
    worlds = (with_parts(puck_world(), effects=(law,)), two_terms.world.with_substep(0.005))
    start = {"objects.puck.velocity.x": np.array([2.0]), "objects.puck.position.y": np.array([0.5])}
    one, other = (simulator(w, TIMES).run(dict(start)).positions[0, :, 0, :2] for w in worlds)
    np.testing.assert_allclose(one, other, atol=1e-9)
    truth = moved(drag_and_shear, np.array([0.0, 0.5, 2.0, 0.0]))
    np.testing.assert_allclose(one, truth, atol=3 * SIGMA)


def test_no_law_is_found_where_only_noise_is_left() -> None:
    assert described(lambda _t, _x, _v: np.zeros(2)) is None


def test_a_torque_stays_beside_the_force_that_is_missing() -> None:
    null = examined(ball_world(), thrown())
    (way, *_) = extended(null.hypothesis, named(["spin_damping"])[0], null.ground.recording)
    best = fit(null.ground, way, growing=True)
    found = residual_force(null.ground, best, null, GapSettings(), lambda: False)
    assert found is not None
    assert found.explains
    assert found.beside == ("spin_damping",)
    assert "x.z" in found.expression
    assert "beside spin_damping explains the data" in found.summary()
    (torque, force) = found.world.effects
    assert force.kind == "expression"
    inertia = 0.4 * 0.2 * 0.05**2
    assert torque.parameters["coefficient"] == pytest.approx(0.6 * inertia, rel=0.02)


def test_a_search_that_is_stopped_says_so() -> None:
    null = examined(puck_world(), recorded(drag))
    calls = iter(range(10**6))
    found = residual_force(null.ground, null, null, GapSettings(), lambda: next(calls) > 22)
    assert found is not None
    assert not found.to_dict()["complete"]
    assert "other laws untried" in found.summary()
    assert residual_force(null.ground, null, null, GapSettings(), lambda: True) is None


def test_numbers_of_a_sum_are_distinct_and_signs_are_drawn_together() -> None:
    k, p = Number("k", "m/s^2", -9.0, 9.0, 0.1, (0.0,)), Number("p", "1", 0.0, 6.0, 0.5, (1.0,))
    law = [Term("drag", "-k*(speed/2[m/s])^p*unit(v)", "", (), (k,), (p,))] * 2
    assert sum_text(law) == "-k1*(speed/2[m/s])^p1*unit(v) - k2*(speed/2[m/s])^p2*unit(v)"
    values = {"k1": "-0.5[m/s^2]", "p1": "1", "k2": "-1[m/s^2]", "p2": "2"}
    assert sum_text(law, values) == "0.5[m/s^2]*(speed/2[m/s])^1*unit(v) + 1[m/s^2]*(speed/2[m/s])^2*unit(v)"


@pytest.mark.parametrize("axes", [(0, 1), (1,)])
def test_every_term_is_an_acceleration_that_is_off_at_its_starts(axes: tuple[int, ...]) -> None:
    world, recording = puck_world(), recorded(drag, 2, axes)
    check_terms(world, recording)


def test_every_term_of_a_spinning_flight_is_an_acceleration() -> None:
    assert {"lift", "drag with spin"} <= check_terms(ball_world(), thrown())


def check_terms(world: World, recording: Recording) -> set[str]:
    """Compile all terms and their variants; return their names."""
    terms = library(world, recording)
    assert len({t.name for t in terms}) == len(terms)
    for term in terms:
        compile_expression(Expression((term.text,), tuple((n.name, n.unit) for n in term.numbers)))
        (variant,) = term.candidate().variants(world, recording)
        strengths = [u for u in variant.unknowns if u.name not in variant.idle]
        assert all(u.start == 0.0 for u in strengths)
        (again,) = term.candidate().variants(variant.world, recording)
        assert [e.name for e in again.world.effects] == ["unexplained", "unexplained_2"]
        assert replace(again.unknowns[0], paths=()) == replace(variant.unknowns[0], paths=())
    return {t.name for t in terms}
