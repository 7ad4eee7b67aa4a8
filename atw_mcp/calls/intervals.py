"""Stretches of time as agents give them: in seconds or in frames, checked against what is covered."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import Field

Seconds = Annotated[
    list[float] | None,
    Field(description="[start, end] in seconds; default: all", min_length=2, max_length=2),
]
FrameRange = Annotated[
    list[Annotated[int, Field(ge=0)]] | None,
    Field(description="[first, last] frame, instead of interval", min_length=2, max_length=2),
]

ROUNDING = 1e-6  # of a frame: an interval's end may have been computed another way


@dataclass(frozen=True)
class Span:
    """A stretch of time, both ends included. start, end [s]; seconds_per_frame converts frames to seconds."""

    start: float
    end: float
    seconds_per_frame: float

    @property
    def seconds(self) -> tuple[float, float]:
        """Start and end [s]."""
        return self.start, self.end

    def shown(self) -> dict[str, Any]:
        """Start and end in both units."""
        return {"seconds": [self.start, self.end], "frames": [self.frame(self.start), self.frame(self.end)]}

    def frame(self, time: float) -> float:
        """A time as a frame number, to a hundredth."""
        return round(time / self.seconds_per_frame, 2)

    def holds(self, time: float) -> bool:
        """Whether a time lies in the span."""
        slack = ROUNDING * self.seconds_per_frame
        return self.start - slack <= time <= self.end + slack


def chosen_span(
    interval: list[float] | None,
    frames: list[int] | None,
    *,
    covered: tuple[float, float],
    seconds_per_frame: float,
    further: str,
) -> Span:
    """The span asked for, default all that is covered.

    further: what to do to get beyond it. Raises ToolError for a span given twice, one that ends before it
    begins, and one that reaches outside what is covered: half an answer would look like a whole one.
    """
    whole = Span(*covered, seconds_per_frame)
    if interval is not None and frames is not None:
        raise ToolError("give interval (seconds) or frames, not both")
    if interval is None and frames is None:
        return whole
    if interval is not None:
        start, end = float(interval[0]), float(interval[1])
    else:
        assert frames is not None
        start, end = frames[0] * seconds_per_frame, frames[1] * seconds_per_frame
    limits = whole.shown()
    text = (
        f"{limits['seconds'][0]:g} to {limits['seconds'][1]:g} s (frames {limits['frames'][0]:g} to "
        f"{limits['frames'][1]:g})"
    )
    if not start <= end:
        raise ToolError(f"an interval is [start, end] with start <= end, got {interval or frames}; covered: {text}")
    if not (whole.holds(start) and whole.holds(end)):
        raise ToolError(f"{interval or frames} reaches outside what is covered: {text}. {further}")
    return Span(max(start, covered[0]), min(end, covered[1]), seconds_per_frame)
