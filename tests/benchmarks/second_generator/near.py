"""Laws whose form is near, but not in, the catalogue."""

from functools import partial

import numpy as np
from numpy.random import Generator

from .cases import Plan
from .effects import Context, Knob, draw_effect
from .scene import Effect


def near_effect(kind: str, c: Context) -> Knob:
    """Return one law by kind; catalogue names are drawn as there.

    power: F = -k |v|^(n-1) v. crisis: k(v) falls to half beyond v_c over d_v. spin: torque -c w. fifth_root:
    e = e0 - a v^(1/5), the given e being that of a drop test at v_test. exponential: e = e0 exp(-v/v0). lens: 0.3..1.2%
    distortion at the edge. camera: 1 degree. gust: u(z) = u_ref ln(1+z/z0)/ln(1+z_ref/z0).
    """
    rng, b, v = c.rng, c.scene.bodies[0], c.speed
    m, e = b.mass, b.restitution
    if kind == "power":
        n = float(rng.uniform(1.6, 2.4))
        return Knob(lambda d: Effect("power_drag", {"k": m * d / v ** (n - 1), "n": n}), 0.2, 0.003, 4.0)
    if kind == "crisis":
        vc, dv = float(v * rng.uniform(0.75, 1.3)), float(v * rng.uniform(0.05, 0.2))
        return Knob(lambda d: Effect("drag_crisis", {"k": m * d / v, "v_c": vc, "d_v": dv}), 0.3, 0.003, 4.0)
    if kind == "spin":
        tau = float(np.exp(rng.uniform(np.log(0.3), np.log(2.0))))
        return Knob(lambda d: Effect("spin_damping", {"c": b.inertia / tau, "decay_time": tau}))
    if kind == "fifth_root":
        vt = float(rng.uniform(2.0, 4.0))
        p = {"form": "fifth_root", "v_test": vt}
        return Knob(lambda d: Effect("restitution_speed", {**p, "e0": e + d * vt**0.2, "a": d}), 0.1, 0.01, 0.6)
    if kind == "exponential":
        vt = float(rng.uniform(1.5, 3.0)) if rng.random() < 0.5 else 0.0
        p = {"form": "exponential", "v_test": vt}
        return Knob(
            lambda d: Effect("restitution_speed", {**p, "e0": min(float(e * np.exp(vt * d)), 1.0), "v0": 1 / d}),
            0.03,
            0.002,
            0.4,
        )
    if kind == "lens":
        k, at = float(rng.choice([-1, 1]) * rng.uniform(0.003, 0.012)) / c.size**2, c.centre.tolist()
        return Knob(lambda d: Effect("observer_distortion", {"k": k, "c": at}))
    if kind == "camera":
        q = {"axis": [0.0, 1.0, 0.0] if c.scene.planar else c.level_way().tolist(), "c": [0.0, 0.0, 0.0]}
        return Knob(lambda d: Effect("observer_tilt", {"angle": float(np.radians(1.0)), **q}))
    if kind == "gust":
        u, z0 = float(rng.uniform(2.0, 6.0)) * c.level_way(), float(np.exp(rng.uniform(np.log(0.005), np.log(0.1))))
        r = {"u_ref": u.tolist(), "z_ref": 2.0, "z0": z0}
        return Knob(lambda d: Effect("wind_profile", {"k": m * d, **r}), 0.05, 0.001, 1.0)
    return draw_effect(kind, c)


AIR, Q, BOTH = ["flight", "bounce"], "quadratic_drag", "linear_drag+quadratic_drag"
# name: (rigs, laws, accepted names)
TABLE: dict[str, tuple[list[str], list[str], list[str]]] = {
    "power_drag": (AIR, ["power"], [Q, "linear_drag", BOTH]),
    "drag_crisis": (AIR, ["crisis"], [Q, "linear_drag", BOTH]),
    "decaying_spin": (["flight*", "bounce*"], ["magnus_lift", "spin"], ["magnus_lift", "magnus_lift+spin_damping"]),
    "fifth_root": (["bounce"], ["fifth_root"], ["restitution_speed", "restitution_error"]),
    "exponential": (["bounce"], ["exponential"], ["restitution_speed", "restitution_error"]),
    "lens_and_drag": (AIR, [Q, "lens"], [Q, f"{Q}+observer_distortion"]),
    "tilt_and_drag": (AIR, [Q, "camera"], [Q, f"{Q}+observer_tilt", f"{Q}+tilt", "wind"]),
    "mixture": (AIR, ["linear_drag", Q], [Q, "linear_drag", BOTH]),
    "gust": (AIR, ["gust"], ["wind"]),
}


def near_plan(rng: Generator, style: str, kinds: list[str]) -> list[Plan]:
    """Return one plan for each kind of TABLE asked for."""
    out = []
    for kind in kinds:
        rigs, laws, ok = TABLE[kind]
        short = kind == "decaying_spin" and bool(rng.random() < 0.5)
        out.append(
            Plan(
                "near_misses",
                style,
                str(rng.choice(rigs)),
                [partial(near_effect, k) for k in laws],
                weak=bool(rng.random() < 0.2),
                min_rate=120.0 if short else 0.0,
                accepted=list(ok),
                options={"kind": kind, "spin_at_start_only": short},
            )
        )
    return out
