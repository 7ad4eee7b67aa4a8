"""Places of bodies in free flight or on an obstacle, in place of those that their rays have on the floor."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.flight.dividing import Divided, divided
from atw_mcp.perception.flight.settings import FlightSettings
from atw_mcp.perception.flight.sightings import Sightings, Solid, sightings
from atw_mcp.perception.flight.surfaces import Surface, is_covered, surfaces_of
from atw_mcp.perception.lying import lies_better
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.tracks import misfits_at_rest, world_tracks
from atw_mcp.perception.video import Cancelled, report
from polyworld.data.tracks import ObservedTracks
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.geometry import circumscribed_radius, equivalent_radius, quaternion_matrix
from polyworld.world.shapes import Box, Cylinder, Sphere

Floats = NDArray[np.float64]
Corners = tuple[tuple[float, float, float], ...]
SETTINGS = FlightSettings()


@dataclass(frozen=True)
class Surroundings:
    """Surroundings of the bodies: gravity [m/s^2], the floor's height [m], corners (n, 3) of fixed convex solids."""

    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    floor: float = 0.0
    fixtures: Mapping[str, Corners] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {"gravity": self.gravity, "floor": self.floor, "fixtures": dict(self.fixtures)}


def with_flights(
    tracks: ObservedTracks,
    seen: ImageObservation,
    camera: Camera,
    solids: Mapping[str, Solid],
    about: Surroundings,
    cancelled: Cancelled | None = None,
) -> tuple[ObservedTracks, dict[str, list[dict[str, Any]]]]:
    """Return tracks with the places of known solids that leave the floor, and which frames show that, by name.

    In flight places follow from gravity and apparent size, and turns are not measured; on an obstacle both follow from
    the outline, as they do on the floor. Frames within such a stretch that do not show all of a body have no place.
    Raises PerceptionCancelled.
    """
    times = tracks.times
    fixtures = {name: np.array(corners) for name, corners in about.fixtures.items()}
    surfaces = surfaces_of(about.floor, fixtures)
    motions: dict[str, list[dict[str, Any]]] = {}
    for name, solid in solids.items():
        report(None, cancelled)
        found = sightings(seen, name, camera, solid, times, SETTINGS.sightings)
        if found is None or name not in tracks.names:
            continue
        lift = _lift(tracks, name, solid)
        found = replace(found, covered=is_covered(found.directions, camera.centre, surfaces[0], lift, fixtures))
        parts = divided(found, camera, surfaces, solid, lift, np.array(about.gravity), SETTINGS)
        if _leaves(parts, found.rows, equivalent_radius(solid)):
            tracks = _in_flight(tracks, seen, camera, name, solid, found, parts)
            tracks = _on_surfaces(tracks, seen, camera, name, solid, parts)
            motions[name] = [
                {"first": seen.frames[part.first], "last": seen.frames[part.last], "motion": part.motion}
                for part in parts.stretches
            ]
    return tracks, motions


def _leaves(parts: Divided, rows: NDArray[np.int64], radius: float) -> bool:
    """Check whether a body is seen off the floor in known places: from above, a flight looks like motion below."""
    for part in parts.stretches:
        own = parts.covariance[(rows >= part.first) & (rows <= part.last)]
        sigma = np.sqrt(np.einsum("kii->k", own) / 3.0)
        off_floor = part.surface is not None and not part.on_floor
        if off_floor or (part.motion == "flight" and np.median(sigma) < SETTINGS.unsure * radius):
            return True
    return False


def _lift(tracks: ObservedTracks, name: str, solid: Solid) -> float:
    """Height of the centre of a solid above what it rests on: of a cylinder as it was seen to lie or to stand."""
    column = tracks.index(name)
    turns = tracks.orientations[tracks.orientation_confidence[:, column] > 0.0, column]
    upward = [abs(float(quaternion_matrix(turn)[2, 2])) for turn in turns]
    if isinstance(solid, Cylinder) and upward and float(np.median(upward)) < SETTINGS.lying:
        return solid.radius
    return _height(solid)


