"""Queries about ropes, cloth, soft bodies and fluids whose motion is written down, so that every answer is known."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.model import mesh_of
from polyworld.probing.predicates import (
    Above,
    AtRest,
    Below,
    Collides,
    Deformed,
    Folded,
    Holds,
    InContact,
    InView,
    Moving,
    Occupies,
    PassesBefore,
    Predicate,
    ReachesBefore,
    Slack,
    Taut,
)
from polyworld.probing.query import QueryResult, query
from polyworld.trajectory import Event, Rollout
from polyworld.world import Region, StaticObject, World
from polyworld.world.representations.cloth import Cloth, Sheet
from polyworld.world.representations.fluid import Container, Fluid, FluidGrid, FluidVolume
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import Box, Plane, Sphere
from tests.polyworld.synthetic import rollout_of

Array = NDArray[np.float64]
TIMES = np.linspace(0.0, 2.0, 41)
T = TIMES[:, None, None]
UP = np.array([0.0, 0.0, 1.0])
ROPE = Rope(name="rope", points=((0.0, 0.0, 2.0), (1.0, 0.0, 2.0)), segments=10, linear_density=0.1)
CLOTH = Cloth(
    name="cloth",
    geometry=Sheet(corner=(0.0, 2.0, 1.0), edge_u=(1.0, 0.0, 0.0), edge_v=(0.0, 1.0, 0.0), divisions=(10, 10)),
)
BALL = Soft(name="ball", shape=Sphere(radius=0.2), position=(0.0, -2.0, 1.0))
WATER = Fluid(
    name="water",
    volumes=(FluidVolume(shape=Box(half_extents=(0.2, 0.2, 0.2)), position=(0.2, 0.2, 0.2)),),
)
OIL = WATER.model_copy(
    update={"name": "oil", "volumes": (FluidVolume(shape=Box(half_extents=(0.2,) * 3), position=(0.2, 0.2, 0.6)),)}
)
WORLD = World(
    objects=(
        RigidObject(name="post", shape=Sphere(radius=0.1), position=(5.0, 0.0, 1.0), representation="rigid_spatial"),
    ),
    deformables=(ROPE, CLOTH, BALL, WATER, OIL),
    statics=(StaticObject(name="floor", shape=Plane(normal=(0.0, 0.0, 1.0))),),
    fluid_grid=FluidGrid(lower=(-1.0, -1.0, 0.0), upper=(3.0, 1.0, 2.0), cell=0.1),
    containers=(Container(name="cup", lower=(-0.1, -0.1, 0.0), upper=(0.4, 0.6, 1.0)),),
    region=Region(lower=(-10.0, -10.0, -1.0), upper=(1.0, 10.0, 10.0)),
)
REST = {d.name: mesh_of(WORLD, d).nodes for d in WORLD.deformables}


def made(**moved: Array) -> Rollout:
    """Everything at rest but what is given; the rope's tension falls from 2 N to nothing within the two seconds."""
    points = {name: np.repeat(nodes[None], len(TIMES), axis=0) for name, nodes in REST.items()} | moved
    tension = np.repeat((2.0 - TIMES)[:, None], 10, axis=1) * np.linspace(1.0, 2.0, 10)
    hit = (
        Event("contact_begin", 0.5, ("ball", "floor"), (0.0, -2.0, 0.0)),
        Event("contact_end", 0.7, ("ball", "floor"), (0.0, -2.0, 0.0)),
    )
    post = (np.tile([5.0, 0.0, 1.0], (len(TIMES), 1)), np.tile([1.0, 0.0, 0.0, 0.0], (len(TIMES), 1)))
    return rollout_of(
        WORLD, TIMES, points, bodies={"post": post}, quantities={"rope": {"tension": tension}}, contacts=hit
    )


def ask(predicate: Predicate, aggregation: Any = "any", interval: Any = None, **moved: Array) -> QueryResult:
    return query(made(**moved), WORLD, predicate, interval, aggregation)


def flowing(rate: float = 0.5) -> Array:
    """The water slides along x without changing its shape."""
    return REST["water"] + rate * T * np.array([1.0, 0.0, 0.0])


def test_the_share_of_a_fluid_in_a_container_falls_as_it_flows_out() -> None:
    # Its block reaches from 0 to 0.4 and leaves over x = 0.4 at 0.5 m/s: half of it is out after 0.4 s.
    half = ask(Occupies(object="water", container="cup", comparison="less_than"), "first", water=flowing())
    assert half.value == pytest.approx(0.4, abs=0.01)
    box = Occupies(object="water", lower=(0.4, -1.0, 0.0), upper=(3.0, 1.0, 2.0), share=0.25)
    assert ask(box, "first", water=flowing()).value == pytest.approx(0.2, abs=0.01)
    assert ask(box, "all", (0.0, 0.15), water=flowing()).value is False
    any_of_it = Occupies(object="rope", lower=(0.95, -1.0, 0.0), upper=(3.0, 1.0, 5.0), share=0.0)
    assert ask(any_of_it).value is True
    assert ask(any_of_it).evidence["share_inside"]["highest"] == pytest.approx(0.05, abs=1e-6)


