"""Results of the tools that run worlds and read what happened."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.documents import Edit, Reading
from atw_mcp.results.motions import Absent, EventRow, Happening, Motion, Participants, TimelineRow
from atw_mcp.results.times import Covers, Periods, Place, Spread
from atw_mcp.results.values import Interval

Cell = float | None | list[float | None] | list[list[float | None]]
FloorContacts = Annotated[bool, Field(description="false: touches of what things stand on are left out")]
Of = Annotated[int, Field(description="number of rows in all")]
NextCursor = Annotated[int | None, Field(description="cursor of the next page; null: this is the last")]


class LastObserved(Result):
    """The last observed frame."""

    seconds: float = Field(description="its time [s]")
    frame: int


class Divergence(Result):
    """Where a rollout diverged."""

    time: float | None = Field(description="[s]; nothing after it is known")
    object: str | None
    element: int | None = Field(description="node of a deformable object")


class PlaceSpread(Result):
    """Median and central 90% interval of a place over the members, coordinate by coordinate [m]."""

    median: Place
    from_: Place = Field(alias="from")
    to: Place


class MemberCount(Result):
    """How many members of an ensemble agree."""

    true: int = Field(description="number of members")
    false: int
    probability: float
    probability_interval: Interval = Field(description="90%")


class LikelyEvent(MemberCount):
    """Something that happens in some members of an ensemble."""

    what: Happening
    objects: Participants
    occurrence: int | None = Field(default=None, description="which of several alike; missing: the first")
    time: Spread = Field(alias="time_90%", description="[s]")
    place: PlaceSpread = Field(alias="place_90%", description="of the first of the objects that moves")


class EndOfObject(Result):
    """Place of an object at the end."""

    object: str
    position: PlaceSpread = Field(alias="position_90%")


class EnsembleRollout(Result):
    """What happens in the members of an ensemble; the last three are missing where all diverge."""

    members: int
    diverged: int
    timeline: list[LikelyEvent] | None = None
    rows_left_out: int | None = Field(default=None, description="less frequent events")
    ends: list[EndOfObject] | None = None


class RolloutMade(Result):
    """Data of Rollout of one branch."""

    rollout: str = Field(description="its id")
    world: str
    base_world: str = Field(description="world that the edits were made to")
    edits: list[Edit]
    horizon: Covers
    sampled_every_s: float | None = Field(description="time between samples [s]; null: there is only one")
    points: dict[str, int] | None = Field(default=None, description="nodes and particles by deformable object, if any")
    observed_until: LastObserved | None = Field(description="null: no frames were observed")
    diverged: Divergence | None = Field(description="null: it completed")
    timeline: list[TimelineRow]
    floor_contacts_included: FloorContacts
    objects: list[Motion | Absent]
    ensemble: EnsembleRollout | None = Field(default=None, description="only where it was asked for")


class Events(Result):
    """Data of ReadEvents."""

    events: list[EventRow]
    of: Of
    next_cursor: NextCursor
    covers: Covers
    floor_contacts_included: bool
    impulse_Ns: str = Field(description="what the impulses of the rows are of")


class Timeline(Result):
    """Data of ReadTimeline."""

    timeline: list[TimelineRow]
    covers: Covers
    floor_contacts_included: FloorContacts


class MotionOverTime(Motion):
    """The motion with its periods."""

    period: Periods | None = Field(description="null: it does not go to and fro")


class AbsentOverTime(Absent):
    """An object that is not there, and has no period."""

    period: None


class MotionSpread(Result):
    """Motion in a few numbers over the members; missing where none has it."""

    displacement: Spread | None = Field(default=None, description="[m]")
    path_length: Spread | None = Field(default=None, description="[m]")
    highest_speed: Spread | None = Field(default=None, description="[m/s]")
    final_speed: Spread | None = Field(default=None, description="[m/s]")


class PeriodSpread(Spread):
    """A period over the members [s]."""

    found_in: int = Field(description="number of members that go to and fro")


class PeriodSpreads(Result):
    """Periods of the coordinates that go to and fro in some member."""

    x: PeriodSpread | None = None
    y: PeriodSpread | None = None
    z: PeriodSpread | None = None


class EnsembleTrajectory(Result):
    """One object's columns over the members of an ensemble."""

    members: int
    columns: list[str]
    cells: str = Field(description="what is in a cell")
    rows: list[list[float | list[float] | None]] = Field(description="time [s], frame, then [median, from, to]")
    motion: MotionSpread
    period: PeriodSpreads


class Trajectory(Result):
    """Data of ReadTrajectory of an object's centre."""

    object: str
    columns: list[str]
    rows: list[list[float | None]] = Field(description="one value for each column; units: argument fields")
    motion: MotionOverTime | AbsentOverTime
    covers: Covers
    of: Of
    ensemble: EnsembleTrajectory | None = Field(default=None, description="only where it was asked for")


class Shape(Result):
    """Data of ReadTrajectory with readout or nodes."""

    object: str
    nodes: list[int] | None = Field(default=None, description="the nodes asked for")
    readout: Reading | None = Field(default=None, description="or the readout asked for, with its defaults")
    unit: str = Field(description="of the values")
    entries: str = Field(description="what the entries of values are")
    thinned: str | None = Field(default=None, description="only where not every sample was read")
    columns: list[Literal["time", "frame", "values"]]
    rows: list[list[Cell]] = Field(description="time [s], frame, and a number, list or list of points")
    covers: Covers
    of: Of
