"""Which frames show a body in free flight, which on the floor or on an obstacle: the cheapest division into these.

The search begins with the floor alone, and with one flight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.flight.chain import Chain, Part, Stretch
from atw_mcp.perception.flight.evidence import Motion, flight, sliding
from atw_mcp.perception.flight.settings import FlightSettings
from atw_mcp.perception.flight.sightings import Sightings, Solid
from atw_mcp.perception.flight.surfaces import Surface, within
from polyworld.world.camera import Camera
from polyworld.world.geometry import circumscribed_radius

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Divided:
    """Stretches of a body's motion, and of its K sightings the places (K, 3) [m] and their covariances (K, 3, 3).

    NaN where no motion explains a sighting."""

    stretches: tuple[Stretch, ...]
    places: Floats
    covariance: Floats


def divided(
    seen: Sightings,
    camera: Camera,
    surfaces: Sequence[Surface],
    solid: Solid,
    lift: float,
    gravity: Floats,
    settings: FlightSettings,
) -> Divided:
    """Divide a body's sightings into stretches of flight and of motion on surfaces, the floor first among these.

    lift [m]: height of its centre above what it is on.
    """
    surfaces = [one for one in surfaces if one.corners is None or _is_met(one, seen, camera, lift, settings)]
    reach = circumscribed_radius(solid)
    motions = _motions(seen, camera, surfaces, lift, gravity, settings)
    local = replace(seen, times=seen.times - seen.times.mean())
    stride = -(-len(seen.rows) // settings.most)
    fewer = local.only(slice(None, None, stride))
    chain = Chain(fewer, camera.centre, motions, surfaces, lift, reach, settings)
    whole = [[Part(0, len(fewer.rows), k)] for k in (0, len(surfaces))]
    parts, _ = min((chain.improved(start) for start in whole), key=lambda found: found[1].energy)
    if all(part.motion == 0 for part in parts):  # it stays on the floor: how it is divided there is of no interest
        floor = Stretch(int(seen.rows[0]), int(seen.rows[-1]), motions[0].name, surfaces[0])
        return Divided((floor,), np.full((len(seen.rows), 3), np.nan), np.full((len(seen.rows), 3, 3), np.nan))
    if stride > 1:
        last = len(seen.rows)
        parts = [replace(p, begin=stride * p.begin, end=min(stride * p.end, last)) for p in parts]
    chain = Chain(local, camera.centre, motions, surfaces, lift, reach, settings)
    parts, solved = chain.settled(parts)
    found = []
    for part in parts:
        name = "unexplained" if part.motion < 0 else motions[part.motion].name
        surface = surfaces[part.motion] if 0 <= part.motion < len(surfaces) else None
        found.append(Stretch(int(seen.rows[part.begin]), int(seen.rows[part.end - 1]), name, surface))
    places, covariance = chain.places(parts, solved)
    return Divided(tuple(found), places, covariance)


def _motions(
    seen: Sightings, camera: Camera, surfaces: Sequence[Surface], lift: float, gravity: Floats, settings: FlightSettings
) -> list[Motion]:
    away = float(np.median(seen.distances))
    middle = camera.centre + away * seen.directions.mean(axis=0)
    length = settings.length * away * camera.width / camera.intrinsics[0][0]
    speed = settings.speed * float(np.sqrt(length * np.linalg.norm(gravity)))
    found = []
    for surface in surfaces:
        point = surface.point + lift * surface.normal
        foot = middle - ((middle - point) @ surface.normal) * surface.normal
        found.append(sliding(surface.name, foot, surface.axes, gravity, settings.friction, length, speed))
    return [*found, flight(gravity, middle, length, speed)]


def _is_met(face: Surface, seen: Sightings, camera: Camera, lift: float, settings: FlightSettings) -> bool:
    """Check whether rays meet a face where a body's centre can be on it, in as many frames as a stretch needs."""
    height = (face.point + lift * face.normal - camera.centre) @ face.normal
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = height / (seen.directions @ face.normal)
    met = camera.centre + distance[:, None] * seen.directions
    return bool(np.count_nonzero((distance > 0.0) & within(met, face, lift)) >= settings.least)
