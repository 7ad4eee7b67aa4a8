"""Draw scenes of each kind: bodies, fixed things, initial velocities."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.benchmarks.examination_scenes.world import CELL, Body, Fixed, Scene, Soft, String, Water

Rng = np.random.Generator
Triple = tuple[float, float, float]
COLOURS = ("red", "blue", "green", "yellow", "purple", "cyan", "orange", "gray")
MATERIALS = ("metal", "rubber", "wood")
TALL = 0.6  # [m] height of a tank
DENSITY = {"metal": 2700.0, "rubber": 1100.0, "wood": 650.0}  # [kg/m^3]; metal is aluminium


def triple(values: object) -> Triple:
    """Return three numbers, rounded to 0.1 mm."""
    x, y, z = np.round(np.asarray(values, dtype=float), 4).tolist()
    return x, y, z


class Maker:
    """Make bodies of a scene, each of its own colour."""

    def __init__(self, rng: Rng) -> None:
        self.rng, self.colours = rng, [str(c) for c in rng.permutation(COLOURS)]

    def body(
        self, kind: str, size: float, position: Triple, velocity: Triple = (0.0, 0.0, 0.0), word: str = ""
    ) -> Body:
        """Return a body of a size [m] (radius, half edge); its material is drawn."""
        rng, material = self.rng, str(self.rng.choice(MATERIALS))
        size = round(size, 3)
        half: tuple[float, ...] = {"sphere": (size,), "cylinder": (size, size), "box": (size, size, size)}[kind]
        volume = {"sphere": 4 / 3 * math.pi, "cylinder": 2 * math.pi, "box": 8.0}[kind] * size**3
        word = word or {"sphere": "ball", "cylinder": "cylinder", "box": "cube"}[kind]
        name = f"{self.colours.pop()}_{material}_{word}"
        yaw = float(rng.uniform(0, math.pi / 2)) if kind == "box" else 0.0
        mass = float(f"{DENSITY[material] * volume:.2g}")
        return Body(name, kind, half, mass, triple(position), triple(velocity), yaw=round(yaw, 3))


def rolling(body: Body, normal: Triple = (0.0, 0.0, 1.0)) -> Body:
    """Return a ball that rolls without slipping on a plane."""
    spin = np.cross(normal, body.velocity) / body.half[0]
    return Body(body.name, body.kind, body.half, body.mass, body.position, body.velocity, triple(spin))


def frictions(rng: Rng) -> dict[str, float]:
    """Return a friction coefficient for each material."""
    low_high = {"metal": (0.12, 0.28), "rubber": (0.35, 0.6), "wood": (0.2, 0.4)}
    return {name: float(rng.uniform(*limits)) for name, limits in low_high.items()}


def slide(rng: Rng, seed: int) -> Scene:
    """Draw bodies that stand on a floor, and others that slide or roll towards them."""
    make, kinds = Maker(rng), [str(k) for k in rng.choice(["box", "cylinder", "sphere"], 4)]
    size = rng.uniform(0.07, 0.16)
    bodies: list[Body] = []
    for number, kind in enumerate(kinds[: 3 + seed % 2]):
        if number < 2:  # stands
            place = rng.uniform(-0.7, 0.7, 2) + np.array([0.0, 1.4 * number - 0.7])
            bodies.append(make.body(kind, size, (place[0], place[1], size)))
            continue
        aim, turn, far = bodies[number - 2], rng.uniform(0, 2 * math.pi), rng.uniform(1.2, 2.0)
        way = np.array([math.cos(turn), math.sin(turn)])
        aside = rng.uniform(-0.9, 0.9) * size * np.array([-way[1], way[0]])
        place, speed = np.array(aim.position[:2]) - far * way + aside, rng.uniform(2.0, 3.2)
        body = make.body(kind, size, (place[0], place[1], size), (*(speed * way), 0.0))
        bodies.append(rolling(body) if kind == "sphere" else body)
    restitution = float(rng.uniform(0.4, 0.75))
    return Scene(tuple(bodies), friction=frictions(rng), restitution=restitution, rolling=0.001)


def roll(rng: Rng, seed: int) -> Scene:
    """Draw balls that roll down a ramp and on a floor."""
    make, slope, thick = Maker(rng), rng.uniform(0.15, 0.35), 0.02
    length, wide = rng.uniform(1.2, 1.6), rng.uniform(0.3, 0.5)
    down, normal = np.array([math.cos(slope), 0, -math.sin(slope)]), (math.sin(slope), 0.0, math.cos(slope))
    middle = -length / 2 * down - thick * np.array(normal)
    ramp = Fixed("ramp", "box", (round(length / 2, 4), round(wide, 4), thick), triple(middle), round(slope, 4))
    bodies = []
    for side in (-1, 1)[: 1 + seed % 2]:
        size, up = rng.uniform(0.05, 0.09), rng.uniform(0.6, 0.9) * length
        place = -up * down + size * np.array(normal) + (0.0, side * wide / 2, 0.0)
        speed = rng.uniform(0.2, 0.9) * (rng.random() < 0.8)
        bodies.append(rolling(make.body("sphere", size, triple(place), triple(speed * down)), normal))
    for number in range(2):
        size, aim = rng.uniform(0.05, 0.09), bodies[number % len(bodies)]
        spot = (rng.uniform(0.4, 1.1) + 0.5 * number, aim.position[1] + rng.uniform(-0.06, 0.06), size)
        turn = rng.uniform(0, 2 * math.pi)
        speed = rng.uniform(0.2, 0.6) * number
        velocity = (speed * math.cos(turn), speed * math.sin(turn), 0.0)
        bodies.append(rolling(make.body("sphere", size, spot, velocity)))
    return Scene(
        tuple(bodies), (ramp,), friction=frictions(rng), restitution=float(rng.uniform(0.5, 0.85)),
        rolling=float(rng.uniform(0.0003, 0.002)),
    )  # fmt: skip


def throw(rng: Rng, seed: int) -> Scene:
    """Draw balls thrown in the plane y = 0, with a wall in half of the scenes."""
    make = Maker(rng)
    fixed = (Fixed("wall", "box", (0.05, 0.4, 0.6), (round(rng.uniform(1.4, 1.9), 3), 0.0, 0.6)),)
    bodies = []
    for side in (1, -1):
        size, place = rng.uniform(0.05, 0.1), (-side * rng.uniform(0.6, 1.1), 0.0, rng.uniform(0.4, 1.0))
        velocity = (side * rng.uniform(0.7, 2.2), 0.0, rng.uniform(-0.5, 2.0))
        bodies.append(make.body("sphere", size, place, velocity))
    return Scene(
        tuple(bodies), fixed if seed % 2 else (), friction={m: float(rng.uniform(0.25, 0.5)) for m in MATERIALS},
        restitution=float(rng.uniform(0.5, 0.8)), floor_restitution=float(rng.uniform(0.6, 0.85)),
    )  # fmt: skip


def hang(rng: Rng, seed: int) -> Scene:
    """Draw a pendulum that meets a cube (seeds 0, 3, ...), two pendulums (1, 4, ...) or a pulley (2, 5, ...)."""
    make = Maker(rng)
    if seed % 3 == 2:
        wheel, heavy = round(rng.uniform(0.08, 0.14), 3), float(rng.uniform(1.06, 1.3))
        height, size, speed = round(rng.uniform(2.0, 2.6), 2), 0.6 * wheel, float(rng.uniform(0.2, 0.7))
        first, second = rng.uniform(0.5, 0.7), rng.uniform(0.9, 1.2)
        place = (-wheel, 0.0, round(first, 3)), (wheel, 0.0, round(second, 3))
        low, high = (
            make.body("cylinder", size, p, (0, 0, v), "weight") for p, v in zip(place, (speed, -speed), strict=True)
        )
        mass = round(float(rng.uniform(0.4, 1.0)), 2)
        weights = [
            Body(b.name, b.kind, b.half, m, b.position, b.velocity)
            for b, m in ((low, mass), (high, round(mass * heavy, 2)))
        ]
        string = math.pi * wheel + sum(height - b.position[2] - b.half[1] for b in weights)
        pulley = Fixed("pulley", "pulley", (wheel, 0.02), (0.0, 0.0, height))
        return Scene(tuple(weights), (pulley,), (String("pulley", (low.name, high.name), round(string, 5)),))
    height, bodies, fixed, strings = round(rng.uniform(1.3, 1.7), 3), [], [], []
    pair = seed % 3 == 1
    for number in range(2 if pair else 1):
        size = round(rng.uniform(0.05, 0.08), 3)
        long = round(float(rng.uniform(0.6, 1.0)) if pair else height - size - 0.01, 3)
        angle = (1 if number else -1) * rng.uniform(0.5, 0.9)
        pivot = (round(number * rng.uniform(0.1, 0.4), 3), 0.0, height)
        name = "right_pivot" if number else "left_pivot" if pair else "pivot"
        turn = np.array([math.sin(angle), 0.0, -math.cos(angle)])
        speed = rng.uniform(0.3, 1.2) * np.array([math.cos(angle), 0.0, math.sin(angle)]) * rng.choice([-1, 1])
        bodies.append(make.body("sphere", size, triple(np.array(pivot) + long * turn), triple(speed)))
        fixed.append(Fixed(name, "pivot", (0.012,), pivot))
        strings.append(String(name, (bodies[-1].name,), long, bool(rng.random() < 0.5)))
    if not pair:
        size = rng.uniform(0.06, 0.09)
        cube = make.body("box", size, (rng.uniform(0.1, 0.4), 0.0, size))
        bodies.append(Body(cube.name, cube.kind, cube.half, cube.mass, cube.position))
    return Scene(
        tuple(bodies), tuple(fixed), tuple(strings), friction=frictions(rng),
        restitution=float(rng.uniform(0.4, 0.8)), mutual_friction=0.1,
    )  # fmt: skip


def soft(rng: Rng, seed: int) -> Scene:
    """Draw a ball thrown at a rope with a bead at its end (even seeds) or at a cloth (odd), and a ball that rolls."""
    make = Maker(rng)
    top = (0.0, 0.0, round(rng.uniform(1.3, 1.6), 2))
    long = round(rng.uniform(0.7, 0.9), 2)
    size, away, speed = rng.uniform(0.05, 0.08), rng.uniform(0.9, 1.4), rng.uniform(2.2, 3.2)
    arrive = away / speed
    height = top[2] - rng.uniform(0.4, 0.9) * long
    rise = rng.uniform(0.3, 1.5)
    place = (-away, 0.0, max(height - rise * arrive + 0.5 * 9.81 * arrive**2, 0.3))
    ball = make.body("sphere", size, place, (speed, 0.0, rise))
    mass = round(float(rng.uniform(0.1, 0.3)), 2)
    thrown = Body(ball.name, ball.kind, ball.half, mass, ball.position, ball.velocity)
    radius = rng.uniform(0.05, 0.08)
    second = make.body(
        "sphere", radius, (rng.uniform(-0.5, 0.6), rng.uniform(-0.1, 0.1), radius), (rng.uniform(-0.8, 0.8), 0, 0)
    )
    bead = make.body("sphere", 0.03, (0.0, 0.0, top[2] - long), word="bead") if seed % 2 == 0 else None
    thing = Soft("rope" if bead else "cloth", top, long, round(float(rng.uniform(0.08, 0.2)), 3), bead)
    return Scene(
        (thrown, rolling(second)), soft=thing, friction={m: 0.3 for m in MATERIALS},
        restitution=float(rng.uniform(0.4, 0.7)), floor_restitution=0.0, rolling=0.001,
    )  # fmt: skip


def water(rng: Rng, seed: int) -> Scene:
    """Draw a column of water that breaks over two bodies (even seeds), or bodies that fall into a tank (odd)."""
    make, deep = Maker(rng), round(rng.uniform(0.1, 0.2), 2)
    long, wide = CELL * round(rng.uniform(0.8, 1.1) / CELL), CELL * round(rng.uniform(0.2, 0.3) / CELL)
    first, second = rng.uniform(0.045, 0.065, 2).round(3).tolist()
    if seed % 2 == 0:
        high = CELL * round(rng.uniform(0.25, 0.4) / CELL)
        block = wide, high
        x = wide + first + rng.uniform(0.05, 0.2)
        near = x + first + second + 0.03
        places = (x, 0.0, first), (rng.uniform(near, max(long - second - 0.05, near + 0.02)), 0.0, second)
        speeds = (0.0, 0.0, 0.0), (-rng.uniform(0.2, 0.5), 0.0, 0.0)
    else:
        high = CELL * round(rng.uniform(0.24, 0.32) / CELL)
        block = long, high
        x = rng.uniform(0.2, 0.4)
        places = (
            (x * long, 0.0, high + rng.uniform(1.2, 2.0) * first),
            ((x + rng.uniform(0.2, 0.4)) * long, 0.0, high + second + rng.uniform(0.03, 0.2)),
        )
        speeds = (0.0, 0.0, 0.0), (rng.uniform(-0.5, 0.5), 0.0, rng.uniform(-1.0, 0.0))
    cube = make.body("box", first, triple(places[0]), speeds[0])
    disc = make.body("cylinder", second, triple(places[1]), triple(speeds[1]), "roller")
    return Scene(
        (across(cube, deep), across(rolling(disc) if seed % 2 == 0 else disc, deep)), tank(long, deep, TALL),
        water=Water((round(long, 4), deep, TALL), (0.0, 0.0, round(block[0], 4), round(block[1], 4))),
        friction=frictions(rng), restitution=float(rng.uniform(0.1, 0.3)),
    )  # fmt: skip


def across(body: Body, deep: float) -> Body:
    """Return the body as deep as a tank: a cylinder lies along y."""
    round_one, size = body.kind == "cylinder", body.half[0]
    half = (size, deep / 2) if round_one else (size, deep / 2, size)
    flat = (math.pi if round_one else 4) * size**2
    density = DENSITY[body.name.split("_")[1]]
    return replace(body, half=half, mass=float(f"{density * flat * deep:.2g}"), yaw=0.0, lies=round_one)


def tank(long: float, deep: float, high: float, thick: float = 0.01) -> tuple[Fixed, ...]:
    """Return the walls of a tank, left and right; its panes are not seen."""
    return tuple(
        Fixed(name, "box", (thick, deep / 2, high / 2), (round(x, 4), 0.0, high / 2))
        for name, x in (("left_wall", -thick), ("right_wall", long + thick))
    )


KINDS: dict[str, Callable[[Rng, int], Scene]] = {
    "slide": slide, "roll": roll, "throw": throw, "hang": hang, "soft": soft,
    "water": water,
}  # fmt: skip
VIEWS = {"slide": "above", "roll": "above", "throw": "side", "hang": "side", "soft": "aslant", "water": "side"}
HORIZON = {  # [s] latest question after the clip
    "slide": 2.0, "roll": 2.0, "throw": 1.2, "hang": 1.5, "soft": 1.0, "water": 0.8,
}  # fmt: skip
