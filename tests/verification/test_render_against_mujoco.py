"""The renderer beside MuJoCo's: same poses, same camera, every frame of the demo clip."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

import cv2
import numpy as np
import pytest

from polyworld.pictures.render import Picture, render
from polyworld.world import World
from polyworld.world.camera import Camera
from polyworld.world.representations.rigid import RigidObject


@pytest.fixture(scope="module")
def truth() -> dict[str, Any]:
    loaded: dict[str, Any] = json.loads((resources.files("atw_mcp") / "demo" / "collision.json").read_text())
    return loaded


@pytest.fixture(scope="module")
def pictures(truth: dict[str, Any]) -> list[Picture]:
    camera = Camera.model_validate(truth["camera"])
    objects = tuple(
        RigidObject(name=n, shape=truth["objects"][n]["shape"], position=(0.0, 0.0, 0.0)) for n in truth["names"]
    )
    world = World(objects=objects)
    return [
        render(world, np.array(p), np.array(q), camera)
        for p, q in zip(truth["positions"], truth["orientations"], strict=True)
    ]


def test_masks_have_the_area_and_centroid_mujoco_measures(truth: dict[str, Any], pictures: list[Picture]) -> None:
    compared = 0
    for picture, masks in zip(pictures, truth["masks"], strict=True):
        for index, name in enumerate(truth["names"]):
            if name not in masks:
                continue
            area, u, v = masks[name]
            rows, columns = np.nonzero(picture.mask(index))
            # MuJoCo draws a cylinder as a prism, inscribed: its masks are up to 1 % smaller.
            assert len(rows) == pytest.approx(area, rel=0.015, abs=3)
            assert np.hypot(columns.mean() - u, rows.mean() - v) < 0.5
            compared += 1
    assert compared > 200


def test_masks_cover_the_coloured_pixels_of_the_clip(truth: dict[str, Any], pictures: list[Picture]) -> None:
    video = cv2.VideoCapture(str(resources.files("atw_mcp") / "demo" / "collision.mp4"))
    overlaps = []
    for picture in pictures:
        ok, frame = video.read()
        assert ok
        saturated = np.ptp(frame.astype(int), axis=2) > 60  # the table is grey, the bodies are not
        drawn = picture.labels >= 0
        overlaps.append((saturated & drawn).sum() / (saturated | drawn).sum())
    assert not video.read()[0]
    assert len(overlaps) == truth["frame_count"]
    assert min(overlaps) > 0.93
