"""Draw scenes of guided and hung things: a pendulum, carts on a track, a rope, a cloth."""

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from .bodies import Body, Cloth, Fixture, Rope, Scene, Vec, vec
from .draw_flight import SIDE, board
from .draw_floor import draw_body
from .looks import Look

DARK: Vec = (0.2, 0.2, 0.22)


def stand(at: Vec, behind: float = 0.22) -> tuple[Fixture, Fixture]:
    """Return a post behind the motion and a bar from it to the point where a thing hangs."""
    post = Fixture(
        "stand", "box", (0.04, 0.04, at[2] + 0.04), (at[0], behind, (at[2] + 0.04) / 2), rgb=DARK, color="black"
    )
    bar = Fixture(
        "bar",
        "box",
        (0.02, behind + 0.02, 0.02),
        (at[0], behind / 2, at[2] + 0.01),
        rgb=DARK,
        color="black",
        solid=False,
    )
    return post, bar


def pendulum(rng: Generator, look: Look) -> Scene:
    """Draw a bob on a rod, at times with a block on the floor in its way."""
    length = float(rng.uniform(0.45, 0.9))
    scale = float(rng.uniform(0.03, 0.04) if look.small else rng.uniform(0.08, 0.15))
    bob = draw_body(rng, "A", "sphere" if rng.random() < 0.75 else "box", scale)
    block = rng.random() < 0.4
    radius = bob.size[2] / 2
    low = radius + (0.015 if block else float(rng.uniform(0.1, 0.4)))
    pivot = (0.0, 0.0, low + length)
    side = -1.0 if rng.random() < 0.5 else 1.0
    inertia = bob.mass * length**2
    bob = replace(
        bob,
        pos=(0.0, 0.0, low),
        joint="arm",
        pivot=pivot,
        angle=side * float(np.radians(rng.uniform(20, 70))),
        rate=float(rng.choice([0.0, rng.uniform(-1.5, 1.5)])),
        damping=float(inertia * rng.uniform(0.02, 0.35)),
    )
    bodies: list[Body] = [bob]
    if block:
        b = draw_body(rng, "B", "box", scale * 1.2)
        b = replace(b, size=(b.size[0], b.size[1], max(b.size[2], 1.2 * low)))
        x = -side * (bob.size[0] / 2 + b.size[0] / 2 + float(rng.uniform(0.005, 0.15)))
        bodies.append(replace(b, pos=(x, 0.0, b.size[2] / 2)))
    fixtures: tuple[Fixture, ...] = stand(pivot)
    if rng.random() < 0.6:
        fixtures = (*fixtures, board(rng, look, 0.6))
    return Scene("pendulum", tuple(bodies), fixtures, view=SIDE, mutual_restitution=float(rng.uniform(0.3, 0.8)))


def cart(rng: Generator, look: Look) -> Scene:
    """Draw one or two carts on a straight track between stops."""
    half, h = float(rng.uniform(0.7, 1.1)), 0.06
    scale = 0.45 if look.small else 1.0
    size = vec(scale * c for c in (rng.uniform(0.14, 0.24), 0.1, rng.uniform(0.05, 0.08)))
    wheel = 0.75 * size[2]
    track = Fixture("track", "box", (2 * half + 0.1, 0.12, h), (0.0, 0.0, h / 2), rgb=(0.45, 0.45, 0.48), solid=False)
    stops = [
        Fixture(f"stop {n}", "box", (0.04, 0.12, 0.09), (s * (half + 0.02), 0.0, h + 0.045), rgb=DARK, color="black")
        for n, s in (("left", -1), ("right", 1))
    ]
    count = 1 if rng.random() < 0.4 else 2
    bodies = []
    for i in range(count):
        x = float(rng.uniform(-0.6, -0.1) if i == 0 else rng.uniform(0.15, 0.6)) * half
        v = float(rng.uniform(0.4, 1.3)) if i == 0 else float(rng.choice([0.0, rng.uniform(-0.7, 0.3)]))
        mass = float(rng.uniform(0.2, 0.8))
        damping, resistance = float(rng.uniform(0.0, 0.15)) * mass, float(rng.uniform(0.003, 0.03))
        bodies.append(
            Body("AB"[i], "box", size, (x, 0.0, h + wheel), (v, 0.0, 0.0), mass=mass, joint="track", damping=damping,
                 resistance=resistance, restitution=float(rng.uniform(0.3, 0.8)))
        )  # fmt: skip
    if rng.random() < 0.5:
        bodies = [replace(b, pos=(-b.pos[0], 0.0, b.pos[2]), vel=(-b.vel[0], 0.0, 0.0)) for b in bodies]
    return Scene(
        "cart",
        tuple(bodies),
        (track, *stops),
        view=(-115.0, -65.0, 8.0, 35.0),
        mutual_restitution=float(rng.uniform(0.2, 0.9)),
    )


