"""Statements about a rollout that can be true at one time and false at another."""

from __future__ import annotations

from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from polyworld.trajectory.events import REST_SPEED, REST_SPIN
from polyworld.world.description import Description, Name, NonNegative, Positive, Vec3

Comparison = Literal["more_than", "less_than"]
Part = Literal["centre", "first_point", "last_point"]


class InContact(Description):
    """a and b touch. A fluid touches what its particles come within half a grid cell of."""

    predicate: Literal["in_contact"] = "in_contact"
    a: Name
    b: Name = Field(description="an object or a static")


class Collides(Description):
    """A contact of a begins, with b or, when b is not given, with anything. True at instants.

    Two that touch from the start begin their contact then.
    """

    predicate: Literal["collides"] = "collides"
    a: Name
    b: Name | None = Field(default=None, description="an object or a static; default: anything but fluids")


class Moving(Description):
    """The object's centre, of a deformable object its points (root mean square), moves faster than `speed`."""

    predicate: Literal["moving"] = "moving"
    object: Name
    speed: Positive = Field(default=REST_SPEED, description="threshold [m/s]")


class AtRest(Description):
    """The object neither moves nor turns faster than the thresholds; of a deformable one, no motion of its points. A
    ball's spin about the vertical does not count."""

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
    """The object's centre is in the camera's image, or in the world's region where there is no camera; of a deformable
    object, at least half of its points."""

    predicate: Literal["in_view"] = "in_view"
    object: Name


class Above(Description):
    """a's centre is higher (z) than b's by more than `margin`."""

    predicate: Literal["above"] = "above"
    a: Name
    b: Name
    margin: float = Field(default=0.0, description="[m]")
    entirely: bool = Field(default=False, description="all of the one beyond all of the other, not the centres")


class Below(Description):
    """a's centre is lower (z) than b's by more than `margin`."""

    predicate: Literal["below"] = "below"
    a: Name
    b: Name
    margin: float = Field(default=0.0, description="[m]")
    entirely: bool = Field(default=False, description="all of the one beyond all of the other, not the centres")


class NearerThan(Description):
    """The centres of a and b are nearer to each other than `distance`."""

    predicate: Literal["nearer_than"] = "nearer_than"
    a: Name
    b: Name
    distance: Positive = Field(description="[m]")


class WithinDistance(Description):
    """The surfaces of a and b are no further apart than `distance`, or a's centre is from `place`."""

    predicate: Literal["within_distance"] = "within_distance"
    a: Name
    b: Name | None = Field(default=None, description="an object or a static; else place")
    place: Vec3 | None = Field(default=None, description="a point [m], instead of b")
    distance: Positive = Field(description="[m]")

    @model_validator(mode="after")
    def _one_target(self) -> Self:
        if (self.b is None) == (self.place is None):
            raise ValueError("within_distance: give b or place")
        return self


class MovedByMoreThan(Description):
    """The object's centre is further than `distance` from where it was at time `since`."""

    predicate: Literal["moved_by_more_than"] = "moved_by_more_than"
    object: Name
    distance: Positive = Field(description="[m]")
    since: NonNegative = Field(default=0.0, description="time of the place it is compared with [s]")


class ComesToRest(Description):
    """The object comes to rest after having moved, for a fifth of a second at least. True at instants."""

    predicate: Literal["comes_to_rest"] = "comes_to_rest"
    object: Name


class PassesBefore(Description):
    """a crosses the plane `axis` = `value` for the first time before b does."""

    predicate: Literal["passes_before"] = "passes_before"
    a: Name
    b: Name
    axis: Literal["x", "y", "z"]
    value: float = Field(description="coordinate of the plane [m]")
    part: Part = Field(default="centre", description="what of each has to pass; points: of deformable objects")


class ReachesBefore(Description):
    """a gets into the box from lower to upper for the first time before b does."""

    predicate: Literal["reaches_before"] = "reaches_before"
    a: Name
    b: Name
    lower: Vec3
    upper: Vec3
    part: Part = Field(default="centre", description="what of each has to pass; points: of deformable objects")


class Occupies(Description):
    """More (or less) than `share` of a deformable object is in a container of the world, or in a box."""

    predicate: Literal["occupies"] = "occupies"
    object: Name
    container: Name | None = Field(default=None, description="container of the world; else lower and upper")
    lower: Vec3 | None = None
    upper: Vec3 | None = None
    comparison: Comparison = "more_than"
    share: float = Field(default=0.5, ge=0.0, le=1.0, description="of the whole object; 0 with more_than: any of it")

    @model_validator(mode="after")
    def _one_place(self) -> Self:
        box = self.lower is not None and self.upper is not None
        if (self.container is not None) == box or (self.lower is None) != (self.upper is None):
            raise ValueError("occupies: give a container, or lower and upper")
        return self


class Holds(Description):
    """A container holds more (or less) than `amount` of a fluid, or of all fluids."""

    predicate: Literal["holds"] = "holds"
    container: Name
    object: Name | None = Field(default=None, description="a fluid; default: all fluids together")
    comparison: Comparison = "more_than"
    amount: NonNegative = Field(description="[m^3]; in planar worlds [m^2]")


class Taut(Description):
    """A rope is pulled everywhere by more than `tension`."""

    predicate: Literal["taut"] = "taut"
    object: Name
    tension: NonNegative | None = Field(default=None, description="[N]; default: half of the rope's own weight")


class Slack(Description):
    """A rope is not taut: somewhere it is pulled by no more than `tension`."""

    predicate: Literal["slack"] = "slack"
    object: Name
    tension: NonNegative | None = Field(default=None, description="[N]; default: half of the rope's own weight")


class Folded(Description):
    """More than `share` of a cloth lies on other parts of it."""

    predicate: Literal["folded"] = "folded"
    object: Name
    share: float = Field(default=0.25, ge=0.0, lt=1.0)


class Deformed(Description):
    """The object is stretched or shortened by more than `strain` of its size: a soft body or cloth along any direction,
    a rope along its length."""

    predicate: Literal["deformed"] = "deformed"
    object: Name
    strain: Positive = Field(default=0.1, description="|length / length without forces - 1|")


Predicate = Annotated[
    InContact
    | Collides
    | Moving
    | AtRest
    | InsideRegion
    | InView
    | Above
    | Below
    | NearerThan
    | WithinDistance
    | MovedByMoreThan
    | ComesToRest
    | PassesBefore
    | ReachesBefore
    | Occupies
    | Holds
    | Taut
    | Slack
    | Folded
    | Deformed,
    Field(discriminator="predicate"),
]


def names_in(predicate: Predicate) -> tuple[str, ...]:
    """Objects and statics that a predicate speaks of."""
    fields = (getattr(predicate, f, None) for f in ("object", "a", "b"))
    return tuple(name for name in fields if name is not None)
