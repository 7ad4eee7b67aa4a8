"""The committed page is what its sources give."""

from __future__ import annotations

import hashlib
import json
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import atw_mcp.viewer
from atw_mcp.viewer.typescript import FILE, typescript

FOLDER = Path(atw_mcp.viewer.__file__).parent
WEB = FOLDER / "web"
STAMP = json.loads((FOLDER / "viewer.json").read_text())
ADVICE = "run `npm install --no-package-lock && npm run build` in atw_mcp/viewer/web and commit what it wrote"


def test_types_of_the_page_are_those_of_the_document() -> None:
    assert FILE.read_text(encoding="utf-8") == typescript(), "run `python -m atw_mcp.viewer.typescript`"


def test_page_was_built_from_the_present_sources() -> None:
    names = ["build.mjs", "index.html", "package.json", "tsconfig.json"]
    names += [path.relative_to(WEB).as_posix() for path in (WEB / "src").rglob("*") if path.is_file()]
    whole = hashlib.sha256()
    for name in sorted(names):
        whole.update(f"{name}\n{hashlib.sha256((WEB / name).read_bytes()).hexdigest()}\n".encode())
    assert STAMP["sources"] == whole.hexdigest(), ADVICE
    assert STAMP["sha256"] == hashlib.sha256((FOLDER / "viewer.html").read_bytes()).hexdigest(), ADVICE


def test_page_runs_nothing_but_its_own_script() -> None:
    page = (FOLDER / "viewer.html").read_text(encoding="utf-8")
    policy = page.split('http-equiv="Content-Security-Policy" content="')[1].split('"')[0]
    rules = dict(rule.strip().split(" ", 1) for rule in policy.split(";"))
    assert rules["default-src"] == "'none'"
    assert rules["script-src"].startswith("'sha256-")
    assert "http" not in policy
    assert page.count("<script") - page.count('"<script') == 1


@pytest.fixture(scope="module")
def web(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The sources of the page with what it is made of."""
    if shutil.which("npm") is None or shutil.which("node") is None:
        pytest.skip("Node.js is not installed: the page cannot be rebuilt")
    web = tmp_path_factory.mktemp("viewer") / "web"
    shutil.copytree(WEB, web, ignore=shutil.ignore_patterns("node_modules"))
    install = ["npm", "install", "--no-package-lock", "--no-audit", "--no-fund", "--prefer-offline"]
    done = subprocess.run(install, cwd=web, capture_output=True, text=True, check=False)
    if done.returncode:
        pytest.skip(f"npm could not install what the page is made of: {done.stderr.strip()[-200:]}")
    return web


def test_rebuilt_page_has_the_same_bytes(web: Path) -> None:
    made = web.parent / "viewer.html"
    subprocess.run(["node", "build.mjs", "--out", str(made)], cwd=web, check=True)
    types = subprocess.run(["npx", "tsc", "--noEmit"], cwd=web, capture_output=True, text=True, check=False)
    assert types.returncode == 0, types.stdout
    assert made.read_bytes() == (FOLDER / "viewer.html").read_bytes(), ADVICE


ASK = """
import { build } from "esbuild";
await build({ entryPoints: ["src/frame_clock.ts"], bundle: true, format: "esm", outfile: "out/frame_clock.mjs" });
const { FrameClock } = await import("./out/frame_clock.mjs");
const { step, clock, places } = JSON.parse(process.argv[2]);
const made = new FrameClock(step, clock);
const times = places.map((place) => made.time(place));
console.log(JSON.stringify({ times, back: times.map((t) => made.frame(t)), interval: made.interval }));
"""


@pytest.mark.parametrize("clock", [None, [0.0, 1.0, 2.0, 5.0, 6.0, 6.5]])
def test_page_takes_frames_at_their_own_times(web: Path, clock: list[float] | None) -> None:
    (web / "ask.mjs").write_text(ASK)
    places = [-1.0, 0.0, 0.5, 2.5, 3.0, 4.75, 5.0, 7.0]
    asked = json.dumps({"step": 0.1, "clock": clock, "places": places})
    done = subprocess.run(["node", "ask.mjs", asked], cwd=web, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout.splitlines()[-1])
    taken = np.arange(6) if clock is None else np.array(clock)
    inside = np.clip(places, 0, 5)
    np.testing.assert_allclose(found["times"], 0.1 * (np.interp(inside, np.arange(6), taken) + places - inside))
    np.testing.assert_allclose(found["back"], places, atol=1e-12)
    assert found["interval"] == pytest.approx(0.1 * taken[-1] / 5)
