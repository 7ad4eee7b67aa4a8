"""The sweep back in time."""

from __future__ import annotations

from collections.abc import Callable

from atw_mcp.perception.segmentation import Foreground
from atw_mcp.perception.tracking import Sweep
from atw_mcp.perception.video import Frames


def resweep(frames: Frames, foregrounds: list[Foreground], sweep: Sweep, stop: Callable[[], None]) -> Sweep:
    return sweep
