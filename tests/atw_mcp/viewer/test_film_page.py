"""The page shows the frame of its clock, with outlines where the engine's own renderer sees the objects."""

from __future__ import annotations

import base64
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.perception.video import read_frames
from atw_mcp.viewer.film import with_film
from atw_mcp.viewer.packing import packed
from atw_mcp.viewer.page import page
from polyworld.pictures.render import render
from polyworld.solver.rollout import rollout
from polyworld.world import World
from tests.atw_mcp.clips import write_film
from tests.atw_mcp.viewer.scenes import Scene, scene_document
from tests.atw_mcp.viewer.test_film import case_of, drawn, webm_with_late_frame

if TYPE_CHECKING:
    from playwright.sync_api import Page

    from tests.atw_mcp.viewer.conftest import Pages

WIDTH, HEIGHT = 160, 120
FRAMES, STEP = 10, 0.02  # of the video; the rollout goes on after it [s]
MIDDLE = 4
CLEVRER = Path(__file__).parents[4] / "shared" / "data" / "clevrer" / "video_00000.mp4"

GRAB = """() => {
  const video = document.querySelector(".film video");
  const canvas = new OffscreenCanvas(video.videoWidth, video.videoHeight);
  const context = canvas.getContext("2d");
  context.drawImage(video, 0, 0);
  const data = context.getImageData(0, 0, canvas.width, canvas.height).data;
  let text = "";
  for (let i = 0; i < data.length; i += 8192) text += String.fromCharCode(...data.subarray(i, i + 8192));
  return [canvas.width, canvas.height, btoa(text)];
}"""


def world() -> World:
    """A box that passes behind a ball, weightless, before a camera that is not level and not centred."""
    return World.model_validate(
        {
            "time": {"seconds_per_frame": STEP, "frame_count": FRAMES},
            "environment": {"gravity": [0, 0, 0]},
            "objects": [
                {"name": "ball", "shape": {"kind": "sphere", "radius": 0.09}, "position": [0, -0.3, 0.1]},
                {
                    "name": "box",
                    "shape": {"kind": "box", "half_extents": [0.12, 0.05, 0.08]},
                    "position": [-0.2, 0.1, 0.1],
                    "velocity": [2.0, 0, 0],
                    "angular_velocity": [0, 0, 4.0],
                },
            ],
            "camera": {
                "width": WIDTH,
                "height": HEIGHT,
                "intrinsics": [[190.0, 1.5, 88.0], [0.0, 180.0, 52.0], [0.0, 0.0, 1.0]],
                "rotation": [[1.0, 0.0, 0.0], [0.0, -0.28, -0.96], [0.0, 0.96, -0.28]],
                "translation": [0.02, 0.1, 1.2],
            },
        }
    )


def report(folder: Path, video: Path, scene: Scene, *, alone: bool = False) -> Path:
    """The page of a scene with the film of a video; alone: the film without the scene, which is slow in software."""
    document, blocks = scene_document("film", scene)
    if alone:
        document = document.model_copy(update={"worlds": [], "rollouts": [], "shown": []})
    document = with_film(document, blocks, case_of(video), video)
    assert document.film is not None, document.missing
    out = folder / "film.html"
    out.write_text(page(packed(document, blocks)), encoding="utf-8")
    return out


def shown(opened: Page, frame: int) -> NDArray[np.uint8]:
    """The video's picture (H, W, 3), blue, green, red, once the page says that a frame is on screen."""
    opened.wait_for_selector(f'.film[data-frame="{frame}"]')
    opened.wait_for_function("!document.querySelector('.film video').seeking")
    width, height, text = opened.evaluate(GRAB)
    return np.frombuffer(base64.b64decode(text), np.uint8).reshape(height, width, 4)[..., 2::-1]


def mistaken(opened: Page, originals: NDArray[np.uint8], frames: Iterable[int]) -> list[tuple[int, int]]:
    """Frames that look more like another of the original frames, with that one; the clock is moved frame by frame."""
    wrong = []
    for frame in frames:
        opened.locator(".film").evaluate("() => document.activeElement?.blur()")
        while int(opened.locator(".film").get_attribute("data-frame") or 0) < frame:
            before = opened.locator(".film").get_attribute("data-frame")
            opened.keyboard.press("ArrowRight")
            opened.wait_for_selector(f'.film:not([data-frame="{before}"])')
        errors = ((originals.astype(float) - shown(opened, frame).astype(float)) ** 2).mean(axis=(1, 2, 3))
        if int(np.argmin(errors)) != frame:
            wrong.append((frame, int(np.argmin(errors))))
    return wrong


