"""FitWorld of several cases of one store: blocks of one material, which share its friction."""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from atw_mcp.cli import main
from polyworld import World
from tests.atw_mcp.session import Session
from tests.polyworld.sliding_block import block_places

FRICTION, SIGMA, HALF = 0.2, 0.002, 0.05


def fitted(session: Session, folder: Path, name: str, speed: float, frames: int) -> dict[str, Any]:
    """Fit a case of one block that slides at `speed` [m/s], from noisy tracks."""
    path, rng = folder / f"{name}.csv", np.random.default_rng(frames)
    places = block_places(FRICTION, speed, frames) + rng.normal(scale=SIGMA, size=(frames, 3)) * [1.0, 1.0, 0.0]
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerows([["t", "object", "x", "y", "z"], *([0.04 * k, "block", *p] for k, p in enumerate(places))])
    session("OpenCase", data=str(path), name=name)
    session("ImportObservation", case=name, kind="tracks", path=str(path), position_sigma=SIGMA)
    block = {"name": "block", "shape": {"kind": "box", "half_extents": [HALF] * 3}, "material": "oak"}
    session("BuildWorld", case=name, objects=[block])
    found: dict[str, Any] = session("FitWorld", case=name, patience_seconds=300)["data"]
    return found


def friction(data: dict[str, Any]) -> tuple[float, float]:
    """Return the 80% interval of the material's friction."""
    low, high = next(value["interval80"] for value in data["values"] if value["name"] == "friction of oak")
    return low, high


def test_fitted_cases_pool_their_material(tmp_path: Path) -> None:
    """A short clip alone leaves friction open and names the longer one, with which it shares the constant."""
    session = Session(tmp_path / "atw.db")
    long = fitted(session, tmp_path, "long", 1.2, 14)
    assert "cases=" not in long["next"]
    short = fitted(session, tmp_path, "short", 0.4, 4)
    assert "FitWorld(case='short', cases=['long'])" in short["next"]
    pooled = session("FitWorld", case="short", cases=["long"], patience_seconds=300)["data"]
    assert pooled["study"] == ["short", "long"]
    assert "cases=" not in pooled["next"]
    low, high = friction(pooled)
    alone = friction(short)
    assert low < 1.1 * FRICTION
    assert high > 0.9 * FRICTION
    assert high - low < 0.5 * (alone[1] - alone[0])
    committed = session("CommitWorld", case="long")["source"]["world"]
    assert committed not in (long["world"], pooled["world"])  # its own world of the study


def test_motion_is_exported_beside_what_was_measured(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    session, speed, frames = Session(tmp_path / "atw.db"), 1.2, 14
    fitted(session, tmp_path, "long", speed, frames)
    out = ["export", "long", "--store", str(tmp_path / "atw.db"), "--until", "0.8", "--motion"]
    assert main([*out, str(tmp_path / "long.csv")]) == 0
    with (tmp_path / "long.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert [float(row["t"]) for row in rows] == pytest.approx(0.04 * np.arange(21))
    assert [row["x_measured"] != "" for row in rows] == [True] * frames + [False] * (21 - frames)
    true = block_places(FRICTION, speed, 21)[:, 0]
    for row, x in zip(rows, true, strict=True):
        low, high = float(row["x_low"]), float(row["x_high"])
        assert low <= float(row["x"]) <= high
        assert abs(float(row["x"]) - x) < 3.0 * (high - low)
    assert main([*out, str(tmp_path / "long.svg")]) == 0
    assert "<svg" in (tmp_path / "long.svg").read_text(encoding="utf-8")
    assert main([*out, str(tmp_path / "long.xls")]) == 1
    assert "use .csv, .svg, .png, .pdf" in capsys.readouterr().err
    session("BuildWorld", case="long", objects=[{"name": "block", "shape": {"kind": "sphere", "radius": HALF}}])
    assert main([*out, str(tmp_path / "built.csv")]) == 0
    assert "without 80% intervals: " in (said := capsys.readouterr().out)
    assert "no posterior sample" in said
    few = ["export", "long", "--store", str(tmp_path / "atw.db"), "--until", "0.12"]
    assert main([*few, "--film", str(tmp_path / "long.webp"), "--world", str(tmp_path / "long.json")]) == 0
    assert cv2.imcount(str(tmp_path / "long.webp")) == 4
    assert World.model_validate_json((tmp_path / "long.json").read_bytes()).moving_names == ("block",)
    assert main([*few, "--world", str(tmp_path / "long.xml")]) == 0
    assert "<mujoco" in (tmp_path / "long.xml").read_text(encoding="utf-8")
    assert "rebound is by damped springs" in capsys.readouterr().out
