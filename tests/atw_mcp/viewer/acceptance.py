"""Stores to look at, the commands that show them, and a reader of what their pages show."""

from __future__ import annotations

import os
import queue
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter

from atw_mcp.calls.app import App
from atw_mcp.cli import main
from atw_mcp.worlds.rollouts import compute_rollout, rollout_from
from evidence_store import Evidence, EvidenceStore
from polyworld.edits.interventions import Intervention, branch
from polyworld.trajectory import Rollout
from polyworld.world import World
from tests.atw_mcp.viewer.scenes import SCENES

if TYPE_CHECKING:
    from playwright.sync_api import Page

DEMOS = ("collision", "gap")
DEMO_CASE = "demo-1"
MATERIALS = ("rope", "cloth", "soft", "fluid", "tap", "joints", "discs", "fifty")
EDITS: TypeAdapter[list[Intervention]] = TypeAdapter(list[Intervention])
STARTED = 60.0  # [s] that the command that serves may take to start on a machine that is shared
AT_REST = 200.0  # [ms] without a motion of the eye, which a slow machine draws every 100 ms or so
LOOKS = 40  # so many of these until the eye has to be at rest
SCRUBBER_MARGIN = 10.0  # px; MARGIN of timeline_view.ts
Array = NDArray[np.float64]


def demo_store(name: str, folder: Path) -> Path:
    """Run a demo; returns its store."""
    command = [sys.executable, "-m", "atw_mcp", "demo", name, "--output", str(folder)]
    subprocess.run(command, check=True, capture_output=True)
    return folder / "demo.db"


def materials_store(path: Path) -> Path:
    """Write a store with a case for each material: its world, run, and the branch where the scene has one."""
    app = App(path)
    for name in MATERIALS:
        scene = SCENES[name]()
        app.store.cases.add(name, content=f"scene {name}", kind="data", path="", facts={})
        case = app.store.cases.get(name)
        app.keep_world(case, scene.world, how="given")
        app.store.cases.commit_world(name, scene.world.id)
        _run(app, name, scene.world, scene.horizon)
        if scene.edits:
            edited = branch(scene.world, EDITS.validate_python(scene.edits))
            app.keep_world(case, edited, how="intervention", parent=scene.world, detail={"edits": list(scene.edits)})
            _run(app, name, edited, scene.horizon)
    app.close()
    return path


def _run(app: App, case: str, world: World, horizon: float) -> None:
    rollout, _ = compute_rollout(app, world, horizon)
    app.store.evidence.add(
        Evidence("Rollout", {}, case=case, world=world.id, rollout=rollout, objects=world.moving_names)
    )


def report(store: Path, case: str, out: Path) -> Path:
    """Write a case's report with the command."""
    assert main(["report", case, "--store", str(store), "--out", str(out)]) == 0
    return out


@contextmanager
def served(store: Path) -> Iterator[str]:
    """Run `atw-mcp view` over a store; yields the address of its list of cases."""
    command = [sys.executable, "-m", "atw_mcp", "view", "--no-browser", "--store", str(store)]
    environment = os.environ | {"PYTHONUNBUFFERED": "1"}
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment)
    lines: queue.Queue[str] = queue.Queue()
    assert process.stdout is not None
    printed = process.stdout
    threading.Thread(target=lambda: [lines.put(line) for line in printed], daemon=True).start()
    try:
        while not (line := lines.get(timeout=STARTED)).startswith("http"):
            pass
        yield line.strip()
    finally:
        process.send_signal(signal.SIGINT)
        process.wait(20.0)


def stored_rollout(store: EvidenceStore, identifier: str) -> Rollout:
    """Read a rollout as the tools do."""
    content = store.rollouts.get(identifier)
    return rollout_from(content.document, content.arrays)


def stored_world(store: EvidenceStore, identifier: str) -> World:
    """Read a world."""
    return World.model_validate_json(store.worlds.document(identifier))


