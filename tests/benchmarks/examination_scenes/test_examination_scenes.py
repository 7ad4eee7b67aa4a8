"""Check the scenes' physics and their keys against closed forms."""

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from tests.benchmarks.examination_scenes.kinds import KINDS
from tests.benchmarks.examination_scenes.picture import draw_camera, film, shown
from tests.benchmarks.examination_scenes.questions import Asker, World, touch
from tests.benchmarks.examination_scenes.world import GRAVITY, Body, Fixed, Scene, String, simulate
from tests.offscreen_gl import needs_gl

FRICTION = 0.25
SLIPS = 0.004  # [m] MuJoCo's regularised contact lets a cylinder slide 0.4% too far
SLIDER = Body("red_metal_cylinder", "cylinder", (0.1, 0.1), 1.0, (0.0, 0.0, 0.1), (2.0, 0.0, 0.0))
TARGET = Body("blue_metal_cylinder", "cylinder", (0.1, 0.1), 1.0, (0.7, 0.0, 0.1))
BALL = Body("red_rubber_ball", "sphere", (0.05,), 0.5, (0.0, 0.0, 1.0), (1.0, 0.0, 2.0))


def sliding(*bodies: Body) -> Scene:
    """Return bodies on a floor of known friction."""
    return Scene(bodies, friction={"metal": FRICTION, "rubber": FRICTION})


def slid(speed: float, time: float) -> float:
    """Return how far Coulomb friction lets a body slide [m]."""
    time = min(time, speed / (FRICTION * GRAVITY))
    return speed * time - FRICTION * GRAVITY * time**2 / 2


def test_sliding_body_stops_where_coulomb_friction_stops_it() -> None:
    run = simulate(sliding(SLIDER), 1.2)
    assert run.place(SLIDER.name, 1.1)[0] == pytest.approx(4.0 / (2 * FRICTION * GRAVITY), abs=SLIPS)


def test_slipping_ball_ends_rolling_at_five_sevenths_of_its_speed() -> None:
    ball = Body("red_rubber_ball", "sphere", (0.1,), 1.0, (0.0, 0.0, 0.1), (2.0, 0.0, 0.0))
    assert simulate(sliding(ball), 1.0).speed(ball.name, 0.9) == pytest.approx(2.0 * 5 / 7, rel=0.005)


def test_thrown_ball_flies_a_parabola() -> None:
    run = simulate(sliding(BALL), 0.5)
    parabola = [0.4, 0.0, 1.0 + 2.0 * 0.4 - GRAVITY * 0.4**2 / 2]
    np.testing.assert_allclose(run.place(BALL.name, 0.4), parabola, atol=1e-3)


def test_bounce_keeps_the_stated_part_of_the_speed() -> None:
    ball = Body("red_rubber_ball", "sphere", (0.05,), 0.5, (0.0, 0.0, 1.0))
    run = simulate(Scene((ball,), friction={"rubber": 0.3}, floor_restitution=0.7), 1.2)
    path = run.places[ball.name][:, 2]
    rise = path[int(path.argmin()) :].max() - 0.05
    assert math.sqrt(rise / 0.95) == pytest.approx(0.7, abs=0.04)


@pytest.mark.parametrize("rigid", [False, True])
def test_pendulum_has_its_period(rigid: bool) -> None:
    length, angle = 0.8, 0.3
    place = (length * math.sin(angle), 0.0, 1.5 - length * math.cos(angle))
    ball = Body("red_metal_ball", "sphere", (0.05,), 1.0, place)
    pivot = Fixed("pivot", "pivot", (0.01,), (0.0, 0.0, 1.5))
    run = simulate(Scene((ball,), (pivot,), (String("pivot", (ball.name,), length, rigid),)), 1.6)
    crossings = np.flatnonzero(np.diff(np.sign(run.places[ball.name][:, 0]))) * 1e-3
    period = 2 * math.pi * math.sqrt(length / GRAVITY) * (1 + angle**2 / 16 + 11 * angle**4 / 3072)
    assert 2 * (crossings[1] - crossings[0]) == pytest.approx(period, abs=3e-3)


def test_weights_on_a_pulley_accelerate_as_atwood_computed() -> None:
    light, heavy = (
        Body(f"{c}_metal_weight", "cylinder", (0.04, 0.05), m, (x, 0.0, 0.8))
        for c, m, x in (("red", 1.0, -0.08), ("blue", 1.2, 0.08))
    )
    pulley = Fixed("pulley", "pulley", (0.08, 0.02), (0.0, 0.0, 2.0))
    string = String("pulley", (light.name, heavy.name), math.pi * 0.08 + 2 * (2.0 - 0.85))
    run = simulate(Scene((light, heavy), (pulley,), (string,)), 0.9)
    rise = GRAVITY * 0.2 / 2.2 * 0.8**2 / 2
    assert run.place(light.name, 0.8)[2] - 0.8 == pytest.approx(rise, abs=2e-3)
    assert run.energy.max() - run.energy[0] < 0.01


def test_collision_is_when_sliding_has_closed_the_gap() -> None:
    run = simulate(sliding(SLIDER, TARGET), 0.5)
    assert slid(2.0, touch(run, frozenset((SLIDER.name, TARGET.name)), 0.0)) == pytest.approx(0.5, abs=5e-3)


def test_keys_agree_with_closed_forms() -> None:
    asker = Asker(np.random.default_rng(0), sliding(SLIDER), 0.2, 1.0, "xy")
    halved = World(asker.fact.scene, [{"action": "scale_velocity", "object": SLIDER.name, "factor": 0.5}], 1.3)
    for world, speed, since in ((asker.fact, 2.0, 0.2), (halved, 1.0, 0.0)):
        place = asker.place(world, SLIDER.name, 0.6)
        assert place is not None
        np.testing.assert_allclose(place["answer"], [slid(speed, 0.8), 0.0], atol=SLIPS)
        assert place["stays"] == pytest.approx(abs(slid(speed, 0.8) - slid(2.0, 0.2)), abs=SLIPS)
        for yes in (True, False):
            asked = asker.whether(world, "moved_by_more_than", [SLIDER.name, ""], 0.6, yes)
            assert asked is not None
            way, threshold = slid(speed, 0.8) - slid(speed, since), asked["predicate"]["distance"]
            assert asked["answer"] == ("yes" if way > threshold else "no") == ("yes" if yes else "no")
            assert 0.09 < abs(way - threshold) / threshold < 0.41


@needs_gl
def test_labels_cover_the_centres_of_the_balls_that_are_seen(tmp_path: Path) -> None:
    rng, at = np.random.default_rng(4), [0.0, 0.1, 0.2]
    scene = KINDS["throw"](rng, 0)
    run = simulate(scene, 0.3, 1)
    paths = {b.name: np.array([run.place(b.name, t) for t in at]) for b in scene.bodies}
    camera = draw_camera(rng, np.concatenate(list(paths.values())), "side")
    labels = film(rng, scene, run, camera, at, tmp_path / "clip.mp4")
    for k, name in enumerate(shown(scene)):
        for frame, (u, v) in zip(labels, camera.pixel(paths[name]).astype(int), strict=True):
            assert frame[v, u] == k + 1
