"""Hidden forces that no catalogue of effects holds, or that MuJoCo computes: what must come out as unexplained."""

# ruff: noqa: ARG001, ARG005  (every law has the same arguments and uses some)

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tests.benchmarks.first_generator.laws import Draw, Drawn, Scenery, unit, with_force
from tests.scenes.ball import Ball

Array = NDArray[np.float64]


def drag_power(power: float) -> Callable[[np.random.Generator, Scenery], Drawn]:
    """Drag with another power of the speed, F = -s |v|^(p - 1) v."""

    def draw(rng: np.random.Generator, scenery: Scenery) -> Drawn:
        def apply(b: Ball, s: float) -> Ball:
            return with_force(b, lambda t, x, v, w: -s * np.linalg.norm(v) ** (power - 1.0) * v)

        return Drawn(f"drag_power_{power:g}", lambda s: {"coefficient": s}, guess=0.01, apply=apply)

    return draw


def drag_by_axis(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """Quadratic drag of each component by itself, F_i = -s |v_i| v_i."""
    return Drawn(
        "drag_by_axis",
        lambda s: {"coefficient": s},
        guess=0.01,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: -s * np.abs(v) * v),
    )


def shear(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """Return a horizontal force that grows with the height."""
    d = unit(rng, flat=True)
    return Drawn(
        "shear",
        lambda s: {"gradient": s},
        guess=0.2,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: s * x[2] * d),
    )


def decaying(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """Return a force in a fixed direction that dies away, F = s d exp(-t / tau)."""
    d, tau = unit(rng), float(rng.uniform(0.15, 0.5))
    return Drawn(
        "decaying",
        lambda s: {"tau": tau},
        guess=1.0,
        apply=lambda b, s: with_force(b, lambda t, x, v, w: s * d * np.exp(-t / tau), 0.03),
    )


def mujoco_box(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """MuJoCo's drag on the inertia box: quadratic, for each axis of the body, which turns with the ball."""
    return Drawn("mujoco_box", lambda s: {"density": s}, guess=1.0, apply=lambda b, s: _in_fluid(b, s, "none", ""))


def mujoco_ellipsoid(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """MuJoCo's ellipsoid model with its default coefficients: quadratic drag, lift by spin, added mass, spin decay."""
    return Drawn(
        "mujoco_ellipsoid", lambda s: {"density": s}, guess=1.0, apply=lambda b, s: _in_fluid(b, s, "ellipsoid", "")
    )


def mujoco_lift(rng: np.random.Generator, scenery: Scenery) -> Drawn:
    """MuJoCo's ellipsoid model with all coefficients zero: added mass remains, and with it a force across the spin."""
    return Drawn(
        "mujoco_lift",
        lambda s: {"density": s},
        guess=5.0,
        most=50.0,
        apply=lambda b, s: _in_fluid(b, s, "ellipsoid", "0 0 0 0 0"),
    )


def _in_fluid(ball: Ball, density: float, shape: str, coefficients: str) -> Ball:
    """Return the ball in MuJoCo's fluid: its passive force and torque at the ball's state."""
    model, data = _fluid_model(ball.mass, ball.radius, shape, coefficients)

    def wrench(s: Array) -> Array:
        model.opt.density = density
        data.qpos[:3] = s[:3]
        data.qpos[3:] = s[6:10] / np.linalg.norm(s[6:10])
        turn = Rotation.from_quat(data.qpos[3:], scalar_first=True)
        data.qvel[:3] = s[3:6]
        data.qvel[3:] = turn.inv().apply(s[10:])  # a free joint's angular velocity is in the body's axes
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        return np.concatenate([data.qfrc_passive[:3], turn.apply(data.qfrc_passive[3:])])

    return replace(ball, wrench=wrench)


@cache
def _fluid_model(mass: float, radius: float, shape: str, coefficients: str) -> tuple[Any, Any]:
    fluid = f'fluidshape="{shape}" fluidcoef="{coefficients}"' if coefficients else f'fluidshape="{shape}"'
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><option gravity="0 0 0" density="1"/><worldbody><body><freejoint/>
        <geom type="sphere" size="{radius}" mass="{mass}" {fluid}/></body></worldbody></mujoco>"""
    )
    return model, mujoco.MjData(model)


# By name: how it is drawn, and sets of names that are right, too, where the force is, or contains, known effects.
OUTSIDE: dict[str, tuple[Draw, tuple[tuple[str, ...], ...]]] = {
    "drag_power_1.5": (drag_power(1.5), ()),
    "drag_power_3": (drag_power(3.0), ()),
    "drag_by_axis": (drag_by_axis, ()),
    "shear": (shear, ()),
    "decaying": (decaying, ()),
    "mujoco_box": (mujoco_box, ()),
    "mujoco_ellipsoid": (
        mujoco_ellipsoid,
        (("magnus_lift", "quadratic_drag"), ("magnus_lift", "quadratic_drag", "spin_damping")),
    ),
    "mujoco_lift": (mujoco_lift, (("magnus_lift",), ("buoyancy", "magnus_lift"))),
}
