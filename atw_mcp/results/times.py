"""Stretches of time, spreads over an ensemble and periods, as results of several tools hold them."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.values import Interval

Place = Annotated[list[float | None], Field(min_length=3, max_length=3)]  # null where there is none of a fluid


class Covers(Result):
    """The stretch of time that a result covers."""

    seconds: Interval = Field(description="start, end [s]")
    frames: Interval = Field(description="the same as frame numbers")


class Spread(Result):
    """Median and central 90% interval over the members of an ensemble."""

    median: float
    from_: float = Field(alias="from", description="lower end of the interval")
    to: float = Field(description="upper end")


class Period(Result):
    """Period of a motion to and fro."""

    seconds: float = Field(description="period [s]")
    cycles: float = Field(description="how many periods were seen")
    from_: float | None = Field(default=None, alias="from", description="90% interval [s], of measured motions")
    to: float | None = Field(default=None, description="its upper end [s]")


class Periods(Result):
    """Periods of the coordinates that go to and fro."""

    x: Period | None = None
    y: Period | None = None
    z: Period | None = None
