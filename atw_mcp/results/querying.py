"""Results of the tools that decide statements and compare rollouts."""

from __future__ import annotations

from typing import Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.documents import Statement
from atw_mcp.results.experimentation import FloorContacts, MemberCount
from atw_mcp.results.motions import Happening, Participants, TimelineRow
from atw_mcp.results.times import Covers, Spread
from atw_mcp.results.values import Interval
from polyworld.trajectory.trajectory import EventKind

Aggregation = Literal["any", "all", "first", "last", "count", "fraction"]
Status = Literal["completed", "diverged"]


class Contact(Result):
    """A contact's beginning or end."""

    kind: EventKind
    time: float = Field(description="[s]")
    participants: list[str]
    position: list[float] | None = Field(description="contact point [m]")
    impulse: float | None = Field(description="[N s]")
    speed: float | None = Field(description="approach speed [m/s]")


class Approach(Result):
    """Closest approach of two surfaces."""

    gap_m: float = Field(description="[m]; 0: they touch")
    time: float = Field(description="[s]")
    with_: str = Field(alias="with", description="the other object or static")


class Extremes(Result):
    """Least and greatest value of what a statement is about, over the time covered."""

    quantity: str = Field(description="its name, which ends in its unit")
    lowest: float
    at: float = Field(description="[s]")
    highest: float
    highest_at: float = Field(description="[s]")


class Grounds(Result):
    """Numbers that a statement was decided on: those that it has."""

    extremes: Extremes | None = None
    events: list[Contact] | None = Field(default=None, description="contacts of those named")
    touches_within_m: float | None = Field(default=None, description="gap up to which a fluid touches [m]")
    closest_approach: Approach | None = None
    passes_at_s: dict[str, float | None] | None = Field(default=None, description="by object [s]; null: never")
    comes_to_rest_at_s: list[float] | None = Field(default=None, description="[s]")


class Split(Result):
    """The threshold of one parameter that separates the members."""

    parameter: str
    threshold: float
    true_where: Literal["below", "above"]
    agree: int = Field(description="members on the side of their answer")
    members: int


class Relation(Result):
    """A parameter that a number rises or falls with."""

    parameter: str
    rank_correlation: float


class Chance(Result):
    """How many members agree, and how probable it is."""

    true: int = Field(description="number of members")
    false: int
    probability: float | None = Field(description="null: unknown in every member")
    probability_interval: Interval | None = Field(description="90%")
    less_sure_because: str | None = Field(default=None, description="only where it differs from the count")


class Answered(Result):
    """Data of QueryWorld for one predicate."""

    verdict: Literal["true", "false", "unknown", "never"] | int | float = Field(
        description="true or false of any and all; a time [s], a count or a share of the others"
    )
    value: bool | int | float | None = Field(description="the same as a value; null: never, or unknown")
    decided: bool = Field(description="false: the rollout does not cover what is asked")
    reason: str | None = Field(description="why it is unknown or never; else null")
    intervals: list[Interval] = Field(description="when it holds [s]")
    covered: Interval | None = Field(description="what of the time asked for is covered [s]; null: nothing")
    asked: Interval | None = Field(description="[s]")
    evidence: Grounds
    margin: float | None = Field(default=None, description="by how much it is true (positive) or false, where known")
    margin_unit: str | None = Field(default=None, description="with margin")
    margin_at_s: float | None = Field(default=None, description="when [s], with margin; null of an order")
    sampled_every_s: float | None = Field(default=None, description="[s]; missing: contacts alone decided")
    predicate: Statement
    aggregation: Aggregation
    covers: Covers | None


class AnsweredSeveral(Result):
    """Data of QueryWorld for several predicates."""

    answers: list[Answered] = Field(description="one for each, in order")


class KeptEvent(Result):
    """An event of both rollouts."""

    kind: EventKind
    objects: Participants
    time: float = Field(description="in the base [s]")
    shift: float = Field(description="how much later in the edited one [s]")


class ChangedEvents(Result):
    """Events of two rollouts."""

    gone: list[TimelineRow] = Field(description="in the base alone")
    new: list[TimelineRow] = Field(description="in the edited one alone")
    kept: list[KeptEvent]


class Displacement(Result):
    """How far apart one object is in two rollouts; null where it is in both at no common time."""

    object: str
    largest_distance: float | None = Field(description="of the centres [m]")
    at: float | None = Field(description="[s]")
    final_distance: float | None = Field(description="[m]")
    apart_from: float | None = Field(description="from when on it is further than the tolerance [s]; null: never")
    moves_differently: bool
    largest_shape_distance: float | None = Field(
        default=None, description="rms of the same points [m], of deformable objects"
    )
    shape_at: float | None = Field(default=None, description="[s]")


class Compared(Result):
    """One of the two rollouts."""

    rollout: str
    world: str
    horizon: float = Field(description="[s]")
    status: Status


class MemberDisplacement(Result):
    """In how many members an object is displaced."""

    object: str
    displaced: Chance
    decided_by: Split | None = Field(description="null: no parameter clearly does")
    decided_by_in_words: str | None
    final_distance: Spread | None = Field(default=None, description="[m]; missing: unknown in every member")


class MemberEvent(MemberCount):
    """In how many members an event is new, or gone."""

    what: Happening
    objects: Participants
    time: Spread = Field(alias="time_90%", description="[s]")


class MemberEvents(Result):
    """Events that differ in some members."""

    gone: list[MemberEvent]
    new: list[MemberEvent]


class EnsembleComparison(Result):
    """Comparison of the members with their own changed copies."""

    members: int
    objects: list[MemberDisplacement]
    events: MemberEvents


class ComparedRollouts(Result):
    """Data of CompareWorlds."""

    events: ChangedEvents
    floor_contacts_included: FloorContacts
    objects: list[Displacement]
    only_in_base: list[str]
    only_in_edited: list[str]
    base: Compared
    edited: Compared
    covers: Covers
    tolerance: float = Field(description="distance from which an object moves differently [m]")
    ensemble: EnsembleComparison | None = Field(default=None, description="only where it was asked for")
