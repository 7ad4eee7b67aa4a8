"""Reading worlds: what they contain, and how well their numbers are known."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mcp.server.mcpserver.exceptions import ToolError

from atw_mcp.calls.app import App
from atw_mcp.cases.origins import SAMPLE
from atw_mcp.tools import inspection as tools
from polyworld.edits.interventions import SetParameter, branch
from polyworld.world import World
from polyworld.world.parameters import with_parameters
from tests.atw_mcp.two_discs import RADIUS, SPEED, case_with, two_discs

FRICTIONS = np.array([0.3, 0.28, 0.29, 0.31, 0.32])


@pytest.fixture
def app(tmp_path: Path) -> App:
    app = App(tmp_path / "atw.db")
    case_with(app, two_discs(), committed=False)
    return app


def fitted_world(app: App) -> World:
    """A child of the built world whose friction and masses a fit is said to have found."""
    case, start = app.case("discs"), two_discs()
    found = {"objects.striker.friction": 0.3, "objects.target.friction": 0.3, "objects.target.mass": 2.0}
    child = with_parameters(start, found)
    common = {"from_prior": False, "at_bound": False}
    values = [
        {"name": "friction", "paths": list(found)[:2], **common},
        {"name": "objects.target.mass", "paths": ["objects.target.mass"], **common},
    ]
    undetermined = [{"parameters": ["objects.target.mass"], "reason": "only the ratio of the masses shows"}]
    fit = app.store.fits.put("fit", {"world": start.id}, {"values": values, "undetermined": undetermined})
    app.keep_world(case, child, how="fitted", parent=start, detail={"fit": fit.id})
    about = {"unknowns": [{"name": "friction", "paths": list(found)[:2], "unit": "1"}]}
    app.store.fits.put(SAMPLE, {"world": child.id}, about, {"values": FRICTIONS[:, None]})
    return child


def test_world_is_described_with_its_descent(app: App) -> None:
    child = fitted_world(app)
    answer = tools.inspect_world(app, "discs", fields=["shape", "parameters", "initial_state", "visibility"])
    assert answer.world == child.id  # the latest draft
    assert [step["how"] for step in answer.data["descent"]] == ["fitted", "built"]
    striker = answer.data["objects"][0]
    assert striker["shape"]["radius"] == RADIUS
    assert striker["initial_state"]["velocity"] == (SPEED, 0.0, 0.0)
    assert striker["starts_in_view"] is True
    assert "in_view" in answer.data["capabilities"]["predicates"]


def test_objects_can_be_chosen(app: App) -> None:
    answer = tools.inspect_world(app, "discs", objects=["target"])
    assert [item["name"] for item in answer.data["objects"]] == ["target"]


def test_fitted_value_comes_with_its_error_and_what_shares_it(app: App) -> None:
    fitted_world(app)
    (row,) = tools.read_property(app, "discs", "friction", ["striker"]).data["values"]
    assert (row["value"], row["known"]) == (0.3, "fitted")
    assert row["standard_error"] == pytest.approx(0.01 * np.sqrt(2.0))  # of 0.28, 0.29, 0.3, 0.31, 0.32
    assert row["interval80"] == pytest.approx([0.284, 0.316])
    assert row["shared_with"] == ["objects.target.friction"]


def test_value_that_was_never_inferred_is_not_called_fitted(app: App) -> None:
    fitted_world(app)
    rows = tools.read_property(app, "discs", "mass").data["values"]
    assert [(row["object"], row["known"]) for row in rows] == [("striker", "given or default"), ("target", "fitted")]
    assert "undetermined" not in rows[0]
    assert rows[1]["undetermined"] == ["only the ratio of the masses shows"]


def test_edited_value_is_distinguished_from_the_inherited_ones(app: App) -> None:
    child = fitted_world(app)
    edited = branch(child, [SetParameter(path="objects.striker.friction", value=0.1)])
    app.keep_world(app.case("discs"), edited, how="intervention", parent=child, detail={"edits": ["x"]})
    rows = tools.read_property(app, "discs", "friction", world=edited.id).data["values"]
    assert [(row["value"], row["known"]) for row in rows] == [(0.1, "edited"), (0.3, "fitted")]
    assert rows[0]["before"] == 0.3


def test_path_reads_one_number_with_unit_and_bounds(app: App) -> None:
    (row,) = tools.read_property(app, "discs", "environment.gravity.z").data["values"]
    assert (row["value"], row["unit"]) == (-9.81, "m/s^2")
    assert row["bounds"][0] < row["value"] < row["bounds"][1]


@pytest.mark.parametrize(
    ("property", "objects", "complaint"),
    [
        ("bounciness", None, "restitution"),
        ("objects.striker.bounciness", None, "objects.striker.restitution"),
        ("friction", ["strike"], "did you mean 'striker'"),
        ("objects.striker.friction", ["striker"], "leave objects out"),
    ],
)
def test_refusals_name_the_valid_choices(app: App, property: str, objects: list[str] | None, complaint: str) -> None:
    with pytest.raises(ToolError, match=complaint):
        tools.read_property(app, "discs", property, objects)
