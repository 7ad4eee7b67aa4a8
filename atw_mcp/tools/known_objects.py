"""Objects that are known before a video is looked at, as arguments, and as the bodies that perception looks for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.observation.importing import mesh_of
from atw_mcp.observation.matching import Known, apparent_radius, elevation_of
from atw_mcp.perception.known.bodies import KnownBody
from atw_mcp.perception.known.colour_words import colour_word
from atw_mcp.perception.silhouettes import lift_of
from atw_mcp.perception.tracks import kind_and_size
from atw_mcp.tools.world_arguments import Argument, Name, Pixel, Point, ShapeArgument
from evidence_store import Case
from polyworld.world import StaticObject
from polyworld.world.camera import Camera
from polyworld.world.geometry import quaternion_matrix, surface_mesh
from polyworld.world.shapes import Box, Cylinder, Plane, Sphere, TriangleMesh, Wall

Floats = NDArray[np.float64]
Sized = Sphere | Box | Cylinder


class KnownObject(Argument):
    """One rigid object of the scene. The more is known, the surer it is found; what is left out is observed or
    fitted."""

    name: Name = Field(description="what it is to be called, e.g. red_ball; colour and shape in the name are hints")
    shape: ShapeArgument | None = Field(default=None, description="shape and size; default: as its outline looks")
    color: str | None = Field(default=None, max_length=32, description="e.g. red")
    material: str | None = Field(default=None, max_length=32, description="e.g. metal, rubber")
    mass: float | None = Field(default=None, gt=0, le=1e9, description="[kg]; not fitted if given")
    friction: float | None = Field(default=None, ge=0, le=10, description="not fitted if given")
    restitution: float | None = Field(default=None, ge=0, le=1, description="not fitted if given")
    pixel: Pixel | None = Field(default=None, description="u, v of a point on it in the first frame that shows it")
    frame: int | None = Field(default=None, ge=0, description="frame of pixel, if another")
    position: Point | None = Field(default=None, description="its centre, used if the video does not show it [m]")


def known_of(app: App, case: Case, item: KnownObject) -> Known:
    """Return what an argument says of an object, as matching and perception take it."""
    shape = None if item.shape is None else item.shape.to_shape(partial(mesh_of, app, case))
    pixel = None if item.pixel is None else (item.pixel[0], item.pixel[1])
    return Known(item.name, shape, item.color, item.material, pixel, item.frame)


def bodies_of(known: Sequence[Known], camera: Camera) -> list[KnownBody]:
    """Return known objects as bodies to look for with a camera.

    Raises ValueError naming the object that has no size or whose colour is not said.
    """
    elevation = elevation_of(camera)
    bodies = []
    for item in known:
        if not isinstance(item.shape, Sized):
            raise ValueError(f"{item.name}: to be looked for it needs a shape: sphere, box or cylinder, with its size")
        if colour_word(item.color or item.name) is None:
            raise ValueError(f"{item.name}: to be looked for it needs a color, such as red, dark grey, pink")
        lift = lift_of(kind_and_size(item.shape)[1])
        radius = apparent_radius(item.shape, elevation)
        bodies.append(KnownBody(item.name, item.color or item.name, radius, lift, item.pixel, item.frame))
    return bodies


def corners_of(fixed: Sequence[StaticObject]) -> list[Floats]:
    """Return the corners (n, 3) [m] of convex solids that do not move, as perception takes what may hide bodies.

    Raises ValueError naming the one that is not a convex solid.
    """
    corners = []
    for item in fixed:
        if isinstance(item.shape, Plane | Wall | TriangleMesh):
            raise ValueError(f"{item.name}: a {item.shape.kind} is no convex solid; give a box, cylinder or sphere")
        own = np.asarray(surface_mesh(item.shape).vertices, dtype=float)
        corners.append(own @ quaternion_matrix(np.asarray(item.orientation)).T + np.asarray(item.position))
    return corners


def known_places(app: App, case: Case, camera: Camera, floor: float) -> Floats:
    """Return points (k, 3) of the scene [m]: those that the camera was calibrated with, else the floor that it sees."""
    found = app.store.cases.observations(case.id, "camera")
    stored: Any = app.store.observations.get(found[0][1]).inputs.get("points") if found else None
    if stored:
        return np.array([point["world"] for point in stored], dtype=float)
    u, v = np.meshgrid(np.linspace(0.05, 0.95, 7) * camera.width, np.linspace(0.05, 0.95, 7) * camera.height)
    hits = camera.onto_plane(np.stack([u.ravel(), v.ravel()], axis=1), np.array([0, 0, floor]), np.array([0, 0, 1.0]))
    hits = hits[np.isfinite(hits).all(axis=1)]
    if len(hits) == 0:
        raise ValueError("the camera sees no floor: calibrate it with points of the scene")
    depth = camera.to_camera(hits)[:, 2]
    return np.asarray(hits[depth <= 2.0 * np.median(depth)], dtype=float)
