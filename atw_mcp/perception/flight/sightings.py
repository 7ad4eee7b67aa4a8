"""Sightings of a body of known size: direction and distance of its centre from the camera, frame by frame."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.depth_tracks import surface_area
from atw_mcp.perception.observation import ImageObservation
from polyworld.world.camera import Camera
from polyworld.world.geometry import equivalent_radius
from polyworld.world.shapes import Box, Cylinder, Sphere

Floats = NDArray[np.float64]
Solid = Sphere | Box | Cylinder


@dataclass(frozen=True)
class SightingSettings:
    """Accuracy of directions and distances that masks give, in pixels of the outline and shares of the body's size.

    edge: noise of an outline's mean radius from frame to frame [px]; edge_bias: error that all frames have in common,
    as blur and compression move every edge alike [px]; turning: relative noise of the distance of a body that is no
    ball, whose outline changes as it turns; masks: relative noise of all distances, as shadows join a mask for some
    frames; shift: distance of a mask's centre from the body's, of its apparent radius, for the same reason; given:
    relative error of a size as it is seen; window, quantile: frames on either side, and of their apparent radii the
    quantile, by which a mask is seen to be larger than usual; least_noise: of a centroid [px]; centroid: distance of
    the outline's centroid from the centre of a body that is no ball, of its radius.
    """

    edge: float = 0.3
    edge_bias: float = 0.4
    turning: float = 0.08
    masks: float = 0.1
    shift: float = 0.1
    window: int = 6
    quantile: float = 0.3
    given: float = 0.1
    least_noise: float = 0.4
    centroid: float = 0.05


@dataclass(frozen=True)
class Sightings:
    """Sightings of one body in K frames.

    rows (K,): of the observation; times (K,) [s]; directions (K, 3): unit vectors from the camera; distances (K,) [m]:
    of its centre, from its apparent size; across (K,) [m]: standard deviation of the centre across the line of sight;
    along (K,) [m]: that of the distance without what all frames have in common; scale: relative standard deviation of
    all distances together. covered (K,): where something fixed would hide the body, were it on the floor.
    """

    rows: NDArray[np.int64]
    times: Floats
    directions: Floats
    distances: Floats
    across: Floats
    along: Floats
    scale: float
    covered: NDArray[np.bool_]

    def only(self, chosen: slice) -> Sightings:
        """Return some of the sightings."""
        return Sightings(
            self.rows[chosen],
            self.times[chosen],
            self.directions[chosen],
            self.distances[chosen],
            self.across[chosen],
            self.along[chosen],
            self.scale,
            self.covered[chosen],
        )


def sightings(
    observation: ImageObservation,
    name: str,
    camera: Camera,
    solid: Solid,
    times: Floats,
    settings: SightingSettings,
) -> Sightings | None:
    """Measure where a body is seen in the frames that show all of it; None where fewer than three do.

    A ball of radius r at distance d is seen under the half angle asin(r / d), in an area that says it. Of other solids
    the mean projected area is a quarter of their surface (Cauchy).
    """
    observed = observation.object(name)
    rows, directions, distances = [], [], []
    focal = float(np.sqrt(camera.intrinsics[0][0] * camera.intrinsics[1][1]))
    radius = float(np.sqrt(surface_area(solid) / (4.0 * np.pi)))
    for row, status in enumerate(observed.status):
        if status != "visible" or observed.confidence[row] <= 0.0:
            continue
        direction = camera.rays(observation.steadied(observed.centroid[row], row))
        slant = float(direction @ np.asarray(camera.rotation)[2])  # area grows as 1 / slant^3 off the axis
        angle = float(np.arcsin(min(np.sqrt(observed.area[row] * slant**3 / np.pi) / focal, 1.0)))
        if not 0.0 < angle < 0.5 * np.pi:
            continue
        rows.append(row)
        directions.append(direction)
        distances.append(radius / np.sin(angle))
    if len(rows) < 3:
        return None
    kept, seen, away = np.array(rows), np.array(directions), np.array(distances)
    pixels = focal * radius / away
    excess = np.abs(pixels - _usual(pixels, kept, settings))
    noise = max(settings.least_noise, _noise(camera.project(camera.centre + seen), kept))
    ball = isinstance(solid, Sphere)
    turning = 0.0 if ball else settings.turning
    offset = 0.0 if ball else settings.centroid * equivalent_radius(solid)
    shift = np.sqrt(noise**2 + (settings.shift * pixels) ** 2 + excess**2)
    return Sightings(
        kept,
        times[kept],
        seen,
        away,
        np.hypot(shift * away / focal, offset),
        away * np.sqrt((settings.edge**2 + excess**2) / pixels**2 + turning**2 + settings.masks**2),
        float(np.hypot(np.hypot(settings.given, turning), settings.edge_bias / np.median(pixels))),
        np.zeros(len(kept), dtype=bool),
    )


def _usual(pixels: Floats, rows: NDArray[np.int64], settings: SightingSettings) -> Floats:
    """Apparent radius (K,) [px] about each frame without those in which a mask takes in a shadow."""
    near = np.abs(rows[:, None] - rows[None, :]) <= settings.window
    found: Floats = np.array([np.quantile(pixels[one], settings.quantile) for one in near])
    return found


def _noise(pixels: Floats, rows: NDArray[np.int64]) -> float:
    """Standard deviation of a path's points (K, 2) [px], from third differences between frames that follow each other.

    Of independent noise s, third differences have s * sqrt(20); half of them may be from what the body meets.
    """
    if len(rows) < 4:
        return 0.0
    follow = rows[3:] - rows[:-3] == 3 * np.diff(rows).min()
    third = np.abs(np.diff(pixels, 3, axis=0))[follow]
    return float(1.4826 * np.median(third) / np.sqrt(20.0)) if len(third) else 0.0
