"""The command line as a user or a script sees it: output, exit codes, messages."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import cv2
import pytest

from atw_mcp.cli import main
from atw_mcp.demo.truth import FOLDER
from polyworld.world import World

CLIP = str(FOLDER / "collision.mp4")


def run(capfd: pytest.CaptureFixture[str], *arguments: str) -> tuple[int, str, str]:
    try:
        code = main(list(arguments))
    except SystemExit as left:  # argparse
        code = int(left.code or 0)
    out, err = capfd.readouterr()
    return code, out, err


def test_call_prints_one_line_of_json(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    store = str(tmp_path / "atw.db")
    code, out, _ = run(capfd, "call", "OpenCase", f"video={CLIP}", 'questions=["Why?"]', "--store", store)
    assert code == 0
    assert out.count("\n") == 1
    body: dict[str, Any] = json.loads(out)
    assert body["data"]["facts"]["frame_count"] == 72
    assert body["data"]["questions"] == ["Why?"]


@pytest.mark.usefixtures("server_here")
def test_pictures_are_written_to_files(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    script = tmp_path / "look.atw"
    script.write_text("open: OpenCase video=$clip\n> look at ${open.case}\nInspectFrames case=$open.case frames=0,70\n")
    code, out, err = run(
        capfd, "run", str(script), f"clip={CLIP}", "--store", str(tmp_path / "a.db"), "--pictures", str(tmp_path / "p")
    )
    assert code == 0
    assert "look at collision" in err
    paths = json.loads(out.splitlines()[-1])["pictures"]
    assert len(paths) == 2
    for path in paths:
        image = cv2.imread(path)
        assert image is not None
        assert image.shape[1] >= 480


@pytest.mark.usefixtures("server_here")
def test_refusal_goes_to_stderr_with_exit_code_1(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    store = str(tmp_path / "atw.db")
    code, out, err = run(capfd, "call", "OpenCase", "video=/no/such/film.mp4", "--store", store)
    assert (code, out) == (1, "")
    assert "nothing at /no/such/film.mp4; nor is there its folder" in err
    assert "Traceback" not in err


def test_file_that_is_no_store_is_named_and_left_alone(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a store")
    code, _, err = run(capfd, "call", "OpenCase", "--store", str(path))
    assert code == 1
    assert f"{path} is not an evidence store" in err
    assert "Traceback" not in err
    assert path.read_text() == "not a store"


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["call", "OpenCase", "video"], "'video' is not key=value"),
        (["run", "/no/such/script"], "cannot read the script"),
        (["tools", "OpenKase"], "no tool 'OpenKase' (did you mean 'OpenCase'?); tools: OpenCase"),
        (["call"], "required: TOOL"),
        (["clal"], "invalid choice: 'clal'"),
        (["schema", "rope"], "invalid choice: 'rope'"),
    ],
)
def test_wrong_usage_has_exit_code_2(capfd: pytest.CaptureFixture[str], arguments: list[str], complaint: str) -> None:
    code, out, err = run(capfd, *arguments)
    assert (code, out) == (2, "")
    assert complaint in err


@pytest.mark.usefixtures("server_here")
def test_arguments_of_a_tool_may_follow_options(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    before = run(capfd, "call", "OpenCase", "nonsense=1", "--store", str(tmp_path / "atw.db"))
    after = run(capfd, "call", "OpenCase", "--store", str(tmp_path / "atw.db"), "nonsense=1")
    assert after == before
    assert "no argument 'nonsense'" in after[2]
    code, _, err = run(capfd, "tools", "OpenCase", "x=1")
    assert code == 2
    assert "unrecognized arguments: x=1" in err


def test_unknown_tool_is_wrong_usage(capfd: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    code, _, err = run(capfd, "call", "OpenKase", "--store", str(tmp_path / "atw.db"))
    assert code == 2
    assert "there is no tool 'OpenKase' (did you mean 'OpenCase'?); tools: OpenCase" in err


def test_schema_of_a_world_describes_what_a_world_accepts(capfd: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capfd, "schema", "world")
    assert code == 0
    assert set(json.loads(out)["properties"]) == set(World.model_fields)


def test_tools_lists_each_tool_with_its_purpose(capfd: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capfd, "tools")
    assert code == 0
    assert {"OpenCase", "Rollout", "Finish"} <= {line.split()[0] for line in out.splitlines()}
    assert all(40 < len(line) < 150 for line in out.splitlines())
    assert "horizon_seconds" in run(capfd, "tools", "Rollout")[1]


def test_bare_command_serves_and_leaves_with_its_client(tmp_path: Path) -> None:
    request = {"jsonrpc": "2.0", "id": 1, "method": "ping"}
    finished = subprocess.run(
        [sys.executable, "-m", "atw_mcp", "--store", str(tmp_path / "atw.db")],
        input=json.dumps(request) + "\n",
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert finished.returncode == 0
    for line in finished.stdout.splitlines():  # standard output is the wire: nothing else may be on it
        assert json.loads(line)["jsonrpc"] == "2.0"


def test_version_is_printed_without_a_server(capfd: pytest.CaptureFixture[str]) -> None:
    code, out, _ = run(capfd, "--version")
    assert code == 0
    assert out.startswith("atw-mcp ")


def test_warmup_names_what_it_compiled(capfd: pytest.CaptureFixture[str]) -> None:
    code, _, err = run(capfd, "warmup")
    assert code == 0
    for name in ("planar worlds", "spatial worlds", "pictures"):
        assert f"{name}: " in err


def test_output_may_be_cut_off_by_its_reader() -> None:
    command = f"{sys.executable} -m atw_mcp schema world | head -1"
    finished = subprocess.run(command, shell=True, capture_output=True, text=True, timeout=120, check=True)
    assert finished.stdout == "{\n"
    assert "Traceback" not in finished.stderr
