"""Assignment: which look-alike is which over the whole clip."""

from __future__ import annotations

from atw_mcp.perception.eye.follow import States
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Floats


def reassign(scene: Scene, states: list[States], seeds: list[dict[int, Floats]]) -> list[States]:
    """Not yet."""
    del scene, seeds
    return states
