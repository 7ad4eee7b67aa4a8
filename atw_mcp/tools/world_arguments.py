"""Arguments that describe parts of a world, in the words of an agent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter

from atw_mcp.building import Given, hull_vertices
from polyworld.description import Appearance
from polyworld.shapes import BodyShape, ConvexMesh, TriangleMesh, Wall
from polyworld.world import Effect, MotionPlane, StaticObject

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,63}$")]
Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Pixel = Annotated[list[float], Field(min_length=2, max_length=2)]
Length = Annotated[float, Field(gt=0, le=1e4)]
CaseId = Annotated[str, Field(description="case id, as OpenCase returned it")]
Patience = Annotated[
    float,
    Field(ge=0, le=3600, description="seconds to wait for the result before it is returned as still running"),
]
Meshes = Callable[[str], tuple[NDArray[np.float64], NDArray[np.int64]]]
_BODY_SHAPE: TypeAdapter[Any] = TypeAdapter(BodyShape)


class Argument(BaseModel):
    """Base of structured arguments: closed to unknown fields, finite numbers only."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class ShapeArgument(Argument):
    """A solid shape. sphere: radius; box: half_extents; cylinder and capsule (upright): radius, half_height;
    convex_mesh: vertices; mesh: the id of an imported mesh, of which a moving object takes the convex hull."""

    kind: Literal["sphere", "box", "cylinder", "capsule", "convex_mesh", "mesh"]
    radius: Length | None = Field(default=None, description="[m]")
    half_height: Length | None = Field(default=None, description="half the length along z [m]")
    half_extents: Annotated[list[Length], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="half the edge lengths x, y, z [m]"
    )
    vertices: Annotated[list[Point], Field(min_length=4, max_length=256)] | None = Field(
        default=None, description="points whose convex hull is the shape [m]"
    )

    mesh: str | None = Field(default=None, max_length=64, description="id, as ImportObservation returned it")

    def to_shape(self, meshes: Meshes) -> Any:
        """The engine's shape; raises ValueError naming what is missing. meshes: vertices and faces by id."""
        if self.kind == "mesh":
            return ConvexMesh(vertices=hull_vertices(self._mesh(meshes)[0]))
        return _BODY_SHAPE.validate_python(self.model_dump(exclude_none=True))

    def to_static_shape(self, meshes: Meshes) -> Any:
        """The same for something that does not move, which may be any triangle mesh."""
        if self.kind != "mesh":
            return self.to_shape(meshes)
        vertices, faces = self._mesh(meshes)
        return TriangleMesh.model_validate({"vertices": vertices.tolist(), "faces": faces.tolist()})

    def _mesh(self, meshes: Meshes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        if self.mesh is None:
            raise ValueError("a shape of kind mesh needs mesh: the id of an imported mesh")
        return meshes(self.mesh)


class ObjectArgument(Argument):
    """What is known about one object and was not observed, or was observed wrongly."""

    name: str = Field(min_length=1, max_length=64, description="its track's name")
    shape: ShapeArgument | None = Field(default=None, description="instead of the observed shape and size")
    mass: float | None = Field(default=None, gt=0, le=1e9, description="[kg]")
    density: float | None = Field(default=None, gt=0, le=1e6, description="[kg/m^3], where mass is not given")
    friction: float | None = Field(default=None, ge=0, le=10, description="Coulomb coefficient")
    restitution: float | None = Field(default=None, ge=0, le=1, description="coefficient of restitution")
    rolling_resistance: float | None = Field(default=None, ge=0, le=10, description="lever arm [m]")
    linear_damping: float | None = Field(default=None, ge=0, le=1000, description="[1/s]")
    angular_damping: float | None = Field(default=None, ge=0, le=1000, description="[1/s]")
    color: str | None = Field(default=None, max_length=32)
    material: str | None = Field(default=None, max_length=32)

    def to_given(self, meshes: Meshes) -> Given:
        """The same for the builder."""
        fields = self.model_dump(exclude={"name", "shape"})
        return Given(shape=None if self.shape is None else self.shape.to_shape(meshes), **fields)


class WallArgument(Argument):
    """An upright wall between two points on the floor."""

    name: Name
    start: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(description="x, y of one end [m]")
    end: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(description="x, y of the other end [m]")
    height: Length = Field(default=1.0, description="[m]")
    thickness: Length = Field(default=0.02, description="[m]")
    friction: float | None = Field(default=None, ge=0, le=10)
    restitution: float | None = Field(default=None, ge=0, le=1)

    def to_static(self, floor: float) -> StaticObject:
        """The engine's wall, standing on the floor."""
        return StaticObject(
            name=self.name,
            shape=Wall(
                start=(self.start[0], self.start[1], floor),
                end=(self.end[0], self.end[1], floor),
                height=self.height,
                thickness=self.thickness,
            ),
            friction=self.friction,
            restitution=self.restitution,
        )


class ObstacleArgument(Argument):
    """Something solid that does not move."""

    name: Name
    shape: ShapeArgument
    position: Point = Field(description="x, y, z of its centre [m]")
    orientation: Annotated[list[float], Field(min_length=4, max_length=4)] | None = Field(
        default=None, description="quaternion w, x, y, z"
    )
    color: str | None = Field(default=None, max_length=32)
    friction: float | None = Field(default=None, ge=0, le=10)
    restitution: float | None = Field(default=None, ge=0, le=1)

    def to_static(self, meshes: Meshes) -> StaticObject:
        """The engine's static object."""
        values: dict[str, Any] = {} if self.orientation is None else {"orientation": tuple(self.orientation)}
        return StaticObject(
            name=self.name,
            shape=self.shape.to_static_shape(meshes),
            appearance=Appearance(color=self.color),
            position=(self.position[0], self.position[1], self.position[2]),
            friction=self.friction,
            restitution=self.restitution,
            **values,
        )


class EffectArgument(Argument):
    """A law beyond gravity, contact and damping."""

    name: Name
    kind: str = Field(max_length=64, description="linear_drag, quadratic_drag, magnus_lift, uniform_acceleration, ...")
    parameters: dict[str, float] = Field(default_factory=dict, description="values by parameter name, SI")
    objects: list[str] | None = Field(default=None, max_length=64, description="objects it acts on; default: all")

    def to_effect(self) -> Effect:
        """The engine's effect; raises ValueError naming the kinds there are."""
        return Effect(
            name=self.name,
            kind=self.kind,
            parameters=self.parameters,
            objects=None if self.objects is None else tuple(self.objects),
        )


class PlaneArgument(Argument):
    """The plane in which planar objects move, where it is not the floor."""

    point: Point = Field(description="a point of the plane [m]")
    normal: Point = Field(description="its normal; (0,-1,0) for motion seen from the side along +y")
    supports: bool = Field(default=False, description="whether objects rest on it")

    def to_plane(self) -> MotionPlane:
        """The engine's plane; raises ValueError for a zero normal."""
        if not any(self.normal):
            raise ValueError("the normal of motion_plane must not be zero")
        (px, py, pz), (nx, ny, nz) = self.point, self.normal
        return MotionPlane(point=(px, py, pz), normal=(nx, ny, nz), supports=self.supports)


class ParameterArgument(Argument):
    """A parameter to search in given bounds, to tie across objects, or to keep fixed."""

    paths: Annotated[list[Annotated[str, Field(max_length=200)]], Field(min_length=1, max_length=64)] = Field(
        description="one or several parameter paths that share one value, e.g. objects.red.friction, "
        "environment.gravity.z, time.seconds_per_frame"
    )
    lower: float | None = Field(default=None, description="lower bound of the search")
    upper: float | None = Field(default=None, description="upper bound of the search")
    prior_mean: float | None = Field(default=None, description="a Gaussian prior's mean")
    prior_sd: float | None = Field(default=None, gt=0, description="and its standard deviation")
    fixed: bool = Field(default=False, description="keep the world's own value instead of searching")
