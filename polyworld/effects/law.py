"""The one interface through which every effect is reached."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

MAX_PARAMETERS = 8


class Vec8(wp.types.vector(length=MAX_PARAMETERS, dtype=wp.float64)):
    """Parameter values of one effect, in the order of `EffectLaw.parameters`; the rest is zero."""


@wp.struct
class Motion:
    """State of the body, or node of a deformable body, that a law acts on. World axes, SI.

    radius: that of the ball with the body's volume, 0 for a node. contact: 1 while the body touches another or is
    pressed on the supporting plane, else 0. gravity: of the environment.
    """

    mass: wp.float64
    radius: wp.float64
    x: wp.vec3d
    v: wp.vec3d
    omega: wp.vec3d
    t: wp.float64
    contact: wp.float64
    gravity: wp.vec3d


@wp.func
def wrench(force: wp.vec3d, torque: wp.vec3d) -> wp.spatial_vectord:
    """Force and torque as one vector of six; Warp makes no spatial vector of two double vectors."""
    return wp.spatial_vectord(force[0], force[1], force[2], torque[0], torque[1], torque[2])


@dataclass(frozen=True)
class Course:
    """How an object has moved by each of T samples, as far as it bounds the work of a law on it.

    mass [kg]; gravity: its size [m/s^2]; path (T,): length of the way [m]; reach: largest distance from the origin
    [m]; speed, spin: the highest [m/s], [rad/s].
    """

    mass: float
    gravity: float
    path: NDArray[np.float64]
    reach: float
    speed: float
    spin: float


Parameters = Mapping[str, float]
Work = Callable[[Parameters, Course], NDArray[np.float64]]


def passive(p: Parameters, course: Course) -> NDArray[np.float64]:
    """Return the work (T,) of a law that only takes energy, or does no work: none."""
    return np.zeros(len(course.path))


def size(p: Parameters, prefix: str = "") -> float:
    """Return the sum of the sizes of the three components of a parameter, at least the length of the vector."""
    return sum(abs(p[f"{prefix}{axis}"]) for axis in "xyz")


@dataclass(frozen=True)
class EffectParameter:
    """A number of a law: unit, admissible range, the range a fit searches, default, and what it means."""

    unit: str
    lower: float
    upper: float
    search: tuple[float, float]
    default: float
    description: str


@dataclass(frozen=True)
class EffectLaw:
    """A law on bodies: a force, a change of what happens at contacts, or both.

    work: the most work (T,) that it can have done on an object by each sample [J], `passive` where it only takes
    energy, None where its work has no bound (a driving law); energy from elsewhere is found by it.
    Warp functions, None where the law has no such part:
    `force` (p: Vec8, b: Motion) -> spatial_vectord: force [N] and torque [N m] about the centre of mass, world axes.
    `friction` (p: Vec8, mu: float64, x: vec3d, way: vec3d) -> float64: the Coulomb coefficient that would be mu of a
    contact with what does not move, mean over the way [m] that it goes in a step, with its middle at x.
    `restitution` (p: Vec8, e: float64, speed: float64) -> float64: the restitution of an impact with that normal
    approach speed [m/s] that would be e.
    `tangential` (p: Vec8) -> vec3d: (share of the bodies' relative tangential velocity, spin left out, that an impact
    takes away; tangential restitution of the points that touch, spin included, or -1 for Coulomb friction alone; its
    share of the impulse, 0 to 1, the rest being Coulomb's).
    per_mass: whether the force is proportional to mass, so that it may act on the nodes of deformable objects too.
    isotropic: whether it knows no direction and no place, and so looks the same in turned axes. falling: whether bodies
    under it still fall with about gravity. `reference` is where the law is written down.
    """

    kind: str
    summary: str
    parameters: dict[str, EffectParameter]
    reference: str
    work: Work | None
    force: Any = None
    friction: Any = None
    restitution: Any = None
    tangential: Any = None
    per_mass: bool = False
    isotropic: bool = False
    falling: bool = False
