"""Angles of bodies on hinges, as encoders measure them, converted to the bodies' poses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.world import World, geometry
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject

Array = NDArray[np.float64]

ON_AXIS = 1e-6  # distance of a centre from its hinge's axis that counts as none [m]


@dataclass(frozen=True)
class HingedBody:
    """A body that a hinge holds to the world.

    axis (3,): unit vector of the hinge; angles are positive about it by the right-hand rule. arm (3,): from the hinge's
    anchor to the body's centre in the described pose [m]. down (3,): direction of gravity across the axis, zero where
    gravity runs along it.
    """

    item: RigidObject
    anchor: Array
    axis: Array
    arm: Array
    down: Array

    @classmethod
    def of(cls, world: World, name: str) -> HingedBody:
        """Return the body called `name`; raises ValueError where no hinge holds it to the world."""
        joints = [j for j in world.joints if isinstance(j, Hinge) and name in (j.object, j.other)]
        fixed = [j for j in joints if j.other is None]
        if not fixed:
            why = f"hinge {joints[0].name!r} holds it to a moving body" if joints else "no hinge of the world holds it"
            raise ValueError(f"an angle does not place it: {why}; describe such a hinge in the world, or give x, y, z")
        item, joint = world.object(name), fixed[0]
        if world.planar:
            axis = geometry.plane_axes(world.environment.motion_plane)[2]
        else:
            axis = np.asarray(joint.axis, dtype=float) / np.linalg.norm(joint.axis)
        gravity = np.asarray(world.environment.gravity, dtype=float)
        anchor = np.asarray(joint.anchor, dtype=float)
        return cls(item, anchor, axis, np.asarray(item.position) - anchor, gravity - axis * (axis @ gravity))

    @property
    def off_axis(self) -> bool:
        """Whether the body's centre moves as it turns."""
        return self.distance > ON_AXIS

    @property
    def distance(self) -> float:
        """Distance of the body's centre from the axis [m]."""
        return float(np.linalg.norm(np.cross(self.axis, self.arm)))

    @property
    def hanging(self) -> float:
        """The angle [rad] from the described pose to the one in which the centre hangs below the axis.

        Raises ValueError for a body that gravity does not turn.
        """
        if not (self.off_axis and np.linalg.norm(self.down) > 0.0):
            raise ValueError(
                f"object {self.item.name!r} hangs nowhere: its centre lies on the hinge's axis, or gravity runs along "
                "it; give the reading of theta in the described pose instead"
            )
        across = self.arm - self.axis * (self.axis @ self.arm)
        return float(np.arctan2(self.axis @ np.cross(across, self.down), across @ self.down))

    def orientations(self, angles: Array) -> Array:
        """Return orientations (..., 4) w, x, y, z at angles (...) [rad] from the described pose."""
        turn = geometry.rotation_quaternion(angles[..., None] * self.axis)
        return geometry.quaternion_product(turn, np.asarray(self.item.orientation))

    def positions(self, angles: Array) -> Array:
        """Return positions (..., 3) [m] of the centre at angles (...) [rad] from the described pose."""
        turn = geometry.quaternion_matrix(geometry.rotation_quaternion(angles[..., None] * self.axis))
        found: Array = self.anchor + turn @ self.arm
        return found

    def measured(self, angles: Array) -> tuple[Array, Array]:
        """Return positions (..., 3) and orientations (..., 4) that stand for measured angles (...) [rad], else NaN.

        One number was measured, and it is passed on once: as the centre's position where that moves, as the orientation
        where the centre lies on the axis. Both at once would count the same measurement twice, and the components of a
        rotation across the axis would count as measured without noise. A position's component along the axis, where
        that is an axis of the world, was not measured.
        """
        positions = np.full((*angles.shape, 3), np.nan)
        orientations = np.full((*angles.shape, 4), np.nan)
        if self.off_axis:
            positions = np.where(np.abs(self.axis) > 1.0 - 1e-9, np.nan, self.positions(angles))
        else:
            orientations = self.orientations(angles)
        return positions, orientations
