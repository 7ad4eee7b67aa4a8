"""Events and motions of rollouts, as results of several tools hold them."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.times import Place
from atw_mcp.results.values import Vector
from polyworld.trajectory.trajectory import EventKind

Happening = Literal["collision", "enters the view", "leaves the view", "comes to rest", "is let go"]
Participants = Annotated[list[str], Field(description="objects and statics that take part")]
Time = Annotated[float, Field(description="[s]")]
Frame = Annotated[float, Field(description="the same as a frame number")]


class EventRow(Result):
    """One event."""

    kind: EventKind
    time: Time
    frame: Frame
    objects: Participants
    impulse_Ns: float | None = Field(default=None, description="normal impulse [N s], of contacts")
    approach_speed: float | None = Field(default=None, description="along the normal [m/s], of contact_begin")
    position: Vector | None = Field(default=None, description="contact point, or the object's centre [m]")


class TimelineRow(Result):
    """One row of a timeline; the last five fields are there for collisions."""

    what: Happening
    objects: Participants
    time: Time
    frame: Frame
    until: float | None = Field(default=None, description="end of the last touch [s]")
    touches: int | None = Field(default=None, description="touches in quick succession that it counts as one")
    impulse_Ns: float | None = Field(default=None, description="sum over its touches [N s]; null: still touching")
    approach_speed: float | None = Field(default=None, description="of the first touch [m/s]")
    still_touching: Literal[True] | None = Field(default=None, description="only where it outlasts the rollout")


class Motion(Result):
    """Motion of one object in a few numbers, null where there is none of a fluid."""

    object: str
    start: Place = Field(description="centre at the beginning [m]")
    end: Place = Field(description="centre at the end [m]")
    displacement: float | None = Field(description="distance between both [m]")
    path_length: float | None = Field(description="[m]")
    highest_speed: float | None = Field(description="[m/s]")
    final_speed: float | None = Field(description="[m/s]")
    moving_at_end: bool


class Absent(Result):
    """An object that is not in the simulation during the time covered."""

    object: str
    active: Literal[False]