def rope(rng: Generator, look: Look) -> Scene:
    """Draw a rope that swings from a bar, at times with a ball at its end."""
    length, links = float(rng.uniform(0.6, 1.1)), int(rng.integers(11, 16))
    anchor = (0.0, 0.0, length + float(rng.uniform(0.25, 0.45)))
    mass = float(rng.uniform(0.05, 0.2))
    line = Rope(
        anchor=anchor,
        length=length,
        links=links,
        diameter=float(rng.uniform(0.01, 0.02)),
        mass=mass,
        angle=float(np.radians(rng.uniform(25, 80))) * (1 if rng.random() < 0.5 else -1),
        rate=float(rng.choice([0.0, rng.uniform(-1.5, 1.5)])),
        damping=float(rng.uniform(2e-4, 2e-3)) * mass,
        color="brown",
        rgb=(0.5, 0.4, 0.25),
    )
    bodies: tuple[Body, ...] = ()
    if rng.random() < 0.6:
        scale = float(rng.uniform(0.025, 0.035) if look.small else rng.uniform(0.06, 0.1))
        bodies = (replace(draw_body(rng, "A", "sphere", scale), joint="rope"),)
    fixtures: tuple[Fixture, ...] = stand(anchor)
    if rng.random() < 0.5:
        fixtures = (*fixtures, board(rng, look, 0.6))
    return Scene("rope", bodies, fixtures, rope=line, view=SIDE)


def cloth(rng: Generator, look: Look) -> Scene:
    """Draw a cloth that hangs from a bar by its edge or its corners and swings, at times in the wind."""
    scale = 0.6 if look.small else 1.0
    width, height = scale * float(rng.uniform(0.35, 0.65)), scale * float(rng.uniform(0.35, 0.65))
    z = height + float(rng.uniform(0.25, 0.5))
    windy = rng.random() < 0.5
    sheet = Cloth(
        top=(0.0, 0.0, z),
        width=width,
        height=height,
        cells=(9, 9),
        mass=float(rng.uniform(0.1, 0.3)) * width * height * 4,
        angle=float(np.radians(rng.uniform(20, 75))) * (1 if rng.random() < 0.5 else -1),
        corners=bool(rng.random() < 0.5),
        wind=(float(rng.normal(0, 0.6)), float(rng.uniform(1.0, 3.0)), 0.0) if windy else (0.0, 0.0, 0.0),
        drag=float(rng.uniform(0.4, 0.9)),
        color="red",
        rgb=(0.8, 0.1, 0.1),
    )
    posts = tuple(
        Fixture(
            f"post {n}",
            "box",
            (0.03, 0.03, z + 0.03),
            (s * (width / 2 + 0.03), 0.0, (z + 0.03) / 2),
            rgb=DARK,
            color="black",
        )
        for n, s in (("left", -1), ("right", 1))
    )
    fixtures = posts
    if not sheet.corners:
        fixtures = (
            *posts,
            Fixture(
                "bar", "box", (width + 0.06, 0.015, 0.015), (0.0, 0.0, z + 0.008), rgb=DARK, color="black", solid=False
            ),
        )
    return Scene("cloth", (), fixtures, cloth=sheet, view=(-140.0, -40.0, 5.0, 25.0))
