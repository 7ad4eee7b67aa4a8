"""Arguments that describe parts of a world, in the words of an agent."""

from __future__ import annotations

from collections.abc import Callable
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, TypeAdapter, WithJsonSchema

from atw_mcp.worlds.building import Given
from atw_mcp.worlds.heights import hull_vertices
from atw_mcp.worlds.parts import parts_schema
from polyworld.effects import CATALOGUE
from polyworld.world import Effect, MotionPlane, StaticObject
from polyworld.world.description import Appearance
from polyworld.world.geometry import quaternion_matrix
from polyworld.world.shapes import BodyShape, Box, Compound, ConvexMesh, Part, TriangleMesh, Wall

Name = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,63}$")]
Point = Annotated[list[float], Field(min_length=3, max_length=3)]
Pixel = Annotated[list[float], Field(min_length=2, max_length=2)]
Length = Annotated[float, Field(gt=0, le=1e4)]
CaseId = Annotated[str, Field(description="case id")]
Patience = Annotated[
    float,
    Field(
        ge=0,
        le=3600,
        description="longest wait for the result [s]; after it the status is running and ReadEvidence returns the "
        "result",
    ),
]
Meshes = Callable[[str], tuple[NDArray[np.float64], NDArray[np.int64]]]
PartArgument = Annotated[Any, WithJsonSchema(parts_schema())]
_BODY_SHAPE: TypeAdapter[Any] = TypeAdapter(BodyShape)


class Argument(BaseModel):
    """Base of structured arguments: closed to unknown fields, finite numbers only."""

    model_config = ConfigDict(extra="forbid", allow_inf_nan=False)


class ShapeArgument(Argument):
    """A solid shape. sphere: radius; box: half_extents; cylinder and capsule (upright): radius, half_height;
    convex_mesh: vertices; mesh: the id of an imported mesh, of which a moving object takes the convex hull; open_box:
    half_extents and thickness, a bucket or tank open at the top, of five walls."""

    kind: Literal["sphere", "box", "cylinder", "capsule", "convex_mesh", "mesh", "open_box"] = Field(
        description="form of the solid"
    )
    radius: Length | None = Field(default=None, description="[m]")
    half_height: Length | None = Field(default=None, description="half the length along z [m]")
    half_extents: Annotated[list[Length], Field(min_length=3, max_length=3)] | None = Field(
        default=None, description="half the edge lengths x, y, z [m]"
    )
    vertices: Annotated[list[Point], Field(min_length=4, max_length=256)] | None = Field(
        default=None, description="points whose convex hull is the shape [m]"
    )
    thickness: Length | None = Field(default=None, description="of the walls of an open_box [m]")
    mesh: str | None = Field(default=None, max_length=64, description="id, as ImportObservation returned it")

    def to_shape(self, meshes: Meshes) -> Any:
        """The engine's shape; raises ValueError naming what is missing. meshes: vertices and faces by id."""
        if self.kind == "mesh":
            return ConvexMesh(vertices=hull_vertices(self._mesh(meshes)[0]))
        if self.kind == "open_box":
            return Compound(parts=tuple(part for _, part in self.walls()))
        return _BODY_SHAPE.validate_python(self.model_dump(exclude_none=True))

    def to_static_shape(self, meshes: Meshes) -> Any:
        """The same for something that does not move, which may be any triangle mesh."""
        if self.kind != "mesh":
            return self.to_shape(meshes)
        vertices, faces = self._mesh(meshes)
        return TriangleMesh.model_validate({"vertices": vertices.tolist(), "faces": faces.tolist()})

    def walls(self) -> list[tuple[str, Part]]:
        """The bottom and the four sides of an open_box, named, about the middle of the whole box."""
        if self.half_extents is None or self.thickness is None:
            raise ValueError("an open_box needs half_extents (its outer size) and thickness of its walls")
        x, y, z = self.half_extents
        t = self.thickness / 2
        if 2 * self.thickness >= 2 * min(x, y) or self.thickness >= 2 * z:
            raise ValueError(f"an open_box of half_extents {self.half_extents} has no room inside walls of {2 * t:g} m")
        high = z - t  # half the height of the sides, which stand on the bottom
        found = {
            "bottom": ((x, y, t), (0.0, 0.0, -z + t)),
            "left": ((t, y, high), (-x + t, 0.0, t)),
            "right": ((t, y, high), (x - t, 0.0, t)),
            "front": ((x - 2 * t, t, high), (0.0, -y + t, t)),
            "back": ((x - 2 * t, t, high), (0.0, y - t, t)),
        }
        return [(name, Part(shape=Box(half_extents=half), position=place)) for name, (half, place) in found.items()]

    def _mesh(self, meshes: Meshes) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
        if self.mesh is None:
            raise ValueError("a shape of kind mesh needs mesh: the id of an imported mesh")
        return meshes(self.mesh)


