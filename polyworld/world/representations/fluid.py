"""Fluids: incompressible liquids with a free surface, their sources, and the regions they are measured in."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from polyworld.world.description import (
    IDENTITY,
    ORIGIN,
    Appearance,
    Description,
    Name,
    NonNegative,
    Positive,
    Quaternion,
    Vec3,
    fixed_length,
)
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Sphere


class FluidVolume(Description):
    """A part of space filled with a fluid at the start. What lies inside statics and bodies is left out."""

    shape: Annotated[Box | Sphere | Cylinder | Capsule | ConvexMesh, Field(discriminator="kind")] = Field(
        description="solid that the fluid fills at the start"
    )
    position: Vec3 = Field(default=ORIGIN, description="of the shape's origin [m]")
    orientation: Quaternion = Field(default=IDENTITY, description="unit quaternion w, x, y, z of the shape")


class Fluid(Description):
    """An incompressible liquid with a free surface against air, which has no mass.

    Carried by particles, two along each edge of a cell of `FluidGrid`. Several fluids share the grid; each keeps its
    density and viscosity. Soft bodies move with the liquid around them, ropes and sheets are dragged by it; sheets
    let nothing through. fluid_planar flows in environment.motion_plane only; its amounts are those of a slice one metre
    thick. Bodies keep their own masses, and count as what they displace per metre of their own depth: their volume over
    their section in the plane.
    """

    name: Name = Field(description="name, which nothing else in the world has")
    representation: Literal["fluid", "fluid_planar"] = "fluid"
    volumes: tuple[FluidVolume, ...] = Field(default=(), max_length=64, description="where it is at the start")
    density: Positive = Field(default=1000.0, description="density [kg/m^3]")
    viscosity: NonNegative = Field(default=0.001, description="dynamic viscosity [Pa s]")
    surface_tension: NonNegative = Field(default=0.0, description="surface tension against air [N/m]")
    slip: bool = Field(default=True, description="whether it slides freely along walls; else it sticks")
    velocity: Vec3 = Field(default=ORIGIN, description="velocity of all of it at the start [m/s]")
    appearance: Appearance = Appearance()


class FluidGrid(Description):
    """The box that fluids are computed in, and its resolution. Fluid that leaves through an open side is gone."""

    lower: Vec3 = Field(description="lower corner [m]")
    upper: Vec3 = Field(description="upper corner [m]")
    cell: Positive = Field(description="edge of a cell [m]; two particles lie along it, walls should be thicker")
    closed: bool = Field(default=True, description="whether the sides hold the fluid; else it leaves. Bodies pass them")

    @model_validator(mode="after")
    def _sensible(self) -> Self:
        extent = np.subtract(self.upper, self.lower)
        if extent.min() < self.cell:
            raise ValueError(f"fluid grid: upper - lower is {extent.tolist()}, less than one cell of {self.cell} m")
        cells = float(np.prod(np.ceil(extent / self.cell - 1e-9)))
        if cells > 4_000_000:
            raise ValueError(f"fluid grid: {cells:.3g} cells are more than 4 000 000; use a larger cell")
        return self


Schedule = tuple[Annotated[tuple[float, NonNegative], fixed_length(2)], ...]


class Emitter(Description):
    """A round nozzle from which a fluid flows."""

    name: Name = Field(description="name, which nothing else in the world has")
    fluid: Name = Field(description="name of the fluid that comes out")
    position: Vec3 = Field(description="centre of the mouth [m]")
    direction: Vec3 = Field(default=(0.0, 0.0, -1.0), description="direction of the flow; normalised when used")
    radius: Positive = Field(description="radius of the mouth [m]; half the slot's width in a plane")
    rate: NonNegative = Field(description="volume per time [m^3/s]; per metre of thickness in a plane [m^2/s]")
    start: NonNegative = Field(default=0.0, description="begins at [s]")
    end: Positive | None = Field(default=None, description="stops at [s]; default: never")
    schedule: Schedule = Field(
        default=(), max_length=256, description="(time [s], factor on the rate) pairs, linear between; default: 1"
    )


class Drain(Description):
    """A box in which fluid vanishes, no faster than `rate`."""

    name: Name = Field(description="name, which nothing else in the world has")
    lower: Vec3 = Field(description="lower corner [m]")
    upper: Vec3 = Field(description="upper corner [m]")
    rate: NonNegative | None = Field(default=None, description="volume per time [m^3/s]; default: all that comes")
    start: NonNegative = Field(default=0.0, description="begins at [s]")
    end: Positive | None = Field(default=None, description="stops at [s]; default: never")
    schedule: Schedule = Field(
        default=(), max_length=256, description="(time [s], factor on the rate) pairs, linear between"
    )


class Container(Description):
    """A box of space whose content is measured: at rest, or carried along by a rigid object."""

    name: Name = Field(description="name, which nothing else in the world has")
    lower: Vec3 = Field(description="lower corner at the start, world axes [m]")
    upper: Vec3 = Field(description="upper corner at the start, world axes [m]")
    object: Name | None = Field(default=None, description="rigid object it moves with; default: none, it stays")

    @model_validator(mode="after")
    def _has_volume(self) -> Self:
        if min(np.subtract(self.upper, self.lower)) <= 0:
            raise ValueError(f"container {self.name!r}: upper must exceed lower along every axis")
        return self
