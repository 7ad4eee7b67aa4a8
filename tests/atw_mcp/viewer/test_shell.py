"""The page around the scene: time, events, rollouts, series and evidence, as a person uses them."""

from __future__ import annotations

import csv
import re
from collections.abc import Iterator
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

import atw_mcp.viewer
from tests.atw_mcp.viewer.conftest import Pages
from tests.atw_mcp.viewer.two_rollouts import (
    FRAMES,
    GROUND,
    HIT,
    LATER,
    NOTED,
    REST,
    SECONDS_PER_FRAME,
    SIGMA,
    TIMES,
    positions,
    report,
)

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

STYLE = Path(atw_mcp.viewer.__file__).parent / "web" / "src" / "style.css"
FLOAT32 = 1e-6  # relative: the document holds float32


@pytest.fixture(scope="module")
def opened(browser: Browser, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Page]:
    """The page, opened once: to draw the scene in software is most of what these tests cost."""
    path = tmp_path_factory.mktemp("shell") / "report.html"
    path.write_text(report(), encoding="utf-8")
    pages = Pages(browser)
    yield pages.open(path, width=640, height=480, touch=True)
    pages.close()


@pytest.fixture
def page(opened: Page) -> Page:
    """The page as it opens: at the start, the branch as a ghost over its base, the series below."""
    opened.click("#tab-series")
    for name, value in (("rollout", "rollout-base"), ("compared", "rollout-branch")):
        opened.select_option(f"[name={name}]", value)
    opened.evaluate("document.activeElement.blur()")  # lists keep keys to themselves
    for key in ("Home", "3"):
        opened.keyboard.press(key)
    return opened


def _draw(page: Page) -> None:
    """Wait until what changed is drawn."""
    page.evaluate("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")


def _time(page: Page) -> float:
    _draw(page)
    return float(page.get_attribute(".clock", "data-time") or "nan")


def _press(page: Page, *keys: str) -> float:
    """Press keys and return the time once it is drawn."""
    for key in keys:
        page.keyboard.press(key)
    return _time(page)


def _value(page: Page, where: str) -> float:
    return float(page.get_attribute(f".series tr{where}", "data-value") or "nan")


def test_keys_move_the_clock_by_frames_and_events(page: Page) -> None:
    assert _press(page, "ArrowRight", "ArrowRight", "ArrowRight", "ArrowLeft") == pytest.approx(2 * SECONDS_PER_FRAME)
    assert [_press(page, "Shift+ArrowRight") for _ in range(4)] == pytest.approx(
        [event.time for event in (GROUND, HIT, LATER, REST)]
    )
    assert _press(page, "Shift+ArrowLeft") == pytest.approx(LATER.time)
    assert "beyond the video" in page.inner_text(".clock")
    assert _press(page, "End") == pytest.approx(TIMES[-1])
    assert _press(page, "Home") == 0
    page.keyboard.press("?")
    page.wait_for_selector("dialog[open]")
    page.keyboard.press("Escape")
    page.wait_for_selector("dialog", state="hidden")
    page.click("#tab-evidence")
    assert _press(page, "Shift+ArrowRight") == pytest.approx(GROUND.time), "a clicked button keeps no keys"
    page.keyboard.press("Home")
    page.fill("[type=search]", "")
    page.press("[type=search]", "ArrowRight")
    assert _time(page) == 0, "an input keeps its keys"


def test_series_show_the_values_of_both_rollouts_and_of_the_observation(page: Page) -> None:
    page.select_option("[name=quantity]", "x")
    page.evaluate("document.activeElement.blur()")
    now = _press(page, *["ArrowRight"] * 4)
    for branch, name in ((False, "rollout-base"), (True, "rollout-branch")):
        expected = np.interp(now, TIMES, positions(branch)[:, 0, 0])
        shown = _value(page, f"[data-object=red_ball][data-rollout={name}]")
        assert shown == pytest.approx(expected, rel=FLOAT32)
    assert _value(page, "[data-observed]") == pytest.approx(np.sin(now) + 0.01, rel=FLOAT32)
    assert f"± {SIGMA:.3f}" in page.inner_text(".series tr[data-observed]")
    assert "none in “without blue_cube”" in page.inner_text(".series table"), "the branch has no cube"
    page.select_option("[name=quantity]", "speed")
    expected = np.interp(now, TIMES, np.abs(np.gradient(positions()[:, 1, 1], TIMES)))
    assert _value(page, "[data-object=blue_cube]") == pytest.approx(expected, rel=FLOAT32)
    plot = page.locator(".series .u-over")
    box = plot.bounding_box()
    assert box is not None
    plot.click(position={"x": box["width"] / 3, "y": 40})
    assert _time(page) == pytest.approx(TIMES[-1] / 3, abs=TIMES[-1] / box["width"]), "a click goes to its moment"
    cursor = page.locator(".series .now").bounding_box()
    assert cursor is not None
    assert cursor["x"] - box["x"] == pytest.approx(box["width"] / 3, abs=2), "the plot shows the clock's time"


