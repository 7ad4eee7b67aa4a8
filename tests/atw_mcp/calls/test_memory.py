"""A server's memory stays bounded after many films: what calls and long work have freed goes back to the system."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.atw_mcp.clips import write_film

FRAMES, WIDTH, HEIGHT = 40, 1920, 1080
DECODED = 3 * FRAMES * WIDTH * HEIGHT  # bytes: 0.25 GB

PROGRAM = """
import sys
from pathlib import Path

import cv2

from atw_mcp import server
from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork
from atw_mcp.calls.limits import resident_bytes
from atw_mcp.calls.results import Answer
from atw_mcp.calls.toolbox import ToolGroup
from atw_mcp.perception.video import read_frames
from tests.atw_mcp.session import Session

FILMS = ToolGroup("execution control")
small = []  # what outlives a call lies between blocks that are freed


def read(path: str) -> Answer:
    grey = [cv2.cvtColor(frame, cv2.COLOR_BGR2GRAY) for frame in read_frames(path)]
    small.append(bytes(100_000))
    return Answer(summary=f"{len(grey)} frames", data={})


@FILMS.tool("ReadNow", title="Read now")
def read_now(app: App, path: str) -> Answer:
    "Read a film at once."
    return read(path)


@FILMS.tool("ReadLong", title="Read long")
def read_long(app: App, path: str) -> LongWork:
    "Read a film as long work."
    return LongWork(path, lambda _: read(path), Answer(summary="reading", data={}), 60.0)


server.GROUPS = (*server.GROUPS, FILMS)
session = Session(Path(sys.argv[2]))
session("ReadNow", path=sys.argv[1])
before = resident_bytes()
for k in range(int(sys.argv[3])):
    session(("ReadLong", "ReadNow")[k % 2], path=sys.argv[1])
print(resident_bytes() - before)
"""


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the system does not say what a process uses")
@pytest.mark.parametrize("films", [2, pytest.param(20, marks=pytest.mark.benchmark)])
def test_memory_is_given_back_after_every_film(films: int, tmp_path: Path) -> None:
    film = write_film(tmp_path / "film.mp4", (np.full((HEIGHT, WIDTH, 3), 60 + k, np.uint8) for k in range(FRAMES)))
    arguments = [str(film), str(tmp_path / "atw.db"), str(films)]
    done = subprocess.run([sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True, check=True)
    assert int(done.stdout.splitlines()[-1]) < 0.2 * DECODED


MODELLING = """
import sys
from pathlib import Path

from atw_mcp.calls.limits import resident_bytes
from tests.atw_mcp.session import Session

session = Session(Path(sys.argv[1]))
length = {"first_pixel": [0, 100], "second_pixel": [100, 100], "length": 1.0, "view": "side"}
ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "color": "red"}
used = []
for film in sys.argv[2:]:
    made = session("ModelVideo", video=film, known_length=length, objects=[ball], patience_seconds=600)
    session("InspectFrames", case=made["case"], frames=[0, 5])
    used.append(resident_bytes())
print(used[-1] - used[0])
"""
GROWTH = 150_000_000  # bytes: twice what 20 films were seen to leave, and a fifth of what the caches may hold


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="the system does not say what a process uses")
@pytest.mark.benchmark  # few films could not grow so far
def test_a_server_that_models_many_films_does_not_grow_with_them(tmp_path: Path) -> None:
    """The first film loads the kernels; those after it differ in where the ball goes."""
    paths = [str(tmp_path / f"film{number}.mp4") for number in range(20)]
    for number, path in enumerate(paths):
        writer = cv2.VideoWriter(path, cv2.VideoWriter.fourcc(*"mp4v"), 30, (320, 240))
        for t in np.arange(30) / 30:
            picture = np.full((240, 320, 3), 150, np.uint8)
            x, z = 0.3 + (1.5 + 0.05 * number) * t, 0.4 + 4.0 * t - 4.905 * t * t
            centre = (round(1600 * x), round(16 * (220 - 100 * z)))
            cv2.circle(picture, centre, 160, (40, 40, 200), -1, cv2.LINE_AA, shift=4)
            writer.write(picture)
        writer.release()
    arguments = [str(tmp_path / "atw.db"), *paths]
    done = subprocess.run(
        [sys.executable, "-c", MODELLING, *arguments], capture_output=True, text=True, check=True, cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(Path(__file__).parents[3])},
    )  # fmt: skip
    assert int(done.stdout.splitlines()[-1]) < GROWTH
