"""Fitted parameters with their spread, as the store has them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import lognorm, norm

from atw_mcp.viewer.fit_parts import FittedParameter, FitView
from atw_mcp.viewer.fits import fit_views
from atw_mcp.viewer.packing import Blocks
from evidence_store import Evidence, EvidenceStore
from tests.evidence_store.records import tamper

SAMPLE = np.random.default_rng(1).normal([0.2, 1.0, 2.0], 0.01, (64, 3))


def value(name: str, at: float, error: float | None, bounds: list[float], **more: Any) -> dict[str, Any]:
    head = {"name": name, "value": at, "unit": "1", "standard_error": error, "bounds": bounds, "at_bound": False}
    return {**head, "paths": [f"objects.{name}"], "scale": "linear", **more}


DRAWN = ("ball.friction", "ball.mass", "ball.restitution")
VALUES = [
    value("ball.friction", 0.2, 0.01, [0.0, 1.0]),
    value("ball.mass", 1.0, 0.2, [0.1, 10.0], unit="kg", scale="log"),
    value("ball.restitution", 0.95, 0.1, [0.0, 1.0], at_bound=True),
    value("cube.restitution", 0.5, None, [0.0, 1.0]),
]
CURVE = {"step": "iteration", "steps": [1, 2], "current": [3.0, 2.0], "best": [3.0, 2.0], "unit": "sigma"}
UNDETERMINED = [
    {"parameters": ["ball.restitution", "cube.restitution"], "reason": "only combinations of these are determined"},
    {"parameters": ["objects.cube.mass"], "reason": "not fitted: it meets no other body"},
]


def fitted(path: Path) -> EvidenceStore:
    store = EvidenceStore(path)
    store.cases.add("c", content="x", kind="video", path="/c.mp4", facts={})
    fit = store.fits.put("fit", {"world": "world-a"}, {})
    store.worlds.put("world-a", "{}")
    store.worlds.put("world-b", '{"b":1}', parent="world-a", how="fitted", detail={"fit": fit.id})
    draws = {f"constants/{name}": SAMPLE[:, i] for i, name in enumerate(DRAWN)}
    store.fits.put("posterior", {"world": "world-b"}, {"constants": list(DRAWN), "unknowns": []}, draws)
    data = {"world": "world-b", "from_world": "world-a", "values": VALUES, "curve": CURVE}
    data |= {"undetermined": UNDETERMINED}
    store.evidence.add(Evidence("FitWorld", {}, case="c", world="world-b", summary="good", payload={"data": data}))
    store.evidence.add(Evidence("FitWorld", {}, case="c", status="failed"))
    numbers = {"x": {"value": 0.12, "unit": "m/s^2", "interval95": [0.119, None], "paths": []}}
    added = {"world": "world-c", "from_world": "world-b", "effects": [{"name": "tilt", "unknowns": numbers}]}
    store.evidence.add(Evidence("AddEffect", {}, case="c", world="world-c", payload={"data": added}))
    return store


def by_name(view: FitView) -> dict[str, FittedParameter]:
    return {parameter.name: parameter for parameter in view.parameters}


def test_values_intervals_and_samples_are_those_of_the_store(tmp_path: Path) -> None:
    blocks, missing = Blocks(), list[str]()
    first, last = fit_views(fitted(tmp_path / "s.db"), "c", blocks, missing)
    assert (first.evidence, first.source_world, first.world) == ("ev-1", "world-a", "world-b")
    found = by_name(first)
    assert found["ball.friction"].interval95 is not None
    assert_allclose(np.array(found["ball.friction"].interval95, float), norm(0.2, 0.01).interval(0.95), rtol=1e-6)
    assert found["ball.mass"].logarithmic
    assert found["ball.mass"].interval95 is not None
    assert_allclose(np.array(found["ball.mass"].interval95, float), lognorm(0.2).interval(0.95), rtol=1e-6)
    assert found["ball.restitution"].interval95 is not None
    assert found["ball.restitution"].interval95[1] == 1.0  # nothing beyond its bounds was searched
    assert found["ball.restitution"].at_bound
    assert found["cube.restitution"].interval95 is None
    assert found["cube.restitution"].note == "determined only in combination with ball.restitution"
    for column, name in enumerate(DRAWN):
        block = found[name].sample
        assert block is not None
        stored = np.frombuffer(blocks.joined(), np.float32, 64, block.offset)
        assert_allclose(stored, SAMPLE[:, column], rtol=1e-6)
    assert by_name(last)["tilt.x"].interval95 == [0.119, None]
    assert not missing


def test_the_curve_is_that_of_the_record(tmp_path: Path) -> None:
    curve = fit_views(fitted(tmp_path / "s.db"), "c", Blocks(), [])[0].curve
    assert curve is not None
    assert (curve.step, curve.best, curve.unit) == ("iteration", [3.0, 2.0], "sigma")


@pytest.mark.parametrize(
    ("statement", "fits", "said"),
    [
        ("UPDATE evidence SET summary = 'x' WHERE seq = 1", 1, None),  # the store's listing names it itself
        ("UPDATE evidence SET payload = '{\"data\":{}}' WHERE seq = 1", 1, "The fit of ev-1 is not shown"),
        (
            "UPDATE fits SET document = '{}' WHERE kind = 'posterior'",
            2,
            "The sample of the fit of ev-1",
        ),
    ],
)
def test_damage_leaves_out_what_it_concerns_and_is_said(
    tmp_path: Path, statement: str, fits: int, said: str | None
) -> None:
    fitted(tmp_path / "s.db").close()
    tamper(tmp_path / "s.db", statement)
    missing = list[str]()
    assert len(fit_views(EvidenceStore(tmp_path / "s.db"), "c", Blocks(), missing)) == fits
    assert len(missing) == (said is not None)
    assert all(said in sentence for sentence in missing if said is not None)


def test_a_record_of_another_version_is_said_not_shown(tmp_path: Path) -> None:
    store, missing = fitted(tmp_path / "s.db"), list[str]()
    store.evidence.add(Evidence("FitWorld", {}, case="c", world="world-b", payload={"data": {"world": "world-b"}}))
    assert len(fit_views(store, "c", Blocks(), missing)) == 2
    assert missing == ["The fit of ev-4 is not shown: its record lacks 'values'."]
