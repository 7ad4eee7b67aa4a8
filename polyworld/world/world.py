"""The world description: what exists, where it starts, and which laws move it.

A `World` is an immutable pydantic model. Its identity is the SHA-256 of its canonical JSON, so two
worlds with equal content have equal ids wherever they were made. SI units; z is up; quaternions are
(w, x, y, z) and rotate body axes into world axes.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from functools import cached_property
from typing import Annotated, Any, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import (
    Field,
    SerializeAsAny,
    ValidatorFunctionWrapHandler,
    WrapValidator,
    field_validator,
    model_validator,
)

from polyworld.world import materials
from polyworld.world.camera import Camera
from polyworld.world.consistency import check_consistent
from polyworld.world.description import (
    IDENTITY,
    ORIGIN,
    Appearance,
    Description,
    Interval,
    Name,
    NonNegative,
    Positive,
    Quaternion,
    Vec3,
    fixed_length,
    unit_quaternion,
)
from polyworld.world.observer import Observer
from polyworld.world.plausible import check_plausible
from polyworld.world.representations.attachment import Attachment, Region
from polyworld.world.representations.cloth import Cloth
from polyworld.world.representations.fluid import Container, Drain, Emitter, Fluid, FluidGrid
from polyworld.world.representations.joint import Joint
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Pulley, Rope
from polyworld.world.representations.soft import Soft
from polyworld.world.shapes import StaticShape


class StaticObject(Description):
    """Something that does not move: floor, wall, obstacle."""

    name: Name = Field(description="name, which nothing else in the world has")
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
    dominant: bool = Field(
        default=False,
        description="whether its friction and restitution, where stated, are a contact's as they are; default: the "
        "geometric mean with the touching object's",
    )

    @field_validator("orientation")
    @classmethod
    def _unit(cls, value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        return unit_quaternion(value)


class Components(Description):
    """An acceleration written component by component along the world axes, each an expression."""

    x: str = "0"
    y: str = "0"
    z: str = "0"


class Effect(Description):
    """A named law acting beyond the base model; see `polyworld.effects.CATALOGUE` and `polyworld.expressions`."""

    name: Name = Field(description="name, which nothing else in the world has")
    kind: str = Field(description="name of a law in the catalogue, or 'expression'")
    parameters: dict[str, float] = Field(default_factory=dict, description="values by parameter name, SI")
    objects: tuple[Name, ...] | None = Field(default=None, description="objects it acts on; default: all")
    enabled: bool = True
    expression: str | Components | None = Field(
        default=None, description="kind 'expression': its acceleration [m/s^2], such as '-k*speed*v'"
    )
    parameter_units: dict[str, str] = Field(default_factory=dict, description="of an expression; default: 1")
    parameter_bounds: dict[str, Interval] = Field(
        default_factory=dict, description="least and greatest value of an expression's parameters"
    )


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
    """Gravity, motion plane and air. Air acts on cloth alone; on rigid objects, effects such as drag do."""

    gravity: Vec3 = Field(default=(0.0, 0.0, -9.81), description="gravitational acceleration [m/s^2]")
    motion_plane: MotionPlane = MotionPlane()
    air_density: NonNegative = Field(default=1.2, description="density of the air that cloth moves through [kg/m^3]")
    wind: Vec3 = Field(default=ORIGIN, description="velocity of that air [m/s]")


class TimeBase(Description):
    """How frames of the observation map to seconds, and how finely the engine steps.

    The frame rate written in a video file says nothing certain about physical time: give or fit
    `seconds_per_frame`.
    """

    seconds_per_frame: Positive = Field(default=0.04, description="physical time between frames [s]")
    frame_count: int = Field(default=0, ge=0, description="number of observed frames; 0 where there are none")
    substep: float = Field(default=0.002, gt=0.0, le=0.05, description="longest integration step [s]")
    origin: float = Field(
        default=0.0, ge=-1e6, le=1e6, description="what laws that depend on time take for the time of the start [s]"
    )


def _registered(value: Any, described: ValidatorFunctionWrapHandler) -> Any:
    """A deformable object whose material is not built in, by its entry in the registry; else as described."""
    kind = value.get("representation") if isinstance(value, Mapping) else getattr(value, "representation", None)
    name = str(kind).removesuffix(materials.PLANAR)
    if name in materials.BUILT_IN or name not in materials.kinds():
        return described(value)
    return materials.material(name).description.model_validate(value)


Deformable = Annotated[
    Rope | Cloth | Soft | Fluid,
    Field(discriminator="representation"),
    WrapValidator(_registered),
    SerializeAsAny(),
]
# Parts that are left out of the canonical JSON where they are empty.
_OPTIONAL = (
    "joints",
    "deformables",
    "attachments",
    "pulleys",
    "no_contact",
    "fluid_grid",
    "emitters",
    "drains",
    "containers",
    "observer",
)
_OF_COMPOUNDS = ("centre_of_mass", "inertia")
_OF_EXPRESSIONS = ("expression", "parameter_units", "parameter_bounds")


class World(Description):
    """An executable world."""

    objects: tuple[RigidObject, ...] = Field(default=(), max_length=512)
    statics: tuple[StaticObject, ...] = Field(default=(), max_length=256)
    environment: Environment = Environment()
    effects: tuple[Effect, ...] = Field(default=(), max_length=64)
    joints: tuple[Joint, ...] = Field(default=(), max_length=256, description="joints of rigid objects")
    deformables: tuple[Deformable, ...] = Field(default=(), max_length=64, description="all but rigid")
    attachments: tuple[Attachment, ...] = Field(default=(), max_length=256, description="fastenings of deformables")
    pulleys: tuple[Pulley, ...] = Field(default=(), max_length=64, description="pulleys that ropes run over")
    no_contact: tuple[Annotated[tuple[Name, Name], fixed_length(2, "string")], ...] = Field(
        default=(),
        max_length=50_000,
        description="pairs that pass through each other: rigid objects, or a rigid object and a static",
    )
    fluid_grid: FluidGrid | None = Field(default=None, description="where and how finely fluids are computed")
    emitters: tuple[Emitter, ...] = Field(default=(), max_length=64)
    drains: tuple[Drain, ...] = Field(default=(), max_length=64)
    containers: tuple[Container, ...] = Field(default=(), max_length=64, description="boxes whose content is measured")
    time: TimeBase = TimeBase()
    camera: Camera | None = Field(default=None, description="camera that observed the world; defines the view")
    region: Region | None = Field(default=None, description="region for entry and exit events without a camera")
    observer: Observer | None = Field(default=None, description="faults of whoever measured the motion")

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        check_plausible(self)
        check_consistent(self)
        return self

    @cached_property
    def id(self) -> str:
        """`world-` and the first 16 hex digits of the SHA-256 of the canonical JSON."""
        return "world-" + hashlib.sha256(self.canonical_json().encode()).hexdigest()[:16]

    def model_copy(self, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> Self:
        """Copy the world; the copy's id is that of its own content, not the one cached here."""
        copied = super().model_copy(update=update, deep=deep)
        copied.__dict__.pop("id", None)
        return copied

    def canonical_json(self) -> str:
        """The world as JSON with sorted keys and no spaces: equal worlds give equal bytes."""
        content = self.model_dump(mode="json")
        effects = ((e, _OF_EXPRESSIONS) for e in content["effects"])
        statics = ((s, ("dominant",)) for s in content["statics"])
        compounds = ((o["shape"], _OF_COMPOUNDS) for o in content["objects"] if o["shape"]["kind"] == "compound")
        for part, names in ((content, _OPTIONAL), (content["time"], ("origin",)), *effects, *statics, *compounds):
            for name in names:
                if not part[name]:
                    del part[name]
        return json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)

    def passing(self) -> NDArray[np.bool_]:
        """Return which objects pass through which others, objects first (n, n + s): joined by a joint, or no_contact.

        Springs leave what they join to collide.
        """
        names = [*(o.name for o in self.objects), *(s.name for s in self.statics)]
        index = {name: i for i, name in enumerate(names)}
        n = len(self.objects)
        found = np.zeros((n, len(names)), dtype=bool)
        joined = [(j.object, j.other) for j in self.joints if j.other is not None and j.kind != "spring"]
        for a, b in (*joined, *self.no_contact):
            i, j = sorted((index[a], index[b]))
            found[i, j] = True
            if j < n:
                found[j, i] = True
        return found

    @property
    def coupled(self) -> bool:
        """Whether there are deformable objects, so that the coupled solver runs it."""
        return bool(self.deformables)

    @property
    def planar(self) -> bool:
        """Whether the objects move in `environment.motion_plane`."""
        return any(o.representation.endswith(materials.PLANAR) for o in (*self.objects, *self.deformables))

    @property
    def moving_names(self) -> tuple[str, ...]:
        """Names of all that moves: rigid objects, then deformable ones; the columns of every trajectory."""
        return tuple(o.name for o in (*self.objects, *self.deformables))

    def object(self, name: str) -> RigidObject:
        """The rigid object called `name`; raises KeyError naming the valid choices."""
        for candidate in self.objects:
            if candidate.name == name:
                return candidate
        if any(d.name == name for d in self.deformables):
            raise KeyError(
                f"{name!r} is {self.deformable(name).representation}, not rigid; rigid objects: "
                f"{[o.name for o in self.objects]}"
            )
        raise KeyError(f"unknown object {name!r}; objects: {list(self.moving_names)}")

    def deformable(self, name: str) -> Deformable:
        """The rope, cloth, soft body or fluid called `name`; raises KeyError naming the valid choices."""
        for candidate in self.deformables:
            if candidate.name == name:
                return candidate
        raise KeyError(f"unknown deformable object {name!r}; deformables: {[d.name for d in self.deformables]}")

    def of_form(self, *forms: materials.Form) -> tuple[Any, ...]:
        """The deformable objects whose materials have one of some forms, in order."""
        return tuple(d for d in self.deformables if materials.material_of(d).form in forms)

    def is_rigid(self, name: str) -> bool:
        """Whether a rigid object is called `name`."""
        return any(o.name == name for o in self.objects)

    def item(self, name: str) -> RigidObject | Deformable:
        """The rigid or deformable object called `name`; raises KeyError naming the valid choices."""
        if any(d.name == name for d in self.deformables):
            return self.deformable(name)
        return self.object(name)

    def with_substep(self, substep: float) -> Self:
        """The world with another longest integration step [s]."""
        return self.model_copy(update={"time": self.time.model_copy(update={"substep": substep})})
