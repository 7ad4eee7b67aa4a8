"""Penalise initial states that a body's support forbids: off the surface, leaving it, tilted, or tumbling on it.

Components of a state are fitted along the world's axes, and on a slope each of them leaves the surface. Left to the
noise of a track, a cylinder that rolls down a ramp begins to wobble on its rims, and where it goes then is chance.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.support import Support, supports
from polyworld.estimation.world_fit.settings import SupportSettings
from polyworld.trajectory.events import REST_SPEED
from polyworld.world import World, geometry
from polyworld.world.parameters import read_parameter

Array = NDArray[np.float64]

FIELDS = ("position", "velocity", "rotation", "angular_velocity")


@dataclass(frozen=True)
class SupportConstraint:
    """Standardised departures of one body's initial state from what its support allows.

    start: path -> value in the world in which it is supported, which a path that is not fitted keeps.
    """

    name: str
    support: Support
    start: Mapping[str, float]
    settings: SupportSettings

    def residuals(self, values: Mapping[str, Array], count: int) -> Array:
        """Return the residuals (count, k) of candidates: path -> values (count,) of what is fitted.

        Along the normal n: the place over a share of the centre's height, the velocity over the speed of rest. Of what
        lies on a face: how far the face's normal is turned off n [rad], and the spin about other axes than n. Of what
        rolls about an axis: the axis along n, and the spin about the direction in which it rolls.
        """
        vectors = {field: self._vector(field, values, count) for field in FIELDS}
        n, height = self.support.normal, self.support.height
        away = vectors["position"] - self.support.position
        found = [away @ n / (self.settings.tight * height), vectors["velocity"] @ n / REST_SPEED]
        if self.support.rolls and self.support.axis is None:
            return np.stack(found, axis=1)
        turn = geometry.quaternion_matrix(geometry.rotation_quaternion(vectors["rotation"]))
        spin = vectors["angular_velocity"] / (REST_SPEED / height)
        if self.support.axis is not None:
            axis = turn @ self.support.axis
            found += [axis @ n / self.settings.tight, np.einsum("ni,ni->n", spin, np.cross(n, axis))]
        else:
            tangent = np.cross(n, np.eye(3)[int(np.argmin(np.abs(n)))])
            tangent /= np.linalg.norm(tangent)
            for direction in (tangent, np.cross(n, tangent)):
                found += [(turn @ n) @ direction / self.settings.tight, spin @ direction]
        return np.stack(found, axis=1)

    def _vector(self, field: str, values: Mapping[str, Array], count: int) -> Array:
        paths = [f"objects.{self.name}.{field}.{axis}" for axis in "xyz"]
        return np.stack([np.broadcast_to(values.get(path, self.start[path]), count) for path in paths], axis=1)


def support_constraints(
    world: World, tracks: ObservedTracks, fitted: Collection[str], settings: SupportSettings | None = None
) -> list[SupportConstraint]:
    """Return the constraints of bodies of which a state is fitted and that a surface supports as their track begins.

    fitted: paths. A body that the world starts otherwise than on its support, by a standard deviation of any residual,
    is left free.
    """
    settings = settings or SupportSettings()
    found = []
    for name, support in supports(world, tracks, settings).items():
        paths = [f"objects.{name}.{field}.{axis}" for field in FIELDS for axis in "xyz"]
        start = {path: read_parameter(world, path) or 0.0 for path in paths}
        constraint = SupportConstraint(name, support, start, settings)
        if set(paths) & set(fitted) and np.abs(constraint.residuals({}, 1)).max() < 1.0:
            found.append(constraint)
    return found
