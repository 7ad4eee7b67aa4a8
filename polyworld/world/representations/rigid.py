"""Rigid bodies: shape, contact and damping parameters, initial state."""

from __future__ import annotations

from typing import Literal

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
from polyworld.world.shapes import BodyShape


class RigidObject(Description):
    """A rigid body: shape, contact and damping parameters, and its state when it enters the simulation."""

    name: Name = Field(description="name, which nothing else in the world has")
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
    def _unit(cls, value: tuple[float, float, float, float]) -> tuple[float, float, float, float]:
        return unit_quaternion(value)
