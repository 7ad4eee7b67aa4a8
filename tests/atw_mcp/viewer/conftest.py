"""Pages in a headless browser, where one is installed."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

INSTALLED = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ("--no-sandbox", "--ignore-gpu-blocklist", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")
"""WebGL in software, which every machine has, and the same on each."""


@pytest.fixture(scope="module")
def browser() -> Iterator[Browser]:
    """A headless Chromium: the one of ATW_CHROMIUM, of the system, or Playwright's own; else the test is skipped."""
    api = pytest.importorskip("playwright.sync_api", reason="Playwright is not installed: --group browser")
    found = os.environ.get("ATW_CHROMIUM") or next((path for name in INSTALLED if (path := shutil.which(name))), None)
    # Of a module, not of the session: its event loop would stay in this thread, where other tests run their own.
    with api.sync_playwright() as playwright:
        if found is None and not Path(playwright.chromium.executable_path).exists():
            pytest.skip("no Chromium is installed: `playwright install chromium`, or ATW_CHROMIUM=PATH")
        started = playwright.chromium.launch(executable_path=found, args=list(FLAGS))
        yield started
        started.close()


@dataclass
class Watched:
    """A page, what went wrong in it, and the addresses that it asked for."""

    page: Page
    errors: list[str] = field(default_factory=list)
    requests: list[str] = field(default_factory=list)


class Pages:
    """Opens pages of one test; `close` asserts that none had an error and that none left its own origin."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._opened: list[tuple[Watched, str]] = []

    def open(
        self, address: str | Path, *, width: int = 1280, height: int = 900, dark: bool = False, touch: bool = False
    ) -> Page:
        """Open a file or an address and wait until its content is shown."""
        url = address.absolute().as_uri() if isinstance(address, Path) else address
        context = self._browser.new_context(
            viewport={"width": width, "height": height}, color_scheme="dark" if dark else "light", has_touch=touch
        )
        watched = Watched(context.new_page())
        watched.page.on("console", lambda m: watched.errors.append(m.text) if m.type == "error" else None)
        watched.page.on("pageerror", lambda e: watched.errors.append(str(e)))
        watched.page.on("request", lambda r: watched.requests.append(r.url))
        self._opened.append((watched, url))
        watched.page.goto(url)
        watched.page.wait_for_selector("main, [role=alert]")
        return watched.page

    def close(self) -> None:
        """Close all pages; AssertionError where one had an error or a request to elsewhere."""
        for watched, url in self._opened:
            watched.page.context.close()
            own = url.partition("#")[0] if url.startswith("file:") else _origin(url)
            inside = (own, "blob:", "data:")
            assert not watched.errors, f"{url}: {watched.errors}"
            assert not [r for r in watched.requests if not r.startswith(inside)], url


def _origin(url: str) -> str:
    return "/".join(url.split("/")[:3]) + "/"


@pytest.fixture
def pages(browser: Browser) -> Iterator[Pages]:
    """Pages that must show no console error and send no request to elsewhere."""
    opened = Pages(browser)
    yield opened
    opened.close()
