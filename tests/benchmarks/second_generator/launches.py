"""Launch habits of two experimenters. A habit is drawn once per case; each run is one draw from it."""

from collections.abc import Callable

import numpy as np
from numpy.random import Generator

from .scene import UP, Array, Body, Launch, Plane, Scene, Start, rotvec_q, unit

Launcher = Callable[[Generator], Launch]
FLOOR_POINT = np.zeros(3)


def heading(azimuth: float, elevation: float = 0.0) -> Array:
    """Unit vector at azimuth and elevation (rad)."""
    return np.array([np.cos(azimuth) * np.cos(elevation), np.sin(azimuth) * np.cos(elevation), np.sin(elevation)])


def draw_spin(rng: Generator, planar: bool, top: float) -> Array:
    """Angular velocity (rad/s), magnitude 0.2..1 of top; along y for planar motion."""
    size = top * rng.uniform(0.2, 1.0)
    return size * (np.array([0, rng.choice([-1.0, 1.0]), 0]) if planar else unit(rng.normal(size=3)))


def ball_scene(rng: Generator, style: str, rig: str, orient: bool, planar: bool, smooth: bool) -> Scene:
    """Return a ball over (or without) a floor; smooth: a frictionless contact."""
    radius = float(rng.choice([0.01, 0.02, 0.0335, 0.05, 0.11]) if style == "b" else rng.uniform(0.012, 0.06))
    density = float(np.exp(rng.uniform(np.log(60), np.log(2500))))
    e = float(rng.uniform(0.55, 0.93))
    mu = 0.0 if smooth else float(rng.uniform(0.06, 0.45))
    mass = density * 4 / 3 * np.pi * radius**3
    floor = rig != "flight"
    planes = [Plane("floor", FLOOR_POINT, UP, e, mu)] if floor else []
    released = "spinning" if orient else "without spin"
    body = Body("ball", "sphere", radius, float(mass), e, mu)
    return Scene([body], planes, floor, rig, orient, planar, released, style)


def puck_scene(rng: Generator, style: str, count: int, orient: bool) -> Scene:
    """Discs on a table; an air table now and then."""
    mu = float(rng.uniform(0.004, 0.02) if rng.random() < 0.35 else rng.uniform(0.04, 0.22))
    e, rim = float(rng.uniform(0.5, 0.95)), float(rng.uniform(0.05, 0.3)) if orient else 0.0
    names = ["puck"] if count == 1 else [f"disc{chr(65 + i)}" for i in range(count)]
    height, r0 = float(rng.uniform(0.008, 0.03)), float(rng.uniform(0.025, 0.06))
    bodies = []
    for name in names:
        r = r0 if style == "b" else float(r0 * rng.uniform(0.8, 1.25))
        density = float(rng.uniform(900, 3000))
        bodies.append(Body(name, "disc", r, density * np.pi * r * r * height, e, mu, height, rim))
    planes = [Plane("table", FLOOR_POINT, UP, 0.0, mu)]
    return Scene(bodies, planes, True, "puck" if count == 1 else "discs", orient, False, "without spin", style)


def ball_launcher(rng: Generator, scene: Scene, spin_top: float, times: str) -> Launcher:
    """Draw a launch habit for a ball and return the function that makes one launch."""
    r, planar, style, rig = scene.bodies[0].radius, scene.planar, scene.style, scene.rig
    if rig == "roll":
        make = _roll(rng, scene)
    elif style == "a":
        make = _throws(rng, rig, r, planar)
    else:
        make = _style_b(rng, scene)
    length, shared = float(rng.uniform(0.8, 2.5)), float(rng.uniform(0.0, 5.0)) if times == "late" else 0.0

    def launch(g: Generator) -> Launch:
        x, v, w = make(g)
        if scene.orient:
            w = draw_spin(g, planar, spin_top)
        q = rotvec_q(np.array([0.0, g.uniform(-3, 3), 0.0]) if planar else unit(g.normal(size=3)) * g.uniform(0, 3))
        t0 = float(g.uniform(0, 5)) if times == "various" else shared
        return Launch(t0, length * float(g.uniform(0.85, 1.1)), [Start(x, v, w, q)])

    return launch


Maker = Callable[[Generator], tuple[Array, Array, Array]]


def _throws(rng: Generator, rig: str, r: float, planar: bool) -> Maker:
    """Style a: throws all round, or in a sector, from hand height."""
    sector, mid = (rng.uniform(0.6, 3.2), rng.uniform(-np.pi, np.pi)) if not planar else (0.0, 0.0)
    hand, fast = rng.uniform(0.5, 1.8), rng.uniform(2.0, 8.0)
    low, high = (15, 75) if rig == "flight" else (-25, 60)
    if rig == "bounce":
        hand, fast = rng.uniform(0.3, 1.3), rng.uniform(1.2, 4.0)

    def make(g: Generator) -> tuple[Array, Array, Array]:
        az, el = mid + g.uniform(-sector, sector), np.radians(g.uniform(low, high))
        if planar and g.random() < 0.3:
            az = np.pi
        x = np.array([g.uniform(-0.3, 0.3), 0.0 if planar else g.uniform(-0.3, 0.3), r + hand * g.uniform(0.7, 1.3)])
        return x, fast * g.uniform(0.5, 1.2) * heading(az, el), np.zeros(3)

    return make


