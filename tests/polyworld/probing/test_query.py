"""Queries on motion that is known on paper; what is not covered is unknown, never false."""

from __future__ import annotations

from typing import Any

import pytest

from polyworld.probing.predicates import (
    AtRest,
    Collides,
    ComesToRest,
    InContact,
    InsideRegion,
    InView,
    MovedByMoreThan,
    Moving,
    NearerThan,
    PassesBefore,
    Predicate,
    WithinDistance,
)
from polyworld.probing.query import QueryResult, query
from polyworld.solver.rollout import rollout
from polyworld.world import MotionPlane, Region, StaticObject, World
from polyworld.world.shapes import Sphere, Wall
from tests.verification.planar_scenes import body, disc, side_view, top_view


def world(**fields: Any) -> World:
    """Red reaches blue at 0.3 s and stops dead; blue goes on at 2 m/s, reaches the wall at x = 1 at 0.7 s."""
    red = body("red", disc(), (-1.0, 0.0, 0.2), velocity=(2.0, 0.0, 0.0), restitution=1.0)
    blue = body("blue", disc(), (0.0, 0.0, 0.2), restitution=1.0)
    late = body("late", disc(), (0.0, 5.0, 0.2), velocity=(1.0, 0.0, 0.0), start_time=0.5)
    wall = StaticObject(name="wall", shape=Wall(start=(1.01, -2.0, 0.0), end=(1.01, 2.0, 0.0)))
    return top_view(red, blue, late, gravity=0.0, statics=(wall,), **fields)


def ask(predicate: Predicate, interval: Any = None, aggregation: Any = "any", *, horizon: float = 1.0) -> QueryResult:
    return query(rollout(world(), horizon), world(), predicate, interval, aggregation)


def test_contacts_are_found_with_their_times() -> None:
    hit = ask(Collides(a="red", b="blue"), aggregation="first")
    assert hit.value == pytest.approx(0.3, abs=1e-6)
    assert ask(Collides(a="blue"), aggregation="count").value == 2  # red, then the wall
    assert ask(Collides(a="blue", b="wall")).value is True
    assert ask(Collides(a="red", b="wall")).value is False
    assert ask(InContact(a="blue", b="wall"), (0.0, 0.5)).value is False
    assert ask(InContact(a="blue", b="wall"), aggregation="first").value == pytest.approx(0.7, abs=1e-6)


def test_moving_and_resting_have_times_and_fractions() -> None:
    assert ask(Moving(object="blue"), (0.0, 0.25)).value is False
    moving = ask(Moving(object="blue"), (0.0, 0.6), "first")
    assert moving.value == pytest.approx(0.3, abs=0.04)  # one sample
    still = ask(AtRest(object="red"), (0.0, 0.6), "fraction")
    assert still.value == pytest.approx(0.5, abs=0.07)
    assert ask(AtRest(object="red"), (0.0, 0.2), "all").value is False
    assert ask(AtRest(object="red"), (0.4, 0.6), "all").value is True
    evidence = ask(Moving(object="red"), (0.0, 0.2)).evidence["speed_m_per_s"]
    assert evidence["highest"] == pytest.approx(2.0)


def test_places_are_found_on_the_line_between_samples() -> None:
    """Red's centre passes x = -0.9 at 0.05 s and x = -0.61 at 0.195 s."""
    region = InsideRegion(object="red", lower=(-0.9, -1.0, 0.0), upper=(-0.61, 1.0, 1.0))
    result = ask(region)
    assert result.intervals[0] == pytest.approx((0.05, 0.195), abs=1e-9)
    assert ask(region, aggregation="last").value == pytest.approx(0.195, abs=1e-9)
    near = ask(NearerThan(a="red", b="blue", distance=0.8), (0.0, 0.3), "first")
    assert near.value == pytest.approx(0.1, abs=1e-9)


def test_the_view_is_the_region_where_there_is_no_camera() -> None:
    seen = world(region=Region(lower=(-0.8, -9.0, -9.0), upper=(9.0, 9.0, 9.0)))
    result = query(rollout(seen, 0.2), seen, InView(object="red"), None, "first")
    assert result.value == pytest.approx(0.1, abs=1e-9)
    without = ask(InView(object="red"))
    assert (without.value, without.decided) == (None, False)
    assert without.reason is not None
    assert "neither a camera nor a region" in without.reason


