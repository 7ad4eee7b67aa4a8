"""Objects that are known before a video is looked at, as arguments, and as the bodies that perception looks for."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from pydantic import Field

from atw_mcp.calls.app import App
from atw_mcp.observation.importing import mesh_of
from atw_mcp.observation.matching import Known
from atw_mcp.perception.eye.colour_names import colour_word
from atw_mcp.perception.known_bodies import KnownBody
from atw_mcp.perception.known_scene import Corners, Sized
from atw_mcp.tools.world_arguments import Argument, Name, Pixel, Point, ShapeArgument
from evidence_store import Case
from polyworld.world import StaticObject
from polyworld.world.geometry import quaternion_matrix, surface_mesh
from polyworld.world.shapes import Plane, TriangleMesh, Wall


class KnownObject(Argument):
    """One rigid object of the scene. The more is known, the surer it is found; what is left out is observed or
    fitted."""

    name: Name = Field(description="what it is to be called, e.g. red_ball; colour and shape in the name are hints")
    shape: ShapeArgument | None = Field(default=None, description="shape and size; default: as its outline looks")
    across: bool = Field(
        default=False, description="a cylinder in a side view: its axis is across the motion plane, seen as a disc"
    )
    color: str | None = Field(default=None, max_length=32, description="e.g. red")
    material: str | None = Field(default=None, max_length=32, description="e.g. metal, rubber")
    mass: float | None = Field(default=None, gt=0, le=1e9, description="[kg]; not fitted if given")
    friction: float | None = Field(default=None, ge=0, le=10, description="not fitted if given")
    restitution: float | None = Field(default=None, ge=0, le=1, description="not fitted if given")
    pixel: Pixel | None = Field(
        default=None, description="u, v near its centre, in the first frame that shows its color there"
    )
    frame: int | None = Field(default=None, ge=0, description="frame of pixel, if another")
    position: Point | None = Field(default=None, description="its centre, used if the video does not show it [m]")


def known_of(app: App, case: Case, item: KnownObject) -> Known:
    """Return what an argument says of an object, as matching and perception take it.

    Raises ValueError where something else than a cylinder is said to be across.
    """
    if item.across and (item.shape is None or item.shape.kind != "cylinder"):
        raise ValueError(f"{item.name}: across says how a cylinder lies: give shape of kind cylinder, or leave it out")
    shape = None if item.shape is None else item.shape.to_shape(partial(mesh_of, app, case))
    pixel = None if item.pixel is None else (item.pixel[0], item.pixel[1])
    return Known(item.name, shape, item.color, item.material, pixel, item.frame)


def bodies_of(known: Sequence[Known]) -> tuple[list[KnownBody], dict[str, Sized]]:
    """Return known objects as bodies to look for, and their shapes.

    Raises ValueError naming the object that has no size, or neither a colour nor a pixel.
    """
    bodies, solids = [], {}
    for item in known:
        if not isinstance(item.shape, Sized):
            raise ValueError(f"{item.name}: to be looked for it needs a shape: sphere, box or cylinder, with its size")
        if item.pixel is None and colour_word(item.color or item.name) is None:
            raise ValueError(f"{item.name}: to be looked for it needs a pixel, or a color such as red, dark grey, pink")
        bodies.append(KnownBody(item.name, item.color or item.name, item.pixel, item.frame))
        solids[item.name] = item.shape
    return bodies, solids


def corners_of(fixed: Sequence[StaticObject]) -> tuple[Corners, ...]:
    """Return the corners (n, 3) [m] of convex solids that do not move, as perception takes what may hide bodies.

    Raises ValueError naming the one that is not a convex solid.
    """
    corners = []
    for item in fixed:
        if isinstance(item.shape, Plane | Wall | TriangleMesh):
            raise ValueError(f"{item.name}: a {item.shape.kind} is no convex solid; give a box, cylinder or sphere")
        own = np.asarray(surface_mesh(item.shape).vertices, dtype=float)
        placed = own @ quaternion_matrix(np.asarray(item.orientation)).T + np.asarray(item.position)
        corners.append(tuple((float(x), float(y), float(z)) for x, y, z in placed))
    return tuple(corners)