def _roll(rng: Generator, scene: Scene) -> Maker:
    """Balls pushed along the floor: sliding at first, or rolling from the start."""
    r, fast = scene.bodies[0].radius, rng.uniform(0.6, 2.5)
    rolling = bool(rng.random() < 0.5) or scene.bodies[0].friction == 0
    scene.released = "rolling" if rolling else "without spin"
    base = rng.uniform(-np.pi, np.pi) if not scene.planar else 0.0
    spread = 0.0 if scene.planar else rng.uniform(0.3, np.pi)

    def make(g: Generator) -> tuple[Array, Array, Array]:
        v = fast * g.uniform(0.4, 1.2) * heading(base + g.uniform(-spread, spread))
        x = np.array([g.uniform(-0.4, 0.4), 0.0 if scene.planar else g.uniform(-0.4, 0.4), r])
        w = np.array([-v[1] / r, v[0] / r, 0.0]) if rolling else np.zeros(3)
        return x, v, w

    return make


def _style_b(rng: Generator, scene: Scene) -> Maker:
    """Style b: drops, a ramp with release heights, throws from one corner, juggling against a known wall."""
    r, planar, body = scene.bodies[0].radius, scene.planar, scene.bodies[0]
    kinds = ["ramp", "corner"] if scene.rig == "flight" else ["drop", "ramp", "corner", "juggle"]
    kind = str(rng.choice(kinds))
    side = 0.0 if planar else 1.0
    reach, top = rng.uniform(1.0, 2.2), rng.uniform(1.0, 2.6)
    if kind == "juggle":
        scene.planes.append(
            Plane("wall", np.array([reach, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]), body.restitution, body.friction)
        )

    def make(g: Generator) -> tuple[Array, Array, Array]:
        if kind == "drop":
            x = np.array([g.normal(0, 0.1), side * g.normal(0, 0.1), r + top * g.uniform(0.35, 1.0)])
            return x, np.array([g.normal(0, 0.25), side * g.normal(0, 0.25), 0.0]), np.zeros(3)
        if kind == "ramp":  # rolls down a quarter ramp: v = sqrt(10/7 g h), leaves almost horizontally
            v = np.sqrt(10 / 7 * 9.81 * top * g.uniform(0.05, 0.5))
            high = max(top, 1.9) if scene.rig == "flight" else 0.5 * top
            tilt = np.radians(g.uniform(-3, 25))
            return np.array([0.0, 0.0, r + high]), v * heading(side * g.normal(0, 0.08), tilt), np.zeros(3)
        if kind == "corner":
            el = np.radians(g.uniform(25, 80) if scene.rig == "flight" else g.uniform(-5, 65))
            x = np.array([0.1, side * 0.1, r + 0.4 * top]) + np.array([1.0, side, 1.0]) * g.normal(0, 0.02, 3)
            return x, top * g.uniform(1.6, 2.6) * heading(side * g.uniform(0.1, 1.45), el), np.zeros(3)
        x = np.array([reach - g.uniform(0.5, 1.0) * reach, side * g.normal(0, 0.2), r + 0.5 * top])
        v = reach * g.uniform(1.2, 3.0) * heading(side * g.normal(0, 0.2), np.radians(g.uniform(10, 50)))
        return x, v, np.zeros(3)

    return make


def disc_launcher(rng: Generator, scene: Scene, spin_top: float, times: str) -> Launcher:
    """Discs on the table. One puck: pushes; several: the first is shot at the others (or all move)."""
    bodies, mu = scene.bodies, scene.bodies[0].friction
    n, all_move = len(bodies), bool(rng.random() < 0.5)
    length = float(rng.uniform(0.8, 2.5))
    fast = max(float(rng.uniform(0.5, 1.6)), 1.1 * mu * 9.81 * min(length, 1.2))
    corner = scene.style == "b"
    shared = float(rng.uniform(0, 5)) if times == "late" else 0.0

    def launch(g: Generator) -> Launch:
        xs = [np.array([*(g.uniform(-0.1, 0.1, 2) if corner else g.uniform(-0.4, 0.4, 2)), 0.0])]
        while len(xs) < n:
            p = xs[0] + g.uniform(0.2, 0.55) * heading(g.uniform(0, 1.57) if corner else g.uniform(-np.pi, np.pi))
            reach = [1.3 * (bodies[len(xs)].radius + b.radius) for b in bodies]
            if all(float(np.linalg.norm(p - o)) > reach[k] for k, o in enumerate(xs)):
                xs.append(p)
        starts = []
        for i in range(n):
            if n == 1:
                v = heading(g.uniform(0.0, 1.57) if corner else g.uniform(-np.pi, np.pi))
            elif i == 0:
                d = xs[1] - xs[0]
                aim = np.arcsin(min(0.8 * (bodies[0].radius + bodies[1].radius) / float(np.linalg.norm(d)), 0.9))
                v = heading(float(np.arctan2(d[1], d[0]) + g.uniform(-aim, aim)))
            else:
                v = unit(xs[0] - xs[i]) * 0.6 + 0.5 * heading(g.uniform(-3, 3)) if all_move else np.zeros(3)
            spin = g.uniform(-1, 1) * min(spin_top, 12.0) if scene.orient and np.any(v) else 0.0
            x = xs[i].copy()
            x[2] = bodies[i].height / 2
            starts.append(Start(x, fast * g.uniform(0.6, 1.3) * v, np.array([0.0, 0.0, spin])))
        t0 = float(g.uniform(0, 5)) if times == "various" else shared
        return Launch(t0, length * float(g.uniform(0.85, 1.1)), starts)

    return launch
