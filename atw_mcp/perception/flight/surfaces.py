"""Surfaces that bodies move on: the floor and the faces of fixed convex solids, and where these hide the floor."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import ConvexHull

Floats = NDArray[np.float64]
STEEPEST = 0.3  # upward part of a face's normal below which bodies slide off it at once


@dataclass(frozen=True)
class Surface:
    """A face that bodies can be on: a point (3,), its unit normal (3,) and corners (n, 3) in order round it; None for
    the floor, which has no end."""

    name: str
    point: Floats
    normal: Floats
    corners: Floats | None = None

    @property
    def axes(self) -> Floats:
        """Two unit vectors (2, 3) along the face, across each other."""
        one = np.cross(self.normal, np.eye(3)[np.argmin(np.abs(self.normal))])
        one = one / np.linalg.norm(one)
        return np.stack([one, np.cross(self.normal, one)])


def surfaces_of(floor: float, fixtures: Mapping[str, Floats]) -> list[Surface]:
    """Return the floor at a height [m], and the faces of fixed convex solids, with corners (n, 3), that can bear."""
    found = [Surface("floor", np.array([0.0, 0.0, floor]), np.array([0.0, 0.0, 1.0]))]
    for name, corners in fixtures.items():
        hull = ConvexHull(corners)
        for equation in np.unique(np.round(hull.equations, 6), axis=0):
            normal = equation[:3]
            if normal[2] < STEEPEST:
                continue
            on = np.unique(hull.simplices[np.abs(hull.equations - equation).max(axis=1) < 1e-5])
            face = corners[on]
            middle = face.mean(axis=0)
            one = (face[0] - middle) / np.linalg.norm(face[0] - middle)
            angles = np.arctan2((face - middle) @ np.cross(normal, one), (face - middle) @ one)
            found.append(Surface(name, middle, normal, face[np.argsort(angles)]))
    return found


def allowed(places: Floats, surfaces: Sequence[Surface], k: int, lift: float, sink: Floats) -> NDArray[np.bool_]:
    """Check whether the ends (S, 2, 3) of stretches are where motion k can be: on its own face, or above the floor.

    sink (S, 2) [m]: depth below the floor that is taken for an error.
    """
    if k == len(surfaces):
        floor = surfaces[0]
        height = (places - floor.point) @ floor.normal
        return np.asarray(np.all(height >= lift - sink, axis=1))
    return np.asarray(within(places, surfaces[k], lift).all(axis=1))


def within(places: Floats, face: Surface, lift: float) -> NDArray[np.bool_]:
    """Check whether places (..., 3) are above a face, or beside it by less than `lift` [m]."""
    inside = np.ones(places.shape[:-1], dtype=bool)
    if face.corners is None:
        return inside
    for a, b in zip(face.corners, np.roll(face.corners, -1, axis=0), strict=True):
        inward = np.cross(face.normal, b - a)
        inside &= (places - a) @ (inward / np.linalg.norm(inward)) >= -lift
    return inside


def is_covered(
    directions: Floats, centre: Floats, floor: Surface, lift: float, fixtures: Mapping[str, Floats]
) -> NDArray[np.bool_]:
    """Check whether rays (K, 3) from a camera meet a fixed solid before a body that is `lift` [m] above the floor.

    What is seen there cannot be on the floor: it is in front of the solid, or on it.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        end = (floor.point + lift * floor.normal - centre) @ floor.normal / (directions @ floor.normal)
    before = np.where(end > 0.0, end - lift, np.inf)
    covered = np.zeros(len(directions), dtype=bool)
    for corners in fixtures.values():
        enter, leave = crossed(directions, centre, corners)
        covered |= enter < np.minimum(leave, before)
    return covered


def crossed(directions: Floats, origin: Floats, corners: Floats) -> tuple[Floats, Floats]:
    """Distances (...) at which rays (..., 3) enter and leave a convex solid; what they leave first they miss.

    They enter at the last of the planes that they cross inwards (Cyrus & Beck 1978, Computers & Graphics 3:23).
    """
    enter, leave = np.zeros(directions.shape[:-1]), np.full(directions.shape[:-1], np.inf)
    for equation in ConvexHull(corners).equations:  # inside: normal . (origin + s direction) + offset < 0
        rate, start = directions @ equation[:3], float(origin @ equation[:3] + equation[3])
        with np.errstate(divide="ignore", invalid="ignore"):
            meets = -start / rate
        enter = np.where(rate < 0.0, np.maximum(enter, meets), enter)
        leave = np.where(rate > 0.0, np.minimum(leave, meets), leave)
        leave = np.where((rate == 0.0) & (start > 0.0), -np.inf, leave)
    return enter, leave
