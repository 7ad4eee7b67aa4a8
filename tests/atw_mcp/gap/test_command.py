"""`atw-mcp gap` as a shell sees it: exit codes, output, errors."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from atw_mcp.cli import main
from tests.atw_mcp.gap.thrown_ball import DRAG, flown, world, write_table


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("gap")
    write_table(folder / "ball.csv", flown())
    (folder / "world.json").write_text(json.dumps(world()))
    return folder


def arguments(folder: Path, *more: str) -> list[str]:
    return ["gap", "--world", str(folder / "world.json"), "--data", str(folder / "ball.csv"), *more]


def failure(capsys: pytest.CaptureFixture[str], *given: str) -> str:
    """What is printed where the command fails."""
    assert main(list(given)) == 1
    printed = capsys.readouterr()
    assert printed.out == ""
    return printed.err


def test_json_of_the_command_names_the_hidden_drag(folder: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(arguments(folder, "--json", "--max-effects", "1", "--effects", "quadratic_drag")) == 0
    result = json.loads(capfd.readouterr().out)
    assert result["verdict"] == "identified"
    assert [effect["name"] for effect in result["effects"]] == ["quadratic_drag"]
    assert result["effects"][0]["unknowns"]["coefficient"]["value"] == pytest.approx(DRAG, rel=0.01)
    assert result["sealed"]["closed"] > 0.95
    assert result["world"]["effects"][0]["kind"] == "quadratic_drag"


def test_words_world_and_pictures_are_written(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    better, pictures = folder / "better.json", folder / "pictures"
    options = ["--effects", "quadratic_drag", "--max-effects", "1", "--out", str(better), "--pictures", str(pictures)]
    assert main(arguments(folder, *options)) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("identified: quadratic_drag")
    assert "closed" in printed
    assert "quadratic_drag 100%" in printed
    assert json.loads(better.read_text())["effects"][0]["name"] == "quadratic_drag"
    assert {p.name for p in pictures.iterdir()} == {"residuals.png", "paths.png", "map.png"}


def test_errors_say_what_is_wrong_with_which_file(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = folder / "broken.json"
    broken.write_text('{"objects": [{"name": "ball"}]}')
    assert "shape" in failure(capsys, "gap", "--world", str(broken), "--data", str(folder / "ball.csv"))
    broken.write_text("{")
    assert "broken.json" in failure(capsys, "gap", "--world", str(broken), "--data", str(folder / "ball.csv"))
    timeless = write_table(folder / "timeless.csv", flown(), "run,object,clock,x,y,z")
    assert "column t" in failure(capsys, *arguments(folder, "--data", str(timeless)))
    stranger = folder / "stranger.csv"
    stranger.write_text((folder / "ball.csv").read_text().replace("ball", "bell"))
    message = failure(capsys, *arguments(folder, "--data", str(stranger)))
    assert "bell" in message
    assert "ball" in message
    assert "quadratic_drag" in failure(capsys, *arguments(folder, "--effects", "dragg"))
    assert "restitution" in failure(capsys, *arguments(folder, "--fit", "objects.ball.restitutionn"))
    assert "r9" in failure(capsys, *arguments(folder, "--seal", "r9"))
    assert "nothing.csv" in failure(capsys, *arguments(folder, "--data", str(folder / "nothing.csv")))


def test_lengths_in_millimetres_are_refused(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    table = write_table(folder / "millimetres.csv", [run * [1.0, 1e3, 1e3, 1e3] for run in flown()[:2]])
    message = failure(capsys, *arguments(folder, "--data", str(table), "--effects", "tilt"))
    assert "mm" in message


def test_wrong_usage_has_its_own_exit_code(folder: Path) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["gap", "--data", str(folder / "ball.csv")])
    assert ended.value.code == 2
