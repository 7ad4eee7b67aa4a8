"""Which frames show a body in free flight, which on the floor or on an obstacle: the cheapest division into these."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.flight.chain import Chain, Part, Stretch
from atw_mcp.perception.flight.evidence import Motion, energy_gains, evidences, flight, normal_equations, sliding
from atw_mcp.perception.flight.settings import FlightSettings
from atw_mcp.perception.flight.sightings import Sightings, Solid
from atw_mcp.perception.flight.surfaces import Surface, allowed, within
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
    rough, airy = _cheapest(fewer, camera, motions, surfaces, lift, settings)
    if all(part.motion == 0 for part in rough):  # it stays on the floor: how it is divided there is of no interest
        floor = Stretch(int(seen.rows[0]), int(seen.rows[-1]), motions[0].name, surfaces[0])
        return Divided((floor,), np.full((len(seen.rows), 3), np.nan), np.full((len(seen.rows), 3, 3), np.nan))
    chain = Chain(fewer, camera.centre, motions, surfaces, lift, reach, settings)
    parts, _ = min((chain.improved(start) for start in (rough, airy)), key=lambda found: found[1].energy)
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


def _cheapest(
    seen: Sightings,
    camera: Camera,
    motions: Sequence[Motion],
    surfaces: Sequence[Surface],
    lift: float,
    settings: FlightSettings,
) -> tuple[list[Part], list[Part]]:
    """Return the cheapest divisions of all frames, without and with what contacts add in favour of flights."""
    count, times = len(seen.rows), seen.times
    cost, unknowns = [], []
    first, last = np.triu_indices(count + 1, 1)
    for k, motion in enumerate(motions):
        normal = normal_equations(motion, seen, camera.centre)
        evidence, theta = evidences(motion, normal, times, (0.0, seen.scale), settings)
        ends, own = np.stack([first, last - 1], axis=1), theta[first, last][:, :6]
        at = times[ends]
        places = np.stack([motion.places(at[:, side], own) for side in (0, 1)], axis=1)
        possible = allowed(places, surfaces, k, lift, settings.sink * seen.distances[ends])
        price = np.full((count, count + 1), np.inf)
        price[first, last] = np.where(possible, -evidence[first, last], np.inf) + settings.contact
        if k == 0:
            behind = np.append(0.0, np.cumsum(settings.covered * seen.covered))
            price[first, last] += behind[last] - behind[first]
        price[first, last] += energy_gains(motion, at, own, motions[-1].drift, settings)
        price += 0.0 if k == 0 else settings.leave
        if k == len(surfaces):
            short = np.arange(count + 1)[None, :] - np.arange(count)[:, None] < settings.least
            price[short] = np.inf
        cost.append(price)
        unknowns.append(theta)
    favoured = [price - (settings.favour if k == len(surfaces) else 0.0) for k, price in enumerate(cost)]
    return _division(cost, unknowns, settings), _division(favoured, unknowns, settings)


def _division(cost: Sequence[Floats], unknowns: Sequence[Floats], settings: FlightSettings) -> list[Part]:
    """Return the division of the least cost (dynamic programming over where stretches end).

    cost: prices (K, K + 1) of stretches [i, j) for each motion; unknowns (K, K + 1, 7) of these.
    """
    count = len(cost[0])
    price, which = np.min(cost, axis=0), np.argmin(cost, axis=0)
    best, back = np.full(count + 1, np.inf), np.zeros((count + 1, 2), dtype=np.int64)
    best[0] = 0.0
    for j in range(1, count + 1):
        options = best[:j] + price[:j, j]
        i = int(np.argmin(options))
        alone = best[j - 1] + settings.unexplained
        best[j], back[j] = (options[i], (i, which[i, j])) if options[i] <= alone else (alone, (j - 1, -1))
    parts: list[Part] = []
    j = count
    while j > 0:
        i, k = int(back[j, 0]), int(back[j, 1])
        if k < 0 and parts and parts[-1].motion < 0:
            parts[-1] = replace(parts[-1], begin=i)
        else:
            parts.append(Part(i, j, k, unknowns[k][i, j] if k >= 0 else None))
        j = i
    return parts[::-1]


def _is_met(face: Surface, seen: Sightings, camera: Camera, lift: float, settings: FlightSettings) -> bool:
    """Check whether rays meet a face where a body's centre can be on it, in as many frames as a stretch needs."""
    height = (face.point + lift * face.normal - camera.centre) @ face.normal
    with np.errstate(divide="ignore", invalid="ignore"):
        distance = height / (seen.directions @ face.normal)
    met = camera.centre + distance[:, None] * seen.directions
    return bool(np.count_nonzero((distance > 0.0) & within(met, face, lift)) >= settings.least)
