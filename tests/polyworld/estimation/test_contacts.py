"""Which bodies may have touched: a ball that bounces between two frames is seen above the floor in both."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.estimation.contacts import possible_contacts
from tests.polyworld.estimation.floor_scenes import GRAVITY, RADIUS, ball, scene, tracks_of

FRAME = 1.0 / 15.0  # [s]


def heights(hit: float, speed: float, restitution: float) -> np.ndarray:
    """Heights (T,) of a ball's centre that hits the floor at `hit` [s] with a speed, or flies on where that is 0."""
    times = np.arange(16) * FRAME
    since = times - hit
    before = RADIUS - speed * since - 0.5 * GRAVITY * since**2
    after = RADIUS + restitution * speed * since - 0.5 * GRAVITY * since**2
    return np.where(since < 0.0, before, after)


def contacts(z: np.ndarray) -> dict[tuple[str, str], float]:
    tracks = tracks_of({"ball": np.stack([0.0 * z, 0.0 * z, z], axis=1)}, sigma=1e-4, frame=FRAME)
    return possible_contacts(scene([ball(position=(0.0, 0.0, float(z[0])))], tracks), tracks)


@pytest.mark.parametrize(("share", "restitution"), [(0.3, 0.9), (0.5, 0.9), (0.5, 0.7), (0.7, 0.9)])
def test_a_bounce_between_frames_is_a_contact(share: float, restitution: float) -> None:
    z = heights((8 + share) * FRAME, 4.5, restitution)[4:12]
    assert z.min() > RADIUS + 0.05  # never seen near the floor
    ((pair, time),) = contacts(z).items()
    assert pair == ("ball", "floor")
    assert time == pytest.approx(5 * FRAME)  # the first frame after it


def test_a_ball_that_turns_back_in_the_air_touches_nothing() -> None:
    """It falls below 0.3 m and is thrown up again without reaching the floor."""
    times = np.arange(12) * FRAME
    assert contacts(RADIUS + 0.3 + 2.0 * (times - 0.37) ** 2) == {}


def test_a_ball_that_falls_towards_the_floor_has_not_met_it_yet() -> None:
    assert contacts(heights(1.2, 4.5, 0.8)[11:16]) == {}
