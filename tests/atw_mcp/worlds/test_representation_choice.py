"""Planar or spatial: what flies is no level motion, though its height is hardly known, and noise of heights is."""

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
    assert chosen(toss(spread), airborne) == expected


def test_noise_of_the_height_of_a_box_on_the_floor_is_no_flight() -> None:
    for seed in range(200):
        tracks = toss(0.0)
        tracks.positions[..., 2] = 0.05 + np.random.default_rng(seed).normal(0.0, 0.005, (COUNT, 1))
        assert chosen(tracks, airborne=False) == "planar"


def chosen(tracks: ObservedTracks, airborne: bool) -> str:
    """Representation of a world of the box."""
    shape = Box(half_extents=(0.05, 0.05, 0.05))
    return choose(
        "auto",
        tracks,
        {"box": 0.05},
        {"box": shape},
        statics=(),
        plane=None,
        gravity=(0.0, 0.0, -9.81),
        parts=Parts(),
        heights_assumed=False,
        airborne=frozenset({"box"} if airborne else ()),
    ).kind
