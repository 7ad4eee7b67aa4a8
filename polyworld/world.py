"""The world description: what exists, where it starts, and which laws move it.

A `World` is an immutable pydantic model. Its identity is the SHA-256 of its canonical JSON, so two
worlds with equal content have equal ids wherever they were made. SI units; z is up; quaternions are
(w, x, y, z) and rotate body axes into world axes.
"""

from __future__ import annotations

import hashlib
import json
from functools import cached_property
from typing import Annotated, Any, Literal, Self

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, WithJsonSchema, field_validator, model_validator

from polyworld.camera import Camera
from polyworld.effects import check_effect


def _fixed_length(count: int) -> WithJsonSchema:
    # JSON-schema tuples (prefixItems) are refused by some MCP clients; a fixed-length list is not.
    return WithJsonSchema({"type": "array", "items": {"type": "number"}, "minItems": count, "maxItems": count})


Vec3 = Annotated[tuple[float, float, float], _fixed_length(3)]
Quaternion = Annotated[tuple[float, float, float, float], _fixed_length(4)]
Name = Annotated[str, Field(min_length=1, max_length=64, pattern=r"^[A-Za-z0-9][A-Za-z0-9_\-]*$")]
Positive = Annotated[float, Field(gt=0.0)]
NonNegative = Annotated[float, Field(ge=0.0)]

IDENTITY: tuple[float, float, float, float] = (1.0, 0.0, 0.0, 0.0)
ORIGIN: tuple[float, float, float] = (0.0, 0.0, 0.0)


