"""The owner of a server sets limits; work that exceeds those of time and memory is refused or stopped, and says so."""

from __future__ import annotations

import time
from pathlib import Path

import pytest
from mcp.server.mcpserver.exceptions import ToolError

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import LongWork, Progress, time_left
from atw_mcp.calls.limits import VARIABLE, Limits, LimitsError, machine_memory, resident_bytes
from atw_mcp.calls.results import Answer
from atw_mcp.worlds.rollouts import compute_rollout
from polyworld.expressions.units import parse_unit
from polyworld.solver.core import patience
from polyworld.world import World
from polyworld.world.representations.rope import Rope


def waiting(progress: Progress) -> Answer:
    """Work that never ends by itself."""
    while True:
        progress.report(0.0, 1.0)
        time.sleep(0.01)


WORK = LongWork("wait", waiting, Answer(summary="waiting", data={}), 0.0)


def test_limits_come_from_a_file_or_the_environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "limits.toml"
    file.write_text("elements = 7\n")
    monkeypatch.delenv(VARIABLE, raising=False)
    assert Limits.read(None) == Limits()
    assert Limits.read(file) == Limits(elements=7)
    monkeypatch.setenv(VARIABLE, str(file))
    assert Limits.read(None).elements == 7


@pytest.mark.parametrize("text", ["elephants = 7", "elements = -1", "elements = 'many'", "elements", "\xff"])
def test_a_wrong_file_of_limits_is_refused(tmp_path: Path, text: str) -> None:
    file = tmp_path / "limits.toml"
    file.write_text(text, encoding="latin-1")
    with pytest.raises(LimitsError, match=r"limits\.toml"):
        Limits.read(file)


def test_long_work_does_not_begin_where_memory_is_used_up(tmp_path: Path) -> None:
    app = App(tmp_path / "atw.db", limits=Limits(memory_bytes=1))
    with pytest.raises(ToolError, match=r"WaitLong cannot begin: the server uses .* GB"):
        app.jobs.start("WaitLong", {}, WORK)
    used = resident_bytes()
    assert used is not None
    assert 1e6 < used < machine_memory()


def test_work_that_runs_too_long_is_stopped_and_has_failed(tmp_path: Path) -> None:
    app = App(tmp_path / "atw.db", limits=Limits(call_seconds=0.1))
    job = app.jobs.start("WaitLong", {}, WORK)
    record = app.jobs.wait_for(job.evidence, 10.0)
    assert record.status == "failed"
    assert "more than 0.1 s, the limit (call_seconds)" in record.summary


def test_a_unit_has_a_limited_length() -> None:
    with pytest.raises(ValueError, match="at most 100 characters"):
        parse_unit("*".join(["m"] * 100_000))


def test_a_rollout_that_would_take_too_long_is_refused_with_what_makes_it_slow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(patience, "TRIAL", 0.0)
    rope = Rope(name="cable", points=((0.0, 0.0, 1.0), (1.2, 0.0, 1.0)), bending_stiffness=0.5)
    app = App(tmp_path / "atw.db", limits=Limits(rollout_seconds=1e-4))
    with pytest.raises(ValueError, match=r"\(rollout_seconds\) of this server.*\. Rope 'cable': bend"):
        compute_rollout(app, World(deformables=(rope,)), 1.0)


def test_the_time_left_follows_from_what_was_done() -> None:
    assert time_left(25.0, 100.0, 20.0) == ", about 60 s left"
    assert time_left(1.0, 3.0, 3600.0) == ", about 2 h left"
    assert {time_left(0.0, 1.0, 20.0), time_left(0.5, None, 20.0), time_left(0.5, 1.0, 1.0)} == {""}
