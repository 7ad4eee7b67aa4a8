"""The viewer in the page of an MCP host: from the handshake to calls back into the server. See `host_page`."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pytest

from atw_mcp.calls.app import App
from atw_mcp.cases.cases import content_hash
from atw_mcp.viewer import in_parts, records
from evidence_store import EvidenceStore
from tests.atw_mcp.clips import write_clip
from tests.atw_mcp.session import Session
from tests.atw_mcp.two_discs import two_discs
from tests.atw_mcp.viewer.host_page import bundled, hosting

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Frame, Page

pytestmark = pytest.mark.benchmark
WIDTH = 700  # [px]
FULL = {"width": 1100, "height": 900}  # [px]


@pytest.fixture(scope="module")
def compared(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """A store with a video, a world, a rollout of it and two branches."""
    folder = tmp_path_factory.mktemp("app")
    session, clip = Session(folder / "atw.db"), write_clip(folder / "discs.mp4")
    app = App(session.store)
    facts = {"bytes": clip.stat().st_size}
    app.store.cases.add("discs", content=content_hash(clip), kind="video", path=str(clip), facts=facts)
    world = two_discs()
    app.keep_world(app.store.cases.get("discs"), world, how="built")
    app.store.cases.commit_world("discs", world.id)
    for edits in ([], [{"action": "remove", "object": "target"}], [{"action": "remove", "object": "striker"}]):
        session("Rollout", case="discs", edits=edits)
    return session


@pytest.fixture(scope="module")
def script() -> str:
    """The script of the host page."""
    return bundled()


class Shown:
    """A host page with the app in it."""

    def __init__(self, page: Page, address: str) -> None:
        self.page, self._address = page, address

    @property
    def app(self) -> Frame:
        """The innermost frame."""
        return self.page.frames[-1]

    def start(self, tool: str, arguments: dict[str, Any], **options: Any) -> str:
        """Have the host call a tool and show its app; returns the revision of the protocol that was agreed on."""
        wanted = {"tool": tool, "arguments": arguments, "era": "auto", "sandbox": self._address, "width": WIDTH}
        revision: str = self.page.evaluate("wanted => host.start(wanted)", {**wanted, "theme": "light", **options})
        self.app.wait_for_selector(".hostbar, [role=alert]")
        return revision

    def heard(self, method: str) -> list[dict[str, Any]]:
        """Parameters of what the app sent by a method."""
        sent: list[dict[str, Any]] = self.page.evaluate("host.heard")
        return [message["params"] for message in sent if message["method"] == method]

    def wait_for(self, method: str, about: Callable[[dict[str, Any]], bool] = bool) -> dict[str, Any]:
        """Wait until the app sends something by a method."""
        for _ in range(100):
            found = [params for params in self.heard(method) if about(params)]
            if found:
                return found[-1]
            self.page.wait_for_timeout(100)
        raise AssertionError(f"no {method} among {self.page.evaluate('host.heard')}")


@contextmanager
def host(browser: Browser, session: Session, script: str) -> Iterator[Shown]:
    """A page whose host serves a store; asserts that nothing went wrong in it and that no request left it."""
    with hosting(session.server, script) as (address, sandbox):
        page = browser.new_page(viewport={"width": FULL["width"], "height": FULL["height"]})
        errors, requests = [], []
        page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda e: errors.append(str(e)))
        page.on("request", lambda r: requests.append(r.url))
        page.goto(address)
        yield Shown(page, sandbox)
        assert page.evaluate("host.failed") == []
        page.close()
        assert errors == []
        origins = (address.removesuffix("host.html"), sandbox.removesuffix("sandbox.html"), "data:", "blob:")
        assert [url for url in requests if not url.startswith(origins)] == []


def rollouts_of(store: Path) -> list[str]:
    opened = EvidenceStore(store)
    try:
        return [str(row.rollout) for row in opened.evidence.of_case("discs") if row.tool == "Rollout"]
    finally:
        opened.close()


@pytest.mark.parametrize("era", ["auto", "legacy"])
def test_a_result_is_shown_in_the_conversation(compared: Session, browser: Browser, script: str, era: str) -> None:
    base, edited, _ = rollouts_of(compared.store)
    with host(browser, compared, script) as shown:
        revision = shown.start("CompareWorlds", {"base": base, "edited": edited}, era=era)
        assert (revision >= "2026") == (era == "auto")
        [hello] = shown.heard("ui/initialize")
        assert hello["appCapabilities"] == {"availableDisplayModes": ["inline", "fullscreen"]}
        assert len(shown.heard("ui/notifications/initialized")) == 1
        # The document's two rollouts, read from the server: the film in a read of its own.
        shown.app.wait_for_function("document.querySelectorAll('.stage > .cell').length === 2")
        reads = [params["uri"] for params in shown.heard("resources/read")]
        assert reads[0] == f"atw://view/discs?rollouts={base},{edited}"
        assert len(reads) == 3
        bar = shown.app.locator(".hostbar")
        assert bar.get_attribute("data-tool") == "CompareWorlds"
        assert shown.app.locator("select:has(option:checked)").first.input_value() == base
        # The frame is as high as the page says it is, and needs no bar to scroll.
        height = shown.wait_for("ui/notifications/size-changed", lambda p: p["height"] > 300)["height"]
        shown.page.wait_for_function(f"document.querySelector('iframe').offsetHeight === {height}")
        assert shown.app.evaluate("document.documentElement.scrollHeight <= innerHeight")
        # All details: the frame grows.
        bar.get_by_role("button", name="More").click()
        shown.wait_for("ui/notifications/size-changed", lambda p: p["height"] > height)
        shown.page.evaluate("host.end()")


def test_people_call_back_into_the_server(
    compared: Session, browser: Browser, script: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(records, "MOST_ROLLOUTS", 2)
    monkeypatch.setattr(in_parts, "PART", 3000)
    base, edited, left_out = rollouts_of(compared.store)
    with host(browser, compared, script) as shown:
        shown.start("CompareWorlds", {"base": base, "edited": edited}, theme="dark")
        assert len(shown.heard("resources/read")) > 3
        bar = shown.app.locator(".hostbar")
        assert shown.app.evaluate("getComputedStyle(document.documentElement).colorScheme") == "dark"
        # The result as the server keeps it.
        evidence = bar.get_attribute("data-evidence")
        bar.get_by_role("button", name=f"Read {evidence}").click()
        text = bar.locator(f"[data-read={evidence}]").inner_text()
        assert shown.heard("tools/call") == [{"name": "ReadEvidence", "arguments": {"evidence": evidence}}]
        assert base in text
        assert "CompareWorlds" in text
        # A rollout that the document leaves out.
        others = bar.get_by_label("other rollouts of the case")
        others.select_option(left_out)
        uri = f"atw://view/discs?rollouts={left_out}"
        shown.wait_for("resources/read", lambda params: params["uri"] == uri)
        shown.app.wait_for_selector(f"select:has(option[value='{left_out}']:checked)")
        # What the model is to know with the next question.
        bar.get_by_role("button", name="Ask about this moment").click()
        context = shown.wait_for("ui/update-model-context")
        assert f"rollout {left_out}" in context["content"][0]["text"]
        assert "0.000 s" in context["content"][0]["text"]
        # The host's other theme and the whole screen.
        shown.page.evaluate("host.theme('light')")
        shown.app.wait_for_selector("html[data-theme=light]")
        bar.get_by_role("button", name="Full screen").click()
        assert shown.wait_for("ui/request-display-mode") == {"mode": "fullscreen"}
        shown.app.wait_for_selector("html[data-host=fullscreen] .below")
        assert shown.app.evaluate("[innerWidth, innerHeight]") == [FULL["width"], FULL["height"]]
        way_back = bar.get_by_role("button", name="Back to the conversation")
        box = way_back.bounding_box()
        assert box is not None
        assert box["y"] + box["height"] < FULL["height"] / 4  # in sight, above the film
        way_back.click()
        shown.app.wait_for_selector("html[data-host=inline]")
        assert [params["mode"] for params in shown.heard("ui/request-display-mode")] == ["fullscreen", "inline"]


def test_a_host_that_lets_nothing_be_read_is_named(compared: Session, browser: Browser, script: str) -> None:
    base, edited, _ = rollouts_of(compared.store)
    with host(browser, compared, script) as shown:
        shown.start("CompareWorlds", {"base": base, "edited": edited}, refuse=True)
        alert = shown.app.locator("[role=alert]").inner_text()
        assert alert.startswith("The case could not be read through the host:")
        assert "this host lets no app read resources" in alert


def test_a_refused_call_shows_why(compared: Session, browser: Browser, script: str) -> None:
    with host(browser, compared, script) as shown:
        shown.start("InspectRollout", {"case": "discs", "rollout": "rollout-0"})
        assert "rollout-0" in shown.app.locator("[role=alert]").inner_text()