class Description(BaseModel):
    """Base of every part of a world: frozen, closed to unknown fields, finite numbers only."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


# --- shapes ------------------------------------------------------------------------------------


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
    faces: tuple[Annotated[tuple[int, int, int], _fixed_length(3)], ...] = Field(
        min_length=1, max_length=200_000, description="vertex indices, counter-clockwise seen from outside"
    )

    @model_validator(mode="after")
    def _indices_in_range(self) -> Self:
        faces = np.asarray(self.faces)
        if faces.min() < 0 or faces.max() >= len(self.vertices):
            raise ValueError(f"face indices must lie in 0..{len(self.vertices) - 1}")
        return self


BodyShape = Annotated[Sphere | Box | Cylinder | Capsule | ConvexMesh, Field(discriminator="kind")]
StaticShape = Annotated[
    Sphere | Box | Cylinder | Capsule | ConvexMesh | Plane | Wall | TriangleMesh, Field(discriminator="kind")
]


# --- objects -----------------------------------------------------------------------------------


class Appearance(Description):
    """How an object looks; used to draw it and to refer to it, never by the physics."""

    color: str | None = Field(default=None, max_length=32, description="colour name, or #rrggbb")
    material: str | None = Field(default=None, max_length=32, description="e.g. metal, rubber")


class RigidObject(Description):
    """A rigid body: shape, contact and damping parameters, and its state when it enters the simulation."""

    name: Name
    representation: Literal["rigid_planar", "rigid_spatial"] = Field(
        default="rigid_spatial",
        description="rigid_planar moves in environment.motion_plane with three degrees of freedom; "
        "rigid_spatial has six",
    )
    shape: BodyShape
    appearance: Appearance = Appearance()
    density: Positive = Field(default=1000.0, description="density [kg/m^3]; used when mass is not given")
    mass: Positive | None = Field(default=None, description="mass [kg]; default density times volume")
    friction: NonNegative = Field(default=0.5, description="Coulomb friction coefficient [1]")
    restitution: float = Field(default=0.5, ge=0.0, le=1.0, description="coefficient of restitution [1]")
    rolling_resistance: NonNegative = Field(
        default=0.0, description="lever arm b of the rolling-resistance moment M = b N [m]"
    )
    torsional_radius: NonNegative | None = Field(
        default=None,
        description="radius r of the contact patch in the spinning-friction moment M = mu N r [m]; default: "
        "0 in spatial worlds, the mean radius of the footprint in planar worlds (0 for spheres)",
    )
    linear_damping: NonNegative = Field(default=0.0, description="rate of dv/dt = -c v [1/s]")
    angular_damping: NonNegative = Field(default=0.0, description="rate of domega/dt = -c omega [1/s]")
    position: Vec3 = Field(description="centre of mass at start_time [m]")
    orientation: Quaternion = Field(default=IDENTITY, description="unit quaternion w, x, y, z at start_time")
    velocity: Vec3 = Field(default=ORIGIN, description="velocity of the centre of mass at start_time [m/s]")
    angular_velocity: Vec3 = Field(default=ORIGIN, description="angular velocity, world axes, at start_time [rad/s]")
    start_time: NonNegative = Field(
        default=0.0, description="time at which the object joins the simulation in the given state [s]"
    )

    @field_validator("orientation")
    @classmethod
    def _unit(cls, value: tuple[float, float, float, float]) -> Any:
        norm = float(np.linalg.norm(value))
        if norm < 1e-9:
            raise ValueError("orientation must not be the zero quaternion")
        if abs(norm - 1.0) < 1e-12:  # already unit: keep the bytes, so that the hash survives a round trip
            return value
        return tuple(float(v / norm) for v in value)


class StaticObject(Description):
    """Something that does not move: floor, wall, obstacle."""

    name: Name
    shape: StaticShape
    appearance: Appearance = Appearance()
    position: Vec3 = ORIGIN
    orientation: Quaternion = IDENTITY
    friction: NonNegative | None = Field(
        default=None, description="Coulomb coefficient [1]; default: the touching object's own"
    )
    restitution: float | None = Field(
        default=None, ge=0.0, le=1.0, description="restitution [1]; default: the touching object's own"
    )


class Effect(Description):
    """A named law acting beyond the base model; see `polyworld.effects.CATALOGUE`."""

    name: Name
    kind: str = Field(description="name of a law in the catalogue")
    parameters: dict[str, float] = Field(default_factory=dict, description="values by parameter name, SI")
    objects: tuple[Name, ...] | None = Field(default=None, description="objects it acts on; default: all")
    enabled: bool = True


class Hinge(Description):
    """Lets an object turn about a point: of the world, or of another object, which then moves with it.

    Frictionless. The axis is the motion plane's normal. Each object is held at that point of it which lies at
    the anchor at the start, inside its shape or not. Objects joined by a hinge do not collide with each other.
    Velocities at the start that would pull the hinge apart are taken up by it at once, as a blow.
    """

    kind: Literal["hinge"] = "hinge"
    name: Name
    object: Name = Field(description="name of the object that turns")
    other: Name | None = Field(default=None, description="name of the object it turns on; default: the world")
    anchor: Vec3 = Field(description="the pivot at the objects' start_time, world axes [m]")


class MotionPlane(Description):
    """The plane in which planar objects move.

    Where gravity presses objects onto it (gravity · normal < 0) and `supports` is true, it is also the
    surface they slide on.
    """

    point: Vec3 = ORIGIN
    normal: Vec3 = (0.0, 0.0, 1.0)
    supports: bool = True
    friction: NonNegative | None = Field(
        default=None, description="Coulomb coefficient of the plane [1]; default: the object's own"
    )


class Environment(Description):
    """What acts on every object."""

    gravity: Vec3 = Field(default=(0.0, 0.0, -9.81), description="gravitational acceleration [m/s^2]")
    motion_plane: MotionPlane = MotionPlane()


class TimeBase(Description):
    """How frames of the observation map to seconds, and how finely the engine steps.

    The frame rate written in a video file says nothing certain about physical time: give or fit
    `seconds_per_frame`.
    """

    seconds_per_frame: Positive = Field(default=0.04, description="physical time between frames [s]")
    frame_count: int = Field(default=0, ge=0, description="number of observed frames; 0 where there are none")
    substep: float = Field(default=0.002, gt=0.0, le=0.05, description="longest integration step [s]")


class Region(Description):
    """An axis-aligned box of space; entry and exit events refer to it when the world has no camera."""

    lower: Vec3
    upper: Vec3


class World(Description):
    """An executable world."""

    objects: tuple[RigidObject, ...] = Field(default=(), max_length=256)
    statics: tuple[StaticObject, ...] = Field(default=(), max_length=256)
    environment: Environment = Environment()
    effects: tuple[Effect, ...] = Field(default=(), max_length=64)
    joints: tuple[Hinge, ...] = Field(default=(), max_length=256, description="hinges; in planar worlds only")
    time: TimeBase = TimeBase()
    camera: Camera | None = Field(default=None, description="camera that observed the world; defines the view")
    region: Region | None = Field(default=None, description="region for entry and exit events without a camera")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        names = [o.name for o in self.objects] + [s.name for s in self.statics]
        repeated = sorted({n for n in names if names.count(n) > 1})
        if repeated:
            raise ValueError(f"names of objects and statics must be unique; repeated: {repeated}")
        kinds = {o.representation for o in self.objects}
        if len(kinds) > 1:
            raise ValueError(
                "rigid_planar and rigid_spatial objects cannot share one world yet: "
                "give every object the same representation"
            )
        if kinds == {"rigid_planar"}:
            meshes = [s.name for s in self.statics if s.shape.kind == "triangle_mesh"]
            if meshes:
                raise ValueError(
                    f"planar worlds take planes, walls and convex statics, not triangle meshes: {meshes}; "
                    "use rigid_spatial objects instead"
                )
        known = {o.name for o in self.objects}
        effect_names = [e.name for e in self.effects]
        if len(set(effect_names)) < len(effect_names):
            raise ValueError(f"effect names must be unique, got {effect_names}")
        for effect in self.effects:
            unknown = sorted(set(effect.objects or ()) - known)
            if unknown:
                raise ValueError(f"effect {effect.name!r} names unknown objects {unknown}; objects: {sorted(known)}")
            check_effect(effect.name, effect.kind, effect.parameters)
        self._check_joints()
        return self

    def _check_joints(self) -> None:
        names = [j.name for j in self.joints]
        if len(set(names)) < len(names):
            raise ValueError(f"joint names must be unique, got {names}")
        starts = {o.name: o.start_time for o in self.objects}
        for joint in self.joints:
            ends = [joint.object] + ([joint.other] if joint.other is not None else [])
            unknown = sorted(set(ends) - set(starts))
            if unknown:
                raise ValueError(
                    f"joint {joint.name!r} names unknown objects {unknown}; objects: {sorted(starts)}; "
                    "to hang an object on the world or on a static, leave `other` out"
                )
            if joint.object == joint.other:
                raise ValueError(f"joint {joint.name!r} joins {joint.object!r} to itself")
            if len({starts[name] for name in ends}) > 1:
                raise ValueError(
                    f"joint {joint.name!r} joins objects of different start_time: "
                    f"{ {name: starts[name] for name in ends} }; give both the same"
                )
        if self.joints and not self.planar:
            raise ValueError(
                f"joints act in planar worlds so far: {names}; make the objects rigid_planar, or leave the joints out"
            )

    @cached_property
    def id(self) -> str:
        """`world-` and the first 16 hex digits of the SHA-256 of the canonical JSON."""
        return "world-" + hashlib.sha256(self.canonical_json().encode()).hexdigest()[:16]

    def canonical_json(self) -> str:
        """The world as JSON with sorted keys and no spaces: equal worlds give equal bytes."""
        content = self.model_dump(mode="json")
        if not self.joints:  # a world without joints keeps the id it had before there were any
            del content["joints"]
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)

    @property
    def planar(self) -> bool:
        """Whether the objects move in `environment.motion_plane`."""
        return bool(self.objects) and self.objects[0].representation == "rigid_planar"

    def object(self, name: str) -> RigidObject:
        """The object called `name`; raises KeyError naming the valid choices."""
        for candidate in self.objects:
            if candidate.name == name:
                return candidate
        raise KeyError(f"unknown object {name!r}; objects: {[o.name for o in self.objects]}")
