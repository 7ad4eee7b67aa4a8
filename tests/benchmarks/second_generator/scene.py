"""Plain records of a laboratory scene, its launches and the hidden effects (SI units, z up)."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
G_GIVEN = 9.81  # m/s^2, the gravity given to the analyst
UP = np.array([0.0, 0.0, 1.0])


@dataclass
class Plane:
    """A flat surface: free side n.(x-p) > 0; restitution e = rebound/approach speed; Coulomb coefficient mu."""

    name: str
    point: Array  # m
    normal: Array  # unit, towards the free side
    restitution: float
    friction: float
    hidden: bool = False


@dataclass
class Body:
    """A ball (I = 2/5 m r^2) or a flat disc (I = 1/2 m r^2)."""

    name: str
    kind: str  # "sphere" | "disc"
    radius: float  # m
    mass: float  # kg
    restitution: float
    friction: float
    height: float = 0.0  # m, discs only
    rim_friction: float = 0.0  # discs only: Coulomb coefficient at the rim

    @property
    def inertia(self) -> float:
        """Moment of inertia about the centre (disc: about the vertical axis), kg m^2."""
        return (0.4 if self.kind == "sphere" else 0.5) * self.mass * self.radius**2


@dataclass
class Scene:
    """Objects of the laboratory, known to the analyst."""

    bodies: list[Body]
    planes: list[Plane]  # known surfaces, the floor among them
    floor: bool
    rig: str  # "flight" | "bounce" | "roll" | "puck" | "discs"
    orient: bool  # orientation measured
    planar: bool  # motion in the x-z plane, y not recorded
    released: str  # "without spin" | "spinning" | "rolling"
    style: str = "a"

    @property
    def flat(self) -> bool:
        """True where the bodies are discs on a table."""
        return self.bodies[0].kind == "disc"


@dataclass
class Start:
    """State of one body at release: position m, velocity m/s, angular velocity rad/s, quaternion (w, x, y, z)."""

    x: Array
    v: Array
    w: Array = field(default_factory=lambda: np.zeros(3))
    q: Array = field(default_factory=lambda: np.array([1.0, 0.0, 0.0, 0.0]))


@dataclass
class Launch:
    """One release: clock time t0 (s), length of the recording (s), one start per body."""

    t0: float
    duration: float
    starts: list[Start]


@dataclass
class Effect:
    """One hidden effect by its standard name with SI parameters."""

    name: str
    p: dict[str, Any]


def unit(v: Array) -> Array:
    """v/|v|."""
    return v / np.linalg.norm(v)


def cross(a: Array, b: Array) -> Array:
    """a x b for three-vectors (faster than numpy.cross)."""
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])


def qmul(a: Array, b: Array) -> Array:
    """Hamilton product of quaternions (w, x, y, z), broadcast over leading axes."""
    aw, ax, ay, az = np.moveaxis(np.asarray(a), -1, 0)
    bw, bx, by, bz = np.moveaxis(np.asarray(b), -1, 0)
    return np.stack(
        [
            aw * bw - ax * bx - ay * by - az * bz,
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by - ax * bz + ay * bw + az * bx,
            aw * bz + ax * by - ay * bx + az * bw,
        ],
        axis=-1,
    )


def rotvec_q(r: Array) -> Array:
    """Quaternion of the rotation vector(s) r (rad)."""
    r = np.asarray(r, dtype=float)
    angle = np.linalg.norm(r, axis=-1, keepdims=True)
    return np.concatenate([np.cos(angle / 2), 0.5 * np.sinc(angle / 2 / np.pi) * r], axis=-1)