def test_who_arrives_first_is_decided_by_the_crossings() -> None:
    """Red passes x = -0.7 at 0.15 s; blue never does."""
    assert ask(PassesBefore(a="red", b="blue", axis="x", value=-0.7)).value is True
    assert ask(PassesBefore(a="blue", b="red", axis="x", value=-0.7)).value is False
    neither = ask(PassesBefore(a="red", b="blue", axis="y", value=3.0))
    assert neither.value is None
    assert not neither.decided


@pytest.mark.parametrize(
    ("predicate", "interval", "reason"),
    [
        (Moving(object="pink"), None, "'pink' is not in this world; objects: ['red', 'blue', 'late']"),
        (Moving(object="wall"), None, "'wall' is static"),
        (Collides(a="wall", b="red"), None, "give the object that moves first"),
        (Moving(object="red"), (2.0, 3.0), "lies outside the covered 0 to 1 s"),
        (Moving(object="late"), (0.0, 0.4), "'late' joins at 0.5 s"),
    ],
)
def test_what_is_not_covered_is_unknown_with_its_reason(predicate: Predicate, interval: Any, reason: str) -> None:
    result = ask(predicate, interval)
    assert (result.value, result.decided) == (None, False)
    assert result.reason is not None
    assert reason in result.reason


def test_partial_coverage_decides_only_what_it_can() -> None:
    """The rollout ends at 0.25 s, before the collision."""

    def part(predicate: Predicate, aggregation: str) -> Any:
        return ask(predicate, (0.0, 2.0), aggregation, horizon=0.25)

    assert part(Moving(object="red"), "any").value is True
    assert part(Moving(object="red"), "all").value is None
    assert part(Moving(object="blue"), "any").value is None
    assert part(Moving(object="blue"), "all").value is False
    assert part(Moving(object="red"), "first").value == 0.0
    assert part(Moving(object="red"), "last").value is None
    assert part(Collides(a="red", b="blue"), "count").value is None
    assert part(Collides(a="red", b="blue"), "any").decided is False


def test_the_default_stretch_begins_when_the_last_named_object_joins() -> None:
    """Late joins at 0.5 s, five metres away from red, and both have a radius of 0.2 m."""
    result = ask(Collides(a="late", b="red"))
    assert (result.value, result.decided, result.asked) == (False, True, (0.5, 1.0))
    assert ask(Moving(object="late"), aggregation="all").value is True
    early = ask(Collides(a="late", b="red"), (0.0, 1.0))
    assert not early.decided
    assert early.reason is not None
    assert "'late' joins at 0.5 s. Asked over [0.5, 1] it is false" in early.reason
    before = ask(Moving(object="late"), (0.0, 0.2))
    assert not before.decided
    assert before.reason is not None
    assert "'late' joins at 0.5 s. Asked over [0.5, 1] it is true" in before.reason
    assert not ask(Moving(object="late"), horizon=0.25).decided


def test_contacts_report_how_near_the_surfaces_come() -> None:
    """Blue's surface reaches x = 0.8 at 0.6 s, where the wall's face is at 1.0; late begins its way at (0, 5)."""
    free = ask(Collides(a="blue", b="wall"), (0.0, 0.6)).evidence["closest_approach"]
    assert free == {"gap_m": pytest.approx(0.2, abs=1e-6), "time": pytest.approx(0.6), "with": "wall"}
    hit = ask(Collides(a="blue"), (0.5, 1.0)).evidence["closest_approach"]
    assert hit == {"gap_m": 0.0, "time": pytest.approx(0.7, abs=1e-6), "with": "wall"}
    apart = ask(NearerThan(a="red", b="late", distance=0.1)).evidence["closest_approach"]
    assert apart["gap_m"] == pytest.approx((5.0**2 + 0.4**2) ** 0.5 - 0.4, abs=1e-6)  # red stands at x = -0.4
    assert apart["time"] == pytest.approx(0.5)


def test_a_question_that_makes_no_sense_is_refused() -> None:
    with pytest.raises(ValueError, match="start <= end"):
        ask(Moving(object="red"), (1.0, 0.5))
    with pytest.raises(ValueError, match="holds at instants"):
        ask(Collides(a="red"), None, "fraction")
    with pytest.raises(ValueError, match="its only aggregation is any"):
        ask(PassesBefore(a="red", b="blue", axis="x", value=0.0), None, "count")
    with pytest.raises(ValueError, match="the rollout is of"):
        query(rollout(world(), 0.1), side_view(body("red", Sphere(radius=0.1), (0, 0, 1))), Moving(object="red"))


