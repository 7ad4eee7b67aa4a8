"""Soft bodies: elastic solids that may yield."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, field_validator

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
    unit_quaternion,
)
from polyworld.world.representations.cloth import SurfaceMesh
from polyworld.world.shapes import Box, Capsule, ConvexMesh, Cylinder, Sphere


class Soft(Description):
    """An elastic solid of quadratic tetrahedra: any deformation, inverted elements included, has finite energy.

    `shape` is its form without forces, in body axes about `position`; a closed surface mesh is filled with
    tetrahedra. soft_planar is a slice of `thickness` that stays in environment.motion_plane (plane stress): its
    outline is what a plane through `position`, parallel to that one, cuts out of `shape`.
    """

    name: Name = Field(description="name, which nothing else in the world has")
    representation: Literal["soft", "soft_planar"] = Field(
        default="soft", description="soft_planar deforms in environment.motion_plane only (plane stress)"
    )
    shape: Annotated[Sphere | Box | Cylinder | Capsule | ConvexMesh | SurfaceMesh, Field(discriminator="kind")] = Field(
        description="form and size without forces"
    )
    resolution: Positive | None = Field(
        default=None,
        description="edge length of the elements, which have nodes halfway too [m]; default: a third of its smallest "
        "extent, which bends within about 1% of the truth",
    )
    thickness: Positive = Field(default=0.1, description="of a soft_planar slice, across the plane [m]")
    density: Positive = Field(default=1000.0, description="density [kg/m^3]")
    youngs_modulus: Positive = Field(default=1e5, description="Young's modulus E [Pa]")
    poisson_ratio: float = Field(default=0.4, ge=0.0, le=0.49, description="Poisson ratio nu [1]")
    damping: NonNegative = Field(default=0.0, description="time tau in stress = C (strain + tau strain rate) [s]")
    linear_damping: NonNegative = Field(default=0.0, description="rate c of dv/dt = -c v [1/s]")
    yield_stress: Positive | None = Field(
        default=None, description="von Mises stress beyond which it flows [Pa]; default: never, it is elastic"
    )
    friction: NonNegative = Field(default=0.5, description="Coulomb friction coefficient [1]")
    restitution: float = Field(default=0.0, ge=0.0, le=1.0, description="coefficient of restitution of its surface [1]")
    position: Vec3 = Field(description="where the shape's origin is at start_time [m]")
    orientation: Quaternion = Field(default=IDENTITY, description="unit quaternion w, x, y, z at start_time")
    velocity: Vec3 = Field(default=ORIGIN, description="velocity at start_time [m/s]")
    angular_velocity: Vec3 = Field(default=ORIGIN, description="angular velocity, world axes, at start_time [rad/s]")
    start_time: NonNegative = Field(default=0.0, description="time at which it joins the simulation [s]")
    appearance: Appearance = Appearance()

    @field_validator("orientation")
    @classmethod
    def _unit(cls, value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        return unit_quaternion(value)
