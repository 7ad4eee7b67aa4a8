"""Every parameter of a world's parts: unit, admissible range, the range a fit searches, meaning."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class ParameterSpec:
    """Definition of a parameter: unit, admissible range, and the range a fit searches by default."""

    unit: str
    lower: float
    upper: float
    search: tuple[float, float]
    description: str


OBJECT_PARAMETERS: dict[str, ParameterSpec] = {
    "mass": ParameterSpec("kg", 1e-9, 1e9, (0.1, 10.0), "mass"),
    "friction": ParameterSpec("1", 0.0, 10.0, (0.0, 1.0), "Coulomb friction coefficient"),
    "restitution": ParameterSpec("1", 0.0, 1.0, (0.0, 1.0), "coefficient of restitution"),
    "rolling_resistance": ParameterSpec("m", 0.0, 10.0, (0.0, 0.05), "lever arm of rolling resistance"),
    "torsional_radius": ParameterSpec("m", 0.0, 10.0, (0.0, 0.3), "radius of the spinning-friction patch"),
    "linear_damping": ParameterSpec("1/s", 0.0, 1e3, (0.0, 1.0), "linear damping rate"),
    "angular_damping": ParameterSpec("1/s", 0.0, 1e3, (0.0, 2.0), "angular damping rate"),
}
COMMON = {
    "linear_damping": OBJECT_PARAMETERS["linear_damping"],
    "friction": OBJECT_PARAMETERS["friction"],
    "restitution": OBJECT_PARAMETERS["restitution"],
}
TAU = (0.0, 0.1)  # times that a search of damping spans [s]
EMITTER_PARAMETERS = {
    "rate": ParameterSpec("m^3/s", 0.0, 1e6, (1e-5, 1e-2), "volume per time"),
}
PULLEY_PARAMETERS = {
    "friction": OBJECT_PARAMETERS["friction"],
    "bearing_friction": ParameterSpec("N m", 0.0, 1e6, (0.0, 1.0), "dry torque of the bearing"),
    "bearing_damping": ParameterSpec("N m s", 0.0, 1e6, (0.0, 1.0), "viscous torque of the bearing"),
    "inertia": ParameterSpec("kg m^2", 0.0, 1e6, (1e-6, 1e-2), "moment of inertia of the wheel"),
}
JOINT_PARAMETERS = {
    "friction": ParameterSpec("N m or N", 0.0, 1e9, (0.0, 1.0), "dry resistance of a joint"),
    "damping": ParameterSpec("N m s or N s/m", 0.0, 1e9, (0.0, 1.0), "viscous resistance of a joint"),
    "stiffness": ParameterSpec("N/m", 0.0, 1e9, (1.0, 1e3), "force per extension of a spring"),
    "lower": ParameterSpec("rad or m", -1e6, 1e6, (-np.pi, 0.0), "lower stop, from the pose at the start"),
    "upper": ParameterSpec("rad or m", -1e6, 1e6, (0.0, np.pi), "upper stop, from the pose at the start"),
}
_ANCHOR = {
    "anchor": ParameterSpec("m", -1e6, 1e6, (-10.0, 10.0), "the joint's point; of a spring, in the pose described"),
    "other_anchor": ParameterSpec("m", -1e6, 1e6, (-10.0, 10.0), "a spring's other end, in the pose described"),
}
ANCHOR_PARAMETERS = {f"{name}.{axis}": spec for name, spec in _ANCHOR.items() for axis in "xyz"}
MOTOR_PARAMETERS = {
    "target_speed": ParameterSpec("rad/s or m/s", -1e6, 1e6, (-20.0, 20.0), "speed a motor aims at, about the axis"),
    "limit": ParameterSpec("N m or N", 0.0, 1e9, (0.0, 10.0), "greatest torque or force of a motor"),
    "delay": ParameterSpec("s", 0.0, 1e4, (0.0, 1.0), "lag with which a motor switches on and off"),
}
_STATE = {
    "position": ParameterSpec("m", -1e6, 1e6, (-10.0, 10.0), "position at start_time"),
    "velocity": ParameterSpec("m/s", -1e5, 1e5, (-10.0, 10.0), "velocity at start_time"),
    "angular_velocity": ParameterSpec("rad/s", -1e5, 1e5, (-20.0, 20.0), "angular velocity at start_time"),
    "rotation": ParameterSpec("rad", -100.0, 100.0, (-np.pi, np.pi), "turn about a world axis, on top of orientation"),
}
STATE_PARAMETERS: dict[str, ParameterSpec] = {f"{k}.{a}": s for k, s in _STATE.items() for a in "xyz"}
SHIFT = {f"shift.{a}": ParameterSpec("m", -1e6, 1e6, (-1.0, 1.0), "displacement of its start") for a in "xyz"}
VELOCITY = {f"velocity.{a}": _STATE["velocity"] for a in "xyz"}
SPIN = {f"angular_velocity.{a}": _STATE["angular_velocity"] for a in "xyz"}
GRAVITY = ParameterSpec("m/s^2", -1e4, 1e4, (-20.0, 20.0), "gravitational acceleration")
STATIC_PARAMETERS = {k: OBJECT_PARAMETERS[k] for k in ("friction", "restitution")}
_POSE = {
    "position": ParameterSpec("m", -1e6, 1e6, (-10.0, 10.0), "where a static stands"),
    "rotation": _STATE["rotation"],
}
STATIC_POSE: dict[str, ParameterSpec] = {f"{k}.{a}": s for k, s in _POSE.items() for a in "xyz"}
ORIGIN = ParameterSpec("s", -1e6, 1e6, (-10.0, 10.0), "time of the start, for laws that depend on time")
SECONDS_PER_FRAME = ParameterSpec("s", 1e-6, 1e4, (0.01, 0.1), "physical time between frames")
_VECTOR = {
    "centre": ParameterSpec("m", -1e6, 1e6, (-10.0, 10.0), "point that faults in space leave where it is"),
    "tilt": ParameterSpec("rad", -np.pi, np.pi, (-0.2, 0.2), "rotation of the observed axes against the world's"),
    "keystone": ParameterSpec("1/m", -1e6, 1e6, (-0.1, 0.1), "relative fall of the image's scale per length"),
}
OBSERVER_PARAMETERS: dict[str, ParameterSpec] = {
    "scale": ParameterSpec("1", 1e-3, 1e3, (0.8, 1.25), "observed length per true length"),
    "clock": ParameterSpec("1", 1e-3, 1e3, (0.8, 1.25), "seconds that the observer's clock counts per second"),
    "time_offset": ParameterSpec("s", -1e4, 1e4, (-0.2, 0.2), "physical time at which the observer's clock showed 0"),
    "distortion": ParameterSpec("1/m^2", -1e6, 1e6, (-0.1, 0.1), "radial distortion k in x (1 + k r^2)"),
    "shift": ParameterSpec("s", -1e4, 1e4, (-0.2, 0.2), "by how much stamps after shift_time are too early"),
    "shift_time": ParameterSpec("s", -1e6, 1e6, (0.0, 10.0), "stamp about which frames were dropped or repeated"),
    **{f"{name}.{axis}": spec for name, spec in _VECTOR.items() for axis in "xyz"},
}
