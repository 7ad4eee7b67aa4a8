"""Compare the places that a report names with the true ones."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from polyworld.world import World

TURN, AWAY = np.cos(np.radians(15.0)), 0.15  # [1], [m] within which a wall found overlaps the true one

Place = Mapping[str, float]


def overlap(places: Mapping[str, Place], effects: list[dict[str, Any]], world: World) -> dict[str, bool]:
    """Return, by effect that has a place and was found, whether the place found overlaps the true one.

    A place is a centre x, y, z with an extent [m], of a wall a level normal with an offset [m], or a time [s].
    """
    found = {}
    for effect in effects:
        place = places.get(effect["name"])
        if place is None:
            continue
        values = {k: u["value"] for k, u in effect["unknowns"].items()}
        if "offset" in place:
            found[effect["name"]] = any(_on_wall(place, s) for s in world.model_dump()["statics"])
        elif "onset" in place:
            found[effect["name"]] = abs(values.get("shift_time", np.inf) - place["onset"]) <= 2.0 * place["extent"]
        elif "x" in place:
            away = [values.get(f"centre_{a}", values.get(a, np.nan)) - place[a] for a in "xyz" if a in place]
            reach = place["extent"] + abs(values.get("width", values.get("radius", 0.0)))
            found[effect["name"]] = bool(np.linalg.norm(away) < reach)
    return found


def _on_wall(place: Place, static: Mapping[str, Any]) -> bool:
    """Return whether a static plane, or upright wall, stands where the true one does."""
    true = np.array([place["normal_x"], place["normal_y"], 0.0])
    shape, at = static["shape"], np.asarray(static.get("position") or (0.0, 0.0, 0.0), dtype=float)
    turn = Rotation.from_quat(static.get("orientation") or (1.0, 0.0, 0.0, 0.0), scalar_first=True)
    if shape["kind"] == "plane":
        normal = turn.apply(shape["normal"])
        normal /= np.linalg.norm(normal)
        return bool(normal @ true > TURN and abs(shape["offset"] + normal @ at - place["offset"]) < AWAY)
    if shape["kind"] == "wall":
        ends = [turn.apply(shape[k]) + at for k in ("start", "end")]
        along = (ends[1] - ends[0]) / np.linalg.norm(ends[1] - ends[0])
        nearest = min(abs(float(true @ e) - place["offset"]) for e in ends)
        return bool(abs(along @ true) < np.sqrt(1.0 - TURN**2) and nearest < 2.0 * AWAY + shape["thickness"])
    return False
