"""Bodies on springs and hinges that start elsewhere than described, against formulas and SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError
from scipy.integrate import solve_ivp

from polyworld.solver.rollout import simulator
from polyworld.world import World
from polyworld.world.parameters import read_parameter

STIFFNESS, MASS, LENGTH = 25.0, 2.0, 0.3
TIMES = np.linspace(0.0, 1.5, 31)


def ball(name: str, position: tuple[float, float, float], **more: Any) -> dict[str, Any]:
    return {"name": name, "shape": {"kind": "sphere", "radius": 0.02}, "mass": MASS, "position": position, **more}


def sprung(**spring: Any) -> World:
    """A ball on a spring along x from the origin, weightless; it starts where the spring is at rest."""
    joint = {"kind": "spring", "name": "s", "object": "ball", "anchor": (LENGTH, 0, 0), "other_anchor": (0, 0, 0)}
    return World.model_validate(
        {
            "objects": [ball("ball", (LENGTH, 0.0, 0.0))],
            "joints": [joint | {"stiffness": STIFFNESS} | spring],
            "environment": {"gravity": (0, 0, 0)},
            "time": {"substep": 0.001},
        }
    )


def rolled(world: World, **overrides: float) -> Any:
    values = {path.replace("__", "."): np.array([v]) for path, v in overrides.items()}
    return simulator(world, TIMES, n_worlds=1).run(values or None).world(0)


@pytest.mark.parametrize("spring", [{}, {"rest_length": LENGTH}])
def test_a_spring_pulls_a_body_that_starts_elsewhere_back_to_where_it_is_at_rest(spring: dict[str, float]) -> None:
    """x = x0 cos(w t): the spring goes with the body, and is as long as described where it is at rest."""
    found = rolled(sprung(**spring), objects__ball__position__x=LENGTH + 0.07)
    expected = LENGTH + 0.07 * np.cos(np.sqrt(STIFFNESS / MASS) * TIMES)
    assert found.positions[:, 0, 0] == pytest.approx(expected, abs=2e-6)
    assert np.abs(found.angular_velocities).max() < 1e-9


def test_a_spring_off_the_centre_is_fastened_to_the_point_that_was_described_however_the_body_is_turned() -> None:
    """A ball held at its left side, and started a quarter turn about z: the spring acts on what is now its lower side.

    SciPy integrates translation and turn in the plane.
    """
    radius = 0.1
    item = ball("ball", (LENGTH + radius, 0.0, 0.0), shape={"kind": "sphere", "radius": radius})
    world = sprung(rest_length=0.5 * LENGTH).model_dump() | {"objects": [item]}
    found = rolled(World.model_validate(world), objects__ball__rotation__z=np.pi / 2)
    moment = 0.4 * MASS * radius**2

    def rate(_t: float, y: Any) -> list[float]:
        arm = radius * np.array([-np.cos(y[2]), -np.sin(y[2])])
        point = y[:2] + arm
        long = float(np.hypot(*point))
        force = -STIFFNESS * (long - 0.5 * LENGTH) * point / long
        return [y[3], y[4], y[5], force[0] / MASS, force[1] / MASS, (arm[0] * force[1] - arm[1] * force[0]) / moment]

    start = [LENGTH + radius, 0.0, np.pi / 2, 0.0, 0.0, 0.0]
    expected = solve_ivp(rate, (0.0, TIMES[-1]), start, t_eval=TIMES, rtol=1e-10, atol=1e-12).y
    assert found.positions[:, 0, :2] == pytest.approx(expected[:2].T, abs=1e-4)
    assert np.ptp(expected[2]) > 1.0  # it turned a good deal


def test_a_hinge_may_stand_elsewhere_in_each_world_of_a_batch() -> None:
    """A bob 0.4 m below a hinge swings faster than one 0.5 m below it: 2 pi sqrt(L / g) with a ball's own inertia."""
    bob = ball("bob", (0.0, 0.0, -0.5), angular_velocity=(0.0, 0.05, 0.0), velocity=(-0.025, 0.0, 0.0))
    joint = {"kind": "hinge", "name": "h", "object": "bob", "anchor": (0, 0, 0), "axis": (0, 1, 0)}
    for kind in ("rigid_spatial", "rigid_planar"):
        plane = {"normal": (0, 1, 0), "supports": False}
        world = World.model_validate(
            {"objects": [bob | {"representation": kind}], "joints": [joint], "environment": {"motion_plane": plane}}
        )
        path = "joints.h.anchor.z"
        assert read_parameter(world, path) == 0.0
        batch = simulator(world, np.linspace(0.0, 6.0, 1201), n_worlds=2).run({path: np.array([0.0, -0.1])})
        for k, long in enumerate((0.5, 0.4)):
            swing = batch.world(k).positions[:, 0, 0]
            up = np.flatnonzero((swing[:-1] > 0.0) & (swing[1:] <= 0.0))
            period = float(np.mean(np.diff(up))) * 0.005
            assert period == pytest.approx(2 * np.pi * np.sqrt((long + 0.4 * 0.02**2 / long) / 9.81), abs=0.003)


def test_a_stop_may_stand_elsewhere_in_each_world_of_a_batch() -> None:
    wheel = ball("wheel", (0.0, 0.0, 0.0), angular_velocity=(0.0, 0.0, 1.0))
    axle = {"kind": "hinge", "name": "h", "object": "wheel", "anchor": (0, 0, 0), "upper": 0.3}
    world = World.model_validate({"objects": [wheel], "joints": [axle], "environment": {"gravity": (0, 0, 0)}})
    batch = simulator(world, TIMES, n_worlds=2).run({"joints.h.upper": np.array([0.3, 0.8])})
    turned = [2 * np.arccos(np.clip(batch.world(k).orientations[-1, 0, 0], -1, 1)) for k in range(2)]
    assert turned == pytest.approx([0.3, 0.8], abs=1e-6)


def test_a_spring_whose_ends_coincide_is_refused_with_what_its_anchors_are() -> None:
    with pytest.raises(ValidationError, match="anchor is where it holds the object"):
        sprung(anchor=(0, 0, 0), rest_length=0.1)
    assert sprung(anchor=(0, 0, 0), rest_length=0.0).joints  # one without length pulls wherever it is stretched
