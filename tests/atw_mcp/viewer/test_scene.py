"""The scene shows objects where the rollout has them: seen by the video's camera, between samples, and compared."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.viewer import document as view
from atw_mcp.viewer import world_parts
from atw_mcp.viewer.packing import Blocks, packed
from atw_mcp.viewer.page import page
from polyworld.world.camera import Camera
from tests.atw_mcp.viewer.blank import ball_rollout, ball_world, document

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

    from tests.atw_mcp.viewer.conftest import Pages

STEP = 0.2  # s between samples; a frame of the video takes half of it
NAMES = ["ball", "box", "cup"]
PLACES = np.array(
    [[[0.3, -0.2, 0.1], [-0.4, 0.3, 0.05], [0.1, 0.5, 0.1]], [[0.5, 0.1, 0.3], [-0.4, 0.3, 0.05], [0.1, 0.5, 0.1]]]
)
"""Positions (T, n, 3) [m]."""
MOVED = PLACES.copy()
MOVED[1, 0, 1] -= 0.3
CAMERA = Camera.model_validate(
    {
        "width": 320,
        "height": 240,
        "intrinsics": [[300.0, 2.0, 171.0], [0.0, 290.0, 112.0], [0.0, 0.0, 1.0]],
        "rotation": [[0.8, 0.6, 0.0], [0.36, -0.48, -0.8], [-0.48, 0.64, -0.6]],
        "translation": [0.05, 0.1, 2.5],
    }
)


def _world(identifier: str, names: list[str]) -> world_parts.WorldView:
    camera = world_parts.CameraView.model_validate(CAMERA.model_dump(mode="json"))
    colors = ["#d55e00"] * len(names)
    return ball_world(identifier, names, colors, 0.05, seconds_per_frame=STEP / 2, frame_count=3, camera=camera)


def _rollout(identifier: str, places: NDArray[np.float64], names: list[str], blocks: Blocks) -> view.RolloutView:
    edits = [view.EditWords(action="remove", object="cup", text="without cup")]
    branch: dict[str, Any] = {"base": "base", "edits": edits} if identifier == "branch" else {}
    times = STEP * np.arange(len(places))
    still = blocks.floats(np.zeros_like(places))
    return ball_rollout(
        identifier, names, times, places, blocks, world=f"world-{identifier}", velocities=still, **branch
    )


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A page with a rollout of three balls, and a branch without the cup in which the ball goes elsewhere."""
    blocks = Blocks()
    made = document(
        "balls",
        about={"committed_world": "world-base"},
        worlds=[_world("world-base", NAMES), _world("world-branch", NAMES[:2])],
        rollouts=[_rollout("base", PLACES, NAMES, blocks), _rollout("branch", MOVED[:, :2], NAMES[:2], blocks)],
        shown=["base"],
    )
    path = tmp_path_factory.mktemp("scene") / "balls.html"
    path.write_text(page(packed(made, blocks)), encoding="utf-8")
    return path


def _labels(opened: Page, kind: str) -> dict[str, dict[str, str]]:
    """What the labels of a kind say in full, by object."""
    opened.wait_for_timeout(200)  # the scene is drawn with the next frame of the display
    found = opened.locator(f".scene-label.{kind}").evaluate_all("labels => labels.map(one => ({...one.dataset}))")
    return {one["object"]: one for one in found}


def test_scene_shows_objects_where_the_video_sees_them(pages: Pages, report: Path) -> None:
    opened = pages.open(report, width=600, height=700)
    scene = opened.get_by_role("region", name="scene")
    scene.get_by_role("button", name="Camera").click()
    opened.keyboard.press("ArrowRight")  # a frame on: midway between two samples
    labels = _labels(opened, "name")
    left, top, width = scene.locator(".frame").evaluate(
        "({style: s}) => [s.left, s.top, s.width].map(Number.parseFloat)"
    )
    pixels = CAMERA.project(PLACES.mean(axis=0))
    for name, (u, v) in zip(NAMES, pixels, strict=True):
        seen = np.array([float(labels[name]["x"]) - left, float(labels[name]["y"]) - top]) * CAMERA.width / width
        assert seen == pytest.approx([u, v], abs=0.01), name  # pixels: float32

    opened.keyboard.press("3")
    opened.keyboard.press("End")
    apart = _labels(opened, "distance")
    assert list(apart) == ["ball"]
    assert float(apart["ball"]["value"]) == pytest.approx(0.3, abs=1e-6)
    assert list(_labels(opened, "gone")) == ["cup"]


def test_page_without_webgl_says_so(browser: Browser, report: Path) -> None:
    context = browser.new_context(viewport={"width": 600, "height": 700})
    context.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    opened = context.new_page()
    opened.goto(report.as_uri())
    said = opened.get_by_role("region", name="scene").get_by_role("alert")
    said.wait_for()
    assert "WebGL" in said.inner_text()
    assert opened.locator(".time").is_visible()
    context.close()
