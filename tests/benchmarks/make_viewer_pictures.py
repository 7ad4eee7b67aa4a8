"""Make the README's pictures of the viewer: `python -m tests.benchmarks.make_viewer_pictures STORE [CASE]`.

Writes `viewer.jpg`, the page of the case's report, and `viewer.webp`, its two rollouts over each other as time goes by,
to `atw_mcp/demo`. Needs the group `browser` and an installed Chromium; STORE is one that `atw-mcp demo` has left.
"""

from __future__ import annotations

import io
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

import atw_mcp.demo
from tests.atw_mcp.viewer.conftest import FLAGS, INSTALLED

FOLDER = Path(atw_mcp.demo.__file__).parent
SIZE = {"width": 1280, "height": 800}  # [px] of the page
EVERY = 2  # frames of the video between two pictures of the animation
PICTURES = 36
SECONDS = 0.08  # between two pictures
ANIMATED = 960  # [px] width of the animation
SETTLE = 600  # [ms] for a seek in the video, the outlines traced on it, and the scene


def main() -> int:
    """Make both; returns the exit code."""
    store, *rest = sys.argv[1:] or [""]
    if not store:
        print(__doc__, file=sys.stderr)
        return 2
    case = rest[0] if rest else "demo-1"
    with tempfile.TemporaryDirectory() as folder, sync_playwright() as playwright:
        report = Path(folder) / "report.html"
        command = [sys.executable, "-m", "atw_mcp", "report", case, "--store", store, "--out", str(report)]
        subprocess.run(command, check=True)
        path = next((found for name in INSTALLED if (found := shutil.which(name))), None)
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        page = browser.new_page(viewport=SIZE, color_scheme="light")
        page.goto(report.as_uri())
        page.wait_for_selector("main")
        page.keyboard.press("3")  # one rollout over the other
        _still(page)
        _animation(page)
        browser.close()
    return 0


def _still(page: Page) -> None:
    page.keyboard.press("End")
    page.wait_for_timeout(3 * SETTLE)
    Image.open(io.BytesIO(page.screenshot())).convert("RGB").save(FOLDER / "viewer.jpg", quality=88)


def _animation(page: Page) -> None:
    page.keyboard.press("Home")
    page.wait_for_timeout(2 * SETTLE)
    stage = page.locator(".stage")
    shots = []
    for _ in range(PICTURES):
        shot = Image.open(io.BytesIO(stage.screenshot())).convert("RGB")
        shots.append(shot.resize((ANIMATED, round(shot.height * ANIMATED / shot.width)), Image.Resampling.LANCZOS))
        for _ in range(EVERY):
            page.keyboard.press("ArrowRight")
        page.wait_for_timeout(SETTLE)
    milliseconds = [round(1000 * SECONDS)] * (len(shots) - 1) + [1500]
    shots[0].save(
        FOLDER / "viewer.webp", save_all=True, append_images=shots[1:], duration=milliseconds, loop=0, quality=70
    )


if __name__ == "__main__":
    sys.exit(main())
