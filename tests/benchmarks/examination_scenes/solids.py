"""Describe discs and boxes in a vertical slice, and let them bounce and rub on each other and on a tank."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SLOW = 0.05  # [m/s] a contact that closes more slowly does not bounce


@dataclass
class Solid:
    """Hold a body of the slice: a disc or a box, its mass per metre of depth [kg/m], and its state."""

    half: tuple[float, ...]  # (radius,) or (half width, half height) [m]
    mass: float
    place: Array  # (2,)
    motion: Array  # (3,) velocity [m/s] and rate of turn from x towards z [rad/s]
    friction: float
    angle: float = 0.0

    @property
    def inertia(self) -> Array:
        """Return mass, mass and moment of inertia (3,)."""
        square = self.half[0] ** 2 / 2 if len(self.half) == 1 else (self.half[0] ** 2 + self.half[1] ** 2) / 3
        return self.mass * np.array([1.0, 1.0, square])

    def distance(self, at: Array) -> Array:
        """Return signed distances of places (..., 2) from the surface, negative inside [m]."""
        offset = at - self.place
        if len(self.half) == 1:
            return np.asarray(np.hypot(offset[..., 0], offset[..., 1]) - self.half[0])
        over = np.abs(offset @ self.axes.T) - self.half
        return np.asarray(np.linalg.norm(np.maximum(over, 0), axis=-1) + np.minimum(over.max(axis=-1), 0))

    @property
    def axes(self) -> Array:
        """Return the body's own axes as rows (2, 2)."""
        c, s = math.cos(self.angle), math.sin(self.angle)
        return np.array([[c, s], [-s, c]])

    def normal(self, at: Array) -> Array:
        """Return outward normals (..., 2) at places, from differences of the distance."""
        steps = 1e-5 * np.eye(2)
        slope = np.stack([self.distance(at + e) - self.distance(at - e) for e in steps], axis=-1)
        return np.asarray(slope / np.maximum(np.linalg.norm(slope, axis=-1, keepdims=True), 1e-12))

    def velocity(self, at: Array) -> Array:
        """Return velocities (..., 2) of the body's material at places."""
        offset = at - self.place
        turned = np.stack([-offset[..., 1], offset[..., 0]], axis=-1)
        return np.asarray(self.motion[:2] + self.motion[2] * turned)

    def lowest(self, normal: Array) -> Array:
        """Return the points (n, 2) that may touch a plane of this normal."""
        if len(self.half) == 1:
            return np.asarray(self.place - self.half[0] * normal)[None]
        corners = np.array([[a, b] for a in (-1, 1) for b in (-1, 1)]) * self.half
        return np.asarray(self.place + corners @ self.axes)

    def hit(self, at: Array, impulse: Array) -> None:
        """Change the motion by an impulse (2,) at a place."""
        arm = at - self.place
        self.motion += np.array([*impulse, arm[0] * impulse[1] - arm[1] * impulse[0]]) / self.inertia


def touching(a: Solid, b: Solid) -> tuple[float, Array, Array]:
    """Return gap [m], normal from a to b and place of contact of two bodies, of which b is a disc."""
    normal = a.normal(b.place)
    gap = float(a.distance(b.place)) - b.half[0]
    return gap, normal, b.place - b.half[0] * normal


def settle(solids: list[Solid], wide: float, restitution: float, rounds: int = 4) -> None:
    """Let bodies bounce and rub on floor, walls (at 0 and wide [m]) and each other, one contact after the other."""
    planes = ((np.array([0.0, 1.0]), 0.0), (np.array([1.0, 0.0]), 0.0), (np.array([-1.0, 0.0]), -wide))
    for _ in range(rounds):
        for solid in solids:
            for normal, height in planes:
                for at in solid.lowest(normal):
                    gap = float(at @ normal) - height
                    if gap < 0.0:
                        collide(None, solid, normal, at, restitution)
                deep = min(float(at @ normal) - height for at in solid.lowest(normal))
                solid.place = solid.place - min(deep, 0.0) * normal
        for a, b in itertools.combinations(solids, 2):
            gap, normal, at = touching(a, b)
            if gap < 0.0:
                collide(a, b, normal, at, restitution)
                share = b.mass / (a.mass + b.mass)
                a.place = a.place + share * gap * normal
                b.place = b.place - (1 - share) * gap * normal


def collide(a: Solid | None, b: Solid, normal: Array, at: Array, restitution: float) -> None:
    """Apply the impulse of a contact; a is None for the tank."""
    speed = b.velocity(at) - (a.velocity(at) if a else 0.0)
    along = np.array([normal[1], -normal[0]])
    closing = float(speed @ normal)
    if closing >= 0.0:
        return

    def ease(way: Array) -> float:
        total = 0.0
        for solid in (a, b):
            if solid is not None:
                arm = at - solid.place
                mass, _, moment = solid.inertia
                total += 1 / mass + (arm[0] * way[1] - arm[1] * way[0]) ** 2 / moment
        return float(total)

    rebound = restitution if closing < -SLOW else 0.0
    push = -(1 + rebound) * closing / ease(normal)
    friction = b.friction if a is None else min(a.friction, b.friction)
    rub = float(np.clip(-float(speed @ along) / ease(along), -friction * push, friction * push))
    for solid, sign in ((a, -1), (b, 1)):
        if solid is not None:
            solid.hit(at, sign * (push * normal + rub * along))
