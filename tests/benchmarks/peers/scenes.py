"""Scenes described once, for every engine: bodies on a floor or in a box, piles, terrain and chains."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from tests.scenes import six_bodies

Array = NDArray[np.float64]
Vector = tuple[float, float, float]

GRAVITY = 9.81  # [m/s^2]
SUBSTEP = 0.002  # [s]
BALL = 0.1  # radius of the balls of piles, half the edge of cubes [m]


@dataclass(frozen=True)
class Body:
    """A body of 1 kg. size: radius; half extents; radius and half height [m]. Velocities [m/s], [rad/s]."""

    kind: Literal["sphere", "box", "cylinder"]
    size: tuple[float, ...]
    position: Vector
    velocity: Vector = (0.0, 0.0, 0.0)
    spin: Vector = (0.0, 0.0, 0.0)
    tilt: float = 0.0  # rotation about y at the start [rad]


@dataclass(frozen=True)
class Terrain:
    """Heights (n, n) [m] of a square of half width `reach` [m] about the origin, as a triangle mesh."""

    heights: Array
    reach: float

    def mesh(self) -> tuple[Array, NDArray[np.int64]]:
        """Return vertices (n * n, 3) and faces (m, 3), counter-clockwise from above."""
        n = len(self.heights)
        x, y = np.meshgrid(np.linspace(-self.reach, self.reach, n), np.linspace(-self.reach, self.reach, n))
        vertices = np.stack([x, y, self.heights], axis=-1).reshape(-1, 3)
        first = (np.arange(n - 1)[:, None] * n + np.arange(n - 1)).ravel()
        faces = np.concatenate(
            [np.stack([first, first + 1, first + n], 1), np.stack([first + 1, first + n + 1, first + n], 1)]
        )
        return vertices, faces

    def height(self, points: Array) -> Array:
        """Height of the mesh under points (..., 2) [m]: the plane of the triangle that they lie in."""
        n = len(self.heights)
        u = np.clip((points + self.reach) / (2 * self.reach) * (n - 1), 0, n - 1 - 1e-9)
        i, j = np.floor(u[..., 1]).astype(int), np.floor(u[..., 0]).astype(int)
        s, t = u[..., 0] - j, u[..., 1] - i
        h = self.heights
        low = h[i, j] + s * (h[i, j + 1] - h[i, j]) + t * (h[i + 1, j] - h[i, j])
        top = h[i + 1, j + 1]
        high = top + (1 - s) * (h[i + 1, j] - top) + (1 - t) * (h[i, j + 1] - top)
        height: Array = np.where(s + t <= 1, low, high)
        return height


@dataclass(frozen=True)
class Scene:
    """Bodies under gravity, with one friction and restitution for all.

    walls: half the inner width of a box without a lid [m]. upright: planar engines move the bodies in the plane y = 0,
    not on the floor. chain: the bodies are rods hinged end to end about y, the first to the world, at these points.
    """

    bodies: tuple[Body, ...]
    duration: float
    friction: float = 0.3
    restitution: float = 0.0
    gravity: Vector = (0.0, 0.0, -GRAVITY)
    floor: bool = True
    walls: float | None = None
    upright: bool = False
    terrain: Terrain | None = None
    chain: tuple[Vector, ...] = field(default=())
    substep: float = SUBSTEP

    @property
    def steps(self) -> int:
        """Steps of a run."""
        return round(self.duration / self.substep)


@dataclass(frozen=True)
class Motion:
    """Motion of one world at T times: positions, velocities, spins (T, n, 3), rotations (T, n, 3, 3)."""

    times: Array
    positions: Array
    velocities: Array
    spins: Array
    rotations: Array


def six(duration: float) -> Scene:
    """Two cylinders, two balls and two cubes that slide and collide on a floor."""
    r = six_bodies.RADIUS
    sizes = {"sphere": (r,), "cylinder": (r, r), "box": (r, r, r)}
    bodies = tuple(
        Body(kind, sizes[kind], (x, y, r), (u, v, 0.0))  # type: ignore[arg-type]
        for _, kind, (x, y), (u, v) in six_bodies.BODIES
    )
    return Scene(bodies, duration, friction=six_bodies.FRICTION, restitution=six_bodies.RESTITUTION)


def pile(count: int, restitution: float, *, upright: bool, duration: float) -> Scene:
    """Balls that fall into a box, in layers about as wide as the pile is high; shifted a little, to fall off another.

    upright: all in the plane y = 0.
    """
    wide = max(1, round(math.sqrt(count / 2) if upright else (count / 2) ** (1 / 3)))
    spacing = 2.3 * BALL
    half = 0.5 * spacing * wide + 0.3 * BALL
    random = np.random.default_rng(0)
    bodies = []
    for k in range(count):
        layer, place = divmod(k, wide if upright else wide * wide)
        row, column = (0, place) if upright else divmod(place, wide)
        shift = random.uniform(-0.1, 0.1, 2) * BALL  # neighbours do not overlap
        x = (column - (wide - 1) / 2) * spacing + shift[0]
        y = 0.0 if upright else (row - (wide - 1) / 2) * spacing + shift[1]
        bodies.append(Body("sphere", (BALL,), (float(x), float(y), BALL + 0.02 + layer * spacing)))
    return Scene(tuple(bodies), duration, restitution=restitution, walls=half, upright=upright)


def terrain(count: int, duration: float) -> Scene:
    """Balls and cubes that fall on hills, a mesh of 2 x 24 x 24 triangles."""
    n, reach = 25, 2.0
    x, y = np.meshgrid(np.linspace(-reach, reach, n), np.linspace(-reach, reach, n))
    heights = 0.15 + 0.1 * np.sin(2.5 * x) * np.cos(2.0 * y) + 0.03 * (x * x + y * y)  # a bowl, so that none rolls off
    wide = math.ceil(math.sqrt(count))
    bodies = tuple(
        Body(
            "box" if k % 2 else "sphere",
            (BALL, BALL, BALL) if k % 2 else (BALL,),
            (0.45 * (k % wide - (wide - 1) / 2), 0.45 * (k // wide - (wide - 1) / 2), 0.9),
        )
        for k in range(count)
    )
    return Scene(bodies, duration, friction=0.5, floor=False, terrain=Terrain(heights, reach))


ROD, THIN = 0.1, 0.01  # length and half the thickness of a chain's rods [m]


def chain(count: int, duration: float, angle: float = 0.5) -> Scene:
    """A straight chain of rods, let go from rest at an angle [rad] from the vertical."""
    down = np.array([math.sin(angle), 0.0, -math.cos(angle)])
    points = [k * ROD * down for k in range(count)]
    bodies = tuple(
        Body("box", (ROD / 2, THIN, THIN), _vector(point + ROD / 2 * down), tilt=math.pi / 2 - angle)
        for point in points
    )
    joints = tuple(_vector(point) for point in points)
    return Scene(bodies, duration, friction=0.0, floor=False, upright=True, chain=joints)


def _vector(values: Array) -> Vector:
    x, y, z = (float(v) for v in values)
    return x, y, z
