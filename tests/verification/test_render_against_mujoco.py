"""The renderer beside MuJoCo's: same poses, same camera; every frame of the demo clip, and shapes in many poses."""

from __future__ import annotations

import json
from importlib import resources
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

from atw_mcp.perception.video import read_frames
from polyworld.pictures.render import Picture, look_at, render
from polyworld.world import World
from polyworld.world.camera import Camera
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Capsule, Cylinder, Sphere
from tests.offscreen_gl import needs_gl


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
    frames = read_frames(str(resources.files("atw_mcp") / "demo" / "collision.mp4"))
    overlaps = []
    for picture, frame in zip(pictures, frames, strict=True):
        saturated = np.ptp(frame.astype(int), axis=2) > 60  # the table is grey, the bodies are not
        drawn = picture.labels >= 0
        overlaps.append((saturated & drawn).sum() / (saturated | drawn).sum())
    assert len(overlaps) == truth["frame_count"]
    assert min(overlaps) > 0.93


SHAPES = {
    "sphere": Sphere(radius=0.25),
    "box": Box(half_extents=(0.3, 0.15, 0.2)),
    "cylinder": Cylinder(radius=0.2, half_height=0.3),
    "capsule": Capsule(radius=0.12, half_height=0.25),
}
SIZES = {"sphere": "0.25", "box": "0.3 0.15 0.2", "cylinder": "0.2 0.3", "capsule": "0.12 0.25"}


def mujoco_labels(positions: NDArray[np.float64], quaternions: NDArray[np.float64], camera: Camera) -> Any:
    """MuJoCo's segmentation (H, W) of the shapes: index of the shape, -1 where none is seen."""

    def row(numbers: Any) -> str:
        return " ".join(map(str, np.ravel(numbers)))

    geoms = "".join(
        f"<geom type='{kind}' size='{SIZES[kind]}' pos='{row(place)}' quat='{row(turn)}'/>"
        for kind, place, turn in zip(SHAPES, positions, quaternions, strict=True)
    )
    axes = np.asarray(camera.rotation) * [[1.0], [-1.0], [-1.0]]  # x right, y up, looking along -z
    angle = np.degrees(2.0 * np.arctan(camera.height / 2.0 / camera.intrinsics[1][1]))
    model = mujoco.MjModel.from_xml_string(
        "<mujoco><visual><quality numslices='128' numstacks='128' offsamples='0'/><map znear='0.01' zfar='100'/>"
        f"<global offwidth='{camera.width}' offheight='{camera.height}'/></visual><worldbody>{geoms}"
        f"<camera name='eye' pos='{row(camera.centre)}' xyaxes='{row(axes[:2])}' fovy='{angle}'/>"
        "</worldbody></mujoco>"
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    with mujoco.Renderer(model, camera.height, camera.width) as renderer:
        renderer.enable_segmentation_rendering()
        renderer.update_scene(data, "eye")
        return renderer.render()[..., 0]


@needs_gl
@pytest.mark.parametrize("seed", range(6))
def test_outlines_agree_with_mujoco_to_a_pixel(seed: int) -> None:
    rng = np.random.default_rng(seed)
    positions = rng.uniform([-0.5, -0.5, 0.3], [0.5, 0.5, 0.9], size=(len(SHAPES), 3))
    quaternions = rng.normal(size=(len(SHAPES), 4))
    quaternions /= np.linalg.norm(quaternions, axis=1, keepdims=True)
    eye = rng.uniform([-1.5, -4.0, 0.8], [1.5, -3.0, 3.0])
    camera = look_at(eye, np.array([0.0, 0.0, 0.5]), focal=600.0, width=640, height=480)
    world = World(objects=tuple(RigidObject(name=n, shape=s, position=(0.0, 0.0, 0.0)) for n, s in SHAPES.items()))
    ours, theirs = render(world, positions, quaternions, camera).labels, mujoco_labels(positions, quaternions, camera)
    inner = maximum_filter(ours, 3) == minimum_filter(ours, 3)
    assert np.array_equal(np.unique(ours), np.arange(-1, len(SHAPES)))
    assert np.array_equal(ours[inner], theirs[inner])
    # MuJoCo's round shapes are inscribed polyhedra of 128 slices: a few pixels of an outline of thousands differ.
    assert (ours != theirs).sum() < 0.01 * (~inner).sum()