class PieceArgument(ShapeArgument):
    """A convex piece of a compound shape."""

    position: Point = Field(default=[0.0, 0.0, 0.0], description="of the piece in the body's axes [m]")
    orientation: Annotated[list[float], Field(min_length=4, max_length=4)] | None = Field(
        default=None, description="quaternion w, x, y, z"
    )


class ObjectArgument(Argument):
    """Known facts about one rigid object that were not observed, or observed wrongly. One that was not observed
    at all needs shape (or pieces) and position."""

    name: str = Field(min_length=1, max_length=64, description="its track's name, or a new one")
    shape: ShapeArgument | None = Field(default=None, description="instead of the observed shape and size")
    pieces: list[PieceArgument] | None = Field(
        default=None, min_length=1, max_length=64, description="instead of shape: convex pieces that move as one"
    )
    mass: float | None = Field(default=None, gt=0, le=1e9, description="[kg]")
    density: float | None = Field(default=None, gt=0, le=1e6, description="[kg/m^3], where mass is not given")
    friction: float | None = Field(default=None, ge=0, le=10, description="Coulomb coefficient")
    restitution: float | None = Field(default=None, ge=0, le=1, description="coefficient of restitution")
    rolling_resistance: float | None = Field(default=None, ge=0, le=10, description="lever arm [m]")
    linear_damping: float | None = Field(default=None, ge=0, le=1000, description="[1/s]")
    angular_damping: float | None = Field(default=None, ge=0, le=1000, description="[1/s]")
    color: str | None = Field(default=None, max_length=32, description="colour name, or #rrggbb")
    material: str | None = Field(default=None, max_length=32, description="e.g. metal, rubber")
    position: Point | None = Field(default=None, description="centre of mass, of an object without a track [m]")
    orientation: Annotated[list[float], Field(min_length=4, max_length=4)] | None = Field(
        default=None, description="quaternion w, x, y, z"
    )
    velocity: Point | None = Field(default=None, description="[m/s]; a track has its own")
    angular_velocity: Point | None = Field(default=None, description="[rad/s]")

    def to_given(self, meshes: Meshes) -> Given:
        """The same for the builder."""
        if self.shape is not None and self.pieces is not None:
            raise ValueError(f"object {self.name!r}: give shape or pieces, not both")
        shape = None if self.shape is None else self.shape.to_shape(meshes)
        if self.pieces is not None:
            shape = Compound(parts=tuple(_part(piece, meshes) for piece in self.pieces))
        state = ("position", "orientation", "velocity", "angular_velocity")
        fields = self.model_dump(exclude={"name", "shape", "pieces", *state})
        return Given(shape=shape, **fields, **{key: _tuple(getattr(self, key)) for key in state})


def _part(piece: PieceArgument, meshes: Meshes) -> Part:
    if piece.kind == "open_box":
        raise ValueError("an open_box has pieces itself: give it as shape, or its five walls as boxes")
    turn = {} if piece.orientation is None else {"orientation": tuple(piece.orientation)}
    plain = ShapeArgument.model_validate(piece.model_dump(exclude={"position", "orientation"}))
    return Part.model_validate({"shape": plain.to_shape(meshes), "position": tuple(piece.position), **turn})


