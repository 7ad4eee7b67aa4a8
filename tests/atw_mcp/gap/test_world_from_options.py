"""Worlds written as options of `atw-mcp gap`."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

import pytest

from atw_mcp.gap.options import EXAMPLES, add_world_options
from atw_mcp.gap.world_from_options import world_of
from polyworld.world import World
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere


def made(*given: str) -> World:
    """The world of some options."""
    parser = argparse.ArgumentParser()
    add_world_options(parser)
    return world_of(parser.parse_args(list(given)))


@pytest.mark.parametrize(
    ("text", "shape", "mass"),
    [
        ("ball:sphere:0.02m:2.7g", Sphere(radius=0.02), 0.0027),
        ("ball:sphere:d=40mm:2.7e-3", Sphere(radius=0.02), 0.0027),
        ("ball:sphere: r = 2 cm : 1 oz", Sphere(radius=0.02), 0.028349523125),
        ("die:box:40x40x20mm:50g", Box(half_extents=(0.02, 0.02, 0.01)), 0.05),
        ("die:box:4cm x 0.04 m x 20mm:50g", Box(half_extents=(0.02, 0.02, 0.01)), 0.05),
        ("die:box:0.1×0.2×0.3:1kg", Box(half_extents=(0.05, 0.1, 0.15)), 1.0),
        ("die:box:5cm:1lb", Box(half_extents=(0.025, 0.025, 0.025)), 0.45359237),
        ("can:cylinder:r=2cm,h=5cm:100g", Cylinder(radius=0.02, half_height=0.025), 0.1),
        ("puck:disc:d=76mm,h=25mm:170g", Cylinder(radius=0.038, half_height=0.0125), 0.17),
    ],
)
def test_bodies_have_their_shapes_and_masses_in_si(text: str, shape: Sphere | Box | Cylinder, mass: float) -> None:
    (item,) = made("--object", text).objects
    given, expected = item.shape.model_dump(), shape.model_dump()
    assert given.keys() == expected.keys()
    assert given.pop("kind") == expected.pop("kind")
    for field, value in expected.items():
        assert given[field] == pytest.approx(value)
    assert item.mass == pytest.approx(mass)
    assert item.representation == "rigid_spatial"


@pytest.mark.parametrize("text", EXAMPLES.values())
def test_the_examples_that_messages_show_are_valid(text: str) -> None:
    assert made("--object", text).moving_names == (text.partition(":")[0],)


def test_bodies_stand_side_by_side_on_the_floor() -> None:
    world = made(
        *("--object", "ball:sphere:2cm:1g", "--object", "die:box:10x20x30cm:1kg"),
        *("--floor=-50cm", "--restitution", "0.7", "--friction", "0.2", "--gravity", "1.62"),
    )
    ball, die = world.objects
    assert (ball.restitution, ball.friction, die.restitution) == (0.7, 0.2, 0.7)
    assert ball.position[2] == pytest.approx(-0.48)
    assert die.position[2] == pytest.approx(-0.35)
    assert math.dist(ball.position[:2], die.position[:2]) > 0.5
    (floor,) = world.statics
    assert isinstance(floor.shape, Plane)
    assert floor.position == (0.0, 0.0, -0.5)
    assert floor.restitution is None  # so that a fit of the ball's own restitution changes its bounces
    assert world.environment.gravity == (0.0, 0.0, -1.62)


def test_without_a_floor_there_is_nothing_but_gravity() -> None:
    world = made("--object", "ball:sphere:2cm:1g")
    assert world.statics == ()
    assert world.environment.gravity == (0.0, 0.0, -9.81)
    assert made("--object", "ball:sphere:2cm:1g", "--floor").statics[0].position == (0.0, 0.0, 0.0)


def test_bodies_on_a_plane_are_planar_and_a_disc_needs_no_thickness_there() -> None:
    world = made("--object", "puck:disc:r=38mm:170g", "--on-plane")
    assert world.planar
    with pytest.raises(ValueError, match="a disc needs its height h, as in puck:disc:"):
        made("--object", "puck:disc:r=38mm:170g")


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["ball:sphere:2.7g"], "--object 'ball:sphere:2.7g' has 3 parts, expected NAME:SHAPE:SIZE:MASS, such as ball:"),
        (["ball:ball:2cm:1g"], "'ball' is no shape; choose from sphere, box, cylinder, disc"),
        (["ball:sphere:2kg:1g"], "'kg' is no unit of length; choose from m, cm"),
        (["ball:sphere:2cm:1mm"], "'mm' is no unit of mass; choose from kg, g"),
        (["ball:sphere:-2cm:1g"], "'-2cm' must be positive"),
        (["ball:sphere:r=2cm,d=4cm:1g"], "needs its radius r or its diameter d, one of them"),
        (["ball:sphere:h=2cm:1g"], "size 'h=2cm' is not that of a sphere"),
        (["can:cylinder:r=2cm:1g"], "a cylinder needs its height h"),
        (["can:cylinder:h=2cm:1g"], "a cylinder needs its radius r or its diameter d"),
        (["die:box:2x3cm:1g"], "a box has three edges, as in die:box:"),
        (["my ball:sphere:2cm:1g"], "'my ball:sphere:2cm:1g': name: String should match"),
        (["a:sphere:2cm:1g", "--object", "a:sphere:2cm:1g"], "must be unique; repeated: ['a']"),
        (["a:sphere:2cm:1g", "--restitution", "2"], "restitution: Input should be less than or equal to 1"),
        (["a:sphere:2cm:1g", "--floor", "low"], "--floor: 'low' is not a number with a unit of length"),
        (["a:sphere:2cm:1g", "--floor", "--on-plane"], "--on-plane and --floor exclude each other"),
    ],
)
def test_options_that_describe_no_world_are_refused_in_one_sentence(given: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=r"\w") as raised:
        made("--object", *given)
    assert message in str(raised.value)
    assert "\n" not in str(raised.value)


def test_options_of_objects_do_not_go_with_a_file(tmp_path: Path) -> None:
    path = tmp_path / "world.json"
    path.write_text(made("--object", "ball:sphere:2cm:1g").model_dump_json())
    assert made("--world", str(path)).moving_names == ("ball",)
    with pytest.raises(ValueError, match="--floor, --gravity go with --object; with --world, write them into"):
        made("--world", str(path), "--floor", "--gravity", "9.8")
