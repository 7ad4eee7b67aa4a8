"""Unknowns of a spatial world: no motion that a support forbids, ordinary values as priors, sets share theirs."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.unknown import Unknown
from polyworld.estimation.world_fit import default_unknowns, plausible_unknowns, with_supports
from polyworld.estimation.world_fit.plausible import joint_unknowns, with_prior
from polyworld.world import StaticObject, World
from polyworld.world.representations.joint import Hinge, Slider
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Sphere
from tests.polyworld.estimation.world_fit.floor_scenes import (
    FLOOR,
    GRAVITY,
    RADIUS,
    ball,
    box,
    frames,
    scene,
    slowed,
    tracks_of,
    upright,
)

COUNT = 20


def along(speed: float, *, y: float = 0.0, x: float = 0.0, z: float = RADIUS) -> np.ndarray:
    return np.stack([x + speed * frames(COUNT), np.full(COUNT, y), np.full(COUNT, z)], axis=1)


def unknowns(world: World, tracks: ObservedTracks) -> dict[str, Unknown]:
    found = plausible_unknowns(world, tracks, default_unknowns(world, tracks, shared=()))
    return {path: u for u in found for path in u.paths}


def world_of(objects: list[RigidObject], tracks: ObservedTracks, statics: tuple[StaticObject, ...] = (FLOOR,)) -> World:
    return with_supports(scene(objects, tracks, statics=statics), tracks)


def test_a_body_on_a_level_floor_has_no_vertical_motion_to_fit() -> None:
    tracks = tracks_of({"box": slowed(frames(COUNT), 1.0, 1.0), "ball": along(0.8, y=2.0)},
                       orientations={"box": upright(COUNT)})  # fmt: skip
    found = unknowns(world_of([box(), ball()], tracks), tracks)
    for name in ("box", "ball"):
        assert f"objects.{name}.velocity.x" in found
        assert not {f"objects.{name}.{field}.z" for field in ("position", "velocity")} & set(found)
    assert not {f"objects.box.{field}.{axis}" for field in ("rotation", "angular_velocity") for axis in "xy"} & set(
        found
    )


def test_a_ball_in_the_air_may_spin_about_any_axis_and_a_rolling_one_about_level_ones() -> None:
    flying = along(1.0, z=1.5) - np.stack([0 * frames(COUNT)] * 2 + [GRAVITY / 2 * frames(COUNT) ** 2], axis=1)
    tracks = tracks_of({"flying": flying, "rolling": along(0.6, y=2.0)})
    world = world_of([ball("flying"), ball("rolling")], tracks)
    found = unknowns(world, tracks)
    spins = {n: {a for a in "xyz" if f"objects.{n}.angular_velocity.{a}" in found} for n in ("flying", "rolling")}
    assert spins == {"flying": set("xyz"), "rolling": set("xy")}
    # It starts rolling without slip along x, about +y.
    rolling = found["objects.rolling.angular_velocity.y"]
    assert rolling.prior is not None
    assert rolling.prior[0] == pytest.approx(0.6 / RADIUS, rel=0.1)
    assert rolling.lower < 0.0 < rolling.upper  # it may as well slide, or spin backwards


def test_a_cart_on_a_track_moves_along_it_alone() -> None:
    tracks = tracks_of({"box": along(0.8)}, orientations={"box": upright(COUNT)})
    track = Slider(name="track", object="box", anchor=(0.0, 0.0, RADIUS), axis=(1.0, 0.0, 0.0))
    found = unknowns(scene([box()], tracks, statics=(), joints=(track,)), tracks)
    speeds = {path for path in found if ".velocity." in path or ".angular_velocity." in path}
    assert speeds == {"objects.box.velocity.x"}


def test_what_can_roll_may_resist_rolling_and_a_box_may_not() -> None:
    tracks = tracks_of({"box": along(1.0), "ball": along(0.8, y=2.0)}, orientations={"box": upright(COUNT)})
    found = unknowns(world_of([box(), ball()], tracks), tracks)
    assert "objects.box.rolling_resistance" not in found
    mean, sd = found["objects.ball.rolling_resistance"].prior or (0.0, 0.0)
    assert 0.001 * RADIUS < mean < 0.1 * RADIUS  # of rubber on wood to steel on felt
    assert sd > 0.0


def test_three_bodies_that_are_alike_share_contact_parameters_and_two_do_not() -> None:
    rolling = {name: along(0.5 - 0.1 * k, y=0.21 * k) for k, name in enumerate("abc")}
    for names in ("ab", "abc"):
        tracks = tracks_of({name: rolling[name] for name in names})
        found = unknowns(world_of([ball(name) for name in names], tracks), tracks)
        for field in ("friction", "restitution", "rolling_resistance"):
            own = {found[f"objects.{name}.{field}"].name for name in names}
            assert len(own) == (1 if names == "abc" else 2), field
        masses = {path for path in found if path.endswith(".mass")}
        assert len(masses) == (0 if names == "abc" else 1)  # of two that may meet, one is the unit
        assert len({found[f"objects.{name}.velocity.x"].name for name in names}) == len(names)


def test_a_body_of_another_size_stays_out_of_the_set() -> None:
    tracks = tracks_of({name: along(0.5, y=0.21 * k) for k, name in enumerate("abcd")})
    objects = [ball(name) for name in "abc"] + [ball("d", shape=Sphere(radius=0.099))]
    found = unknowns(world_of(objects, tracks), tracks)
    assert found["objects.d.friction"].paths == ("objects.d.friction",)
    assert set(found["objects.a.friction"].paths) == {f"objects.{name}.friction" for name in "abc"}


def test_walls_and_floors_get_coefficients_of_their_own_where_bodies_also_meet() -> None:
    wall = StaticObject(
        name="wall", shape=Box(half_extents=(0.05, 1.0, 0.2)), position=(0.9, 0.0, 0.2), restitution=None
    )
    apart = {"a": along(1.0, y=0.0), "b": along(0.3, y=1.5, x=-1.0)}
    near = {"a": along(1.0, y=0.0), "b": along(0.3, y=0.22)}
    for places, has in ((apart, False), (near, True)):
        tracks = tracks_of(places)
        found = unknowns(world_of([ball("a"), ball("b")], tracks, (FLOOR, wall)), tracks)
        assert ("statics.wall.restitution" in found) is has
        assert "statics.floor.restitution" not in found  # they rest on it
        assert ("statics.floor.friction" in found) is has


def test_priors_that_were_given_are_kept_and_states_have_none() -> None:
    world = World(objects=(ball(),))
    given = Unknown("ball.friction", ("objects.ball.friction",), "1", 0.1, 0.0, 1.0, 0.1, prior=(0.1, 0.01))
    assert with_prior(world, given) == given
    speed = Unknown("ball.velocity.x", ("objects.ball.velocity.x",), "m/s", 1.0, 0.0, 2.0, 0.1)
    assert with_prior(world, speed) == speed
    free = with_prior(world, Unknown("ball.friction", ("objects.ball.friction",), "1", 0.5, 0.0, 1.0, 0.1))
    assert free.prior is not None
    assert free.upper > 1.0  # rubber on rubber


def test_the_resistance_searched_for_a_joint_scales_with_what_hangs_on_it() -> None:
    """Dry friction is a moment at a hinge, m g l at most of that order, and a force at a slider."""
    arm, mass = 0.8, 2.5
    swing = np.stack([arm * np.sin(0.3 * np.cos(frames(COUNT))), 0 * frames(COUNT), 0 * frames(COUNT) + 2.0], axis=1)
    tracks = tracks_of({"bob": swing})
    bob = ball("bob", mass=mass)
    for joint, weight in (
        (Hinge(name="j", object="bob", anchor=(float(swing[0, 0]), 0.0, 2.0 + arm), axis=(0.0, 1.0, 0.0)), arm),
        (Slider(name="j", object="bob", anchor=(0.0, 0.0, 2.0), axis=(1.0, 0.0, 0.0)), 1.0),
    ):
        world = scene([bob], tracks, joints=(joint,))
        found = {u.name: u for u in joint_unknowns(world, tracks)}
        assert set(found) == {"j.friction", "j.damping"}
        assert found["j.friction"].upper / (mass * GRAVITY * weight) == pytest.approx(0.3, rel=0.05)
