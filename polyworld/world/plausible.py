"""Ranges outside which a number of a world is a mistake, wide enough for cells and for moons.

Contacts and constraints multiply lengths, masses and rates three and more at a time; within these ranges their products
stay far from the limits of double precision, and a position keeps at least a micrometre of resolution.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from pydantic import BaseModel

if TYPE_CHECKING:
    from polyworld.world.world import World


@dataclass(frozen=True)
class Range:
    """Plausible magnitudes of a quantity other than zero, in its unit."""

    least: float
    most: float
    unit: str

    def __str__(self) -> str:
        return f"{self.least:g} to {self.most:g} {self.unit}" if self.least else f"at most {self.most:g} {self.unit}"


PLACE = Range(0.0, 1e9, "m")  # the Moon is at 4e8 m; doubles resolve 1e-7 m there
LENGTH = Range(1e-9, 1e9, "m")  # a molecule, a star
SPEED = Range(0.0, 3e8, "m/s")  # light
SPIN = Range(0.0, 1e9, "rad/s")  # levitated nanoparticles reach 1e9
ACCELERATION = Range(0.0, 1e7, "m/s^2")  # ultracentrifuges reach 1e7
MASS = Range(1e-24, 1e28, "kg")  # an atom, a planet
DENSITY = Range(1e-9, 1e12, "kg/m^3")  # a good vacuum, a white dwarf
STEP = Range(1e-8, 1e4, "s")  # light passes 3 m in it, hours between frames
TIME = Range(0.0, 1e9, "s")  # thirty years
OTHER = Range(1e-30, 1e30, "in SI units")  # stiffnesses, coefficients: squares and cubes of them are finite
RANGES: Mapping[str, Range] = {
    **dict.fromkeys(("position", "point", "points", "corner", "centre", "vertices", "lower", "upper", "anchor"), PLACE),
    **dict.fromkeys(("other_anchor", "offset", "edge_u", "edge_v"), PLACE),
    **dict.fromkeys(("radius", "half_extents", "half_height", "height", "thickness", "resolution", "cell"), LENGTH),
    "length": LENGTH,
    "velocity": SPEED,
    "wind": SPEED,
    "angular_velocity": SPIN,
    "gravity": ACCELERATION,
    "mass": MASS,
    "density": DENSITY,
    "substep": STEP,
    "seconds_per_frame": STEP,
    "start_time": TIME,
    "start": TIME,  # of an emitter [s]; of a wall [m], with the same bound
    "end": TIME,
}
MANY = 64  # rows of a table from which on only the one with the greatest number is looked at
# Names, and what has checks of its own.
UNCHECKED = frozenset(("camera", "orientation", "normal", "direction", "axis", "schedule", "no_contact"))


def check_plausible(world: World) -> None:
    """Raise ValueError naming the first number that is beyond what its quantity can be, and the range it may have."""
    _check_fields(world, "")


def _check_fields(model: BaseModel, path: str) -> None:
    for name, value in model.__dict__.items():
        if name not in UNCHECKED and value is not None:
            _check(value, f"{path}{name}", RANGES.get(name, OTHER))


def _check(value: Any, path: str, allowed: Range) -> None:
    if isinstance(value, float):
        if value != 0.0 and not allowed.least <= abs(value) <= allowed.most:
            raise ValueError(f"{path} has the value {value:g}, which is not plausible: {allowed}")
    elif isinstance(value, BaseModel):
        _check_fields(value, f"{path}.")
    elif isinstance(value, dict):
        for key, item in value.items():
            _check(item, f"{path}.{key}", allowed)
    elif isinstance(value, tuple):
        if len(value) > MANY and isinstance(value[0], tuple):  # vertices, or faces
            sizes = np.abs(np.asarray(value))
            value = (value[int(np.argmax(sizes.max(axis=1)))],)
        for number, item in enumerate(value):
            if isinstance(item, float):
                _check(item, path, allowed)
            elif isinstance(item, BaseModel):
                _check_fields(item, f"{path}.{getattr(item, 'name', number)}.")
            elif isinstance(item, tuple):
                _check(item, path, allowed)
