"""Readouts of deformable objects, comparable with an observation: each kind names one measurement.

Every readout has values of shape (..., T, m, c): m entries at each of T times, of c components. view "world": metres in
world axes; view "image": pixels of the world's camera, u to the right, v down.
"""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from polyworld.world.description import Description, Name, Vec3, fixed_length

View = Literal["world", "image"]


class Markers(Description):
    """Places of k points that move with the material: c = 3 [m] or 2 [px].

    Each is named by where it is at the object's start, so that it means the same whatever the resolution.
    """

    kind: Literal["markers"] = "markers"
    object: Name
    at: tuple[Vec3, ...] = Field(min_length=1, max_length=10_000, description="places at the object's start [m]")
    view: View = "world"


class Centreline(Description):
    """`count` points of a rope, evenly spaced along it from end to end: c = 3 [m] or 2 [px].

    Spaced by length in space, or by length in the image. directed: the first observed point is the rope's first; else
    either direction may be meant, and the nearer counts.
    """

    kind: Literal["centreline"] = "centreline"
    object: Name
    count: int = Field(default=16, ge=2, le=1000)
    view: View = "world"
    directed: bool = True


class Curve(Description):
    """`count` points that lie on a rope somewhere, as where only a part of it is seen: c = 3 [m] or 2 [px].

    The readout is, for each observed point, the point of the rope nearest to it.
    """

    kind: Literal["curve"] = "curve"
    object: Name
    count: int = Field(ge=1, le=1000)
    view: View = "world"


class Outline(Description):
    """How far the object reaches along each direction (its support function): c = 1 [m] or [px].

    Opposite directions together give a width and a middle: directional deformation and the centre's motion.
    directions: (x, y, z) unit vectors for the world, (u, v, 0) for the image.
    """

    kind: Literal["outline"] = "outline"
    object: Name
    directions: tuple[Vec3, ...] = Field(min_length=1, max_length=64, description="unit vectors")
    view: View = "world"

    @model_validator(mode="after")
    def _unit(self) -> Self:
        if np.any(np.abs(np.linalg.norm(np.asarray(self.directions), axis=1) - 1.0) > 1e-6):
            raise ValueError("directions of an outline must be unit vectors")
        if self.view == "image" and np.any(np.asarray(self.directions)[:, 2] != 0.0):
            raise ValueError("directions in the image are (u, v, 0)")
        return self


class ImageOccupancy(Description):
    """Share of each cell of a grid laid over the image that the object covers: m = rows x columns, c = 1.

    Cells run row by row from the top left.
    """

    kind: Literal["image_occupancy"] = "image_occupancy"
    object: Name
    columns: int = Field(ge=1, le=512)
    rows: int = Field(ge=1, le=512)


class GridOccupancy(Description):
    """Share of each cell of a box of space that a fluid fills: m = nx ny nz (z fastest), c = 1.

    In planar worlds the grid has one cell across the motion plane, and areas count.
    """

    kind: Literal["grid_occupancy"] = "grid_occupancy"
    object: Name
    lower: Vec3
    upper: Vec3
    cells: Annotated[tuple[int, int, int], fixed_length(3, "integer")]

    @model_validator(mode="after")
    def _has_cells(self) -> Self:
        if min(self.cells) < 1 or int(np.prod(self.cells)) > 100_000:
            raise ValueError(f"cells must be positive and at most 100 000 in all, got {self.cells}")
        if min(np.subtract(self.upper, self.lower)) <= 0.0:
            raise ValueError("upper must exceed lower along every axis")
        return self


class Amount(Description):
    """How much of the object is in a container of the world, or in a box of space: m = 1, c = 1.

    [m^3] of a fluid (planar: [m^2]), [m] of a rope, [m^2] of a cloth, [m^3] of a soft body. A container moves with the
    rigid object that carries it.
    """

    kind: Literal["amount"] = "amount"
    object: Name
    container: Name | None = Field(default=None, description="container of the world; else lower and upper")
    lower: Vec3 | None = None
    upper: Vec3 | None = None

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        box = self.lower is not None and self.upper is not None
        if (self.container is not None) == box or (self.lower is None) != (self.upper is None):
            raise ValueError("amount: give a container, or lower and upper")
        return self


class Front(Description):
    """Coordinate along `direction` below which `share` of the object lies: m = 1, c = 1 [m].

    Direction (0, 0, 1) and share 1 is the height of its highest point; (1, 0, 0) and 0.99 the front of a flow.
    """

    kind: Literal["front"] = "front"
    object: Name
    direction: Vec3 = (0.0, 0.0, 1.0)
    share: float = Field(default=1.0, ge=0.0, le=1.0)


class Level(Description):
    """Depth at which a fluid would stand in a container, or in its fluid grid, were it level: m = 1, c = 1 [m].

    What of it is inside, over the horizontal extent of that box: an area (in planar worlds a width).
    """

    kind: Literal["level"] = "level"
    object: Name
    container: Name | None = Field(default=None, description="container of the world; default: the fluid grid")


class Tension(Description):
    """Tension of a rope at a share of its length from its first end, or its largest: m = 1, c = 1 [N]."""

    kind: Literal["tension"] = "tension"
    object: Name
    at: float | None = Field(default=None, ge=0.0, le=1.0, description="share of the length; default: the largest")


class Stretch(Description):
    """Principal stretches of the object as a whole, largest first: m = 1, c = 3 [1] (2 in planar worlds)."""

    kind: Literal["stretch"] = "stretch"
    object: Name


Readout = Annotated[
    Markers
    | Centreline
    | Curve
    | Outline
    | ImageOccupancy
    | GridOccupancy
    | Amount
    | Front
    | Level
    | Tension
    | Stretch,
    Field(discriminator="kind"),
]
