"""Cylinders whose axis is across the plane of a side view."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.worlds.building import Given, Scene, build_world
from polyworld.data.tracks import ObservedTracks
from polyworld.solver.rollout import rollout
from polyworld.world import MotionPlane, TimeBase
from polyworld.world.shapes import Cylinder

ACROSS = np.array([1.0, 1.0, 0.0, 0.0]) / np.sqrt(2.0)  # own z along -y
SIDE = MotionPlane(normal=(0.0, -1.0, 0.0), supports=False)


def test_a_roller_seen_along_its_axis_falls_on_its_round_side() -> None:
    """Of 0.05 m in radius and 0.4 m long, let go 0.2 m above a floor: its centre comes to rest at its radius."""
    frames, shape = np.arange(6), (6, 1)
    height = 0.25 - 4.905 * (0.01 * frames) ** 2
    tracks = ObservedTracks(
        names=("roller",),
        frames=frames,
        seconds_per_frame=0.01,
        positions=np.stack([np.zeros(6), np.zeros(6), height], axis=1)[:, None],
        position_sigma=np.full(shape, 1e-3),
        orientations=np.tile(ACROSS, (6, 1, 1)),
        confidence=np.ones(shape),
        orientation_confidence=np.ones(shape),
        symmetry=(0,),
    )
    given = {"roller": Given(shape=Cylinder(radius=0.05, half_height=0.2), mass=1.0, restitution=0.0)}
    made = build_world(
        tracks, (), given=given, scene=Scene(floor_height=0.0, motion_plane=SIDE), representation="planar",
        time=TimeBase(seconds_per_frame=0.01, frame_count=6),
    )  # fmt: skip
    assert made.world.objects[0].orientation == pytest.approx(ACROSS)
    ends = rollout(made.world, 2.0).trajectory.positions[-1, 0]
    assert ends[2] == pytest.approx(0.05, abs=1e-3)
