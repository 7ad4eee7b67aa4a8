"""Describe a world: an immutable description with a content hash, its parameters and its checks.

Read `world` first, then `description`, `shapes`, `representations`, `joints`, `camera`, `observer`; `parameters` names
every number by a path.
"""

from polyworld.world.representations.attachment import Region
from polyworld.world.world import (
    Deformable,
    Effect,
    Environment,
    MotionPlane,
    StaticObject,
    TimeBase,
    World,
)

__all__ = ["Deformable", "Effect", "Environment", "MotionPlane", "Region", "StaticObject", "TimeBase", "World"]
