"""Ropes: slender elastic rods, with attachments elsewhere (`attachment`) and pulleys here."""

from __future__ import annotations

from typing import Literal, Self

import numpy as np
from pydantic import Field, model_validator

from polyworld.world.description import ORIGIN, Appearance, Description, Name, NonNegative, Positive, Vec3


class Rope(Description):
    """A rope, cable or rod: a centreline that resists stretching, bending and twisting.

    Simulated as `segments` straight segments of equal rest length between nodes. Lumped mass, Kirchhoff rod
    with stretch. EA, EI and GJ of a solid round rod are E pi r^2, E pi r^4/4 and E pi r^4/(4 (1 + nu)); a rope of
    many strands bends far more easily than that.
    """

    name: Name = Field(description="name, which nothing else in the world has")
    representation: Literal["rope", "rope_planar"] = Field(
        default="rope", description="rope_planar stays in environment.motion_plane and does not twist"
    )
    points: tuple[Vec3, ...] = Field(
        min_length=2, max_length=10_000, description="centreline at start_time, first end to last [m]"
    )
    segments: int = Field(default=40, ge=1, le=5_000, description="number of segments it is divided into")
    length: Positive | None = Field(
        default=None,
        description="length without tension [m]; default: as long as its segments along `points` are at the start",
    )
    radius: Positive = Field(default=0.005, description="radius of the round cross-section, for contact [m]")
    linear_density: Positive = Field(default=0.05, description="mass per rest length [kg/m]")
    stretch_stiffness: Positive = Field(default=1e4, description="EA: tension per strain [N]")
    bending_stiffness: NonNegative = Field(default=0.0, description="EI: moment per curvature [N m^2]")
    twist_stiffness: NonNegative = Field(default=0.0, description="GJ: torque per twist rate [N m^2]")
    curved_at_rest: bool = Field(default=False, description="whether the initial curve is its shape without moments")
    stretch_damping: NonNegative = Field(default=0.0, description="tau in tension EA (strain + tau strain rate) [s]")
    bending_damping: NonNegative = Field(default=0.0, description="time tau in moment EI (kappa + tau kappa rate) [s]")
    linear_damping: NonNegative = Field(default=0.0, description="rate c of dv/dt = -c v [1/s]")
    friction: NonNegative = Field(default=0.3, description="Coulomb friction coefficient [1]")
    restitution: float = Field(default=0.0, ge=0.0, le=1.0, description="coefficient of restitution [1]")
    velocity: Vec3 = Field(default=ORIGIN, description="velocity of all of it at start_time [m/s]")
    start_time: NonNegative = Field(default=0.0, description="time at which it joins the simulation [s]")
    appearance: Appearance = Appearance()

    @model_validator(mode="after")
    def _has_length(self) -> Self:
        steps = np.linalg.norm(np.diff(np.asarray(self.points), axis=0), axis=1)
        if steps.min() < 1e-9:
            raise ValueError(f"rope {self.name!r}: consecutive points must differ")
        return self


class Pulley(Description):
    """A round pulley that one rope runs over: fixed to the world, or carried by a rigid object (a movable pulley).

    The rope must pass it at the start: it is threaded between the two of the rope's `points` that lie on either
    side of index `after` and runs round the wheel from the tangent of the first to the tangent of the second. Two
    points outside the wheel, one on either side, suffice: none of the rope's points belongs on the rim.
    Belt friction bounds the ratio of the two tensions by exp(friction * wrap angle) (Euler-Eytelwein); where the
    wheel turns, the bearing's dry torque, viscous torque and the wheel's inertia make them differ.
    """

    name: Name = Field(description="name, which nothing else in the world has")
    rope: Name = Field(description="name of the rope")
    centre: Vec3 = Field(description="centre of the wheel at the start [m]")
    axis: Vec3 = Field(default=(0.0, 1.0, 0.0), description="axis of the wheel; normalised when used")
    radius: NonNegative = Field(description="radius at which the rope runs [m]; 0 for an eye or a hook")
    after: int = Field(ge=0, description="the rope runs from points[after] over the wheel to points[after + 1]")
    turns_positive: bool = Field(
        default=True,
        description="the rope goes round the wheel counter-clockwise seen with the axis pointing at the viewer",
    )
    object: Name | None = Field(default=None, description="rigid object that carries it; default: the world")
    fixed_wheel: bool = Field(default=False, description="the wheel cannot turn: the rope slides over it")
    friction: NonNegative = Field(
        default=0.0, description="friction coefficient of rope on a wheel that cannot turn [1]"
    )
    bearing_friction: NonNegative = Field(default=0.0, description="dry torque of the bearing [N m]")
    bearing_damping: NonNegative = Field(default=0.0, description="viscous torque of the bearing [N m s]")
    inertia: NonNegative = Field(default=0.0, description="moment of inertia of the wheel about its axis [kg m^2]")
