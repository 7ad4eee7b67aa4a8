"""Size and time of reports, frames per second of the page, and how soon a live page shows a change.

    python -m tests.benchmarks.viewer_speed [STORE CASE ...]    # bars: 15 MB, 10 s; a report of each store's case

Without arguments both demos are run for their stores, and a CLEVRER case is modelled where its video is beside this
repository. Times are wall / CPU, as the machine may be shared. WebGL is drawn in software, so frames per second say how
a machine without a GPU fares; `own` is the page's own work on a frame, whoever draws it.
"""

from __future__ import annotations

import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

import anyio
from mcp import Client

from atw_mcp.server import build_server
from atw_mcp.viewer.packing import packed
from atw_mcp.viewer.page import page
from evidence_store import Answer, EvidenceStore
from tests.atw_mcp.viewer.acceptance import DEMO_CASE, DEMOS, Reader, demo_store, served
from tests.atw_mcp.viewer.conftest import FLAGS, INSTALLED
from tests.atw_mcp.viewer.scenes import SCENES, scene_document
from tests.benchmarks.clevrer_tools import Caller
from tests.scenes.clevrer_data import SECONDS_PER_FRAME

if TYPE_CHECKING:
    from playwright.sync_api import Browser

VIDEO = Path(__file__).parents[3] / "shared" / "data" / "clevrer" / "video_00000.mp4"
WATCHED = 4.0  # [s] of play over which frames are counted
CHANGES = 5  # of the store, of which the median latency is printed
BEGIN = "window.started = {...window.__atw, at: performance.now()}"
SPENT = """(() => {
  const [now, then] = [window.__atw, window.started], frames = now.frames - then.frames;
  return [frames / (performance.now() - then.at) * 1000, (now.updateTotalMs - then.updateTotalMs) / frames,
          (now.drawTotalMs - then.drawTotalMs) / frames];
})()"""


def command(*arguments: str) -> tuple[float, float]:
    """Run a command of the project; returns wall and CPU seconds."""
    before, begin = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
    subprocess.run([sys.executable, "-m", "atw_mcp", *arguments], check=True, capture_output=True)
    wall, after = time.perf_counter() - begin, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


async def clevrer_case(store: Path) -> str:
    """Model the CLEVRER video and a branch of it with tools, by a short fit; returns the case."""
    plane = json.loads((VIDEO.parent / "camera_homography_z0.2.json").read_text())
    async with Client(build_server(store, allow=[VIDEO])) as client:
        call = Caller(client)
        case = str((await call("OpenCase", video=str(VIDEO), name="clevrer"))["case"])
        await call("ObserveObjects", case=case)
        await call("CalibrateCamera", case=case, homography=plane["H"], plane_z=0.2)
        built = await call("BuildWorld", case=case, seconds_per_frame=SECONDS_PER_FRAME, representation="planar")
        fitted = await call("FitWorld", case=case, world=built["data"]["world"])
        await call("CommitWorld", case=case, world=fitted["data"]["world"])
        await call("Rollout", case=case)
        first = (await call("InspectWorld", case=case))["data"]["objects"][0]["name"]
        await call("Rollout", case=case, edits=[{"action": "remove", "object": first}])
    return case


def measure_report(name: str, store: Path, case: str, out: Path) -> None:
    """Print size and time of a report."""
    wall, cpu = command("report", case, "--store", str(store), "--out", str(out))
    print(f"report {name:12s} {out.stat().st_size / 1e6:6.2f} MB {wall:6.2f} s wall {cpu:6.2f} s CPU", flush=True)


def measure_page(browser: Browser, name: str, path: Path) -> None:
    """Print when the first picture is there, frames per second, and milliseconds a frame."""
    opened = browser.new_page(viewport={"width": 1280, "height": 900})
    begin = time.perf_counter()
    opened.goto(path.as_uri())
    while not opened.evaluate("window.__atw?.frames > 0"):  # `wait_for_function` would need `eval`
        opened.wait_for_timeout(20)
    first = time.perf_counter() - begin
    opened.keyboard.press(" ")
    opened.evaluate(BEGIN)
    opened.wait_for_timeout(1000 * WATCHED)
    rate, own, drawing = opened.evaluate(SPENT)
    print(
        f"page {name:14s} first picture {first:5.2f} s, {rate:5.1f} frames/s, "
        f"own {own:6.2f} ms, WebGL {drawing:6.1f} ms",
        flush=True,
    )
    opened.close()


def measure_latency(browser: Browser, store: Path, case: str) -> None:
    """Print how long after a change of the store the live page shows it."""
    with served(store) as address:
        opened = browser.new_page()
        opened.goto(f"{address}{case}/")
        opened.wait_for_selector("main")
        Reader(opened).settle()
        took = []
        for number in range(CHANGES):
            question = f"question {number}?"
            writer = EvidenceStore(store)
            writer.cases.add_question(case, question)
            writer.cases.add_answer(case, Answer(question, "true", None, (), ""))
            writer.close()
            begin = time.perf_counter()
            opened.wait_for_selector(f'[data-question="{question}"][data-answer="true"]', state="attached")
            took.append(time.perf_counter() - begin)
        print(f"live page shows a change after {sorted(took)[CHANGES // 2]:.2f} s, at most {max(took):.2f} s")
        opened.close()


def main(arguments: list[str]) -> None:
    """Print all."""
    from playwright.sync_api import sync_playwright

    load = os.getloadavg()[0]
    print(f"{os.cpu_count()} cores, load {load:.1f} at the start")
    with tempfile.TemporaryDirectory() as made, sync_playwright() as playwright:
        folder = Path(made)
        cases = {f"{Path(s).stem}": (Path(s), c) for s, c in zip(arguments[::2], arguments[1::2], strict=True)}
        if not arguments:
            cases = {demo: (demo_store(demo, folder / demo), DEMO_CASE) for demo in DEMOS}
            if VIDEO.is_file():
                store = folder / "clevrer.db"
                cases["clevrer"] = (store, anyio.run(clevrer_case, store))
        for label, (store, case) in cases.items():
            measure_report(label, store, case, folder / f"{label}.html")
        found = next((path for name in INSTALLED if (path := shutil.which(name))), None)
        browser = playwright.chromium.launch(executable_path=found, args=list(FLAGS))
        for label in cases:
            measure_page(browser, label, folder / f"{label}.html")
        for scene in ("fifty", "particles"):
            path = folder / f"{scene}.html"
            path.write_text(page(packed(*scene_document(scene, SCENES[scene]()))), encoding="utf-8")
            measure_page(browser, scene, path)
        measure_latency(browser, *next(iter(cases.values())))
        browser.close()


if __name__ == "__main__":
    main(sys.argv[1:])
