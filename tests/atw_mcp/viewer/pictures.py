"""Small pictures of the page to compare with: `python -m tests.atw_mcp.viewer.pictures` makes those stored again.

A stored picture is a screenshot WIDTH px wide, blurred. Two are compared by the share of the area where they differ by
more than CONTRAST, which a moved panel or an empty scene does in large patches and another font, another shade of the
same colour or another renderer of WebGL only along thin lines, which the blur takes down.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.viewer.packing import packed
from atw_mcp.viewer.page import page
from tests.atw_mcp.viewer import two_rollouts
from tests.atw_mcp.viewer.scenes import SCENES, scene_document

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

FOLDER = Path(__file__).parent / "pictures"
WIDTH = 160  # px
BLUR = 1.5  # px standard deviation, of WIDTH: about a line of text on a desktop
CONTRAST = 16.0  # of 255: half of what a line of text, blurred, differs from its background
Image = NDArray[np.uint8]


@dataclass(frozen=True)
class Shot:
    """A page, the keys pressed before it is taken, and the screen."""

    html: Callable[[], str]
    keys: tuple[str, ...]
    width: int = 1280
    height: int = 900
    dark: bool = False


def _scene(name: str) -> Callable[[], str]:
    return lambda: page(packed(*scene_document(name, SCENES[name]())))


SHOTS: dict[str, Shot] = {
    "rollouts": Shot(two_rollouts.report, ("ArrowRight",) * 30),
    "cloth_side": Shot(_scene("cloth"), ("2", *("ArrowRight",) * 25), dark=True),
    "fluid": Shot(_scene("fluid"), ("ArrowRight",) * 8),
    "joints": Shot(_scene("joints"), ("3", *("ArrowRight",) * 40)),
}


def show(browser: Browser, shot: Shot, folder: Path) -> Page:
    """Open a page, press the keys, and wait until nothing moves."""
    path = folder / "page.html"
    path.write_text(shot.html(), encoding="utf-8")
    context = browser.new_context(
        viewport={"width": shot.width, "height": shot.height},
        color_scheme="dark" if shot.dark else "light",
        reduced_motion="reduce",
    )
    opened = context.new_page()
    opened.goto(path.as_uri())
    opened.wait_for_selector("main")
    for key in shot.keys:
        opened.keyboard.press(key)
    return opened


def take(opened: Page) -> Image:
    """Take a small picture once two in a row are equal."""
    before, taken = None, _small(opened.screenshot())
    while before is None or difference(before, taken) > 0:
        opened.wait_for_timeout(300)
        before, taken = taken, _small(opened.screenshot())
    return taken


def _small(png: bytes) -> Image:
    image = cv2.imdecode(np.frombuffer(png, dtype=np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    height = round(image.shape[0] * WIDTH / image.shape[1])
    small = cv2.resize(image, (WIDTH, height), interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.GaussianBlur(small, (0, 0), BLUR), dtype=np.uint8)


def difference(one: Image, other: Image) -> float:
    """Return the share of the area where two pictures differ by more than CONTRAST in a colour; 1 for other sizes."""
    if one.shape != other.shape:
        return 1.0
    return float((np.abs(one.astype(float) - other.astype(float)).max(axis=-1) > CONTRAST).mean())


def stored(name: str) -> Image:
    """Read a picture to compare with."""
    image = cv2.imread(str(FOLDER / f"{name}.png"))
    assert image is not None, f"no picture {name}: python -m tests.atw_mcp.viewer.pictures"
    return np.asarray(image, dtype=np.uint8)


def main() -> None:
    """Make all pictures again."""
    import tempfile

    from playwright.sync_api import sync_playwright

    from tests.atw_mcp.viewer.conftest import FLAGS, INSTALLED

    found = next((path for name in INSTALLED if (path := shutil.which(name))), None)
    FOLDER.mkdir(exist_ok=True)
    with sync_playwright() as playwright, tempfile.TemporaryDirectory() as folder:
        browser = playwright.chromium.launch(executable_path=found, args=list(FLAGS))
        for name, shot in SHOTS.items():
            opened = show(browser, shot, Path(folder))
            cv2.imwrite(str(FOLDER / f"{name}.png"), take(opened), [cv2.IMWRITE_PNG_COMPRESSION, 9])
            print(f"{name}: {(FOLDER / f'{name}.png').stat().st_size / 1000:.1f} kB")
            opened.context.close()
        browser.close()


if __name__ == "__main__":
    main()