def test_events_are_marked_on_the_lane_of_their_rollout(page: Page) -> None:
    read = "marks => marks.map(m => [Number(m.dataset.time), m.dataset.change])"
    base = '[data-lane="rollout-base"] .mark'
    branch = '[data-lane="rollout-branch"] .mark'
    assert page.eval_on_selector_all(base, read) == [[GROUND.time, ""], [HIT.time, "gone"], [REST.time, "gone"]]
    assert page.eval_on_selector_all(branch, read) == [[GROUND.time, ""], [LATER.time, "new"]]
    page.click(f'{base}[data-time="{HIT.time}"]')
    assert _time(page) == HIT.time
    assert "red ball and blue cube, 0.7500 N s" in page.inner_text(".now")
    extent = page.locator(".film-extent")
    assert float(extent.get_attribute("data-to") or "nan") == pytest.approx((FRAMES - 1) * SECONDS_PER_FRAME)
    assert float(page.locator(".held-out").get_attribute("data-from") or "nan") == pytest.approx(1.6)
    page.click("text=with the ground")
    hidden = page.eval_on_selector_all(branch, read)
    page.click("text=with the ground")
    assert hidden == []
    page.keyboard.press("1")
    assert page.locator("[data-lane]").count() == 1, "one rollout, one lane"


def test_evidence_shows_its_rollout_and_interval(page: Page) -> None:
    assert page.locator("[data-status=truncated]").inner_text().endswith("red_ball left the world")
    assert page.get_attribute("[data-question]", "data-answer") == "true"
    page.keyboard.press("1")
    page.select_option("[name=rollout]", "rollout-branch")
    page.click("text=ev-2")
    assert page.get_attribute("[data-evidence=ev-2]", "aria-pressed") == "true", "cited by the answer"
    page.click("[data-evidence=ev-2]")
    assert page.input_value("[name=rollout]") == "rollout-base"
    assert _time(page) == pytest.approx(1.2)
    page.click("#tab-comparison")
    changes = page.eval_on_selector_all("[data-change][data-kind]:is(tr)", "rows => rows.map(r => r.dataset.change)")
    assert changes == ["gone", "new", "gone"]


def test_nothing_is_wider_than_the_screen(page: Page) -> None:
    for width in (820, 360):
        page.set_viewport_size({"width": width, "height": 740})
        _draw(page)
        assert page.evaluate("document.documentElement.scrollWidth") == width
    bar = page.locator(".transport .main").bounding_box()
    page.set_viewport_size({"width": 640, "height": 480})
    assert bar is not None
    assert bar["y"] + bar["height"] == 740, "on a phone play stays at the bottom"


def test_text_colours_stand_out_from_every_surface() -> None:
    pairs = dict(
        (name, (light, dark))
        for name, light, dark in re.findall(
            r"--([\w-]+): light-dark\((#\w{6}), (#\w{6})\);", STYLE.read_text(encoding="utf-8")
        )
    )
    text = ("ink", "ink-soft", "accent", "good", "warn", "bad", "base", "branch", "gone", "new")
    behind = ("page", "surface", "inset", "hover", "accent-soft", "good-soft", "warn-soft", "bad-soft")
    for name, surface, theme in product(text, behind, (0, 1)):
        assert _contrast(pairs[name][theme], pairs[surface][theme]) >= 4.5, (name, surface, theme)
    for theme in (0, 1):
        assert _contrast(pairs["on-accent"][theme], pairs["accent"][theme]) >= 4.5
        assert _contrast(pairs["line-strong"][theme], pairs["surface"][theme]) >= 3


