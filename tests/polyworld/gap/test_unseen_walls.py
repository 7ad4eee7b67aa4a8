"""Where a wall that nobody sees is taken to stand, from paths that turned round at it."""

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import catalogue, named
from polyworld.world import World
from tests.polyworld.gap_scenes import RADIUS, Bouncing, ball_recording, ball_world, launches
from tests.scenes.ball import Ball, Launch, Plane, fly

ANGLE, OFFSET, FRICTION = 2.9, -2.0, 0.1
NORMAL = np.array([np.cos(ANGLE), np.sin(ANGLE), 0.0])
TIMES = np.arange(120) / 120.0


def recorded(launches: list[Launch]) -> Recording:
    """Throws at the wall, which is rough: jumps are bent away from its normal."""
    ball = Ball(friction=FRICTION, planes=(Plane(), Plane((float(NORMAL[0]), float(NORMAL[1]), 0.0), OFFSET)))
    rng = np.random.default_rng(2)
    runs = []
    for k, launch in enumerate(launches):
        path = fly(ball, launch, TIMES)
        assert any(abs(p @ NORMAL - OFFSET - 0.1) < 0.05 for p in path.positions)
        places = path.positions + rng.normal(0.0, 0.0005, path.positions.shape)
        runs.append(Run(f"run {k}", ("ball",), TIMES, places[:, None], np.full((len(TIMES), 1, 4), np.nan)))
    return Recording(tuple(runs))


def starts(data: Recording) -> list[tuple[float, float]]:
    """Offset along the axis and turn [rad] of all starts, where the wall is most across x."""
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "mass": 0.5, "position": [0, 0, 2]}
    world = World.model_validate(
        {
            "objects": [ball | {"friction": FRICTION, "restitution": 0.8}],
            "statics": [{"name": "floor", "shape": {"kind": "plane"}}],
        }
    )
    found = catalogue()["hidden_wall"].variants(world, data)
    return [(s["offset"], np.pi + s["turn_z"]) for v in found if v.label == "across x, facing -x" for s in v.starts]


def turned(angle: float) -> float:
    return abs((angle - ANGLE + np.pi) % (2.0 * np.pi) - np.pi)


def test_two_hits_show_how_a_rough_wall_runs() -> None:
    aside = np.array([-NORMAL[1], NORMAL[0], 0.0])
    throws = [-3.5 * NORMAL + s * aside for s in (1.5, -1.5)]
    data = recorded([Launch((0.0, float(v[1]) * 0.3, 2.0), (float(v[0]), float(v[1]), 2.0)) for v in throws])
    offset, turn = starts(data)[0]
    assert turned(turn) < 0.03
    assert offset == pytest.approx(OFFSET / NORMAL[0], abs=0.05)


def test_one_hit_is_tried_with_the_jump_bent_to_either_side() -> None:
    aside = np.array([-NORMAL[1], NORMAL[0], 0.0])
    v = -3.5 * NORMAL + 2.5 * aside
    data = recorded([Launch((0.0, 0.0, 2.0), (float(v[0]), float(v[1]), 2.0))])
    found = starts(data)
    assert min(turned(turn) for _, turn in found) < 0.75 * turned(found[0][1])  # the jump itself misleads


@pytest.mark.parametrize("normal", [(0.37, -0.21, 0.9), (-0.7, 0.3, 0.64)])
def test_a_slanted_wall_is_found_in_free_flight(normal: tuple[float, float, float]) -> None:
    """Throws without any floor, reflected by SciPy at a plane that is neither upright nor level."""
    rng = np.random.default_rng(7)
    begins = launches(rng, 6)
    across = np.array(normal) / np.linalg.norm(normal)
    offset = min(float(b.place @ across) for b in begins) - 1.2 * RADIUS
    hidden = Bouncing(after=lambda speed, along: (0.7 * speed, along), planes=((across, offset),))
    data = ball_recording(hidden, begins, rng, 0.002, duration=1.0, rate=60.0)
    world = ball_world().model_copy(update={"statics": ()})
    candidates = named(["hidden_wall", "hidden_body", "gravity_error", "tilt"])
    settings = GapSettings(null_control=False, experiment=False)
    report = find_gap(world, data, candidates=candidates, settings=settings)
    assert report.names == ("hidden_wall",)
    values = report.to_dict()["effects"][0]["unknowns"]
    assert values["restitution"]["value"] == pytest.approx(0.7, abs=0.03)


@pytest.mark.parametrize("pair", [0.87, 0.3])
def test_a_wall_off_which_a_ball_rebounds_unlike_off_anything_else_is_found_with_its_own_restitution(
    pair: float,
) -> None:
    """A ball of restitution 0.6 in free flight beside a wall: thrown and reflected by SciPy."""
    rng = np.random.default_rng(3)
    begins = launches(rng, 6)
    normal = np.array([np.cos(2.6), np.sin(2.6), 0.0])
    offset = min(float(b.place @ normal) for b in begins) - 1.5 * RADIUS
    hidden = Bouncing(after=lambda speed, along: (pair * speed, along), planes=((normal, offset),))
    world = ball_world()
    world = world.model_copy(
        update={"objects": (world.objects[0].model_copy(update={"restitution": 0.6}),), "statics": ()}
    )
    report = find_gap(
        world,
        ball_recording(hidden, begins, rng, rate=60.0),
        candidates=named(["hidden_wall", "hidden_body", "tether", "tilt"]),
        settings=GapSettings(null_control=False, experiment=False),
    )
    assert report.names == ("hidden_wall",)
    (effect,) = report.to_dict()["effects"]
    low, high = effect["unknowns"]["restitution"]["interval95"]
    assert low < pair < high
    assert high - low < 0.05
