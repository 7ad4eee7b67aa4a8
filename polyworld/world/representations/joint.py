"""Joints between rigid bodies, or between a body and the world."""

from __future__ import annotations

import math
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from polyworld.world.description import Description, Name, NonNegative, Positive, Vec3

ROUNDING = 1e-6  # [rad or m]
Z: tuple[float, float, float] = (0.0, 0.0, 1.0)


class Motor(Description):
    """Drives a hinge or a slider: towards a speed, or with a constant effort, never harder than `limit`.

    Positive is the object turning about the axis by the right-hand rule, or moving along it, as seen from the other
    (or the world); in planar worlds a hinge's axis is the motion plane's normal.
    """

    target_speed: float | None = Field(
        default=None,
        description="speed aimed at [rad/s of a hinge, positive about its axis by the right-hand rule; m/s of a "
        "slider, along its axis]; default: constant effort",
    )
    limit: NonNegative = Field(description="greatest torque [N m] or force [N]; the effort itself without a target")
    reverse: bool = Field(default=False, description="constant effort in the negative direction")
    start: NonNegative = Field(default=0.0, description="switched on at [s]")
    end: Positive | None = Field(default=None, description="switched off at [s]; default: never")
    delay: NonNegative = Field(default=0.0, description="lag of switching on and off, as of a slow actuator [s]")


class _Joint(Description):
    name: Name = Field(description="name, which nothing else in the world has")
    object: Name = Field(description="name of the rigid object that is held")
    other: Name | None = Field(default=None, description="name of the rigid object it is held to; default: the world")
    anchor: Vec3 = Field(description="the joint's point at the objects' start_time, world axes [m]")


class _Limited(_Joint):
    friction: NonNegative = Field(
        default=0.0, description="dry friction: greatest torque [N m] or force [N] that resists the joint's motion"
    )
    damping: NonNegative = Field(default=0.0, description="viscous resistance [N m s/rad or N s/m]")
    lower: float | None = Field(default=None, description="lower stop, from the initial pose [rad or m]; default: none")
    upper: float | None = Field(default=None, description="upper stop, from the initial pose [rad or m]; default: none")
    motor: Motor | None = None

    @model_validator(mode="after")
    def _ordered(self) -> Self:
        if self.lower is not None and self.upper is not None and self.lower > self.upper:
            raise ValueError(f"joint {self.name!r}: lower {self.lower} exceeds upper {self.upper}")
        # Rounding of a pose at a stop is no start beyond it.
        if (self.lower is not None and self.lower > ROUNDING) or (self.upper is not None and self.upper < -ROUNDING):
            raise ValueError(
                f"joint {self.name!r} starts outside its stops, lower {self.lower} and upper {self.upper}, which count "
                "from the initial pose: describe the object where they let it be, or stops with lower <= 0 <= upper"
            )
        return self


class Hinge(_Limited):
    """Lets an object turn about an axis through a point: of the world, or of another object, which then moves with it.

    Its stops do not rebound. In planar worlds the axis is the motion plane's normal, whatever `axis` says. Each object
    is held at that point of it which lies at the anchor at the start, inside its shape or not. Objects joined by a
    joint do not collide with each other. Velocities at the start that would pull a joint apart are taken up by it at
    once, as a blow.
    """

    kind: Literal["hinge"] = "hinge"
    axis: Vec3 = Field(default=Z, description="direction of the axis at the start, world axes; normalised when used")


class Slider(_Limited):
    """Lets an object move along an axis without turning against the other. Its stops do not rebound."""

    kind: Literal["slider"] = "slider"
    axis: Vec3 = Field(default=Z, description="direction of travel at the start, world axes; normalised when used")


class Ball(_Joint):
    """Holds a point and lets the object turn every way about it."""

    kind: Literal["ball"] = "ball"
    friction: NonNegative = Field(default=0.0, description="greatest torque that resists turning [N m]")
    damping: NonNegative = Field(default=0.0, description="viscous resistance to turning [N m s/rad]")


class Fixed(_Joint):
    """Holds two objects together in the pose they start in."""

    kind: Literal["fixed"] = "fixed"


class Spring(_Joint):
    """A straight spring and damper between a point of the object and a point of the other (or of the world).

    It is fastened to the points of its bodies that lie at its two anchors in the world as described; where a fit lets a
    body start elsewhere, its point goes with it.
    """

    kind: Literal["spring"] = "spring"
    other_anchor: Vec3 = Field(description="the spring's other end at the start, world axes [m]")
    stiffness: NonNegative = Field(description="force per extension [N/m]")
    damping: NonNegative = Field(default=0.0, description="force per speed of extension [N s/m]")
    rest_length: NonNegative | None = Field(default=None, description="length without force [m]; default: as it starts")

    @property
    def length(self) -> float:
        """Length without force [m]."""
        return math.dist(self.anchor, self.other_anchor) if self.rest_length is None else self.rest_length

    @model_validator(mode="after")
    def _has_a_direction(self) -> Self:
        if self.anchor == self.other_anchor and self.length > 0.0:
            raise ValueError(
                f"spring {self.name!r} has both ends at {self.anchor}, so its direction is undefined: anchor is "
                "where it holds the object, in world axes at the start, and other_anchor its other end"
            )
        return self


Joint = Annotated[Hinge | Slider | Ball | Fixed | Spring, Field(discriminator="kind")]