def _contrast(one: str, other: str) -> float:
    """Return the contrast ratio of two colours by WCAG 2.2."""
    high, low = sorted((_luminance(one), _luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


def _luminance(color: str) -> float:
    shares = np.array([int(color[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(shares <= 0.04045, shares / 12.92, ((shares + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def test_a_link_leads_back_to_what_was_shown(browser: Browser, page: Page) -> None:
    page.click("#tab-evidence")
    now = _press(page, "ArrowRight", "ArrowRight")
    page.wait_for_url(f"**t={now:g}")
    pages = Pages(browser)
    try:
        again = pages.open(page.url, width=640, height=480)
        assert _time(again) == pytest.approx(now, abs=1e-4)
        assert again.get_attribute("#tab-evidence", "aria-selected") == "true"
        assert again.input_value("[name=compared]") == "rollout-branch"
        assert again.get_attribute(".stage", "data-layout") == "ghost"
    finally:
        pages.close()


def test_series_and_pictures_are_taken_away(page: Page, tmp_path: Path) -> None:
    page.select_option("[name=quantity]", "x")
    saved = {}
    for place, button in ((".series", "CSV"), (".series", "PNG"), (".scene", "PNG")):
        with page.expect_download() as found:
            page.click(f"{place} button:text-is('{button}')")
        found.value.save_as(path := tmp_path / f"{place}{button}")
        saved[place, button] = path
    with saved[".series", "CSV"].open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == ["source", "object", "t [s]", "position x [m]", "sigma"]
    base = [float(row[3]) for row in rows if row[:2] == ["as built", "red_ball"]]
    np.testing.assert_allclose(base, positions(False)[:, 0, 0], rtol=FLOAT32)
    np.testing.assert_allclose([float(row[4]) for row in rows if row[0] == "observed"], SIGMA, rtol=FLOAT32)
    for place in (".series", ".scene"):
        picture = cv2.imread(str(saved[place, "PNG"]))
        assert picture.std() > 5.0, "something is drawn"


def test_one_coordinate_against_another_is_drawn_and_saved(page: Page, tmp_path: Path) -> None:
    page.select_option("[name=quantity]", "y")
    page.select_option("[name=against]", "x")
    if page.query_selector(cube := ".which [data-object=blue_cube][aria-pressed=false]"):
        page.click(cube)
    saved = {}
    for button in ("CSV", "SVG"):
        with page.expect_download() as found:
            page.click(f".series button:text-is('{button}')")
        found.value.save_as(path := tmp_path / button)
        saved[button] = path.read_text(encoding="utf-8")
    with page.expect_download() as found:
        page.click(".series button:text-is('PNG')")
    found.value.save_as(path := tmp_path / "picture.png")
    assert cv2.imread(str(path)).std() > 5.0, "something is drawn"
    header, *rows = csv.reader(saved["CSV"].splitlines())
    assert header == ["source", "object", "t [s]", "position x [m]", "position y [m]"]
    base = np.array([row[3:] for row in rows if row[:2] == ["as built", "blue_cube"]], float)
    np.testing.assert_allclose(base, positions(False)[:, 1, :2], rtol=FLOAT32)
    seen = np.array([row[3:] for row in rows if row[:2] == ["observed", "red_ball"]], float)
    np.testing.assert_allclose(seen[:, 0], np.sin(np.arange(FRAMES) * SECONDS_PER_FRAME) + 0.01, rtol=FLOAT32)
    drawing = ElementTree.fromstring(saved["SVG"])
    curves = [path.get("d") or "" for path in drawing.iter("{http://www.w3.org/2000/svg}path")]
    places = np.array(re.findall(r"[-\d.]+", curves[1]), float).reshape(-1, 2)  # the ball in both rollouts beside it
    assert len(places) == len(TIMES)
    assert np.ptp(places[:, 0]) == 0.0, "the cube moves along y alone"
    np.testing.assert_allclose(places[0, 1] - places[:, 1], TIMES**2 * np.ptp(places[:, 1]) / 9, atol=0.11)  # px
    page.click(".series .plot svg", position={"x": 70, "y": 20})
    page.select_option("[name=against]", "")


def test_band_of_the_ensemble_is_drawn_about_its_rollout(page: Page, tmp_path: Path) -> None:
    page.select_option("[name=quantity]", "x")
    assert page.get_attribute("[data-members]", "data-members") == "40"
    with page.expect_download() as found:
        page.click(".series button:text-is('SVG')")
    found.value.save_as(path := tmp_path / "x.svg")
    paths = ElementTree.parse(path).getroot().iter("{http://www.w3.org/2000/svg}path")
    drawn = [(p.get("fill"), np.array(re.findall(r"[-\d.]+", p.get("d") or ""), float).reshape(-1, 2)) for p in paths]
    areas = [places for fill, places in drawn if fill != "none"]
    lines = [places for fill, places in drawn if fill == "none"]
    area, line, count = areas[0], lines[0], len(TIMES)
    low, high = area[:count], area[count:][::-1]
    np.testing.assert_allclose((low + high) / 2, line, atol=0.11)  # px
    assert np.ptp(low[:, 1] - high[:, 1]) < 0.25
    page.select_option("[name=quantity]", "speed")
    assert page.query_selector("[data-members]") is None, "the ensemble is of positions"


def test_ruler_measures_in_the_plane_of_motion(page: Page) -> None:
    page.keyboard.press("p")
    page.click(".scene button:text-is('Ruler')")
    _draw(page)
    box = page.locator(".scene svg.ruler").bounding_box()
    scale = page.locator(".scene .scale")
    assert box is not None
    text = scale.inner_text()
    metres = float(text.split()[0]) * {"m": 1.0, "cm": 1e-2, "mm": 1e-3}[text.split()[1]]
    pixels = float(scale.get_attribute("data-pixels") or "nan")
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for dx, dy in ((0, 0), (60, 0), (60, 40)):
        page.mouse.click(x + dx, y + dy)
    ruler = page.locator(".scene svg.ruler")
    assert ruler.get_attribute("data-unit") == "m"
    assert float(ruler.get_attribute("data-length") or "nan") == pytest.approx(60 * metres / pixels, rel=5e-3)
    assert float(ruler.get_attribute("data-angle") or "nan") == pytest.approx(90.0, abs=0.01)
    page.click(".scene button:text-is('Ruler')")
    page.keyboard.press("o")


def test_note_is_shown_at_its_moment(page: Page) -> None:
    assert page.query_selector("[data-note]") is None
    assert page.locator(".timeline .flag").count() == 1
    for _ in range(round(NOTED / SECONDS_PER_FRAME)):
        page.keyboard.press("ArrowRight")
    _draw(page)
    assert page.get_attribute("[data-note]", "data-note") == "ev-4"
    assert "a result of Note" in page.inner_text("[data-note]")
