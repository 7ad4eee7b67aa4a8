"""Files of others are read in a process with limits: what asks for too much is refused, and nothing goes on running."""

from __future__ import annotations

import multiprocessing
import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from polyworld.core.interruption import Interrupted, Interruption
from polyworld.exchange import ImportLimits, import_confined, import_world

pytest.importorskip("mujoco")
BALL = '<mujoco><worldbody><body name="a"><freejoint/><geom size="0.1" mass="2"/></body></worldbody></mujoco>'
GRID = '<replicate count="1000" offset="1 0 0">'


def written(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_a_file_is_read_as_without_limits(tmp_path: Path) -> None:
    path = written(tmp_path / "ball.xml", BALL)
    asked: list[Path] = []
    found = import_confined(path, read=lambda other: asked.append(other) or other.read_bytes())  # type: ignore[func-returns-value]
    assert found == import_world(path)
    assert asked == [path]
    assert not multiprocessing.active_children()


@pytest.mark.parametrize("inside", ['<geom size="0.1"/>', ""])
def test_elements_are_counted_before_anything_is_made_of_them(tmp_path: Path, inside: str) -> None:
    many = f"<mujoco><worldbody>{GRID * 3}{inside}{'</replicate>' * 3}</worldbody></mujoco>"
    started = time.process_time()
    with pytest.raises(ValueError, match="makes more than 20,000 elements"):
        import_world(written(tmp_path / "many.xml", many))
    assert time.process_time() - started < 2.0


def test_a_reader_that_takes_too_long_is_ended(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "part.xml")  # nobody writes to it: whoever opens it waits
    path = written(tmp_path / "whole.xml", '<mujoco><include file="part.xml"/></mujoco>')
    with pytest.raises(ValueError, match=r"whole.xml takes more than 1 s to read"):
        import_confined(path, limits=ImportLimits(seconds=1.0))
    assert not multiprocessing.active_children()


def test_a_reader_that_takes_too_much_memory_is_ended(tmp_path: Path) -> None:
    heights = '<asset><hfield name="h" nrow="9000" ncol="9000" size="1 1 1 1"/></asset>'  # 324 MB in singles
    path = written(tmp_path / "high.xml", BALL.replace("<worldbody>", f"{heights}<worldbody>"))
    with pytest.raises(ValueError, match=r"high\.xml"):
        import_confined(path, limits=ImportLimits(memory=100_000_000))


def test_an_import_that_is_cancelled_ends(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "part.xml")
    path = written(tmp_path / "whole.xml", '<mujoco><include file="part.xml"/></mujoco>')
    stop = Interruption()
    threading.Timer(0.5, stop.request).start()
    with stop.active(), pytest.raises(Interrupted):
        import_confined(path)
    assert not multiprocessing.active_children()


def test_a_stage_opens_nothing_that_it_refers_to(tmp_path: Path) -> None:
    pytest.importorskip("pxr")
    os.mkfifo(tmp_path / "part.usda")
    part = f"@{tmp_path}/part.usda@"
    stages = {
        "references": f'def "robot" (references = {part}) {{}}',
        "variants": f'def "robot" (variantSets = "v")\n{{\nvariantSet "v" = {{\n"a" (payload = {part}) {{\n}}\n}}\n}}',
        "sublayers": f"(subLayers = [{part}])",
        "clips": f'def "robot" (clips = {{ dictionary default = {{ asset[] assetPaths = [{part}] }} }}) {{}}',
    }
    for name, text in stages.items():
        path = written(tmp_path / f"{name}.usda", f"#usda 1.0\n{text}\n")
        with pytest.raises(ValueError, match="refers to other files"):
            import_world(path, read=Path.read_bytes)


PROGRAM = """
import sys, time
from pathlib import Path
from polyworld.exchange import ImportLimits, import_world
from polyworld.exchange.confined import _bound, _load_readers
from tests.polyworld.exchange import random_files

_load_readers(Path("a.xml")), _load_readers(Path("a.usda"))
_bound(ImportLimits(seconds=60.0))
for seed in range(30):
    started = time.process_time()
    random_files.outcome(random_files.write(Path(sys.argv[1]), seed), import_world)
    print(seed, time.process_time() - started, flush=True)
"""


def test_random_files_are_read_or_refused_within_time_and_memory(tmp_path: Path) -> None:
    """All in one bounded process, as starting one takes longer than a file: the benchmark takes one for each."""
    pytest.importorskip("pxr")
    done = subprocess.run([sys.executable, "-c", PROGRAM, str(tmp_path)], capture_output=True, text=True, check=True)
    spent = [float(line.split()[1]) for line in done.stdout.splitlines()]
    assert len(spent) == 30
    assert max(spent) < 10.0  # seconds