def test_a_container_holds_amounts_of_one_fluid_or_of_all() -> None:
    whole = 0.4**3
    assert ask(Holds(container="cup", amount=1.9 * whole), "all").value is True
    assert ask(Holds(container="cup", object="water", amount=1.1 * whole)).value is False
    emptied = Holds(container="cup", object="water", comparison="less_than", amount=0.1 * whole)
    assert ask(emptied, "first", water=flowing()).value == pytest.approx(0.9 * 0.8, abs=0.01)
    unknown = ask(Holds(container="jar", amount=1.0))
    assert not unknown.decided
    assert unknown.reason is not None
    assert "cup" in unknown.reason


def test_a_rope_is_taut_until_its_least_tension_falls_below_half_its_weight() -> None:
    limit = 0.5 * 0.1 * 1.0 * 9.81
    slack = ask(Slack(object="rope"), "first")
    assert slack.value == pytest.approx(2.0 - limit, abs=1e-6)
    assert ask(Taut(object="rope"), "all", (0.0, 1.4)).value is True
    assert ask(Taut(object="rope", tension=1.5), "first").value == 0.0
    assert ask(Slack(object="rope", tension=1.5), "first").value == pytest.approx(0.5, abs=1e-6)


def test_statements_about_another_material_are_unknown_and_say_for_what_they_are() -> None:
    for predicate, choice in (
        (Taut(object="cloth"), "rope"),
        (Folded(object="rope"), "cloth"),
        (Deformed(object="water"), "ball"),
        (Holds(container="cup", object="ball", amount=1.0), "water"),
        (Deformed(object="post"), "ball"),
    ):
        answer = ask(predicate)
        assert not answer.decided
        assert answer.value is None
        assert answer.reason is not None
        assert choice in answer.reason


def test_a_cloth_is_folded_from_when_half_of_it_comes_to_lie_on_the_other_half() -> None:
    angle = np.pi * np.clip(TIMES / 1.0, 0.0, 1.0)  # one half turns over the middle line in one second
    x = REST["cloth"][:, 0] - 0.5
    turning = np.where(x > 0, x, 0.0)
    moved = np.repeat(REST["cloth"][None], len(TIMES), axis=0)
    moved[..., 0] = 0.5 + np.where(x > 0, np.cos(angle)[:, None] * turning, x)
    moved[..., 2] = 1.0 + np.sin(angle)[:, None] * turning + 0.005 * (x > 0)
    folded = ask(Folded(object="cloth"), "first", cloth=moved)
    assert folded.value is not None
    assert 0.7 < folded.value < 1.0
    assert ask(Folded(object="cloth")).value is False


def test_deformation_is_the_largest_principal_strain_whatever_the_turn() -> None:
    centre = np.array([0.0, -2.0, 1.0])
    stretch = 1.0 + 0.2 * T
    moved = centre + (REST["ball"] - centre) * np.concatenate([stretch, 1.0 / stretch, np.ones_like(T)], axis=2)
    onset = ask(Deformed(object="ball", strain=0.1), "first", ball=moved)
    assert onset.value == pytest.approx(0.5, abs=0.01)
    assert onset.evidence["largest_strain"]["highest"] == pytest.approx(0.4, abs=1e-6)
    assert ask(Deformed(object="rope", strain=2.0 * 1.9 / 1e4), "all", (0.0, 0.09)).value is True  # tension over EA


def test_resting_is_of_the_points_though_the_centre_stays() -> None:
    swell = 1.0 + 0.1 * np.sin(2.0 * np.pi * T)
    centre = REST["ball"].mean(axis=0)
    breathing = centre + (REST["ball"] - centre) * swell
    assert ask(Moving(object="ball"), "fraction", ball=breathing).value == pytest.approx(1.0, abs=0.15)
    assert ask(AtRest(object="ball"), "all", ball=breathing).value is False
    assert ask(AtRest(object="ball"), "all").value is True


def test_contact_of_a_soft_body_is_that_of_the_events_and_its_closest_approach_that_of_its_points() -> None:
    assert ask(InContact(a="ball", b="floor"), "first").value == 0.5
    missed = ask(InContact(a="ball", b="post"))
    assert missed.value is False
    gap = missed.evidence["closest_approach"]["gap_m"]
    assert gap == pytest.approx(np.hypot(5.0, 2.0) - 0.3, abs=0.02)
    near = ask(InContact(a="water", b="cloth")).evidence["closest_approach"]["gap_m"]
    assert near == pytest.approx(np.hypot(1.6, 0.6), abs=0.08)


def test_above_by_centres_and_entirely_differ_for_things_that_overlap_in_height() -> None:
    assert ask(Above(a="oil", b="water"), "all").value is True
    assert ask(Below(a="water", b="oil", entirely=True), "all").value is True
    hanging = REST["rope"] - UP * np.linspace(0.0, 1.95, 11)[:, None]
    moved = np.repeat(hanging[None], len(TIMES), axis=0)
    assert ask(Above(a="rope", b="water"), "all", rope=moved).value is True
    assert ask(Above(a="rope", b="water", entirely=True), rope=moved).value is False
    assert ask(Above(a="post", b="water", entirely=True, margin=0.49), "all").value is True  # 0.9 above 0.4
    assert ask(Above(a="post", b="water", entirely=True, margin=0.53)).value is False