def _in_flight(
    tracks: ObservedTracks,
    seen: ImageObservation,
    camera: Camera,
    name: str,
    solid: Solid,
    found: Sightings,
    parts: Divided,
) -> ObservedTracks:
    column, observed, rows = tracks.index(name), seen.object(name), found.rows
    positions, sigma = tracks.positions.copy(), tracks.position_sigma.copy()
    spread = np.zeros_like(positions) if tracks.position_spread is None else tracks.position_spread.copy()
    pixel = SETTINGS.sightings.edge * found.distances / camera.intrinsics[0][0]
    total = np.einsum("kii->k", parts.covariance)
    along = np.einsum("ki,kij,kj->k", found.directions, parts.covariance, found.directions)
    across = np.sqrt(np.maximum(0.5 * (total - along), 0.0))
    confidence, turns = tracks.confidence.copy(), tracks.orientation_confidence.copy()
    radius = equivalent_radius(solid)
    floor = np.zeros(len(tracks.frames), dtype=bool)
    for part in parts.stretches:
        if part.on_floor:
            floor[part.first : part.last + 1] = True
    confidence[~floor, column] = turns[~floor, column] = 0.0
    for part in parts.stretches:
        if part.on_floor or part.motion == "unexplained":
            continue
        for k in np.flatnonzero((rows >= part.first) & (rows <= part.last)):
            row = rows[k]
            positions[row, column] = parts.places[k]
            sigma[row, column] = off = max(SETTINGS.trusted * across[k], pixel[k])
            far = (SETTINGS.trusted**2 * along[k]) - off**2
            spread[row, column] = np.sqrt(max(far, 0.0)) * found.directions[k]
            confidence[row, column] = round(float(observed.confidence[row]) / (1.0 + (off / radius) ** 2), 4)
    return replace(
        tracks,
        positions=positions,
        position_sigma=sigma,
        confidence=confidence,
        orientation_confidence=turns,
        position_spread=spread,
    )


def _height(solid: Solid) -> float:
    """Height of the centre of a solid that stands [m]."""
    if isinstance(solid, Box):
        return solid.half_extents[2]
    return solid.radius if isinstance(solid, Sphere) else solid.half_height


def _rest(seen: ImageObservation, camera: Camera, name: str, solid: Solid, parts: Divided) -> dict[str, bool]:
    """Check whether a cylinder lies, by its outline on all surfaces together; empty for other solids."""
    if not isinstance(solid, Cylinder):
        return {}
    misfits: dict[bool, list[Floats]] = {False: [], True: []}
    for part in parts.stretches:
        if part.surface is not None:
            rows = np.arange(part.first, part.last + 1)
            for lies, own in misfits_at_rest(seen, camera, name, solid, _plane(part.surface), rows).items():
                misfits[lies].append(own)
    if not misfits[True]:
        return {}
    return {name: lies_better(np.concatenate(misfits[False]), np.concatenate(misfits[True]))}


def _not_settled(places: Floats, camera: Camera, solid: Solid) -> Floats:
    """Standard deviations (F, 3) [m] along the line of sight of bodies that landed, which may be higher than they rest.

    They stand on an edge, or bounce too low for it to show.
    """
    lift = _height(solid)
    higher = max(0.5 * (circumscribed_radius(solid) - lift), SETTINGS.low * lift)
    away = places - camera.centre
    return np.asarray(higher * away / np.maximum(np.abs(away[:, 2:]), 1e-9))


def _plane(face: Surface) -> MotionPlane:
    point, normal = (tuple(float(x) for x in vector) for vector in (face.point, face.normal))
    return MotionPlane.model_validate({"point": point, "normal": normal})


def _on_surfaces(
    tracks: ObservedTracks,
    seen: ImageObservation,
    camera: Camera,
    name: str,
    solid: Solid,
    parts: Divided,
) -> ObservedTracks:
    column = tracks.index(name)
    series = {
        key: getattr(tracks, key).copy()
        for key in ("positions", "position_sigma", "orientations", "confidence", "orientation_confidence")
    }
    spread = np.zeros_like(tracks.positions) if tracks.position_spread is None else tracks.position_spread.copy()
    rests = _rest(seen, camera, name, solid, parts)
    flown = False
    for part in parts.stretches:
        flown |= part.motion == "flight"
        if part.surface is None:
            continue
        rows = np.arange(part.first, part.last + 1)
        if rests or not part.on_floor:
            placed = world_tracks(
                seen,
                camera,
                {name: solid},
                _plane(part.surface),
                seconds_per_frame=tracks.seconds_per_frame,
                only=[name],
                lying=rests,
            )
            shown = rows[placed.confidence[rows, column] > 0.0]
            for key, values in series.items():
                values[shown, column] = getattr(placed, key)[shown, column]
            spread[shown, column] = 0.0
        if part.on_floor and flown:
            spread[rows, column] = _not_settled(series["positions"][rows, column], camera, solid)
    return replace(tracks, **series, position_spread=spread)
