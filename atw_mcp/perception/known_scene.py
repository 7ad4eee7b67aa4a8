"""Known facts of a scene: its camera, the plane of motion, solids that move and solids that may hide them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from atw_mcp.perception.eye import Solid
from atw_mcp.perception.eye.bodies import FAR, FLOOR
from atw_mcp.perception.flight.surfaces import Surface, crossed, surfaces_of
from polyworld.world import MotionPlane
from polyworld.world.camera import Camera
from polyworld.world.geometry import plane_axes
from polyworld.world.shapes import Box, Cylinder, Sphere

Floats = NDArray[np.float64]
Sized = Sphere | Box | Cylinder
Corners = tuple[tuple[float, float, float], ...]
# of a body, as notes say it
OFF_PLANE = "is larger or smaller than on its plane of motion (the floor, where no other was given)"
LEVEL = 1.0 - 1e-6  # least upward part of the normal of a level plane
_SIZED: TypeAdapter[Sized] = TypeAdapter(Sized)


@dataclass(frozen=True)
class KnownScene:
    """Camera, plane of motion, solids by name, and corners (n, 3) [m] of convex solids that may hide them.

    off_plane: names of solids that are not on the plane, and are followed in the image. floor: z [m] of a level floor
    that ends an upright plane below, None where none is known. across: names of cylinders whose axis is along the
    normal of an upright plane.
    """

    camera: Camera
    plane: MotionPlane = FLOOR
    solids: Mapping[str, Sized] = field(default_factory=dict)
    fixtures: tuple[Corners, ...] = ()
    off_plane: frozenset[str] = frozenset()
    floor: float | None = None
    across: frozenset[str] = frozenset()

    def body(self, name: str) -> Solid:
        """Return a solid as a body with a silhouette."""
        solid = self.solids[name]
        faces: tuple[Surface, ...] = ()
        if isinstance(solid, Sphere) and self.plane.supports and plane_axes(self.plane)[2, 2] > LEVEL:
            corners = {str(k): np.array(c) for k, c in enumerate(self.fixtures)}
            faces = tuple(surfaces_of(self.plane.point[2], corners)[1:])
        found = replace(solid_body(name, solid, self.camera, self.plane), faces=faces, floor=self.floor)
        return replace(found, lies=True) if found.upright and name in self.across else found

    def renamed(self, old: str, new: str) -> KnownScene:
        """Return the scene with another name of a solid."""
        solids = {new if name == old else name: solid for name, solid in self.solids.items()}
        off, across = (
            frozenset(new if name == old else name for name in names) for names in (self.off_plane, self.across)
        )
        return replace(self, solids=solids, off_plane=off, across=across)

    def hiding(self, shape: tuple[int, int]) -> NDArray[np.float32] | None:
        """Distance along the camera's axis (H, W) [m] of the nearest fixture, FAR where there is none."""
        if not self.fixtures:
            return None
        depths = fixture_depths([np.array(c) for c in self.fixtures], self.camera, shape)
        return np.minimum(depths, np.float32(FAR))

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values; `from_dict` reads them back."""
        return {
            "camera": self.camera.model_dump(mode="json"),
            "plane": self.plane.model_dump(mode="json"),
            "solids": {name: solid.model_dump(mode="json") for name, solid in self.solids.items()},
            "fixtures": [[list(corner) for corner in corners] for corners in self.fixtures],
            "off_plane": sorted(self.off_plane),
            "floor": self.floor,
            "across": sorted(self.across),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the inverse of `to_dict`."""
        return cls(
            Camera.model_validate(data["camera"]),
            MotionPlane.model_validate(data["plane"]),
            {name: _SIZED.validate_python(solid) for name, solid in data["solids"].items()},
            tuple(tuple((float(x), float(y), float(z)) for x, y, z in corners) for corners in data["fixtures"]),
            frozenset(data["off_plane"]),
            data["floor"],
            frozenset(data["across"]),
        )


def solid_body(name: str, solid: Sized, camera: Camera, plane: MotionPlane) -> Solid:
    """Return a solid on a plane as a body with a silhouette."""
    if isinstance(solid, Box):
        half = solid.half_extents
    else:
        half = (solid.radius, solid.radius, solid.radius if isinstance(solid, Sphere) else solid.half_height)
    return Solid(name, solid.kind, half, camera, plane)


def same_plane(one: MotionPlane, other: MotionPlane) -> bool:
    """Check whether two planes of motion are the same for bodies on them."""
    normals = [np.asarray(p.normal) / np.linalg.norm(p.normal) for p in (one, other)]
    apart = float((np.asarray(one.point) - np.asarray(other.point)) @ normals[0])
    return one.supports == other.supports and bool(np.allclose(normals[0], normals[1], atol=1e-9)) and abs(apart) < 1e-9


def fixture_depths(fixtures: Sequence[Floats], camera: Camera, shape: tuple[int, int]) -> NDArray[np.float32]:
    """Return the distance along the camera's axis (H, W) [m] of the nearest convex solid, infinite where there is none.

    fixtures: corners (n, 3) of each [m].
    """
    nearest = np.full(shape, np.inf)
    v, u = np.mgrid[0 : shape[0], 0 : shape[1]]
    rays = camera.rays(np.stack([u, v], axis=-1).astype(float))
    rays = rays / (camera.to_camera(camera.centre + rays)[..., 2:])
    for corners in fixtures:
        enter, leave = crossed(rays, camera.centre, corners)
        nearest = np.where((enter < leave) & (enter > 0.0), np.minimum(nearest, enter), nearest)
    return np.asarray(nearest, dtype=np.float32)
