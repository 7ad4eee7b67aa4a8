"""The proposed experiment: where laws differ by theory the proposal goes there, and what it predicts SciPy confirms."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from polyworld.data.recording import Recording, Run
from polyworld.gap.catalogue import named
from polyworld.gap.cross_validation import examined
from polyworld.gap.experiment import propose_experiment
from polyworld.gap.fitting import Fitted, fit
from polyworld.gap.ground import Ground, ground_of
from polyworld.gap.hypothesis import Hypothesis, extended
from polyworld.gap.settings import GapSettings
from polyworld.world import World

Array = NDArray[np.float64]

G, MASS, DRAG, LIFT = 9.81, 0.0027, 4e-4, 3e-5  # [m/s^2]; a table tennis ball: [kg], [kg/m], [kg]
SIGMA, SPIN_SIGMA = 0.01, 0.5  # [m], [rad/s]
TIMES = np.arange(48) / 60.0
SETTINGS = GapSettings()
LAWS = {"quadratic_drag": lambda v: np.linalg.norm(v) * v, "linear_drag": lambda v: v}


def ball_world() -> World:
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.02}, "mass": MASS, "position": [0, 0, 1]}
    return World.model_validate({"objects": [ball], "time": {"substep": 0.002}})


def path(start: Array, push: Array | float = 0.0, law: str = "quadratic_drag", drag: float = 0.0) -> Array:
    """Positions (T, 3) of a ball from a start (6,), pushed [m/s^2] and slowed by a law of drag."""

    def rate(_: float, y: Array) -> Array:
        return np.concatenate([y[3:], np.array([0.0, 0.0, -G]) + push - drag / MASS * LAWS[law](y[3:])])

    places: Array = solve_ivp(rate, (0.0, TIMES[-1]), start, t_eval=TIMES, rtol=1e-10, atol=1e-12).y[:3].T
    return places


def recorded(places: Array, name: str = "throw", spin: Array | None = None, seed: int = 0) -> Run:
    rng = np.random.default_rng(seed)
    seen = (places + rng.normal(0.0, SIGMA, places.shape))[:, None]
    spins = np.full(seen.shape, np.nan) if spin is None else spin + rng.normal(0.0, SPIN_SIGMA, seen.shape)
    return Run(name, ("ball",), TIMES, seen, np.full((len(TIMES), 1, 4), np.nan), SIGMA, angular_velocities=spins)


def contender(ground: Ground, effect: str) -> Fitted:
    (hypothesis,) = extended(Hypothesis(ground.world), named([effect])[0], ground.recording)
    return fit(ground, hypothesis, growing=True, scale=1.0)


def slowed() -> Ground:
    start = np.array([0.0, 0.0, 1.0, 3.0, 1.0, 2.0])
    return ground_of(ball_world(), Recording((recorded(path(start, drag=DRAG)),)), SETTINGS)


def test_linear_and_quadratic_drag_are_separated_by_a_faster_throw() -> None:
    ground = slowed()
    pair = [contender(ground, law) for law in LAWS]
    assert abs(pair[0].objective - pair[1].objective) < 10.0  # this throw does not separate them
    proposed = propose_experiment(pair, SETTINGS)
    assert proposed is not None
    assert np.linalg.norm(proposed.velocity) > 2.0 * np.sqrt(14.0)
    assert proposed.decides
    assert proposed.separations[0].sigmas > np.sqrt(2.0 * SETTINGS.excluded)
    watched, _, rest = proposed.watch.partition(" of ball at ")
    row = int(np.argmin(np.abs(TIMES - float(rest.removesuffix(" s")))))
    start = np.concatenate([proposed.position, proposed.velocity])
    for law, fitted in zip(LAWS, pair, strict=True):
        expected = path(start, law=law, drag=float(fitted.values[0]))[row, "xyz".index(watched[-1])]
        assert proposed.forecasts[law] == pytest.approx(expected, abs=0.2 * SIGMA)


def test_separation_from_a_push_is_that_of_the_closed_form() -> None:
    """A push a leaves 0.5 a t^2 less its line, of squared length L^2 a^2. It is known from as many runs R, so that of
    its length in one more, uncertain by its variance 1 / (R L^2), the share R / (R + 1) counts."""
    runs, push = 3, np.array([0.6, 0.3, 0.0])
    starts = np.random.default_rng(1).uniform(-2.0, 2.0, (runs, 6))
    paths = [path(start, push) for start in starts]
    recording = Recording(tuple(recorded(p, f"throw{k}", seed=k) for k, p in enumerate(paths)))
    ground = ground_of(ball_world(), recording, SETTINGS)
    pushed, still = contender(ground, "tilt"), fit(ground, Hypothesis(ground.world), growing=True, scale=1.0)
    pushed.scale = still.scale = 1.0
    proposed = propose_experiment([pushed, still], SETTINGS)
    assert proposed is not None
    n, rate = len(TIMES), 1.0 / TIMES[1]
    length = np.sqrt(n * (n**2 - 1) * (n**2 - 4) / 720.0) / rate**2 / SIGMA  # of even samples, exactly
    expected = length * float(np.linalg.norm(pushed.values)) * np.sqrt(runs / (runs + 1.0))
    assert proposed.separations[0].sigmas == pytest.approx(expected, rel=0.05)
    assert set(proposed.forecasts) == {"tilt", "nothing missing"}
    assert proposed.to_dict()["separations"][0]["second"] == ()


def test_a_throw_with_its_spin_reversed_separates_lift_from_turning_axes() -> None:
    """A lift that follows the spin, and an acceleration that does not, look alike in one throw."""
    spin = np.array([30.0, -60.0, 40.0])

    def rate(_: float, y: Array) -> Array:
        return np.concatenate([y[3:], np.array([0.0, 0.0, -G]) + LIFT / MASS * np.cross(spin, y[3:])])

    whole = solve_ivp(rate, (0.0, TIMES[-1]), [0, 0, 1, 6, 1, 2], t_eval=TIMES, rtol=1e-10, atol=1e-12)
    ground = ground_of(ball_world(), Recording((recorded(whole.y[:3].T, spin=spin),)), SETTINGS)
    proposed = propose_experiment([contender(ground, "magnus_lift"), contender(ground, "coriolis")], SETTINGS)
    assert proposed is not None
    assert proposed.decides
    np.testing.assert_allclose(proposed.angular_velocity, -spin, atol=1.0)


def test_two_names_for_one_motion_are_not_separable() -> None:
    drag = contender(slowed(), "quadratic_drag")
    (part,) = drag.hypothesis.parts
    labelled = [
        replace(drag, hypothesis=replace(drag.hypothesis, parts=(replace(part, variant=variant),)))
        for variant in (replace(part.variant, label="one"), replace(part.variant, label="other"))
    ]
    proposed = propose_experiment(labelled, SETTINGS)
    assert proposed is not None
    assert not proposed.decides
    assert proposed.separations[0].sigmas == pytest.approx(0.0, abs=1e-6)
    assert set(proposed.forecasts) == {"quadratic_drag (one)", "quadratic_drag (other)"}


def test_nothing_is_proposed_for_one_contender_or_a_body_that_is_held() -> None:
    assert propose_experiment([contender(slowed(), "quadratic_drag")], SETTINGS) is None
    hinge = {"name": "pivot", "kind": "hinge", "object": "ball", "anchor": [0, 0, 2], "axis": [0, 1, 0]}
    world = World.model_validate({**ball_world().model_dump(), "joints": [hinge]})
    angle = 0.1 * np.cos(np.sqrt(G) * TIMES)
    places = np.stack([-np.sin(angle), np.zeros_like(angle), 2.0 - np.cos(angle)], axis=1)
    swing = examined(world, Recording((recorded(places),)))
    assert propose_experiment([swing, swing], SETTINGS) is None
