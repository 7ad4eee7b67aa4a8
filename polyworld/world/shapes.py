"""Shapes of bodies and statics."""

from __future__ import annotations

from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from polyworld.world.description import (
    IDENTITY,
    ORIGIN,
    Description,
    Positive,
    Quaternion,
    Vec3,
    fixed_length,
    unit_quaternion,
)


class Sphere(Description):
    """A ball."""

    kind: Literal["sphere"] = "sphere"
    radius: Positive = Field(description="radius [m]")


class Box(Description):
    """A rectangular box centred on the body origin."""

    kind: Literal["box"] = "box"
    half_extents: Vec3 = Field(description="half the edge lengths along body x, y, z [m]")

    @field_validator("half_extents")
    @classmethod
    def _positive(cls, value: tuple[float, float, float]) -> tuple[float, float, float]:
        if min(value) <= 0.0:
            raise ValueError(f"half_extents must all be positive, got {value}")
        return value


class Cylinder(Description):
    """A right circular cylinder about body z, centred on the body origin."""

    kind: Literal["cylinder"] = "cylinder"
    radius: Positive = Field(description="radius [m]")
    half_height: Positive = Field(description="half the length along body z [m]")


class Capsule(Description):
    """A cylinder about body z with half-spheres on both ends."""

    kind: Literal["capsule"] = "capsule"
    radius: Positive = Field(description="radius [m]")
    half_height: Positive = Field(description="half the distance between the two cap centres [m]")


class ConvexMesh(Description):
    """The convex hull of points; the body origin is moved to the hull's centre of mass."""

    kind: Literal["convex_mesh"] = "convex_mesh"
    vertices: tuple[Vec3, ...] = Field(
        min_length=4, max_length=256, description="points whose convex hull is the shape [m]"
    )

    @field_validator("vertices")
    @classmethod
    def _spans_a_volume(cls, value: tuple[tuple[float, float, float], ...]) -> Any:
        points = np.asarray(value, dtype=float)
        if np.linalg.matrix_rank(points - points.mean(axis=0), tol=1e-9) < 3:
            raise ValueError("vertices lie in one plane: a convex mesh needs four points that span a volume")
        return value


class Plane(Description):
    """A half space: points p with normal · p <= offset are solid. Static only."""

    kind: Literal["plane"] = "plane"
    normal: Vec3 = Field(default=(0.0, 0.0, 1.0), description="outward normal; normalised when used")
    offset: float = Field(default=0.0, description="distance of the surface from the origin along the normal [m]")


class Wall(Description):
    """An upright rectangular wall between two points on the floor. Static only."""

    kind: Literal["wall"] = "wall"
    start: Vec3 = Field(description="one end, at the wall's foot [m]")
    end: Vec3 = Field(description="the other end, at the wall's foot [m]")
    height: Positive = Field(default=1.0, description="height along z [m]")
    thickness: Positive = Field(default=0.02, description="thickness [m]")

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        if np.linalg.norm(np.subtract(self.end, self.start)) < 1e-9:
            raise ValueError("a wall's start and end must differ")
        return self


class TriangleMesh(Description):
    """A triangle mesh, not necessarily convex. Static only, and in spatial worlds only."""

    kind: Literal["triangle_mesh"] = "triangle_mesh"
    vertices: tuple[Vec3, ...] = Field(min_length=3, max_length=100_000, description="vertices [m]")
    faces: tuple[Annotated[tuple[int, int, int], fixed_length(3)], ...] = Field(
        min_length=1, max_length=200_000, description="vertex indices, counter-clockwise seen from outside"
    )

    @model_validator(mode="after")
    def _indices_in_range(self) -> Self:
        faces = np.asarray(self.faces)
        if faces.min() < 0 or faces.max() >= len(self.vertices):
            raise ValueError(f"face indices must lie in 0..{len(self.vertices) - 1}")
        return self


ConvexShape = Annotated[Sphere | Box | Cylinder | Capsule | ConvexMesh, Field(discriminator="kind")]


class Part(Description):
    """One convex piece of a compound shape, placed in the compound's axes."""

    shape: ConvexShape
    position: Vec3 = Field(default=ORIGIN, description="of the piece's origin [m]")
    orientation: Quaternion = Field(default=IDENTITY, description="unit quaternion w, x, y, z of the piece")

    @field_validator("orientation")
    @classmethod
    def _unit(cls, value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        return unit_quaternion(value)


class Compound(Description):
    """Several convex pieces that move as one: a bucket, a table, a dumbbell.

    Pieces should not overlap: mass is counted for each. The body origin is moved to the common centre of mass. A body
    that is not solid, or not of one density, states its centre of mass and its inertia.
    """

    kind: Literal["compound"] = "compound"
    parts: tuple[Part, ...] = Field(min_length=1, max_length=64)
    centre_of_mass: Vec3 | None = Field(
        default=None, description="in the compound's axes [m]; default: of solid pieces"
    )
    inertia: Annotated[tuple[float, ...], fixed_length(6)] | None = Field(
        default=None,
        description="xx, yy, zz, xy, xz, yz of the inertia tensor for 1 kg, about the centre of mass in the compound's "
        "axes [m^2]; default: of solid pieces",
    )

    @field_validator("inertia")
    @classmethod
    def _of_a_body(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is None:
            return None
        if len(value) != 6:
            raise ValueError(f"inertia takes six numbers, xx, yy, zz, xy, xz, yz; got {len(value)}")
        least, middle, most = np.linalg.eigvalsh(inertia_matrix(value))
        if least <= 0.0 or most > (least + middle) * (1.0 + 1e-6):
            raise ValueError(
                f"inertia has the principal moments {least:.6g}, {middle:.6g}, {most:.6g}: each must be positive and "
                "none exceed the sum of the others"
            )
        return value


def inertia_matrix(moments: tuple[float, ...]) -> NDArray[np.float64]:
    """Inertia tensor (3, 3) of its components xx, yy, zz, xy, xz, yz."""
    xx, yy, zz, xy, xz, yz = moments
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


BodyShape = Annotated[Sphere | Box | Cylinder | Capsule | ConvexMesh | Compound, Field(discriminator="kind")]
StaticShape = Annotated[
    Sphere | Box | Cylinder | Capsule | ConvexMesh | Plane | Wall | TriangleMesh, Field(discriminator="kind")
]
