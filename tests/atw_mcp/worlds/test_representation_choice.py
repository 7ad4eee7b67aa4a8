"""Planar or spatial: a box whose height is hardly known is still no level motion where it was seen to fly."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.worlds.parts import Parts
from atw_mcp.worlds.representation_choice import choose
from polyworld.data.tracks import ObservedTracks
from polyworld.world.shapes import Box

COUNT = 12


def toss(spread: float) -> ObservedTracks:
    """A box that is thrown 0.2 m high, with a deviation of `spread` [m] along a level line of sight."""
    t = np.arange(COUNT) / 30.0
    places = np.stack([t, 0.0 * t, 0.1 + 1.98 * t - 4.905 * t**2], axis=1)
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (COUNT, 1, 1))
    return ObservedTracks(
        names=("box",),
        frames=np.arange(COUNT),
        seconds_per_frame=1.0 / 30.0,
        positions=places[:, None],
        position_sigma=np.full((COUNT, 1), 0.005),
        orientations=turns,
        confidence=np.ones((COUNT, 1)),
        orientation_confidence=np.ones((COUNT, 1)),
        symmetry=(4,),
        position_spread=np.tile([0.0, spread, 0.0], (COUNT, 1, 1)),
    )


@pytest.mark.parametrize(
    ("spread", "airborne", "expected"), [(0.0, False, "spatial"), (0.3, True, "spatial"), (0.3, False, "spatial")]
)
def test_a_box_that_flies_gets_a_spatial_world(spread: float, airborne: bool, expected: str) -> None:
    shape = Box(half_extents=(0.05, 0.05, 0.05))
    choice = choose(
        "auto",
        toss(spread),
        {"box": 0.05},
        {"box": shape},
        statics=(),
        plane=None,
        gravity=(0.0, 0.0, -9.81),
        parts=Parts(),
        heights_assumed=False,
        airborne=frozenset({"box"} if airborne else ()),
    )
    assert choice.kind == expected
