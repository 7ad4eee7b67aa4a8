"""A server's memory stays bounded after many films: what calls and long work have freed goes back to the system."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

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
@pytest.mark.parametrize("films", [4, pytest.param(20, marks=pytest.mark.benchmark)])
def test_memory_is_given_back_after_every_film(films: int, tmp_path: Path) -> None:
    film = tmp_path / "film.mp4"
    writer = cv2.VideoWriter(str(film), cv2.VideoWriter.fourcc(*"mp4v"), 30, (WIDTH, HEIGHT))
    for k in range(FRAMES):
        writer.write(np.full((HEIGHT, WIDTH, 3), 60 + k, np.uint8))
    writer.release()
    arguments = [str(film), str(tmp_path / "atw.db"), str(films)]
    done = subprocess.run([sys.executable, "-c", PROGRAM, *arguments], capture_output=True, text=True, check=True)
    assert int(done.stdout.splitlines()[-1]) < 0.2 * DECODED