def test_states_say_how_fine_their_samples_are_and_contacts_are_exact() -> None:
    fine = query(rollout(world(), 1.0, sample_interval=0.01), world(), Moving(object="blue"), aggregation="first")
    assert fine.sampled_every == pytest.approx(0.01)
    assert fine.value == pytest.approx(0.3, abs=0.01)
    assert ask(Collides(a="red", b="blue")).sampled_every is None


def test_displacement_is_measured_from_where_the_object_was_at_a_time() -> None:
    assert ask(MovedByMoreThan(object="red", distance=0.5)).value is True  # 0.6 m to the contact
    assert ask(MovedByMoreThan(object="red", distance=0.7)).value is False
    since = ask(MovedByMoreThan(object="red", distance=0.3, since=0.1), aggregation="first")
    assert since.value == pytest.approx(0.1 + 0.3 / 2.0, abs=1e-3)
    before = ask(MovedByMoreThan(object="red", distance=0.1, since=0.28), (0.0, 0.2))
    assert before.value is False  # nothing counts before that time
    unknown = ask(MovedByMoreThan(object="late", distance=0.1))
    assert not unknown.decided
    assert "known for 0.5" in (unknown.reason or "")


def test_surfaces_come_within_a_distance_before_they_touch() -> None:
    """Balls of 0.2 m: the gap is 0.6 m at first and closes at 2 m/s; the wall stands 1.01 m from blue's centre."""
    near = ask(WithinDistance(a="red", b="blue", distance=0.2), aggregation="first")
    assert near.value == pytest.approx(0.2, abs=1e-3)
    assert ask(WithinDistance(a="red", b="wall", distance=0.5)).value is False
    assert ask(WithinDistance(a="blue", b="wall", distance=0.01)).value is True
    at_a_place = ask(WithinDistance(a="blue", place=(0.5, 0.0, 0.2), distance=0.1), aggregation="first")
    assert at_a_place.value == pytest.approx(0.3 + 0.4 / 2.0, abs=0.01)
    with pytest.raises(ValueError, match="give b or place"):
        WithinDistance(a="red", distance=0.1)


def test_coming_to_rest_happens_at_an_instant() -> None:
    """Red stops dead in the contact at 0.3 s; blue never rests."""
    rests = ComesToRest(object="red")
    assert ask(rests, aggregation="first").value == pytest.approx(0.3, abs=0.03)
    assert ask(rests, aggregation="count").value == 1
    assert ask(rests, (0.0, 0.2)).value is False
    assert ask(ComesToRest(object="blue")).value is False
    assert not ask(ComesToRest(object="blue"), (0.0, 6.0)).decided
    with pytest.raises(ValueError, match="holds at instants"):
        ask(rests, aggregation="all")


def test_a_ball_that_spins_about_the_vertical_comes_to_rest_where_its_centre_stops() -> None:
    """Sliding friction mu stops it after v / (mu g); nothing but a point of contact slows its spin."""
    ball = body("ball", Sphere(radius=0.1), (0.0, 0.0, 0.1), velocity=(1.0, 0.0, 0.0), friction=0.4)
    world = top_view(
        ball.model_copy(update={"angular_velocity": (0.0, 0.0, 5.0)}), motion_plane=MotionPlane(friction=0.4)
    )
    run = rollout(world, 1.0)
    assert run.trajectory.angular_velocities[-1, 0, 2] == pytest.approx(5.0, rel=0.2)
    stops = 1.0 / (0.4 * 9.81)
    for statement in (AtRest(object="ball"), ComesToRest(object="ball")):
        assert query(run, world, statement, aggregation="first").value == pytest.approx(stops, abs=0.05)


@pytest.mark.parametrize(
    ("predicate", "aggregation", "margin", "unit"),
    [
        (MovedByMoreThan(object="red", distance=0.5), "any", 0.1, "m"),
        (NearerThan(a="red", b="blue", distance=0.3), "any", -0.1, "m"),
        (Moving(object="red", speed=0.5), "any", 1.5, "m/s"),
        (Moving(object="red", speed=0.5), "all", -0.5, "m/s"),
        (Collides(a="red", b="wall"), "any", None, "m"),
        (Collides(a="red", b="blue"), "any", 0.0, "m"),
    ],
)
def test_an_answer_has_a_margin_of_its_own_sign(
    predicate: Predicate, aggregation: Any, margin: float | None, unit: str
) -> None:
    answer = ask(predicate, aggregation=aggregation)
    assert answer.margin is not None
    assert answer.margin_unit == unit
    if margin is None:
        margin = -answer.evidence["closest_approach"]["gap_m"]
    assert answer.margin == pytest.approx(margin, abs=0.05)
    assert (answer.value is True) == (answer.margin >= 0.0)
