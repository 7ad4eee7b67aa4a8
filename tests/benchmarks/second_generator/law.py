"""The true law of a case: base mechanics plus hidden effects, as forces, torques and contact rules."""

from collections.abc import Callable
from typing import Any

import numpy as np

from .scene import G_GIVEN, Array, Body, Effect, Plane, Scene, cross, unit

Force = Callable[[dict[str, Any], float, Array, Array, Array, float], Array]  # (parameters, t, x, v, w, m) -> N


def _norm(v: Array) -> float:
    return float(np.sqrt(v @ v))


def _tether(p: dict[str, Any], t: float, x: Array, v: Array, w: Array, m: float) -> Array:
    d = x - p["anchor"]
    r = _norm(d)
    return -p["k"] * (r - p["L"]) / r * d if r > p["L"] else 0 * d


def _rel(v: Array, u: Array, k: float) -> Array:
    """-k |v-u| (v-u)."""
    return -k * _norm(v - u) * (v - u)


def _crisis(p: dict[str, Any], speed: float) -> float:
    """k (1 - 1/2 / (1+exp(-(|v|-v_c)/d_v)))."""
    return float(p["k"] * (1 - 0.5 / (1 + np.exp(-(speed - p["v_c"]) / p["d_v"]))))


def _log(z: float, p: dict[str, Any]) -> float:
    """ln(1+z/z0)/ln(1+z_ref/z0) for z > 0, else 0."""
    return float(np.log1p(max(z, 0.0) / p["z0"]) / np.log1p(p["z_ref"] / p["z0"]))


FORCES: dict[str, Force] = {
    "linear_drag": lambda p, t, x, v, w, m: -p["c"] * v,
    "quadratic_drag": lambda p, t, x, v, w, m: _rel(v, np.zeros(3), p["k"]),
    "wind": lambda p, t, x, v, w, m: _rel(v, p["u"], p["k"]),
    "power_drag": lambda p, t, x, v, w, m: -p["k"] * _norm(v) ** (p["n"] - 1) * v,
    "drag_crisis": lambda p, t, x, v, w, m: _rel(v, np.zeros(3), _crisis(p, _norm(v))),
    "wind_profile": lambda p, t, x, v, w, m: _rel(v, p["u_ref"] * _log(x[2], p), p["k"]),
    "magnus_lift": lambda p, t, x, v, w, m: p["s"] * cross(w, v),
    "coriolis": lambda p, t, x, v, w, m: -2 * m * cross(p["Omega"], v),
    "tilt": lambda p, t, x, v, w, m: m * np.array([p["a"][0], p["a"][1], 0.0]),
    "periodic_forcing": lambda p, t, x, v, w, m: (
        m * p["A"] * np.sin(2 * np.pi * p["f"] * t + p["phi"]) * p["direction"]
    ),
    "push": lambda p, t, x, v, w, m: p["F"] if p["t_on"] <= t < p["t_off"] else 0 * p["F"],  # a contamination
    "spring": lambda p, t, x, v, w, m: -p["k"] * (x - p["anchor"]),
    "tether": _tether,
    "central_force": lambda p, t, x, v, w, m: -p["s"] * _norm(x - p["point"]) ** (p["n"] - 1) * (x - p["point"]),
    "fan": lambda p, t, x, v, w, m: p["f"] * np.exp(-((x - p["c"]) @ (x - p["c"])) / (2 * p["w"] ** 2)),
}


