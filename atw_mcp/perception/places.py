"""Places in the world of solids that were followed by their silhouettes, and tracks that take them as they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from atw_mcp.perception.eye import EyeSettings, Solid
from polyworld.data.tracks import ObservedTracks
from polyworld.world.geometry import plane_axes

Floats = NDArray[np.float64]
TURN_UNSURE = 0.25  # [rad] standard deviation of an angle at which its confidence has fallen to 1/e
ON_ITS_SIDE = Rotation.from_euler("y", 90.0, degrees=True)  # own z along x
ALIKE = 0.02  # relative difference of a box's sides below which a quarter turn is not seen


@dataclass(frozen=True)
class Places:
    """Positions (T, 3) [m] of a solid's centre, NaN where it is not seen, with standard deviations (T,) [m];
    orientations (T, 4) w, x, y, z with standard deviations (T,) [rad], infinite where the silhouette shows none;
    symmetry as in ObservedTracks."""

    positions: Floats
    sigma: Floats
    orientations: Floats
    turn_sigma: Floats
    symmetry: int

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values; `from_dict` reads them back."""
        series = {
            "positions": self.positions,
            "sigma": self.sigma,
            "orientations": self.orientations,
            "turn_sigma": self.turn_sigma,
        }
        return {**{key: _listed(values) for key, values in series.items()}, "symmetry": self.symmetry}

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the inverse of `to_dict`."""
        series = {key: np.array(data[key], dtype=float) for key in ("positions", "sigma", "orientations", "turn_sigma")}
        series["turn_sigma"][np.isnan(series["turn_sigma"])] = np.inf
        return cls(**series, symmetry=int(data["symmetry"]))


def _listed(values: Floats) -> list[Any]:
    rounded = np.round(values, 6).astype(object)
    rounded[~np.isfinite(values)] = None
    listed: list[Any] = rounded.tolist()
    return listed


def places_of(body: Solid, poses: Floats, covariances: Floats) -> Places:
    """Places of a solid by its poses (T, 4), NaN where it is not seen, and their covariances (T, 4, 4)."""
    count, systematic = len(poses), EyeSettings().systematic
    positions, sigma = np.full((count, 3), np.nan), np.full(count, np.nan)
    orientations, turn_sigma = np.full((count, 4), np.nan), np.full(count, np.inf)
    axes = plane_axes(body.plane)
    rest = Rotation.identity() if body.upright and not body.lies else Rotation.from_matrix(axes.T)
    if body.lies and not body.upright:
        rest = rest * ON_ITS_SIDE
    turns = len(body.angles()) > 1
    tilted = abs(axes[2, 2]) < 1 - 1e-6 and (body.lies or not body.upright)
    angles = _continuous(poses[:, 2], np.pi / 2 if _order(body) == 4 else np.pi)
    for k in np.flatnonzero(np.isfinite(poses[:, 0])):
        pose, covariance = poses[k], covariances[k]
        positions[k] = body.middle(pose)
        moved = [(body.centre(pose + 1e-4 * e) - body.centre(pose)) / 1e-4 for e in np.eye(4)[:2]]
        inverse = np.linalg.pinv(np.stack(moved, axis=1))
        plane = covariance[:2, :2] + (systematic * body.radius(pose)) ** 2 * inverse @ inverse.T
        sigma[k] = np.sqrt(np.trace(plane) / 2 + covariance[3, 3])
        if turns or tilted:
            turn = Rotation.from_rotvec(angles[k] * axes[2]) * rest
            orientations[k] = turn.as_quat()[[3, 0, 1, 2]]
            turn_sigma[k] = np.sqrt(covariance[2, 2]) if turns else 0.0
    return Places(positions, sigma, orientations, turn_sigma, _order(body))


def _order(body: Solid) -> int:
    """Order of rotational symmetry about the plane's normal."""
    if len(body.angles()) == 1 or body.lies:
        return 0
    across = body.half[2] if body.upright else body.half[1]
    return 4 if body.kind == "box" and abs(body.half[0] - across) < ALIKE * body.half[0] else 2


def _continuous(angles: Floats, period: float) -> Floats:
    """Angles (T,) [rad] without jumps of a period, NaN left out."""
    found = angles.copy()
    seen = np.isfinite(found)
    found[seen] = np.unwrap(found[seen], period=period)
    return found


def with_places(
    tracks: ObservedTracks, places: Mapping[str, Places], confidence: Mapping[str, Floats]
) -> ObservedTracks:
    """Return tracks in which the named objects are where they were followed, with confidences (T,) of each."""
    series = {
        key: getattr(tracks, key).copy()
        for key in ("positions", "position_sigma", "orientations", "confidence", "orientation_confidence")
    }
    symmetry = list(tracks.symmetry)
    for name, own in places.items():
        column = tracks.index(name)
        known = np.isfinite(own.positions).all(axis=1)
        sure = np.where(known, confidence[name], 0.0)
        series["positions"][:, column] = own.positions
        series["position_sigma"][:, column] = own.sigma
        series["orientations"][:, column] = own.orientations
        series["confidence"][:, column] = np.round(sure, 4)
        turned = np.isfinite(own.turn_sigma)
        weight = np.exp(-((np.where(turned, own.turn_sigma, 0.0) / TURN_UNSURE) ** 2))
        series["orientation_confidence"][:, column] = np.round(np.where(turned, sure * weight, 0.0), 4)
        symmetry[column] = own.symmetry
    return replace(tracks, **series, symmetry=tuple(symmetry))
