"""Where a wall that nobody sees is taken to stand, from paths that turned round at it."""

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.gap import find_gap
from polyworld.gap.catalogue import catalogue, named
from polyworld.gap.report import effects_of
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
    assert min(turned(turn) for _, turn in found) < 0.1  # the jump itself is 0.25 off


def test_a_slanted_wall_in_free_flight_is_found_with_its_own_restitution() -> None:
    """Throws without any floor of a ball of restitution 0.8, reflected by SciPy at a plane with less."""
    rng = np.random.default_rng(7)
    begins = launches(rng, 6)
    across = np.array([0.37, -0.21, 0.9]) / np.linalg.norm([0.37, -0.21, 0.9])
    offset = min(float(b.place @ across) for b in begins) - 1.2 * RADIUS
    hidden = Bouncing(after=lambda speed, along: (0.7 * speed, along), planes=((across, offset),))
    data = ball_recording(hidden, begins, rng, 0.002, duration=1.0, rate=60.0)
    world = ball_world().model_copy(update={"statics": ()})
    report = find_gap(world, data, candidates=named(["hidden_wall", "hidden_body", "gravity_error", "tilt"]))
    assert (report.verdict.kind, report.names) == ("identified", ("hidden_wall",))
    low, high = effects_of(report.verdict.best)[0]["unknowns"]["restitution"]["interval95"]
    assert low < 0.7 < high < 1.1 * low
