"""Describe a scene before it becomes a simulator model: bodies, fixtures, hung things, gravity."""

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Vec = tuple[float, float, float]
Quat = tuple[float, float, float, float]  # w, x, y, z

DT = 1.0 / 2400.0  # simulation step in s; every frame rate used falls on whole steps
HORIZON = 2.0  # s simulated beyond the last frame
UPRIGHT: Quat = (1.0, 0.0, 0.0, 0.0)


def vec(values: Iterable[float]) -> Vec:
    """Return three numbers as a tuple of floats."""
    x, y, z = values
    return (float(x), float(y), float(z))


@dataclass(frozen=True)
class Body:
    """A body that can move. size: full extents in m (sphere: diameter three times; cylinder: d, d, length)."""

    name: str
    shape: str  # sphere, box or cylinder
    size: Vec
    pos: Vec
    vel: Vec = (0.0, 0.0, 0.0)
    spin: Vec = (0.0, 0.0, 0.0)  # angular velocity in rad/s, world axes
    quat: Quat = UPRIGHT
    color: str = "red"
    rgb: Vec = (0.8, 0.1, 0.1)
    mass: float = 1.0
    friction: float = 0.3  # with everything that does not move
    restitution: float = 0.4  # with everything that does not move
    rolling: float = 0.002  # rolling resistance as a fraction of the radius
    joint: str = "free"  # free, track (slides along x), arm (hangs on a pivot) or rope (ends a rope)
    damping: float = 0.0  # at the joint of an arm (N m s) or a track (N s/m)
    resistance: float = 0.0  # dry resistance of a track as a fraction of the weight
    pivot: Vec = (0.0, 0.0, 0.0)
    angle: float = 0.0  # initial angle of an arm in rad
    rate: float = 0.0  # initial angular rate of an arm in rad/s

    @property
    def reach(self) -> float:
        """Return the radius of a sphere around the body in m (for a sphere: its own)."""
        if self.shape == "sphere":
            return self.size[0] / 2
        if self.shape == "cylinder":
            return float(np.hypot(self.size[0], self.size[2])) / 2
        return float(np.linalg.norm(self.size)) / 2


@dataclass(frozen=True)
class Fixture:
    """A thing that does not move: post, ramp, cushion, board. size: full extents in m."""

    name: str
    shape: str
    size: Vec
    pos: Vec
    quat: Quat = UPRIGHT
    color: str = "grey"
    rgb: Vec = (0.5, 0.5, 0.5)
    solid: bool = True  # whether bodies collide with it


@dataclass(frozen=True)
class Rope:
    """A chain of capsules that hangs from an anchor and starts straight at an angle from the vertical."""

    anchor: Vec
    length: float
    links: int
    diameter: float
    mass: float
    angle: float
    rate: float  # initial angular rate about the anchor in rad/s
    damping: float  # N m s per joint
    color: str
    rgb: Vec


@dataclass(frozen=True)
class Cloth:
    """A square-meshed sheet held at its upper edge or at its upper corners, starting tilted by an angle."""

    top: Vec  # middle of the upper edge
    width: float
    height: float
    cells: tuple[int, int]
    mass: float
    angle: float  # from the vertical in rad
    corners: bool  # held at the corners alone
    wind: Vec  # m/s
    drag: float  # N s^2/m^4 per area: force = drag * area * |u_n| u_n along the normal
    color: str
    rgb: Vec


@dataclass(frozen=True)
class Scene:
    """A scene at the time of the first frame. mutual_*: between two bodies that can both move."""

    kind: str
    bodies: tuple[Body, ...]
    fixtures: tuple[Fixture, ...] = ()
    floor: bool = True
    mutual_friction: float = 0.2
    mutual_restitution: float = 0.6
    gravity: float = 9.81
    rope: Rope | None = None
    cloth: Cloth | None = None
    marks: tuple[Vec, ...] = ()  # candidate marks on surfaces
    mark_facing: tuple[Vec, ...] = ()  # normal of the surface under each mark
    focus: tuple[Vec, ...] = ()  # points to frame instead of the motion, where given
    view: tuple[float, float, float, float] = (-70.0, -110.0, 25.0, 45.0)  # azimuth from, to, elevation from, to (deg)
    contents: dict[str, float] = field(default_factory=dict)

    def named(self, name: str) -> Body:
        """Return the body of that name."""
        return next(b for b in self.bodies if b.name == name)


class Rejected(Exception):
    """The draw gives no usable clip; draw again."""