def test_film_is_in_step_and_outlines_lie_where_the_renderer_sees_the_objects(pages: Pages, tmp_path: Path) -> None:
    video = write_film(tmp_path / "a.mp4", drawn(FRAMES, WIDTH, HEIGHT), rate=30)
    scene = Scene(world(), 0.3)
    opened = pages.open(report(tmp_path, video, scene), width=360, height=640)
    assert not mistaken(opened, read_frames(video), (0, MIDDLE))

    film = opened.locator(".film")
    opened.wait_for_selector('.film[data-simulated~="box"][data-simulated~="ball"]')
    motion = rollout(scene.world, 0.3).trajectory
    at = int(np.argmin(np.abs(motion.times - MIDDLE * STEP)))
    picture = render(scene.world, motion.positions[at], motion.orientations[at])
    area = film.locator("canvas").bounding_box()
    assert area is not None

    def under(u: int, v: int) -> str:
        opened.mouse.move(
            area["x"] + (u + 0.5) * area["width"] / WIDTH, area["y"] + (v + 0.5) * area["height"] / HEIGHT
        )
        tip = film.locator("[role=tooltip] strong")
        return tip.inner_text() if tip.count() else ""

    # Along a row through both: what is seen there, but for the pixels beside an edge, which may fall either way.
    labels = np.where(picture.labels < len(motion.names), picture.labels, -1)
    row = int(np.argmax([len(set(line)) * 1000 + np.count_nonzero(line >= 0) for line in labels]))
    columns = [u for u in range(2, WIDTH - 2, 6) if len(set(labels[row - 1 : row + 2, u - 1 : u + 2].flat)) == 1]
    names = {-1: "", **dict(enumerate(motion.names))}
    assert {names[int(labels[row, u])] for u in columns} == {"", "ball", "box"}
    assert {u: under(u, row) for u in columns} == {u: names[int(labels[row, u])] for u in columns}

    u = next(u for u in columns if names[int(labels[row, u])] == "box")
    film.locator("canvas").click(
        position={"x": (u + 0.5) * area["width"] / WIDTH, "y": (row + 0.5) * area["height"] / HEIGHT}
    )
    opened.wait_for_selector('.film[data-chosen="box"]')

    # A right angle in the plane of motion, which the camera sees askew, is measured as one.
    assert scene.world.camera is not None
    film.locator("button:text-is('Ruler')").click()
    places = np.array([[-0.2, 0.0, 0.1], [0.2, 0.0, 0.1], [0.2, 0.3, 0.1]])
    for u, v in scene.world.camera.project(places):
        opened.mouse.click(
            area["x"] + (u + 0.5) * area["width"] / WIDTH, area["y"] + (v + 0.5) * area["height"] / HEIGHT
        )
    ruler = film.locator("svg.ruler")
    assert float(ruler.get_attribute("data-length") or "nan") == pytest.approx(0.4, rel=0.01)
    assert float(ruler.get_attribute("data-angle") or "nan") == pytest.approx(90.0, abs=1.0)
    film.locator("button:text-is('Ruler')").click()
    opened.keyboard.press("w")
    opened.wait_for_selector('.film[data-simulated=""]')
    opened.keyboard.press("End")
    opened.wait_for_selector('.film[data-frame=""]')
    assert "beyond the video" in film.inner_text()


@pytest.mark.benchmark
def test_every_frame_of_a_file_that_browsers_play_is_shown_in_its_turn(pages: Pages, tmp_path: Path) -> None:
    late = webm_with_late_frame(tmp_path)
    opened = pages.open(report(tmp_path, late, Scene(world(), STEP), alone=True), width=640, height=800)
    frames = read_frames(late)
    assert not mistaken(opened, frames, range(len(frames)))
    if not CLEVRER.is_file():
        pytest.skip("no CLEVRER video in shared/data")
    opened = pages.open(report(tmp_path, CLEVRER, Scene(world(), STEP), alone=True), width=640, height=800)
    assert not mistaken(opened, read_frames(CLEVRER), range(128))
