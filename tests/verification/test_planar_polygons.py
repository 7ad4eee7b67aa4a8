"""Impacts of polygons against an event-driven computation made here from scratch.

The time of impact is the root (SciPy's brentq) of the smallest corner-to-face distance of two boxes in
uniform motion; the impulse solves Newton's restitution and Coulomb's cone at that corner in closed form.
"""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.optimize import brentq

from polyworld.world.shapes import Box
from tests.verification.planar_scenes import body, run, top_view

Array = NDArray[np.float64]


def _cross(a: Array, b: Array) -> float:
    return float(a[0] * b[1] - a[1] * b[0])


def _corners(centre: Array, angle: float, half: Array) -> Array:
    c, s = np.cos(angle), np.sin(angle)
    return centre + (half * np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]])) @ np.array([[c, s], [-s, c]])


def _corner_in_box(corners: Array, centre: Array, angle: float, half: Array) -> tuple[float, Array, Array]:
    """Smallest over the corners of the signed distance to a box, with the corner and the face's normal."""
    c, s = np.cos(angle), np.sin(angle)
    rotation = np.array([[c, -s], [s, c]])
    local = (corners - centre) @ rotation
    outside = np.abs(local) - half
    axis = outside.argmax(axis=1)
    distance = outside[np.arange(4), axis]
    # A corner beyond two faces at once is as far as their corner; it does not touch first in these cases.
    both = np.all(outside > 0, axis=1)
    distance = np.where(both, np.linalg.norm(np.maximum(outside, 0), axis=1), distance)
    k = int(distance.argmin())
    normal = np.zeros(2)
    normal[axis[k]] = np.sign(local[k, axis[k]])
    return float(distance[k]), corners[k], rotation @ normal


def _impact(boxes: list[dict[str, Array]], e: float, mu: float, mass: Array) -> tuple[float, Array, Array, float]:
    """Time of the first impact of two boxes, velocities (2, 2) and spins (2,) after it, and its normal impulse."""

    def pose(i: int, t: float) -> tuple[Array, float]:
        b = boxes[i]
        return b["x"] + b["v"] * t, float(b["angle"] + b["spin"] * t)

    def contact(t: float) -> tuple[float, Array, Array]:
        (xa, qa), (xb, qb) = pose(0, t), pose(1, t)
        on_a = _corner_in_box(_corners(xb, qb, boxes[1]["half"]), xa, qa, boxes[0]["half"])
        distance, point, normal = _corner_in_box(_corners(xa, qa, boxes[0]["half"]), xb, qb, boxes[1]["half"])
        return on_a if on_a[0] < distance else (distance, point, -normal)  # normal from a to b

    grid = np.linspace(0.0, 2.0, 4001)
    gaps = [contact(t)[0] for t in grid]
    k = next(i for i, g in enumerate(gaps) if g < 0)
    time = float(brentq(lambda t: contact(t)[0], grid[k - 1], grid[k], xtol=1e-14))
    _, point, n = contact(time)
    t = np.array([-n[1], n[0]])
    inertia = mass / 3 * np.array([(b["half"] ** 2).sum() for b in boxes])
    arms = [point - pose(i, time)[0] for i in range(2)]
    sign = [-1.0, 1.0]
    relative = sum(sign[i] * (boxes[i]["v"] + boxes[i]["spin"] * np.array([-arms[i][1], arms[i][0]])) for i in range(2))

    def effect(direction: Array, along: Array) -> float:
        turn = [_cross(arms[i], direction) * _cross(arms[i], along) / inertia[i] for i in range(2)]
        return float((direction @ along) * (1 / mass).sum() + sum(turn))

    un, ut = float(relative @ n), float(relative @ t)
    matrix = np.array([[effect(n, n), effect(n, t)], [effect(n, t), effect(t, t)]])
    jn, jt = np.linalg.solve(matrix, [-(1 + e) * un, -ut])
    if abs(jt) > mu * jn:
        slope = -np.sign(ut) * mu
        jn = -(1 + e) * un / (matrix[0, 0] + slope * matrix[0, 1])
        jt = slope * jn
        after = ut + matrix[1, 0] * jn + matrix[1, 1] * jt
        assert mu == 0.0 or after * ut >= 0  # slides throughout in this case: Coulomb's direction does not turn
    impulse = jn * n + jt * t
    v = np.array([boxes[i]["v"] + sign[i] * impulse / mass[i] for i in range(2)])
    w = np.array([float(boxes[i]["spin"]) + sign[i] * _cross(arms[i], impulse) / inertia[i] for i in range(2)])
    return time, v, w, float(jn)


@pytest.mark.parametrize("mu", [0.0, 0.2])
@pytest.mark.parametrize("seed", range(6))
def test_two_boxes_collide_as_computed_from_scratch(seed: int, mu: float) -> None:
    """Random boxes, poses, speeds, spins: time of impact to 1e-6 s, velocities to 1e-5, impulse to 1e-5."""
    draw = np.random.default_rng(seed)
    e, mass = 0.7, draw.uniform(0.5, 2.0, 2)
    boxes = [
        {
            "x": np.array([side, draw.uniform(-0.15, 0.15)]),
            "v": np.array([-side * draw.uniform(0.8, 1.5), draw.uniform(-0.1, 0.1)]),
            "angle": draw.uniform(0, 6.28),
            "spin": draw.uniform(-2.0, 2.0),
            "half": draw.uniform(0.15, 0.3, 2),
        }
        for side in (-0.7, 0.7)
    ]
    time, v, w, impulse = _impact(boxes, e, mu, mass)
    objects = [
        body(
            name,
            Box(half_extents=(*b["half"], 0.2)),
            (*b["x"], 0.2),
            orientation=(float(np.cos(b["angle"] / 2)), 0.0, 0.0, float(np.sin(b["angle"] / 2))),
            velocity=(*b["v"], 0.0),
            angular_velocity=(0.0, 0.0, float(b["spin"])),
            mass=float(m),
            restitution=e,
            friction=mu,
        )
        for name, b, m in zip("ab", boxes, mass, strict=True)
    ]
    motion = run(top_view(*objects, gravity=0.0), time + 0.02, interval=0.0001)
    begin = next(k for k in motion.events[0] if k.kind == "contact_begin")
    assert begin.time == pytest.approx(time, abs=1e-6)
    after = int(np.flatnonzero(motion.times[0] > time)[0]) + 1
    np.testing.assert_allclose(motion.velocities[0, after, :, :2], v, atol=1e-5)
    np.testing.assert_allclose(motion.angular_velocities[0, after, :, 2], w, atol=1e-4)
    assert begin.impulse == pytest.approx(impulse, rel=1e-5)
