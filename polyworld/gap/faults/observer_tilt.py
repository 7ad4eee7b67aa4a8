"""Axes of whoever measured that are not the world's."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.expressions.effect import law_of
from polyworld.gap.adding import one_start
from polyworld.gap.candidate import Candidate, Variant
from polyworld.gap.faults.observer_scale_and_time import is_bare, measured_axes, observed, of_observer
from polyworld.world import StaticObject, World, geometry
from polyworld.world.shapes import Plane

Array = NDArray[np.float64]

MOST = 0.5  # [rad]
ORDINARY = 0.2  # of a camera held by hand [rad]


def _tilt(world: World, recording: Recording) -> tuple[Variant, ...]:
    axes = [a for a in range(3) if _tilt_shows(world, recording, a)]
    if not axes:
        return ()
    child = observed(world)
    limits = {"lower": -MOST, "upper": MOST, "plausible": ORDINARY}
    unknowns = [of_observer(child, f"tilt.{'xyz'[a]}", f"tilt_{'xyz'[a]}", 0.02, **limits) for a in axes]
    return (one_start(child, unknowns, same_as=("tilt",) if is_bare(world) else ()),)


def _tilt_shows(world: World, recording: Recording, axis: int) -> bool:
    """Return whether axes turned about this one change what is seen, to first order, beyond what initial states take
    up."""
    others = {0, 1, 2} - {axis}
    if not others <= set(measured_axes(recording)):
        return False
    about = np.eye(3)[axis]
    if world.planar:
        normal = geometry.plane_axes(world.environment.motion_plane)[2]
        if abs(about @ normal) < 1.0 - 1e-9 and np.max(np.abs(normal)) > 1.0 - 1e-9:
            return False
    gravity = np.asarray(world.environment.gravity)
    size = float(np.linalg.norm(gravity))
    upright = size == 0.0 or abs(about @ gravity) > (1.0 - 1e-9) * size
    if not upright:
        return True
    level = all(_level(s, about) for s in world.statics)
    free = not (world.joints or world.deformables)
    return not (level and free and all(law_of(e).isotropic for e in world.effects if e.enabled))


def _level(static: StaticObject, up: Array) -> bool:
    """Return whether a static is a plane across a direction."""
    if not isinstance(static.shape, Plane):
        return False
    normal = geometry.quaternion_matrix(np.asarray(static.orientation)) @ np.asarray(static.shape.normal)
    return bool(abs(normal @ up) > (1.0 - 1e-9) * np.linalg.norm(normal))


CANDIDATES = (
    Candidate(
        name="observer_tilt",
        group="observer",
        law="x_seen = centre + R(tilt)^T (x - centre)",
        variants=_tilt,
    ),
)