def _tuple(values: list[float] | None) -> Any:
    return None if values is None else tuple(values)


class WallArgument(Argument):
    """An upright wall between two points on the floor."""

    name: Name = Field(description="its name in the world")
    start: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(description="x, y of one end [m]")
    end: Annotated[list[float], Field(min_length=2, max_length=2)] = Field(description="x, y of the other end [m]")
    height: Length = Field(default=1.0, description="[m]")
    thickness: Length = Field(default=0.02, description="[m]")
    friction: float | None = Field(default=None, ge=0, le=10, description="Coulomb coefficient; default: the object's")
    restitution: float | None = Field(default=None, ge=0, le=1, description="coefficient; default: the object's")

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

    name: Name = Field(description="its name in the world")
    shape: ShapeArgument = Field(description="its shape and size")
    position: Point = Field(description="x, y, z of its centre [m]")
    orientation: Annotated[list[float], Field(min_length=4, max_length=4)] | None = Field(
        default=None, description="quaternion w, x, y, z"
    )
    color: str | None = Field(default=None, max_length=32, description="colour name, or #rrggbb")
    friction: float | None = Field(default=None, ge=0, le=10, description="Coulomb coefficient; default: the object's")
    restitution: float | None = Field(default=None, ge=0, le=1, description="coefficient; default: the object's")

    def to_statics(self, meshes: Meshes) -> list[StaticObject]:
        """The engine's static objects: one, or the five walls of an open_box."""
        turn = (1.0, 0.0, 0.0, 0.0) if self.orientation is None else tuple(self.orientation)
        if self.shape.kind != "open_box":
            return [self._static(self.name, self.shape.to_static_shape(meshes), np.asarray(self.position), turn)]
        matrix = quaternion_matrix(np.asarray(turn) / np.linalg.norm(turn))
        return [
            self._static(f"{self.name}_{side}", wall.shape, np.asarray(self.position) + matrix @ wall.position, turn)
            for side, wall in self.shape.walls()
        ]

    def _static(self, name: str, shape: Any, position: NDArray[np.float64], turn: tuple[float, ...]) -> StaticObject:
        return StaticObject.model_validate(
            {
                "name": name,
                "shape": shape,
                "appearance": Appearance(color=self.color),
                "position": tuple(float(v) for v in position),
                "friction": self.friction,
                "restitution": self.restitution,
                "orientation": turn,
            }
        )


class EffectArgument(Argument):
    """A law beyond gravity, contact and damping."""

    name: Name = Field(description="its name in the world")
    kind: str = Field(max_length=64, description=f"expression, or a law of the catalogue: {', '.join(CATALOGUE)}")
    parameters: dict[str, float] = Field(default_factory=dict, description="values by parameter name, SI")
    objects: list[str] | None = Field(default=None, max_length=64, description="objects it acts on; default: all")
    expression: Annotated[str, Field(max_length=2000)] | None = Field(
        default=None,
        description="kind expression: an acceleration [m/s^2] such as '-k*speed*v', made of vectors v, x, omega, g, "
        "ex, ey, ez, numbers speed, spin, t, contact, mass, radius, vx, x.., parameters, + - * / ^ and sin cos exp log "
        "sqrt abs tanh min max step dot cross norm unit",
    )
    parameter_units: dict[str, str] = Field(
        default_factory=dict, description="of an expression's parameters, e.g. {'k': '1/m'}; default: 1"
    )
    parameter_bounds: dict[str, Annotated[list[float], Field(min_length=2, max_length=2)]] = Field(
        default_factory=dict, description="least and greatest value of an expression's parameters"
    )

    def to_effect(self) -> Effect:
        """The engine's effect; raises ValueError naming the kinds there are."""
        return Effect(
            name=self.name,
            kind=self.kind,
            parameters=self.parameters,
            objects=None if self.objects is None else tuple(self.objects),
            expression=self.expression,
            parameter_units=self.parameter_units,
            parameter_bounds={name: (low, high) for name, (low, high) in self.parameter_bounds.items()},
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
