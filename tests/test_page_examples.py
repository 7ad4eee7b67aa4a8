"""The pages' examples of Python run as they are written, one after the other, and give what they say."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

PAGES = Path(__file__).parent.parent / ".docs" / "pages"


def test_examples_of_python_run_and_say_what_is_so(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    text = "".join((PAGES / f"{name}.md").read_text(encoding="utf-8") for name in ("python", "worlds"))
    blocks = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    assert len(blocks) == 7
    names: dict[str, Any] = {}
    for block in blocks:
        exec(block, names)
    assert names["heights"].shape == (51,)
    assert names["bounces"][0] == (
        pytest.approx(np.sqrt(2 / 9.81), abs=2e-3),
        pytest.approx(np.sqrt(2 * 9.81), rel=1e-3),
    )
    np.testing.assert_allclose(names["apex"], np.linspace(0.1, 0.9, 64) ** 2, atol=6e-3)
    whole = names["run"].trajectory
    np.testing.assert_array_equal(names["rest"].trajectory.positions, whole.positions[25:])
    # Held against its weight of 8.4 kg: 400 (0.5 - angle) = m g l sin(angle).
    x, _, z = names["state"].positions[1]
    assert 0.4 < np.arctan2(-x, 2 - z) < 0.5
    assert [o.name for o in names["imported"].world.objects] == ["ball", "rod"]
    # Made with a drag coefficient of 0.5, and 1 mm of noise.
    assert names["gap"].names == ("quadratic_drag",)
    assert names["drag"] == pytest.approx(0.5 * 0.5 * 1.2 * np.pi * 0.02**2, rel=0.02)
    low, high = names["found"].constants[0].interval
    assert low < names["drag"] < high
    assert (tmp_path / "flight.svg").read_text(encoding="utf-8").count("<path") > 10
