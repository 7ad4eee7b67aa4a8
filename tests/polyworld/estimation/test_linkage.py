"""Initial states of jointed bodies: double pendulums and carts, against their own geometry and SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.recording import Run
from polyworld.estimation.linkage import linkages
from polyworld.estimation.states import state_coordinates
from polyworld.world import World
from tests.polyworld.double_pendulum import LOWER, MASS, RADIUS, UPPER, angles

Array = NDArray[np.float64]
SIGMA = 0.001
TIMES = np.arange(90) / 60.0


def ball(name: str, position: tuple[float, float, float], **more: Any) -> dict[str, Any]:
    return {"name": name, "shape": {"kind": "sphere", "radius": RADIUS}, "mass": MASS, "position": position, **more}


def hinge(name: str, anchor: tuple[float, float, float], **more: Any) -> dict[str, Any]:
    return {"kind": "hinge", "name": name, "anchor": anchor, "axis": (0, 1, 0), **more}


def double(**second: Any) -> World:
    """Two balls that hang: one from the origin, the other from the first. The second joint names them the other way."""
    place = (0.0, 0.0, -UPPER)
    return World.model_validate(
        {
            "objects": [ball("b", (0, 0, -UPPER - LOWER)), ball("a", place)],
            "joints": [hinge("h2", place, object="a", other="b", **second), hinge("h1", (0, 0, 0), object="a")],
            "time": {"substep": 0.002},
        }
    )


def cart(**slider: Any) -> World:
    """A ball on a rail along x, and one that hangs from it."""
    rail = {"kind": "slider", "name": "rail", "object": "a", "anchor": (0, 0, 0), "axis": (1, 0, 0)} | slider
    return World.model_validate(
        {
            "objects": [ball("a", (0, 0, 0)), ball("b", (0, 0, -LOWER))],
            "joints": [rail, hinge("h", (0, 0, 0), object="b", other="a")],
        }
    )


def hung(long: float, angle: Array) -> Array:
    """Where a rod of a length ends that is turned by an angle (T,) about y from hanging."""
    return long * np.stack([-np.sin(angle), 0.0 * angle, -np.cos(angle)], axis=-1)


def run(places: dict[str, Array], seed: int = 0, name: str = "r") -> Run:
    """A run of noisy places (T, 3) by name, y not measured."""
    measured = np.stack(list(places.values()), axis=1)
    measured = measured + np.random.default_rng(seed).normal(0.0, SIGMA, measured.shape)
    measured[:, :, 1] = np.nan
    return Run(name, tuple(places), TIMES, measured, np.full((len(TIMES), len(places), 4), np.nan))


def swung(start: tuple[float, float, float, float], damping: float = 0.0) -> dict[str, Array]:
    """A double pendulum by Lagrange's equations, with the balls' own inertia: angles from hanging, and their rates.

    damping [N m s/rad]: of the upper hinge.
    """
    found = angles(start, TIMES, damping)
    upper = hung(UPPER, found[0])
    return {"a": upper, "b": upper + hung(LOWER, found[1])}


def test_places_and_velocities_follow_from_the_joints_coordinates() -> None:
    (tree,) = linkages(double())
    assert tree.labels == ("angle", "rate", "b.angle", "b.rate")
    angle, turn = np.array([0.4]), np.array([-0.7])
    values = np.array([[0.4, 1.1, -0.7, 2.0]])
    found = tree.overrides(values, {})
    for name, place in (("a", hung(UPPER, angle)), ("b", hung(UPPER, angle) + hung(LOWER, angle + turn))):
        placed = [found[f"objects.{name}.position.{axis}"][0] for axis in "xyz"]
        assert placed == pytest.approx(place[0], abs=1e-12)
    step = 1e-6
    after = tree.overrides(values + step * np.array([[1.1, 0.0, 2.0, 0.0]]), {})
    for name in "ab":
        for axis in "xyz":
            moved = (after[f"objects.{name}.position.{axis}"] - found[f"objects.{name}.position.{axis}"]) / step
            assert found[f"objects.{name}.velocity.{axis}"] == pytest.approx(moved, abs=1e-5)
        assert found[f"objects.{name}.angular_velocity.y"] == pytest.approx(1.1 if name == "a" else 3.1)
    assert [found[f"joints.h2.anchor.{axis}"][0] for axis in "xz"] == pytest.approx(hung(UPPER, angle)[0, ::2])


def test_a_double_pendulum_starts_where_its_first_samples_say() -> None:
    (found,) = state_coordinates(double(), run(swung((1.2, 0.4, 0.5, -1.0))))
    assert found.start == pytest.approx([1.2, 0.5, -0.8, -1.5], abs=0.3)


def test_a_cart_that_carries_a_pendulum_starts_where_its_first_samples_say() -> None:
    place = np.stack([0.1 + 0.4 * TIMES, 0 * TIMES, 0 * TIMES], axis=-1)
    measured = run({"a": place, "b": place + hung(LOWER, 0.3 - 0.5 * TIMES)})
    (found,) = state_coordinates(cart(), measured)
    assert found.labels == ("a.displacement", "a.rate", "a.b.angle", "a.b.rate")
    assert found.start == pytest.approx([0.1, 0.4, 0.3, -0.5], abs=0.05)


@pytest.mark.parametrize(
    "joint",
    [
        hinge("h1", (0, 0, 0), object="a") | {"axis": (1, 0, 0)},  # it would tilt the other's axis
        {"kind": "ball", "name": "h1", "object": "a", "anchor": (0, 0, 0)},
    ],
)
def test_what_is_held_otherwise_starts_as_the_world_says(joint: dict[str, Any]) -> None:
    world = World.model_validate(double().model_dump() | {"joints": [double().joints[0].model_dump(), joint]})
    assert linkages(world) == ()
    measured = run(swung((0.0, 0.0, 0.0, 0.1)))
    assert state_coordinates(world, measured) == ()


def test_a_body_that_was_not_seen_starts_as_the_world_says_on_what_was() -> None:
    world = cart().model_dump()
    world["objects"][1]["angular_velocity"] = (0.0, 2.0, 0.0)
    place = np.stack([0.1 + 0.4 * TIMES, 0 * TIMES, 0 * TIMES], axis=-1)
    measured, made = run({"a": place}), World.model_validate(world)
    (found,) = state_coordinates(made, measured)
    assert found.labels == ("a.displacement", "a.rate")
    overrides = found.overrides(np.array([[0.1, 0.4]]), {})
    assert overrides["objects.b.position.x"] == pytest.approx(0.1)
    assert overrides["objects.b.angular_velocity.y"] == pytest.approx(2.0)
    assert overrides["objects.b.velocity.x"] == pytest.approx(0.4 - 2.0 * LOWER)


def test_a_door_on_two_hinges_has_one_angle() -> None:
    door = {"name": "a", "shape": {"kind": "box", "half_extents": [0.4, 0.02, 1.0]}, "position": (0.4, 0, 0)}
    hinges = [
        {"kind": "hinge", "name": f"h{z}", "object": "a", "anchor": (0, 0, z - 1), "axis": (0, 0, 1)} for z in (0, 2)
    ]
    (tree,) = linkages(World.model_validate({"objects": [door], "joints": hinges}))
    assert tree.labels == ("angle", "rate")
    bent = hinges[0] | {"name": "bent", "anchor": (0.1, 0, 0.2)}
    assert linkages(World.model_validate({"objects": [door], "joints": [*hinges, bent]})) == ()


def test_a_closed_chain_has_no_coordinates_of_its_own() -> None:
    world = double()
    closed = [*(j.model_dump() for j in world.joints), hinge("h3", (0, 0, -UPPER - LOWER), object="b")]
    assert linkages(World.model_validate(world.model_dump() | {"joints": closed})) == ()
