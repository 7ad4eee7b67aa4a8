"""Draw scenes on a floor seen obliquely: sliding and rolling bodies, a break of billiard balls, bodies that enter."""

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.random import Generator

from .bodies import UPRIGHT, Body, Fixture, Quat, Rejected, Scene, Vec
from .looks import Look

NAMES = "ABCDEFGHIJKL"


def turn_z(angle: float) -> Quat:
    """Return the rotation about z by an angle in rad."""
    return (float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2)))


def lying(direction: float) -> Quat:
    """Return the rotation that lays a cylinder (axis z) down so that it rolls along a direction in the plane (rad)."""
    half = np.sqrt(0.5)
    tip = np.array([half, half, 0.0, 0.0])  # z to -y
    c, s = np.cos(direction / 2), np.sin(direction / 2)
    return (float(c * tip[0]), float(c * tip[1]), float(s * tip[1]), float(s * tip[0]))


def rolling_spin(vel: Vec, radius: float) -> Vec:
    """Return the angular velocity with which a body of that radius rolls without slip."""
    return (-vel[1] / radius, vel[0] / radius, 0.0)


def draw_body(rng: Generator, name: str, shape: str, scale: float) -> Body:
    """Draw shape, size, mass and surface of a body lying on the floor at the origin; scale in m."""
    d = scale * float(rng.uniform(0.75, 1.25))
    density = float(rng.uniform(250, 1500))
    size: Vec
    if shape == "sphere":
        size, volume = (d, d, d), np.pi / 6 * d**3
    elif shape == "box":
        size = (d * float(rng.uniform(0.8, 1.4)), d, d * float(rng.uniform(0.5, 0.9)))
        volume = size[0] * size[1] * size[2]
    else:
        size = (d, d, d * float(rng.uniform(0.5, 1.1)))
        volume = np.pi / 4 * d**2 * size[2]
    height = size[0] / 2 if shape == "sphere" else size[2] / 2
    rough = (0.12, 0.4) if shape != "sphere" else (0.2, 0.5)
    return Body(
        name=name,
        shape=shape,
        size=size,
        pos=(0.0, 0.0, height),
        mass=float(density * volume),
        friction=float(rng.uniform(*rough)),
        restitution=float(rng.uniform(0.1, 0.3) if shape == "box" else rng.uniform(0.3, 0.7)),
        rolling=float(rng.uniform(0.004, 0.03)),
    )


def set_off(rng: Generator, body: Body, at: tuple[float, float], speed: float, direction: float) -> Body:
    """Put a body at a place on the floor with a speed (m/s) in a direction (rad); balls and some cylinders roll."""
    vel = (speed * float(np.cos(direction)), speed * float(np.sin(direction)), 0.0)
    z, quat, spin = body.pos[2], UPRIGHT, (0.0, 0.0, 0.0)
    if body.shape == "box":
        quat = turn_z(float(rng.uniform(-np.pi, np.pi)))
        spin = (0.0, 0.0, float(rng.normal(0, 1.5)) if speed > 0 else 0.0)
    elif body.shape == "cylinder" and rng.random() < 0.5:
        z, quat = body.size[0] / 2, lying(direction)
        spin = rolling_spin(vel, body.size[0] / 2)
    elif body.shape == "sphere" and rng.random() < 0.75:
        spin = rolling_spin(vel, body.size[0] / 2)
    return replace(body, pos=(at[0], at[1], z), quat=quat, vel=vel, spin=spin)


def speed_for(rng: Generator, body: Body, distance: float) -> float:
    """Return a speed (m/s) with which the body goes about that far before it stops, at most 2 m/s."""
    rolls = body.shape == "sphere"
    slow = 9.81 * (body.rolling * 5 / 7 if rolls else body.friction)
    wanted = np.sqrt(2 * slow * distance) * float(rng.uniform(0.8, 1.3))
    return float(np.clip(max(wanted, rng.uniform(0.4, 0.9)), 0.3, 2.0))


def _spread(rng: Generator, count: int, half: tuple[float, float], gap: float) -> list[tuple[float, float]]:
    places: list[tuple[float, float]] = []
    for _ in range(400):
        p = (float(rng.uniform(-half[0], half[0])), float(rng.uniform(-half[1], half[1])))
        if all(np.hypot(p[0] - q[0], p[1] - q[1]) > gap for q in places):
            places.append(p)
        if len(places) == count:
            return places
    raise Rejected("no room on the floor")


def floor(rng: Generator, look: Look) -> Scene:
    """Draw three or four bodies of which most move and aim at one another."""
    scale = float(rng.uniform(0.025, 0.035) if look.small else rng.uniform(0.08, 0.15))
    count = int(rng.integers(3, 5))
    shapes = [str(s) for s in rng.choice(["sphere", "box", "cylinder"], count, p=[0.45, 0.3, 0.25])]
    bodies = [draw_body(rng, NAMES[i], s, scale) for i, s in enumerate(shapes)]
    places = _spread(rng, count, (0.6, 0.45), 2.2 * scale)
    moving = int(rng.integers(1, count))
    out = []
    for i, (b, p) in enumerate(zip(bodies, places, strict=True)):
        if i < moving:
            target = places[int(rng.choice([j for j in range(count) if j != i]))]
            aim = np.array(target) - p
            direction = float(np.arctan2(aim[1], aim[0]) + rng.normal(0, 0.5 * scale / np.linalg.norm(aim)))
            out.append(set_off(rng, b, p, speed_for(rng, b, 1.5 * float(np.linalg.norm(aim))), direction))
        else:
            out.append(set_off(rng, b, p, 0.0, float(rng.uniform(-np.pi, np.pi))))
    order = rng.permutation(count)
    renamed = tuple(replace(out[int(k)], name=NAMES[i]) for i, k in enumerate(order))
    return Scene(
        kind="floor",
        bodies=renamed,
        mutual_friction=float(rng.uniform(0.05, 0.3)),
        mutual_restitution=float(rng.uniform(0.3, 0.85)),
        view=(-180.0, 180.0, 22.0, 55.0),
    )