class Reader:
    """What a page shows, read as a person would come to it: by its buttons, lists and keys."""

    def __init__(self, page: Page) -> None:
        self.page = page

    def settle(self) -> None:
        """Wait until what changed is drawn."""
        self.page.evaluate("new Promise(drawn => requestAnimationFrame(() => requestAnimationFrame(drawn)))")

    def press(self, *keys: str) -> None:
        """Press keys that belong to the whole page."""
        self.page.evaluate("document.activeElement?.blur()")
        for key in keys:
            self.page.keyboard.press(key)
        self.settle()

    @property
    def time(self) -> float:
        """The clock [s]."""
        return float(self.page.get_attribute(".clock", "data-time") or "nan")

    def scrub(self, share: float) -> float:
        """Drag the thumb to a share of all time; returns the clock [s]."""
        self.page.locator(".scrubber").scroll_into_view_if_needed()
        box = self.page.locator(".scrubber").bounding_box()
        assert box is not None
        y = box["y"] + box["height"] / 2
        room = box["width"] - 2 * SCRUBBER_MARGIN
        self.page.mouse.move(box["x"] + SCRUBBER_MARGIN, y)
        self.page.mouse.down()
        for part in (0.3, 1.0):
            self.page.mouse.move(box["x"] + SCRUBBER_MARGIN + share * part * room, y)
        self.page.mouse.up()
        self.settle()
        return self.time

    def open_tab(self, name: str) -> None:
        """Open a panel below the timeline."""
        self.page.click(f"#tab-{name}")
        self.settle()

    def choose(self, rollout: str, compared: str | None = None) -> None:
        """Show a rollout, alone or as a ghost beside another."""
        if self.page.locator("[name=rollout]").input_value() != rollout:
            self.page.select_option("[name=rollout]", rollout)
        if compared is not None:
            self.page.select_option("[name=compared]", compared)
        elif self.page.locator("[name=compared]").count():
            self.press("1")
        self.settle()

    def rollouts(self) -> list[str]:
        """Ids of all rollouts that can be chosen."""
        found: list[str] = self.page.eval_on_selector_all("[name=rollout] option", "all => all.map(o => o.value)")
        return found

    def quantities(self) -> list[str]:
        """Names of the series that can be drawn."""
        found: list[str] = self.page.eval_on_selector_all("[name=quantity] option", "all => all.map(o => o.value)")
        return found

    def series(self, quantity: str) -> dict[tuple[str, str], float]:
        """Values of a quantity at the clock's time, of all objects, by rollout and object; NaN where none is shown."""
        if self.page.locator("[name=quantity]").input_value() != quantity:
            self.page.select_option("[name=quantity]", quantity)
        self.settle()
        for button in self.page.locator(".series .which button[aria-pressed=false]").all()[::-1]:
            button.click()
        self.settle()
        rows: list[list[str]] = self.page.eval_on_selector_all(
            f'.series tr[data-series="{quantity}"][data-rollout]',
            "rows => rows.map(r => [r.dataset.rollout, r.dataset.object, r.dataset.value])",
        )
        return {(rollout, name): float(value or "nan") for rollout, name, value in rows}

    def label(self, name: str) -> Array:
        """Where the scene's name of an object points to once the eye has come to rest [px from the scene's corner]."""
        before, found = None, self._labels()
        for _ in range(LOOKS):
            self.page.wait_for_timeout(AT_REST)
            before, found = found, self._labels()
            if found == before and name in found:
                break
        assert name in found, f"no name {name} in sight, only {list(found)}"
        return np.array(found[name])

    def _labels(self) -> dict[str, list[float]]:
        self.settle()
        found: list[list[str]] = self.page.eval_on_selector_all(
            ".scene-label.name",
            "all => all.filter(l => l.checkVisibility({visibilityProperty: true}))"
            ".map(l => [l.dataset.object, l.dataset.x, l.dataset.y])",
        )
        return {name: [float(x), float(y)] for name, x, y in found}

    def data(self, selector: str) -> list[dict[str, str]]:
        """The data attributes of all elements that match."""
        found: list[dict[str, str]] = self.page.eval_on_selector_all(selector, "all => all.map(e => ({...e.dataset}))")
        return found
