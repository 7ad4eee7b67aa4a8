"""Entry, exit and rest read off motion that is known on paper."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.solver.rollout import rollout
from polyworld.trajectory import Event
from polyworld.world import Region, World
from polyworld.world.camera import Camera
from tests.verification.planar_scenes import G, body, disc, top_view


def of_kind(events: tuple[Event, ...], *kinds: str) -> list[tuple[str, str, float]]:
    return [(e.kind, e.participants[0], round(e.time, 6)) for e in events if e.kind in kinds]


def test_entry_and_exit_times_lie_between_samples() -> None:
    """1 m/s through a region from x = -0.31 to 0.29: in at 0.69 s, out at 1.29 s, sampled every 0.04 s."""
    runner = body("runner", disc(), (-1.0, 0.0, 0.2), velocity=(1.0, 0.0, 0.0))
    inside = body("inside", disc(), (0.0, 3.0, 0.2))
    region = Region(lower=(-0.31, -9.0, -9.0), upper=(0.29, 9.0, 9.0))
    events = rollout(top_view(runner, inside, gravity=0.0, region=region), 2.0).events
    assert of_kind(events, "entry", "exit") == [("entry", "runner", 0.69), ("exit", "runner", 1.29)]
    entry = next(e for e in events if e.kind == "entry")
    np.testing.assert_allclose(entry.position, [-0.31, 0.0, 0.2], atol=1e-9)


def test_the_camera_defines_the_view_before_the_region() -> None:
    """Looking straight down from 10 m with f = 100 px: the image's 100 px are 5 m on either side at height 0."""
    camera = Camera(
        width=100,
        height=100,
        intrinsics=((100.0, 0.0, 50.0), (0.0, 100.0, 50.0), (0.0, 0.0, 1.0)),
        rotation=((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
        translation=(0.0, 0.0, 10.0),
    )
    runner = body("runner", disc(), (-6.0, 0.0, 0.0), velocity=(2.0, 0.0, 0.0))
    far = Region(lower=(-0.1, -0.1, -0.1), upper=(0.1, 0.1, 0.1))
    events = rollout(top_view(runner, gravity=0.0, camera=camera, region=far), 6.0).events
    assert of_kind(events, "entry", "exit") == [("entry", "runner", 0.5), ("exit", "runner", 5.5)]


def test_an_object_that_joins_in_view_enters_then() -> None:
    late = body("late", disc(), (0.0, 0.0, 0.2), start_time=0.4)
    region = Region(lower=(-1.0, -1.0, -1.0), upper=(1.0, 1.0, 1.0))
    assert of_kind(rollout(top_view(late, region=region), 1.0).events, "entry", "exit") == [("entry", "late", 0.4)]


def test_without_a_view_there_is_neither_entry_nor_exit() -> None:
    runner = body("runner", disc(), (-1.0, 0.0, 0.2), velocity=(100.0, 0.0, 0.0))
    assert not of_kind(rollout(top_view(runner, gravity=0.0), 2.0).events, "entry", "exit")


def test_rest_is_when_motion_has_ended_for_good() -> None:
    """Slides to rest in v / mu g; an object that never moved has no rest event."""
    mu = 0.2
    slider = body("slider", disc(), (0.0, 0.0, 0.2), velocity=(1.0, 0.0, 0.0), friction=mu)
    still = body("still", disc(), (0.0, 3.0, 0.2), friction=mu)
    (rest,) = of_kind(rollout(top_view(slider, still), 2.0, sample_interval=0.01).events, "rest")
    assert rest[:2] == ("rest", "slider")
    assert rest[2] == pytest.approx(1.0 / (mu * G), abs=0.015)


def bounced(pause: float) -> World:
    """A disc that stops and is struck by another `pause` seconds later."""
    mu, v = 0.2, 1.0
    stop, length = v / (mu * G), v**2 / (2 * mu * G)
    first = body("first", disc(), (0.0, 0.0, 0.2), velocity=(v, 0.0, 0.0), friction=mu)
    second = body(
        "second",
        disc(),
        (length + 0.4 + 0.001, 0.0, 0.2),
        velocity=(-3.0, 0.0, 0.0),
        friction=mu,
        start_time=stop + pause,
    )
    return top_view(first, second)


@pytest.mark.parametrize(("pause", "rests"), [(0.1, 1), (0.4, 2)])
def test_a_short_pause_is_not_rest(pause: float, rests: int) -> None:
    found = of_kind(rollout(bounced(pause), 3.0, sample_interval=0.01).events, "rest")
    assert len([f for f in found if f[1] == "first"]) == rests
