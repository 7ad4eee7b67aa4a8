"""Quantities derived from measured positions of one object: velocity to energy with 90% intervals, and a period."""

from __future__ import annotations

from typing import Any, Literal, get_args

import numpy as np
from mcp.server.mcpserver.exceptions import ToolError
from numpy.typing import NDArray

from atw_mcp.calls.results import explained
from atw_mcp.observation.periods import HALF, periods
from polyworld.data.track_motion import LocalMotion, local_motion
from polyworld.data.tracks import ObservedTracks
from polyworld.world import World
from polyworld.world.parameters import object_mass

Array = NDArray[np.float64]

Quantity = Literal[
    "velocity", "speed", "acceleration", "momentum", "kinetic_energy", "potential_energy", "energy", "period"
]
NEED_MASS = ("momentum", "kinetic_energy", "potential_energy", "energy")
UNITS = {
    "velocity": "m/s",
    "speed": "m/s",
    "acceleration": "m/s^2",
    "momentum": "kg m/s",
    "kinetic_energy": "J",
    "potential_energy": "J",
    "energy": "J",
}


def observed_quantities(
    tracks: ObservedTracks, world: World | None, name: str, wanted: list[Quantity], first: float, last: float
) -> dict[str, Any]:
    """Columns and rows (time, frame, then [value, from, to] of each quantity) between two times [s], and the period.

    Raises ToolError where a quantity needs a mass that no world of the case has, or there are too few places.
    """
    item = world.object(name) if world is not None and world.is_rigid(name) else None
    asked = [quantity for quantity in NEED_MASS if quantity in wanted]
    if asked and item is None:
        raise ToolError(
            f"{', '.join(asked)} of {name!r} needs the mass of a rigid object: BuildWorld gives it one, FitWorld the "
            "ratios that collisions show; velocity, speed, acceleration and period need none"
        )
    with explained():
        motion = local_motion(tracks, name)
    times = tracks.times[motion.rows]
    inside = np.flatnonzero((times >= first - 1e-9) & (times <= last + 1e-9))
    mass = 1.0 if item is None else object_mass(item)
    gravity = np.zeros(3) if world is None else np.asarray(world.environment.gravity)
    columns: dict[str, tuple[Array, Array]] = {}
    for quantity in get_args(Quantity):
        if quantity in wanted and quantity != "period":
            columns |= _columns(motion, quantity, mass, gravity)
    rows = [
        [
            float(times[k]),
            int(tracks.frames[motion.rows[k]]),
            *([float(v[k]), float(v[k] - HALF * e[k]), float(v[k] + HALF * e[k])] for v, e in columns.values()),
        ]
        for k in inside
    ]
    about: dict[str, Any] = {
        "columns": ["time", "frame", *columns],
        "units": {quantity: UNITS[quantity] for quantity in wanted if quantity in UNITS},
        "cells": "value and 90% interval: value, from, to",
        "rows": rows,
    }
    if asked:
        about["mass"] = mass
        about["kinetic_energy_is"] = "of the centre's motion; rotation is not included"
    if "period" in wanted:
        sigma = float(np.median(tracks.coordinate_sigma[motion.rows, tracks.index(name)]))
        places = tracks.positions[motion.rows][:, tracks.index(name)]
        about["period"] = periods(times[inside], places[inside], sigma)
    return about


def _columns(motion: LocalMotion, quantity: str, mass: float, gravity: Array) -> dict[str, tuple[Array, Array]]:
    """Columns by name: values and standard errors (n,) each."""
    velocity, errors = motion.derivatives[:, 1], motion.standard_errors(1)
    if quantity == "speed":
        speed = np.linalg.norm(velocity, axis=1)
        error = np.sqrt(((velocity * errors) ** 2).sum(axis=1)) / np.maximum(speed, 1e-12)
        return {"speed": (speed, error)}
    if quantity == "kinetic_energy":
        return {quantity: motion.kinetic_energy(mass)}
    if quantity == "potential_energy":
        return {quantity: motion.potential_energy(mass, gravity)}
    if quantity == "energy":
        return {quantity: motion.energy(mass, gravity)}
    values, errors, letter = {
        "velocity": (velocity, errors, "v"),
        "acceleration": (motion.derivatives[:, 2], motion.standard_errors(2), "a"),
        "momentum": (mass * velocity, mass * errors, "p"),
    }[quantity]
    return {f"{letter}{axis}": (values[:, i], errors[:, i]) for i, axis in enumerate("xyz")}
