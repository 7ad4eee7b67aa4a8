"""Draw scenes seen from the side: a tossed ball, a bouncing ball, a body on a ramp."""

from dataclasses import replace

import numpy as np
from numpy.random import Generator

from .bodies import Body, Fixture, Quat, Scene, vec
from .draw_floor import NAMES, draw_body, lying, rolling_spin
from .looks import Look

SIDE = (-104.0, -76.0, 2.0, 14.0)


def board(rng: Generator, look: Look, y: float) -> Fixture:
    """Return an upright board behind the motion."""
    level = float(np.clip(sum(look.floor_rgb) / 3 + rng.uniform(0.1, 0.3), 0.2, 0.9))
    tint = np.zeros(3) if look.grey else rng.uniform(-0.06, 0.06, 3)
    rgb = vec(np.clip(level + tint, 0.1, 0.95))
    return Fixture("board", "box", (12.0, 0.04, 5.0), (0.0, y + 0.02, 2.5), color="pale", rgb=rgb)


def tossed(rng: Generator, look: Look) -> Scene:
    """Draw a ball (at times a box) thrown in front of a board, at times with a body on the floor."""
    scale = float(rng.uniform(0.035, 0.05) if look.small else rng.uniform(0.09, 0.2))
    shape = "box" if rng.random() < 0.15 else "sphere"
    a = draw_body(rng, "A", shape, scale)
    z0, vx, vz = float(rng.uniform(0.3, 1.3)), float(rng.uniform(0.8, 2.6)), float(rng.uniform(1.5, 4.5))
    spin = vec(rng.normal(0, 3, 3))
    a = replace(
        a,
        pos=(-0.8, 0.0, z0),
        vel=(vx, float(rng.normal(0, 0.06)), vz),
        spin=spin,
        restitution=float(rng.uniform(0.3, 0.8)),
        rolling=float(rng.uniform(0.01, 0.05)),
    )
    bodies = [a]
    if rng.random() < 0.5:
        lands = -0.8 + vx * (vz + np.sqrt(vz**2 + 2 * 9.81 * z0)) / 9.81
        b = draw_body(rng, "B", str(rng.choice(["box", "sphere", "cylinder"])), scale * 1.2)
        bodies.append(replace(b, pos=(float(lands + rng.uniform(-0.1, 0.9)), float(rng.normal(0, 0.02)), b.pos[2])))
    return Scene("tossed", tuple(bodies), (board(rng, look, 0.7),), view=SIDE, mutual_restitution=0.5)


def bouncing(rng: Generator, look: Look) -> Scene:
    """Draw one or two balls that bounce on the floor."""
    scale = float(rng.uniform(0.03, 0.045) if look.small else rng.uniform(0.08, 0.18))
    bodies = []
    for i in range(int(rng.integers(1, 3))):
        b = draw_body(rng, NAMES[i], "sphere", scale)
        x = -0.5 + 0.6 * i + float(rng.uniform(-0.1, 0.1))
        vx = float(rng.uniform(0.1, 0.9)) * (1 if i == 0 or rng.random() < 0.3 else -1)
        bodies.append(
            replace(
                b,
                pos=(x, float(rng.normal(0, 0.02)), float(rng.uniform(0.4, 1.3))),
                vel=(vx, 0.0, float(rng.uniform(-0.5, 0.8))),
                spin=(0.0, float(rng.normal(0, 4)), 0.0),
                restitution=float(rng.uniform(0.5, 0.9)),
                rolling=float(rng.uniform(0.01, 0.04)),
            )
        )
    return Scene(
        "bouncing",
        tuple(bodies),
        (board(rng, look, 0.6),),
        view=SIDE,
        mutual_restitution=float(rng.uniform(0.5, 0.9)),
        mutual_friction=float(rng.uniform(0.1, 0.3)),
    )


def ramp(rng: Generator, look: Look) -> Scene:
    """Draw a body that slides or rolls down a ramp onto the floor, at times towards another one."""
    theta = float(np.radians(rng.uniform(12, 32)))
    length, thick = float(rng.uniform(0.8, 1.4)), 0.03
    scale = float(rng.uniform(0.025, 0.035) if look.small else rng.uniform(0.07, 0.13))
    down, normal = np.array([np.cos(theta), 0, -np.sin(theta)]), np.array([np.sin(theta), 0, np.cos(theta)])
    tilt: Quat = (float(np.cos(theta / 2)), 0.0, float(np.sin(theta / 2)), 0.0)
    shape = str(rng.choice(["box", "sphere", "cylinder"], p=[0.5, 0.3, 0.2]))
    a = draw_body(rng, "A", shape, scale)
    height, quat, spin = a.pos[2], tilt, (0.0, 0.0, 0.0)
    speed = float(rng.choice([0.0, rng.uniform(0.1, 0.6)]))
    if shape == "cylinder":
        height, quat = a.size[0] / 2, lying(0.0)
    if shape == "box":
        a = replace(a, friction=float(np.tan(theta) * rng.uniform(0.25, 0.85)))
    else:
        spin = rolling_spin((speed, 0.0, 0.0), height)
    along = length * float(rng.uniform(0.75, 0.9))
    place = -along * down + (height + 1e-4) * normal
    a = replace(
        a,
        pos=vec(place),
        quat=quat,
        vel=vec(speed * down),
        spin=spin,
        restitution=float(rng.uniform(0.05, 0.3)),
    )
    centre = -length / 2 * down - thick / 2 * normal
    slab = Fixture("ramp", "box", (length, 0.4, thick), vec(centre), tilt, "brown", (0.55, 0.42, 0.3))
    bodies: list[Body] = [a]
    if rng.random() < 0.6:
        b = draw_body(rng, "B", str(rng.choice(["box", "sphere", "cylinder"], p=[0.5, 0.2, 0.3])), scale)
        bodies.append(replace(b, pos=(float(rng.uniform(0.2, 0.6)), float(rng.normal(0, 0.01)), b.pos[2])))
    fixtures = (slab, board(rng, look, 0.6)) if rng.random() < 0.5 else (slab,)
    turn = 0.0 if len(fixtures) == 2 or rng.random() < 0.5 else 180.0
    return Scene(
        "ramp",
        tuple(bodies),
        fixtures,
        view=(-115.0 + turn, -65.0 + turn, 8.0, 30.0),
        mutual_restitution=float(rng.uniform(0.2, 0.7)),
    )
