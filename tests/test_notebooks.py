"""The notebooks run from their first cell to their last and find what their data were made with."""

from __future__ import annotations

import ast
import asyncio
import inspect
import json
from pathlib import Path
from types import CodeType
from typing import Any

import numpy as np
import pytest

FOLDER = Path(__file__).parents[1] / ".docs" / "notebooks"


def cells(name: str) -> list[CodeType]:
    """Return the code of a notebook, which may await at the top level, without the lines that IPython alone reads."""
    notebook = json.loads((FOLDER / f"{name}.ipynb").read_text(encoding="utf-8"))
    code = [cell["source"] for cell in notebook["cells"] if cell["cell_type"] == "code"]
    texts = ["".join(line for line in lines if not line.startswith("%")) for lines in code]
    return [compile(text, name, "exec", flags=ast.PyCF_ALLOW_TOP_LEVEL_AWAIT) for text in texts]


def run(name: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Any]:
    """Run a notebook in a folder of its own and return its variables."""
    monkeypatch.chdir(folder)
    names: dict[str, Any] = {}

    async def every() -> None:
        for cell in cells(name):
            if inspect.isawaitable(ends := eval(cell, names)):
                await ends

    asyncio.run(every())
    return names


def test_every_notebook_is_code_without_results() -> None:
    paths = sorted(FOLDER.glob("*.ipynb"))
    assert [path.stem for path in paths if not cells(path.stem)] == []
    for path in paths:
        kept = json.loads(path.read_text(encoding="utf-8"))["cells"]
        assert [cell["id"] for cell in kept if cell.get("outputs")] == []


def test_the_bearing_of_a_pendulum_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = run("pendulum", tmp_path, monkeypatch)
    assert found["gap"].names == ("joint_damping",)
    assert found["gap"].world.joints[0].damping == pytest.approx(found["BRAKE"], rel=0.01)


@pytest.mark.benchmark
def test_drag_and_lift_are_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = run("drag_and_lift", tmp_path, monkeypatch)
    assert set(found["gap"].names) == {"quadratic_drag", "magnus_lift"}
    values = {effect.name: effect.parameters["coefficient"] for effect in found["gap"].world.effects}
    assert values["quadratic_drag"] == pytest.approx(found["DRAG"], rel=0.01)
    assert values["magnus_lift"] == pytest.approx(found["LIFT"], rel=0.01)
    np.testing.assert_allclose(*found["across"], atol=20.0)  # [rad/s]


@pytest.mark.benchmark
def test_the_restitution_of_a_filmed_ball_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = run("bouncing_ball", tmp_path, monkeypatch)
    assert found["restitution"]["value"] == pytest.approx(found["RESTITUTION"], abs=0.01)
    # A livelier ball is higher 2 s after it was let go.
    assert len(found["asked"]["data"]["answers"]) == 2
