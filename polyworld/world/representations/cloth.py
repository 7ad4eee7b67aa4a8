"""Cloth: thin elastic sheets of triangles."""

from __future__ import annotations

from typing import Annotated, Literal, Self

import numpy as np
from pydantic import Field, model_validator

from polyworld.world.description import ORIGIN, Appearance, Description, Name, NonNegative, Positive, Vec3, fixed_length


class Sheet(Description):
    """A flat parallelogram, divided into a regular grid of triangles."""

    kind: Literal["sheet"] = "sheet"
    corner: Vec3 = Field(description="one corner [m]")
    edge_u: Vec3 = Field(description="vector along one edge, its length the edge's [m]")
    edge_v: Vec3 = Field(description="vector along the other edge [m]")
    divisions: Annotated[tuple[int, int], fixed_length(2, "integer")] = Field(
        default=(20, 20),
        description="number of divisions nu, nv along u and v; node i (nv + 1) + j is i along u and j along v",
    )

    @model_validator(mode="after")
    def _has_area(self) -> Self:
        if np.linalg.norm(np.cross(self.edge_u, self.edge_v)) < 1e-12:
            raise ValueError("edge_u and edge_v must span an area")
        if min(self.divisions) < 1 or max(self.divisions) > 500:
            raise ValueError(f"divisions must lie in 1..500, got {self.divisions}")
        return self


class SurfaceMesh(Description):
    """A triangle mesh, given vertex by vertex."""

    kind: Literal["mesh"] = "mesh"
    vertices: tuple[Vec3, ...] = Field(min_length=3, max_length=100_000, description="vertices [m]")
    faces: tuple[Annotated[tuple[int, int, int], fixed_length(3, "integer")], ...] = Field(
        min_length=1, max_length=200_000, description="vertex indices of the triangles"
    )

    @model_validator(mode="after")
    def _indices_in_range(self) -> Self:
        faces = np.asarray(self.faces)
        if faces.min() < 0 or faces.max() >= len(self.vertices):
            raise ValueError(f"face indices must lie in 0..{len(self.vertices) - 1}")
        return self


class Cloth(Description):
    """A thin elastic sheet: resists stretching and shearing in its surface, and bending.

    For a homogeneous sheet of thickness t: stretch_stiffness = E t, bending_stiffness D = E t^3 / 12 (1 - nu^2); a
    woven fabric bends more easily than that. Force per width is proportional to extension at any stretch; a strip
    much longer than wide bends with D (1 - nu^2) per width. A shear_stiffness of its own is that between a sheet's
    edge_u and the direction across it (of a mesh: its longest extent). Its shape without forces is the initial
    one, flat where `flat_at_rest`.
    """

    name: Name = Field(description="name, which nothing else in the world has")
    representation: Literal["cloth"] = "cloth"
    geometry: Annotated[Sheet | SurfaceMesh, Field(discriminator="kind")] = Field(
        description="the cloth at rest: a sheet (a parallelogram in divisions) or a triangle mesh. Results depend "
        "on resolution: the lowest point of a ball dropped on one sheet moved by 4% of its fall from 12x12 to 20x20 "
        "divisions; refine until the answer no longer changes"
    )
    areal_density: Positive = Field(default=0.2, description="mass per area [kg/m^2]")
    thickness: Positive = Field(default=0.002, description="thickness, for contact [m]")
    stretch_stiffness: Positive = Field(default=500.0, description="E t: force per width and strain [N/m]")
    poisson_ratio: float = Field(default=0.3, ge=-0.9, le=0.49, description="Poisson ratio in the sheet [1]")
    shear_stiffness: Positive | None = Field(
        default=None, description="G t [N/m]; default E t / (2 (1 + nu)), that of an isotropic sheet"
    )
    bending_stiffness: NonNegative = Field(default=1e-5, description="D: moment per width and curvature [N m]")
    flat_at_rest: bool = Field(default=False, description="whether it is flat without forces")
    stretch_damping: NonNegative = Field(default=0.0, description="time tau in stress C (strain + tau strain rate) [s]")
    bending_damping: NonNegative = Field(default=0.0, description="time tau in moment D (kappa + tau kappa rate) [s]")
    linear_damping: NonNegative = Field(default=0.0, description="rate c of dv/dt = -c v [1/s]")
    drag_normal: NonNegative = Field(default=1.2, description="drag coefficient of flow across the sheet [1]")
    drag_tangential: NonNegative = Field(default=0.02, description="friction coefficient of flow along the sheet [1]")
    friction: NonNegative = Field(default=0.3, description="Coulomb friction coefficient [1]")
    restitution: float = Field(default=0.0, ge=0.0, le=1.0, description="coefficient of restitution [1]")
    self_contact: bool = Field(default=True, description="whether parts of it can touch each other")
    velocity: Vec3 = Field(default=ORIGIN, description="velocity of all of it at start_time [m/s]")
    start_time: NonNegative = Field(default=0.0, description="time at which it joins the simulation [s]")
    appearance: Appearance = Appearance()
