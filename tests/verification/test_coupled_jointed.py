"""Ropes, cloths and soft bodies on rigid bodies that joints hold: they yield as the joints let them, far from their
centres too."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import eigh

from polyworld import World, rollout
from polyworld.trajectory import PointMotion, Trajectory
from tests.verification.rope_world import G, ball, held, rope, world

Array = NDArray[np.float64]

BLOCK = 0.05  # half extent [m]: its radius of gyration is 0.04 m
LEVER = 1.9  # of the rope's end from its centre [m]
SOFT = {
    "name": "bar",
    "representation": "soft",
    "shape": {"kind": "box", "half_extents": (0.1, 0.05, 0.05)},
    "resolution": 0.05,
    "youngs_modulus": 1e5,
    "poisson_ratio": 0.3,
    "density": 1000.0,
    "damping": 0.002,
}


def box(name: str, position: Sequence[float], half: Sequence[float], mass: float) -> dict[str, Any]:
    """A rigid box."""
    shape = {"kind": "box", "half_extents": half}
    return {"name": name, "representation": "rigid_spatial", "shape": shape, "position": position, "mass": mass}


def joint(kind: str, name: str, anchor: Sequence[float], **more: Any) -> dict[str, Any]:
    """A joint of an object and the world, or `other`."""
    return {"kind": kind, "name": f"joint-{name}", "object": name, "anchor": anchor, **more}


def ran(scene: World, horizon: float, interval: float | None = None) -> tuple[Trajectory, PointMotion]:
    """Trajectory, and the motion of the first deformable object."""
    result = rollout(scene, horizon, sample_interval=interval or horizon)
    assert result.status == "completed"
    return result.trajectory, result.trajectory.deformables[scene.deformables[0].name]


def stretched(**fastening: Any) -> World:
    """A rope between the world and a point that is the world's too, or the far end of a lever on a small block.

    It starts level and without tension.
    """
    cable = rope([(0, 0, LEVER), (1, 0, LEVER)], 20, linear_density=0.1)
    if not fastening:
        return world(cable, attachments=[held("start"), held("end")], substep=0.004)
    return world(
        cable,
        objects=[box("block", (0, 0, 0), (BLOCK,) * 3, 0.2)],
        joints=[joint(name="block", anchor=(0, 0, 0), **fastening)],
        attachments=[held("start", to="block"), held("end")],
        substep=0.004,
    )


@pytest.mark.parametrize(
    "fastening",
    [
        {"kind": "fixed"},
        {"kind": "hinge", "axis": (0, 1, 0), "lower": 0.0, "upper": 0.0},
        {"kind": "hinge", "axis": (0, 1, 0), "friction": 100.0},
        {"kind": "hinge", "axis": (0, 1, 0), "motor": {"target_speed": 0.0, "limit": 100.0}},
    ],
    ids=["weld", "stops", "friction", "motor"],
)
def test_rope_on_the_far_end_of_a_held_body_pulls_as_on_the_world(fastening: dict[str, Any]) -> None:
    """A lever of 47 radii of gyration that cannot turn: the rope cannot tell it from the world."""
    _, fixed = ran(stretched(), 0.2, 0.1)
    _, jointed = ran(stretched(**fastening), 0.2, 0.1)
    assert jointed.points == pytest.approx(fixed.points, abs=2e-5)
    tension = fixed.quantities["tension"][-1]
    assert tension.max() > 1.0  # [N]: more than its weight
    assert jointed.quantities["tension"][-1] == pytest.approx(tension, rel=0.01)


def small_swing(lever: Array, mass: Array, moved: float, times: Array) -> Array:
    """Displacement (T, n) of the masses of a hanging chain with links of lengths `lever`, let go from a straight line.

    Linear: M x'' = -K x, K of a string under the weight below each link. moved: mass that the first one, the end of a
    rod, moves with beyond its own [kg]; the rod's own weight acts at half of its length.
    """
    n = len(mass)
    below = np.cumsum(mass[::-1])[::-1] * G
    stiffness = np.zeros((n, n))
    for k in range(n):
        pull = (below[k] + (ROD * G / 2.0 if k == 0 else 0.0)) / lever[k]
        stiffness[k, k] += pull
        if k > 0:
            stiffness[k - 1, k - 1] += pull
            stiffness[k, k - 1] -= pull
            stiffness[k - 1, k] -= pull
    inertia = np.diag(mass)
    inertia[0, 0] += moved
    squares, modes = eigh(stiffness, inertia)
    start = np.cumsum(lever)
    amounts = modes.T @ inertia @ start
    moving: Array = (np.cos(np.sqrt(squares) * times[:, None]) * amounts) @ modes.T
    return moving


ROD = 0.4  # mass [kg]


@pytest.mark.parametrize("links", [1, 3])
def test_load_on_a_rope_from_a_swinging_rod_moves_as_the_linear_theory_says(links: int) -> None:
    """A rod on a hinge, of one piece or of three welded ones, with a rope and a ball from its end.

    The weight of the rod at its end is half its own, its inertia a third of its mass there.
    """
    length, below, load, density, parts, tilt = 0.6, 0.5, 0.3, 0.02, 10, 0.03
    at = length / links
    objects, joints = [], []
    for i in range(links):
        middle = (tilt * at * (i + 0.5), 0.0, -at * (i + 0.5))
        item = box(f"rod-{i}", middle, (0.001, 0.001, at / 2), ROD / links)
        half = 0.5 * np.arctan(tilt)
        item["orientation"] = (np.cos(half), 0.0, -np.sin(half), 0.0)
        objects.append(item)
        top = (tilt * at * i, 0.0, -at * i)
        joints.append(
            joint("fixed", f"rod-{i}", top, other=f"rod-{i - 1}") if i else joint("hinge", "rod-0", top, axis=(0, 1, 0))
        )
    end, bottom = (tilt * length, 0.0, -length), (tilt * (length + below), 0.0, -length - below)
    scene = world(
        rope([end, bottom], parts, linear_density=density),
        objects=[*objects, ball("load", bottom, load)],
        joints=joints,
        attachments=[held("start", to=f"rod-{links - 1}"), held("end", to="load")],
        environment={"air_density": 0.0},
    )
    trajectory, cable = ran(scene, 1.5, 0.05)
    node = density * below / parts
    mass = np.array([node / 2, *[node] * (parts - 1), load + node / 2])
    lever = np.array([length, *[below / parts] * parts])
    expected = tilt * small_swing(lever, mass, ROD / 3.0, trajectory.times)
    assert cable.points[:, -1, 0] == pytest.approx(expected[:, -1], abs=0.01 * tilt * (length + below))
    assert cable.points[:, 0, 0] == pytest.approx(expected[:, 0], abs=0.01 * tilt * (length + below))


def on_a_lever(to: str | None) -> World:
    """A soft bar held by one end to the world, or to a small welded block one metre away."""
    region = {"lower": (-0.101, -1, -1), "upper": (-0.099, 1, 1)}
    blocks = [box("block", (-1, 0, 0), (0.03,) * 3, 0.05)] if to else []
    return world(
        {**SOFT, "position": (0, 0, 0)},
        objects=blocks,
        joints=[joint("fixed", "block", (-1, 0, 0))] if to else [],
        attachments=[{"name": "hold", "object": "bar", "region": region, "to": to}],
    )


def on_a_shelf(*, welded: bool) -> World:
    """A soft bar that falls on a static shelf, or on a light one that is welded to the world at its edge."""
    place, half = (0.0, 0.0, 0.0), (0.6, 0.2, 0.02)
    shelf = {"name": "shelf", "shape": {"kind": "box", "half_extents": half}, "position": place}
    return world(
        {**SOFT, "position": (0.4, 0, 0.072)},
        objects=[box("shelf", place, half, 0.05)] if welded else [],
        statics=[] if welded else [shelf],
        joints=[joint("fixed", "shelf", (-0.6, 0, 0))] if welded else [],
    )


@pytest.mark.parametrize(
    ("fixed", "jointed"),
    [(on_a_lever(None), on_a_lever("block")), (on_a_shelf(welded=False), on_a_shelf(welded=True))],
    ids=["held", "resting"],
)
def test_soft_bar_on_a_light_welded_body_moves_as_on_the_world(fixed: World, jointed: World) -> None:
    """The bar weighs 40 times as much as what it is held to, or rests on."""
    _, one = ran(fixed, 0.3, 0.1)
    _, other = ran(jointed, 0.3, 0.1)
    assert other.points == pytest.approx(one.points, abs=2e-4)