class Law:
    """All that acts in a case. Contact rules refer to the known surfaces; hidden walls bring their own."""

    def __init__(self, scene: Scene, effects: list[Effect]) -> None:
        self.scene, self.effects = scene, effects
        self.p: dict[str, dict[str, Any]] = {e.name: e.p for e in effects}
        self.g = self.p.get("gravity_error", {}).get("g", G_GIVEN)
        r = self.p.get("buoyancy", {}).get("r", 0.0)
        self.weight = self.g * (1 - r)  # m/s^2 times m: apparent weight
        self.added = 1 + self.p.get("buoyancy", {}).get("C", 0.5) * r
        self.forces = [
            (FORCES[e.name], {k: np.array(v, dtype=float) if isinstance(v, list) else v for k, v in e.p.items()})
            for e in effects
            if e.name in FORCES
        ]
        self.viscous = self.p.get("viscous_friction", {}).get("c", 0.0)
        self.rolling = self.p.get("rolling_resistance", {}).get("b", 0.0)
        self.spin_c = self.p.get("spin_damping", {}).get("c", 0.0)
        self.masses = [b.mass for b in scene.bodies]
        if "mass_error" in self.p:
            self.masses[self.p["mass_error"]["index"]] = self.p["mass_error"]["mass"]
        self.planes = list(scene.planes)
        for e in effects:
            if e.name == "hidden_wall":
                self.planes.append(
                    Plane(
                        "hidden_wall",
                        np.array(e.p["point"], dtype=float),
                        unit(np.array(e.p["normal"], dtype=float)),
                        e.p["restitution"],
                        e.p["friction"],
                        hidden=True,
                    )
                )
        self.breaks = sorted(t for e in effects if e.name == "push" for t in (e.p["t_on"], e.p["t_off"]))

    def force(self, t: float, x: Array, v: Array, w: Array, m: float) -> Array:
        """Return the sum of the hidden body forces, gravity left out (N)."""
        total = np.zeros(3)
        for f, p in self.forces:
            total = total + f(p, t, x, v, w, m)
        return total

    def restitution(self, plane: Plane | None, given: float, speed: float) -> float:
        """Restitution at a contact met with normal approach speed (m/s); plane None: two discs."""
        if plane is not None and plane.hidden:
            return plane.restitution
        e = given if plane is None else plane.restitution
        if "restitution_error" in self.p and (plane is None or not self.scene.flat):
            return float(self.p["restitution_error"]["e"])
        q = self.p.get("restitution_speed")
        if q is None:
            return e
        form = q.get("form", "rational")
        if form == "rational":  # e0/(1+k v)
            return float(q["e0"] / (1 + q["k"] * speed))
        if form == "fifth_root":  # e0 - a v^(1/5)
            return float(np.clip(q["e0"] - q["a"] * speed**0.2, 0.05, 1.0))
        return float(q["e0"] * np.exp(-speed / q["v0"]))  # exponential

    def friction(self, given: float, x: Array) -> float:
        """Coulomb coefficient of a known surface at x."""
        mu = self.p.get("friction_error", {}).get("mu", given)
        patch = self.p.get("friction_patch")
        if patch is not None and np.hypot(x[0] - patch["center"][0], x[1] - patch["center"][1]) < patch["radius"]:
            mu = patch["mu"]
        return float(mu)


def bounce(law: Law, plane: Plane, body: Body, x: Array, v: Array, w: Array) -> tuple[Array, Array, float]:
    """Rigid-sphere impact on a plane; returns new v, new w and the rebound speed.

    J_n = m (1+e) |v_n|; slip u = v_t + w x (-r n); the tangential impulse is the smaller of the sticking one
    (2/7) m |u| and mu J_n; w changes by (-r n) x J_t / I. The hidden rules bounce_friction (v_t' = (1-f) v_t, spin
    untouched) and spin_coupling (u' = -e_t u) take the place of Coulomb friction on the known surfaces.
    """
    n, r, m = plane.normal, body.radius, body.mass
    vn = float(v @ n)
    e = law.restitution(plane, plane.restitution, -vn)
    arm = -r * n
    slip = v - vn * n + cross(w, arm)
    slip = slip - (slip @ n) * n
    speed = _norm(slip)
    v_new = v - (1 + e) * vn * n
    if not plane.hidden and "bounce_friction" in law.p:
        vt = v_new - (v_new @ n) * n
        return v_new - law.p["bounce_friction"]["f"] * vt, w.copy(), -e * vn
    if not plane.hidden and "spin_coupling" in law.p:
        jt = -(1 + law.p["spin_coupling"]["e_t"]) * (2.0 / 7.0) * m * slip
    elif speed > 0:
        mu = plane.friction if plane.hidden else law.friction(plane.friction, x)
        jt = -min((2.0 / 7.0) * m * speed, mu * m * (1 + e) * -vn) * slip / speed
    else:
        jt = np.zeros(3)
    return v_new + jt / m, w + cross(arm, jt) / body.inertia, -e * vn
