"""Comparison of rollouts whose difference is known on paper."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.edits.interventions import Remove, SetParameter, SetVelocity, branch
from polyworld.probing.compare import compare, positions_at
from polyworld.solver.rollout import rollout
from polyworld.world import World
from tests.verification.planar_scenes import G, body, disc, top_view


def world() -> World:
    red = body("red", disc(), (-1.0, 0.0, 0.2), velocity=(2.0, 0.0, 0.0), restitution=1.0)
    blue = body("blue", disc(), (0.0, 0.0, 0.2), restitution=1.0)
    return top_view(red, blue, gravity=0.0)


def test_a_world_compared_with_itself_shows_no_difference() -> None:
    base = rollout(world(), 2.0)
    same = compare(base, base)
    assert [(o.largest, o.final, o.apart_from) for o in same.objects] == [(0.0, 0.0, None)] * 2
    assert len(same.events_in_both) == len(base.events) > 0
    assert not same.events_only_in_base
    assert not same.events_only_in_other


def test_a_faster_start_shows_as_distance_and_as_a_shift_of_the_collision() -> None:
    """Red at 2.2 instead of 2 m/s: 0.2 t apart, and the touch at 0.6/2.2 instead of 0.3 s."""
    base = rollout(world(), 0.24)
    other = rollout(branch(world(), [SetVelocity(object="red", velocity=(2.2, 0.0, 0.0))]), 1.0)
    result = compare(base, other, ["red"], tolerance=0.01)
    assert result.horizon == pytest.approx(0.24)
    (red,) = result.objects
    assert red.final == pytest.approx(0.048, abs=1e-9)
    assert red.largest_time == pytest.approx(0.24)
    assert red.apart_from == pytest.approx(0.05, abs=1e-9)
    longer = compare(rollout(world(), 1.0), other)
    begin = next(m for m in longer.events_in_both if m.base.kind == "contact_begin")
    assert begin.shift == pytest.approx(0.6 / 2.2 - 0.3, abs=1e-6)


def test_a_removed_object_takes_its_events_with_it() -> None:
    base = rollout(world(), 1.0)
    other = rollout(branch(world(), [Remove(object="red")]), 1.0)
    result = compare(base, other)
    assert result.objects_only_in_base == ("red",)
    assert {e.kind for e in result.events_only_in_base} >= {"contact_begin", "contact_end"}
    (blue,) = result.objects
    assert blue.final == pytest.approx(2.0 * 0.7, abs=1e-6)  # it left at 0.3 s with 2 m/s
    back = compare(other, base)
    assert back.objects_only_in_other == ("red",)
    assert len(back.events_only_in_other) == len(result.events_only_in_base)


def test_other_sample_times_are_met_by_the_cubic_through_positions_and_velocities() -> None:
    """Uniform deceleration is a parabola: the cubic is exact; sampled at 0.03 s against 0.05 s."""
    thrown = top_view(body("a", disc(), (0.0, 0.0, 0.2), velocity=(3.0, 0.0, 0.0), friction=0.1))
    rough = branch(thrown, [SetParameter(path="objects.a.friction", value=0.2)])
    result = compare(rollout(thrown, 1.0, sample_interval=0.05), rollout(rough, 1.0, sample_interval=0.03))
    assert result.objects[0].final == pytest.approx(0.5 * 0.1 * G, abs=1e-9)
    trajectory = rollout(thrown, 1.0, sample_interval=0.05).trajectory
    t = np.linspace(0, 1, 37)
    np.testing.assert_allclose(positions_at(trajectory, 0, t)[:, 0], 3 * t - 0.5 * 0.1 * G * t**2, atol=1e-12)


def test_an_unknown_object_is_refused_by_name() -> None:
    base = rollout(world(), 0.2)
    with pytest.raises(KeyError, match=r"unknown objects \['pink'\]; objects in either rollout: \['red', 'blue'\]"):
        compare(base, base, ["red", "pink"])


def test_the_comparison_is_json_ready() -> None:
    import json

    base = rollout(world(), 1.0)
    assert json.loads(json.dumps(compare(base, base).to_dict()))["objects"][0]["name"] == "red"
