"""Readouts of a rollout: blows out of touches, rows out of series."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.calls.intervals import Span
from atw_mcp.probing import readouts
from polyworld.trajectory import Event, Rollout, Trajectory
from polyworld.world import StaticObject, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Plane, Sphere

FRAME = 0.04
SPAN = Span(0.0, 1.0, FRAME)


def world() -> World:
    return World(
        objects=tuple(RigidObject(name=n, shape=Sphere(radius=0.1), position=(0, 0, 0.1)) for n in ("a", "b")),
        statics=(
            StaticObject(name="floor", shape=Plane()),
            StaticObject(name="side", shape=Plane(normal=(-1.0, 0.0, 0.0), offset=-2.0)),
        ),
    )


def rollout(*events: Event) -> Rollout:
    still = np.zeros((26, 2, 3))
    trajectory = Trajectory(
        names=("a", "b"),
        times=np.arange(26) * FRAME,
        positions=still,
        orientations=np.tile([1.0, 0.0, 0.0, 0.0], (26, 2, 1)),
        velocities=still,
        angular_velocities=still,
        active=np.ones((26, 2), dtype=bool),
    )
    return Rollout(world().id, 1.0, trajectory, tuple(sorted(events, key=lambda e: e.time)))


def touch(
    begin: float, end: float, impulse: float, pair: tuple[str, str] = ("a", "b"), speed: float = 1.0
) -> list[Event]:
    return [
        Event("contact_begin", begin, pair, (0, 0, 0), impulse / 2, speed),
        Event("contact_end", end, pair, None, impulse),
    ]


def test_touches_in_quick_succession_are_one_collision_with_their_whole_impulse() -> None:
    result = rollout(*touch(0.10, 0.11, 1.0), *touch(0.15, 0.16, 2.0), *touch(0.50, 0.51, 4.0))
    rows = readouts.timeline(world(), result, SPAN)
    assert [(row["time"], row["until"], row["touches"], row["impulse_Ns"]) for row in rows] == [
        (0.10, 0.16, 2, 3.0),
        (0.50, 0.51, 1, 4.0),
    ]


def test_standing_on_the_floor_is_left_out_and_a_wall_is_not() -> None:
    result = rollout(*touch(0.0, 0.9, 1.0, ("a", "floor"), speed=0.01), *touch(0.3, 0.4, 1.0, ("a", "side")))
    assert [row["objects"] for row in readouts.timeline(world(), result, SPAN)] == [["a", "side"]]
    assert not readouts.floor_contacts_included(world(), result)


def test_landing_on_the_floor_after_flight_is_reported_and_slow_touches_after_it_are_not() -> None:
    landing = touch(0.2, 0.21, 1.0, ("a", "floor"), speed=0.05)
    slow, fast = (touch(t, t + 0.01, 1.0, ("a", "floor"), speed=v) for t, v in ((0.5, 0.05), (0.7, 0.3)))
    rows = readouts.timeline(world(), rollout(*landing, *slow, *fast), SPAN)
    assert [row["time"] for row in rows] == [0.2, 0.7]
    result = rollout(*landing, *fast)
    assert readouts.floor_contacts_included(world(), result)


def test_collision_that_lasts_into_the_interval_belongs_to_it() -> None:
    result = rollout(*touch(0.1, 0.5, 1.0))
    assert len(readouts.timeline(world(), result, Span(0.3, 0.4, FRAME))) == 1
    assert readouts.timeline(world(), result, Span(0.6, 0.7, FRAME)) == []


def test_collision_that_never_ends_lasts_to_the_end_of_the_rollout() -> None:
    result = rollout(*touch(0.1, 0.12, 1.0), touch(0.15, 0.2, 1.0)[0])
    (row,) = readouts.timeline(world(), result, Span(0.5, 0.6, FRAME))
    assert (row["time"], row["until"], row["touches"]) == (0.1, 1.0, 2)
    assert row["still_touching"]
    assert row["impulse_Ns"] is None  # that of the touch that goes on is not reported


@pytest.mark.parametrize("limit", [2, 3, 7, 24, 99, 100, 101])
def test_thinned_rows_are_evenly_spaced_up_to_the_last(limit: int) -> None:
    rows = [[k] for k in range(100)]
    kept = [k for (k,) in readouts.thinned(rows, limit)]
    assert len(kept) <= limit
    assert (kept[0], kept[-1]) == (0, 99)
    gaps = np.diff(kept)
    assert len(set(gaps[:-1].tolist())) <= 1
    assert gaps[-1] <= gaps[0]


def test_summary_says_how_much_it_leaves_out() -> None:
    rows = readouts.timeline(world(), rollout(*(e for k in range(9) for e in touch(0.1 * k, 0.1 * k, 1.0))), SPAN)
    assert readouts.in_words(rows, most=2).endswith("; and 7 more")