def test_which_passes_first_may_be_asked_of_the_first_drop_or_of_the_last() -> None:
    moved = {"water": flowing(0.5), "oil": REST["oil"] + np.array([0.25, 0.0, 0.0]) + 0.25 * T * [1.0, 0.0, 0.0]}
    plane: dict[str, Any] = {"a": "water", "b": "oil", "axis": "x", "value": 0.8}
    # Fronts at 0.4 and 0.65: the oil's is first (0.6 s against 0.8 s); rears at 0 and 0.25: the water's (1.6 s, 2.2 s).
    first = ask(PassesBefore(**plane, part="first_point"), **moved)
    assert first.value is False
    assert first.evidence["passes_at_s"]["oil"] == pytest.approx(0.6, abs=0.12)  # half a particle before its border
    last = ask(PassesBefore(**plane, part="last_point"), **moved)
    assert last.value is True
    assert last.evidence["passes_at_s"]["oil"] is None
    box = ReachesBefore(a="water", b="oil", lower=(0.8, -1.0, 0.0), upper=(2.0, 1.0, 2.0), part="first_point")
    assert ask(box, **moved).value is False
    centres = ask(box.model_copy(update={"part": "centre"}), **moved)
    assert centres.evidence["passes_at_s"]["water"] == pytest.approx(1.2, abs=1e-6)
    assert centres.evidence["passes_at_s"]["oil"] == pytest.approx(1.4, abs=1e-6)
    there = ReachesBefore(a="water", b="oil", lower=(-1.0, -1.0, 0.0), upper=(2.0, 1.0, 2.0))
    assert ask(there, **moved).evidence["passes_at_s"]["water"] == 0.0


def test_a_fluid_that_is_not_there_yet_has_no_height_and_is_in_no_container() -> None:
    late = flowing(0.0).repeat(1, axis=0) + 0.0 * T
    late[TIMES < 1.0] = np.nan
    unknown = ask(Above(a="water", b="post"), water=late)
    assert not unknown.decided
    assert unknown.covered == pytest.approx((1.0, 2.0))
    assert ask(Above(a="oil", b="water"), "all", (1.1, 2.0), water=late).value is True
    held = ask(Holds(container="cup", object="water", amount=0.01), "first", water=late)
    assert held.value == pytest.approx(0.97, abs=0.05)  # on the line between the samples before and at 1 s
    never = np.full_like(late, np.nan)
    nothing = ask(Moving(object="water"), water=never)
    assert not nothing.decided
    assert nothing.reason is not None
    assert "none of 'water'" in nothing.reason


def test_a_rope_is_in_view_while_half_of_it_is_and_leaves_when_that_ends() -> None:
    moved = REST["rope"] + 0.5 * T * [1.0, 0.0, 0.0]  # the view ends at x = 1
    view = ask(InView(object="rope"), "fraction", rope=moved)
    assert view.value == pytest.approx(0.5, abs=0.05)
    leaves = [e for e in made(rope=moved).events if e.kind == "exit" and e.participants == ("rope",)]
    assert len(leaves) == 1
    assert leaves[0].time == pytest.approx(1.0, abs=0.1)
    assert leaves[0].position == pytest.approx((1.0, 0.0, 2.0), abs=0.06)


def test_rest_comes_when_all_points_have_come_to_rest() -> None:
    swell = 1.0 + 0.1 * np.sin(2.0 * np.pi * np.minimum(T, 1.0))
    centre = REST["ball"].mean(axis=0)
    events = made(ball=centre + (REST["ball"] - centre) * swell).events
    rests = [e.time for e in events if e.kind == "rest" and e.participants == ("ball",)]
    assert rests[-1] == pytest.approx(1.05, abs=0.051)


def test_a_fluid_touches_what_its_particles_come_close_to_though_no_event_says_so() -> None:
    assert ask(InContact(a="water", b="floor"), "all").value is True
    assert ask(InContact(a="oil", b="floor")).value is False
    assert ask(InContact(a="water", b="oil"), "all").value is True
    rising = REST["water"] + 0.1 * T * UP
    leaves = ask(InContact(a="water", b="floor"), "last", water=rising)
    assert leaves.value == pytest.approx(0.5, abs=0.05)  # half a cell of 0.1 m at 0.1 m/s
    sliding = ask(Collides(a="post", b="water"), "first", water=REST["water"] + 2.4 * T * [1.0, 0.0, 0.18])
    assert sliding.value == pytest.approx((5.0 - 0.1 - 0.05 - 0.4) / 2.4, abs=0.05)
    anything = ask(Collides(a="water"))
    assert not anything.decided
    assert anything.reason is not None
    assert "pair by pair" in anything.reason
