"""How each effect of the catalogue is drawn: fixed parameters at random, one strength knob d left to calibrate."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.random import Generator

from .launches import heading
from .scene import Array, Effect, Launch, Scene, unit
from .walls import place_wall

# rigs in which an effect shows; a trailing * asks for measured orientations, a trailing 0 for a smooth contact
RIGS: dict[str, list[str]] = {
    "gravity_error": ["flight", "bounce"],
    "restitution_error": ["bounce"],
    "friction_error": ["bounce*", "bounce", "puck", "roll"],
    "linear_drag": ["flight", "bounce", "puck"],
    "quadratic_drag": ["flight", "bounce"],
    "wind": ["flight", "bounce"],
    "magnus_lift": ["flight*", "bounce*"],
    "coriolis": ["flight", "bounce", "puck"],
    "buoyancy": ["flight", "bounce"],
    "tilt": ["flight", "bounce", "puck", "roll"],
    "periodic_forcing": ["flight", "bounce", "roll"],
    "spring": ["flight", "bounce", "puck"],
    "tether": ["flight", "bounce"],
    "central_force": ["flight", "bounce"],
    "fan": ["flight", "bounce", "puck"],
    "restitution_speed": ["bounce"],
    "bounce_friction": ["bounce0"],
    "spin_coupling": ["bounce0*", "bounce0", "bounce*"],
    "spin_damping": ["bounce*"],
    "viscous_friction": ["puck", "roll"],
    "friction_patch": ["puck", "puck", "roll"],
    "hidden_wall": ["flight", "bounce", "puck"],
    "rolling_resistance": ["roll"],
    "observer_scale": ["bounce", "flight"],
    "observer_clock": ["bounce", "flight"],
    "observer_tilt": ["bounce", "flight"],
    "observer_distortion": ["flight", "bounce"],
    "dropped_frames": ["flight", "bounce"],
}
# effects of one group are (nearly) the same thing, or exclude each other, so that no pair is drawn from a group
GROUPS = [
    {"gravity_error", "buoyancy", "observer_scale", "observer_clock"},
    {"spring", "central_force", "tether"},
    {"restitution_error", "restitution_speed"},
    {"linear_drag", "quadratic_drag", "wind", "viscous_friction"},
    {"friction_error", "bounce_friction", "spin_coupling", "friction_patch"},
    {"tilt", "observer_tilt"},
    {"hidden_wall", "dropped_frames"},
    {"observer_distortion", "observer_scale"},
]


@dataclass
class Context:
    """Input of a draw: scene, launches, and the base paths as a cloud of points (m)."""

    rng: Generator
    scene: Scene
    launches: list[Launch]
    times: list[Array]  # run -> s since release
    paths: list[Array]  # run -> (body, time, 3)
    rate: float
    options: dict[str, Any] = field(default_factory=dict)

    @property
    def cloud(self) -> Array:
        return np.concatenate([p.reshape(-1, 3) for p in self.paths])

    @property
    def centre(self) -> Array:
        return np.asarray(self.cloud.mean(axis=0))

    @property
    def size(self) -> float:
        """Radius of the region that the paths fill (m)."""
        return float(np.sqrt(np.mean(np.sum((self.cloud - self.centre) ** 2, axis=1))))

    @property
    def speed(self) -> float:
        """RMS speed (m/s) along the base paths."""
        v = [np.gradient(p, t, axis=1) for p, t in zip(self.paths, self.times, strict=True)]
        return float(np.sqrt(np.mean(np.concatenate([np.sum(a * a, axis=-1).ravel() for a in v]))))

    @property
    def spin(self) -> float:
        return float(np.mean([np.linalg.norm(s.w) for run in self.launches for s in run.starts])) + 1e-3

    def level_way(self) -> Array:
        """Return a random horizontal direction (along x for planar motion)."""
        if self.scene.planar:
            return np.array([float(self.rng.choice([-1.0, 1.0])), 0.0, 0.0])
        return heading(self.rng.uniform(-np.pi, np.pi))

    def place(self, spread: float) -> Array:
        """Return a point near the paths (m), in their plane where they have one."""
        p = self.cloud[self.rng.integers(len(self.cloud))] + self.rng.normal(size=3) * spread * self.size
        if self.scene.planar:
            p[1] = 0.0
        if self.scene.flat or self.scene.rig == "roll":
            p[2] = self.cloud[0, 2]
        return np.asarray(p)


@dataclass
class Knob:
    """Effect as a function of the strength d to calibrate (start, bounds); fixed where the bounds coincide."""

    make: Callable[[float], Effect]
    d0: float = 1.0
    lo: float = 1.0
    hi: float = 1.0


def draw_effect(name: str, c: Context) -> Knob:
    """Draw one effect of the catalogue."""
    for table in (_contact, _air, _places, _observer):
        knob = table(name, c)
        if knob is not None:
            return knob
    raise KeyError(name)


def _air(name: str, c: Context) -> Knob | None:
    rng, b = c.rng, c.scene.bodies[0]
    m, v = b.mass, c.speed
    if name == "gravity_error":
        sign = rng.choice([-1.0, 1.0])
        return Knob(lambda d: Effect(name, {"g": 9.81 * (1 + sign * d)}), 0.05, 0.002, 0.45)
    if name == "linear_drag":
        return Knob(lambda d: Effect(name, {"c": m * d}), 0.2, 0.003, 4.0)
    if name == "quadratic_drag":
        return Knob(lambda d: Effect(name, {"k": m * d}), 0.2 / v, 0.002 / v, 4.0 / v)
    if name == "wind":
        u = rng.uniform(1.0, 5.0) * c.level_way()
        return Knob(lambda d: Effect(name, {"k": m * d, "u": u.tolist()}), 0.05, 0.001, 1.0)
    if name == "magnus_lift":
        s0 = m * 9.81 / (c.spin * v)
        return Knob(lambda d: Effect(name, {"s": s0 * d}), 0.1, 0.002, 2.0)
    if name == "coriolis":
        om = np.array([0.0, 1.0, 0.0]) if c.scene.planar else unit(rng.normal(size=3))
        if c.scene.flat or (rng.random() < 0.4 and not c.scene.planar):
            om = np.array([0.0, 0.0, float(rng.choice([-1.0, 1.0]))])
        return Knob(lambda d: Effect(name, {"Omega": (d * om).tolist()}), 0.1, 0.003, 2.0)
    if name == "buoyancy":
        return Knob(lambda d: Effect(name, {"r": d, "C": 0.5}), 0.04, 0.001, 0.5)
    if name == "tilt":
        way = c.level_way()
        return Knob(lambda d: Effect(name, {"a": (d * way[:2]).tolist()}), 0.4, 0.01, 4.0)
    if name == "periodic_forcing":
        way, phi = c.level_way(), float(rng.uniform(-np.pi, np.pi))
        span = float(np.mean([t[-1] for t in c.times]))
        f = float(np.exp(rng.uniform(np.log(0.8 / span), np.log(min(6.0 / span, c.rate / 6)))))
        return Knob(
            lambda d: Effect(name, {"A": d, "f": f, "phi": phi, "direction": way.tolist()}), 2.0 * f, 0.01, 60.0
        )
    return None


def _places(name: str, c: Context) -> Knob | None:
    rng, m, size = c.rng, c.scene.bodies[0].mass, c.size
    if name == "spring":
        a = c.place(0.8)
        return Knob(lambda d: Effect(name, {"k": m * d, "anchor": a.tolist()}), 0.4, 0.005, 30.0)
    if name == "tether":
        start = np.mean([run.starts[0].x for run in c.launches], axis=0)
        a = start + np.array([0, 0, rng.uniform(-0.3, 0.5)]) * size if rng.random() < 0.6 else c.place(0.5)
        r = np.linalg.norm(c.cloud - a, axis=1)
        length = float(np.quantile(r, rng.uniform(0.3, 0.7)))
        return Knob(lambda d: Effect(name, {"k": m * d, "L": length, "anchor": a.tolist()}), 2.0, 0.02, 300.0)
    if name == "central_force":
        n = float(rng.choice([-2.0, -1.0, -0.5, 0.0, 0.5, 1.0]))
        p = c.place(1.0)
        for _ in range(200):
            if np.linalg.norm(c.cloud - p, axis=1).min() > 0.35 * size:
                break
            p = c.place(1.0 + rng.uniform(0, 1))
        scale = float(np.mean(np.linalg.norm(c.cloud - p, axis=1))) ** n
        sign = float(rng.choice([1.0, 1.0, -1.0]))
        return Knob(lambda d: Effect(name, {"s": sign * m * d / scale, "n": n, "point": p.tolist()}), 0.4, 0.01, 8.0)
    if name == "fan":
        p, w = c.place(0.3), float(size * rng.uniform(0.2, 0.6))
        way = c.level_way() if c.scene.flat or c.scene.planar or rng.random() < 0.6 else unit(rng.normal(size=3))
        return Knob(lambda d: Effect(name, {"f": (m * d * way).tolist(), "c": p.tolist(), "w": w}), 1.0, 0.02, 40.0)
    if name == "hidden_wall":
        e = place_wall(rng, c.scene, c.paths, c.options.get("variant"))
        return Knob(lambda d: e)
    return None


def _contact(name: str, c: Context) -> Knob | None:
    rng, b = c.rng, c.scene.bodies[0]
    sign = float(rng.choice([-1.0, 1.0]))
    if name == "restitution_error":
        room = (0.97 - b.restitution) if sign > 0 else b.restitution - 0.2
        return Knob(lambda d: Effect(name, {"e": b.restitution + sign * d}), 0.05, 0.002, max(room, 0.01))
    if name == "friction_error":
        up = sign if b.friction < 0.3 else -1.0
        return Knob(lambda d: Effect(name, {"mu": float(b.friction * np.exp(up * d))}), 0.4, 0.01, 2.5)
    if name == "restitution_speed":
        return Knob(lambda d: Effect(name, {"e0": b.restitution, "k": d}), 0.03, 0.001, 0.4)
    if name == "bounce_friction":
        return Knob(lambda d: Effect(name, {"f": d}), 0.15, 0.01, 0.9)
    if name == "spin_coupling":
        low, high = (0.15, 0.85) if b.friction > 0 else (-0.6, 0.8)
        weak = c.options.get("weak", False) and b.friction == 0
        e_t = float(rng.uniform(-0.95, -0.7) if weak else rng.uniform(low, high))
        return Knob(lambda d: Effect(name, {"e_t": e_t, "replaces_coulomb": True}))
    if name == "spin_damping":
        rate = float(np.exp(rng.uniform(np.log(0.4), np.log(4.0)))) * (0.2 if c.options.get("weak") else 1.0)
        return Knob(lambda d: Effect(name, {"c": b.inertia * rate}))
    if name == "viscous_friction":
        return Knob(lambda d: Effect(name, {"c": b.mass * d}), 0.2, 0.003, 5.0)
    if name == "rolling_resistance":
        return Knob(lambda d: Effect(name, {"b": b.radius * d}), 0.01, 0.0005, 0.15)
    if name == "friction_patch":
        p, rad = c.place(0.1), float(c.size * rng.uniform(0.25, 0.7))
        up = sign if b.friction < 0.25 else -1.0
        center = p[:2].tolist()
        return Knob(
            lambda d: Effect(
                name, {"mu": float(np.clip(b.friction * np.exp(up * d), 0, 0.8)), "center": center, "radius": rad}
            ),
            1.0,
            0.1,
            5.5,
        )
    if name == "mass_error":
        i = int(rng.integers(len(c.scene.bodies)))
        body = c.scene.bodies[i]
        return Knob(
            lambda d: Effect(
                name,
                {"object": body.name, "index": i, "mass": float(body.mass * np.exp(sign * d)), "mass_given": body.mass},
            ),
            0.3,
            0.03,
            1.5,
        )
    return None


def _observer(name: str, c: Context) -> Knob | None:
    rng, sign = c.rng, float(c.rng.choice([-1.0, 1.0]))
    centre = c.centre + rng.normal(size=3) * 0.2 * c.size
    if c.scene.planar:
        centre[1] = 0.0
    pin = centre if rng.random() < 0.6 else np.zeros(3)
    if name == "observer_scale":
        return Knob(lambda d: Effect(name, {"s": 1 + sign * d, "c": pin.tolist()}), 0.05, 0.002, 0.3)
    if name == "observer_clock":
        return Knob(lambda d: Effect(name, {"c": 1 + sign * d}), 0.03, 0.001, 0.25)
    if name == "observer_tilt":
        axis = np.array([0.0, 1.0, 0.0]) if c.scene.planar else c.level_way()
        return Knob(
            lambda d: Effect(name, {"angle": sign * d, "axis": axis.tolist(), "c": pin.tolist()}), 0.05, 0.002, 0.35
        )
    if name == "observer_distortion":
        return Knob(lambda d: Effect(name, {"k": sign * d / c.size**2, "c": centre.tolist()}), 0.05, 0.003, 0.25)
    if name == "dropped_frames":
        run = int(rng.integers(len(c.launches)))
        frames = int(rng.integers(1, 4) if c.options.get("weak") else rng.integers(3, 10))
        on = c.launches[run].t0 + float(c.times[run][-1] * rng.uniform(0.25, 0.75))
        kind = str(rng.choice(["lost", "skip"]))
        p = {"run": run, "onset": on, "frames": frames, "shift": frames / c.rate, "sign": kind}
        return Knob(lambda d: Effect(name, p))
    return None


def accepted(name: str, scene: Scene, p: dict[str, Any]) -> list[str]:
    """Return alternatives indistinguishable, or hardly, from the effect in this scene (the name itself left out)."""
    open_air = not scene.floor
    sliding = scene.rig in ("puck", "discs", "roll")
    on_floor = open_air or abs(p.get("c", [0, 0, 0])[2] if isinstance(p.get("c"), list) else 0.0) < 1e-9
    table: dict[str, list[str]] = {
        "gravity_error": ["buoyancy", "observer_clock"] + (["observer_scale"] if open_air else []),
        "buoyancy": ["gravity_error", "observer_clock"] + (["observer_scale"] if open_air else []),
        "observer_clock": ["gravity_error", "buoyancy"] + (["observer_scale"] if open_air else []),
        "observer_scale": ["gravity_error", "buoyancy", "observer_clock"] if on_floor else [],
        "observer_tilt": ["tilt"] if open_air else [],
        "tilt": ["observer_tilt"] if open_air else [],
        "spring": ["central_force"],
        "central_force": ["spring"] if p.get("n") == 1.0 else [],
        "linear_drag": ["viscous_friction"] if sliding else [],
        "viscous_friction": ["linear_drag"] if sliding else [],
    }
    return table.get(name, [])