def entering(rng: Generator, look: Look) -> Scene:
    """Draw two to four bodies of which most start outside the view and move into it."""
    scale = float(rng.uniform(0.025, 0.035) if look.small else rng.uniform(0.08, 0.14))
    count = int(rng.integers(2, 5))
    half = (0.45, 0.32)
    still = _spread(rng, 1 + count, half, 2.5 * scale)
    waiting = int(rng.random() < 0.6)
    out = []
    for i in range(count):
        shape = str(rng.choice(["sphere", "cylinder", "box"], p=[0.6, 0.2, 0.2]))
        b = draw_body(rng, NAMES[i], shape, scale)
        if shape != "sphere":
            b = replace(b, friction=float(rng.uniform(0.06, 0.15)))
        if i < waiting:
            out.append(set_off(rng, b, still[i], 0.0, 0.0))
            continue
        where = float(rng.uniform(-np.pi, np.pi))
        away = float(rng.uniform(0.75, 1.3))
        p = (away * float(np.cos(where)), away * float(np.sin(where)))
        if any(np.hypot(p[0] - q.pos[0], p[1] - q.pos[1]) < 2.5 * scale for q in out):
            raise Rejected("entrants overlap")
        aim = np.array(still[0] if rng.random() < 0.5 else still[i]) - p
        speed = float(np.clip(speed_for(rng, b, 1.6 * away), 0.7, 2.2))
        out.append(set_off(rng, b, p, speed, float(np.arctan2(aim[1], aim[0]))))
    corners = tuple((sx * half[0], sy * half[1], z) for sx in (-1, 1) for sy in (-1, 1) for z in (0.0, scale))
    return Scene(
        kind="entering",
        bodies=tuple(out),
        mutual_friction=float(rng.uniform(0.05, 0.3)),
        mutual_restitution=float(rng.uniform(0.3, 0.85)),
        view=(-180.0, 180.0, 25.0, 60.0),
        focus=corners,
    )


def billiard(rng: Generator, look: Look) -> Scene:
    """Draw a table with cushions, a moving ball and five to nine balls at rest, racked or scattered."""
    d = 0.0572
    count = int(rng.integers(6, 11))
    length = float(rng.uniform(1.9, 2.3) if look.small else rng.uniform(1.0, 1.4))
    width = length * float(rng.uniform(0.5, 0.62))
    surface: dict[str, Any] = {
        "mass": 0.17 * float(rng.uniform(0.8, 1.2)),
        "friction": float(rng.uniform(0.15, 0.3)),
        "restitution": float(rng.uniform(0.6, 0.85)),
        "rolling": float(rng.uniform(0.008, 0.025)),
    }
    spots: list[tuple[float, float]] = []
    gap = d * 1.01
    if rng.random() < 0.6:
        row, x0 = 0, length * float(rng.uniform(0.08, 0.18))
        while len(spots) < count - 1:
            spots.extend((x0 + row * gap * 0.866, (k - row / 2) * gap) for k in range(row + 1))
            row += 1
        spots = spots[: count - 1]
    else:
        shifted = _spread(rng, count - 1, (0.28 * length, 0.4 * width), 1.3 * d)
        spots = [(x + 0.14 * length, y) for x, y in shifted]
    start = (-length * float(rng.uniform(0.22, 0.4)), width * float(rng.uniform(-0.25, 0.25)))
    target = spots[0] if rng.random() < 0.7 else spots[int(rng.integers(len(spots)))]
    aim = np.array(target) - start
    direction = float(np.arctan2(aim[1], aim[0]) + rng.normal(0, 0.3 * d / np.linalg.norm(aim)))
    speed = float(rng.uniform(1.2, 3.2))
    vel = (speed * float(np.cos(direction)), speed * float(np.sin(direction)), 0.0)
    balls = [Body(NAMES[i], "sphere", (d, d, d), (x, y, d / 2), **surface) for i, (x, y) in enumerate([start, *spots])]
    balls[0] = replace(balls[0], vel=vel, spin=rolling_spin(vel, d / 2) if rng.random() < 0.7 else (0.0, 0.0, 0.0))
    t, h = 0.06, 0.05
    wood = (0.36, 0.22, 0.12)
    sides = [
        Fixture("cushion east", "box", (t, width + 2 * t, h), (length / 2 + t / 2, 0, h / 2), rgb=wood, color="brown"),
        Fixture("cushion west", "box", (t, width + 2 * t, h), (-length / 2 - t / 2, 0, h / 2), rgb=wood, color="brown"),
        Fixture("cushion north", "box", (length, t, h), (0, width / 2 + t / 2, h / 2), rgb=wood, color="brown"),
        Fixture("cushion south", "box", (length, t, h), (0, -width / 2 - t / 2, h / 2), rgb=wood, color="brown"),
    ]
    corners = tuple(
        (sx * (length / 2 + t), sy * (width / 2 + t), z) for sx in (-1, 1) for sy in (-1, 1) for z in (0.0, h)
    )
    return Scene(
        kind="billiard",
        bodies=tuple(balls),
        fixtures=tuple(sides),
        mutual_friction=float(rng.uniform(0.03, 0.08)),
        mutual_restitution=float(rng.uniform(0.88, 0.96)),
        view=(-150.0, -30.0, 30.0, 60.0),
        focus=corners,
        contents={"room_x": length, "room_y": width},
    )
