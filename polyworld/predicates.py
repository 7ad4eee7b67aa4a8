"""Statements about a rollout that can be true at one time and false at another."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from polyworld.description import Description, Name, Positive, Vec3
from polyworld.events import REST_SPEED, REST_SPIN


class InContact(Description):
    """a and b touch."""

    predicate: Literal["in_contact"] = "in_contact"
    a: Name
    b: Name = Field(description="an object or a static")


class Collides(Description):
    """A contact of a begins, with b or, when b is not given, with anything. True at instants.

    Two that touch from the start begin their contact then.
    """

    predicate: Literal["collides"] = "collides"
    a: Name
    b: Name | None = Field(default=None, description="an object or a static; default: anything")


class Moving(Description):
    """The object's centre moves faster than `speed`."""

    predicate: Literal["moving"] = "moving"
    object: Name
    speed: Positive = Field(default=REST_SPEED, description="threshold [m/s]")


class AtRest(Description):
    """The object neither moves nor turns faster than the thresholds."""

    predicate: Literal["at_rest"] = "at_rest"
    object: Name
    speed: Positive = Field(default=REST_SPEED, description="threshold [m/s]")
    spin: Positive = Field(default=REST_SPIN, description="threshold [rad/s]")


class InsideRegion(Description):
    """The object's centre lies in the axis-aligned box from lower to upper."""

    predicate: Literal["inside_region"] = "inside_region"
    object: Name
    lower: Vec3
    upper: Vec3


class InView(Description):
    """The object's centre is in the camera's image, or in the world's region where there is no camera."""

    predicate: Literal["in_view"] = "in_view"
    object: Name


class Above(Description):
    """a's centre is higher (z) than b's by more than `margin`."""

    predicate: Literal["above"] = "above"
    a: Name
    b: Name
    margin: float = Field(default=0.0, description="[m]")


class Below(Description):
    """a's centre is lower (z) than b's by more than `margin`."""

    predicate: Literal["below"] = "below"
    a: Name
    b: Name
    margin: float = Field(default=0.0, description="[m]")


class NearerThan(Description):
    """The centres of a and b are nearer to each other than `distance`."""

    predicate: Literal["nearer_than"] = "nearer_than"
    a: Name
    b: Name
    distance: Positive = Field(description="[m]")


class PassesBefore(Description):
    """a's centre crosses the plane `axis` = `value` for the first time before b's does."""

    predicate: Literal["passes_before"] = "passes_before"
    a: Name
    b: Name
    axis: Literal["x", "y", "z"]
    value: float = Field(description="coordinate of the plane [m]")


Predicate = Annotated[
    InContact | Collides | Moving | AtRest | InsideRegion | InView | Above | Below | NearerThan | PassesBefore,
    Field(discriminator="predicate"),
]


def names_in(predicate: Predicate) -> tuple[str, ...]:
    """Objects and statics that a predicate speaks of."""
    fields = (getattr(predicate, f, None) for f in ("object", "a", "b"))
    return tuple(name for name in fields if name is not None)
