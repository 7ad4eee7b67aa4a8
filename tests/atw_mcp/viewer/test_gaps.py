"""What the viewer shows of a gap is what the store holds and what a rollout gives."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.viewer.case_document import case_document
from atw_mcp.viewer.fit_parts import GapView
from atw_mcp.viewer.gaps import gap_views
from atw_mcp.viewer.packing import Blocks, packed
from atw_mcp.viewer.page import page
from atw_mcp.viewer.parts import Block
from evidence_store import EvidenceStore
from evidence_store.export import export_case, import_case
from tests.atw_mcp.gap.thrown_ball import DRAG, LAUNCHES, SIGMA, flown, world, write_table
from tests.atw_mcp.session import Session
from tests.atw_mcp.viewer.conftest import Pages

WAIT = {"patience_seconds": 300}
HELD_OUT = 46  # the first of 61 samples that is held out, the last quarter
STRUCK, STRIKE = 0.31, np.array([5.0, -3.0, 0.0])  # [s], [m/s]


@pytest.fixture(scope="module")
def call(tmp_path_factory: pytest.TempPathFactory) -> Session:
    """One throw of a ball: its gap, and drag added with the coefficient that it has; and one that is struck."""
    folder = tmp_path_factory.mktemp("view")
    table = write_table(folder / "ball.csv", flown(launches=LAUNCHES[1:2]))
    session = Session(folder / "atw.db")
    session("OpenCase", data=str(table), name="ball")
    session("ImportObservation", case="ball", kind="recording", path=str(table))
    session("BuildWorld", case="ball", world=world())
    session("FindDiscrepancy", case="ball", **WAIT)
    effect = {"name": "air", "kind": "quadratic_drag", "parameters": {"coefficient": DRAG}}
    added = session("AddEffect", case="ball", effect=effect, **WAIT)["data"]["world"]
    session("CommitWorld", case="ball", world=added)
    session("Rollout", case="ball", horizon_seconds=1.0)
    (rows,) = flown(drag=0.0, launches=LAUNCHES[1:2])
    rows[:, 1:] += STRIKE * np.maximum(rows[:, :1] - STRUCK, 0.0)
    session("OpenCase", data=str(write_table(folder / "struck.csv", [rows])), name="struck")
    session("ImportObservation", case="struck", kind="recording", path=str(folder / "struck.csv"))
    session("BuildWorld", case="struck", world=world())
    session("FindDiscrepancy", case="struck", **WAIT)
    return session


class Read:
    """The views of a store, and their numbers."""

    def __init__(self, store: EvidenceStore, case: str = "ball") -> None:
        self.blocks = Blocks()
        self.views, self.missing = gap_views(store, store.cases.get(case), self.blocks)

    def __call__(self, block: Block | None) -> NDArray[np.float64]:
        assert block is not None
        count = int(np.prod(block.shape))
        whole = np.frombuffer(self.blocks.joined(), "<f4", count, block.offset)
        return whole.reshape(block.shape).astype(float)

    def of(self, tool: str) -> GapView:
        """The only step of a tool."""
        (found,) = [v for v in self.views if v.tool == tool]
        return found


@pytest.fixture(scope="module")
def read(call: Session) -> Read:
    return Read(EvidenceStore(call.store))


def test_residuals_are_simulated_less_observed_in_standard_deviations(call: Session, read: Read) -> None:
    (series,) = read.of("AddEffect").series
    rows = flown(launches=LAUNCHES[1:2])[0]
    np.testing.assert_allclose(read(series.times), rows[:, 0], atol=1e-6)
    np.testing.assert_allclose(read(series.observed), rows[:, 1:], atol=1e-6)
    store = EvidenceStore(call.store)
    (rollout,) = [r.rollout for r in store.evidence.of_case("ball", tool="Rollout")]
    assert rollout is not None
    path = store.rollouts.get(rollout).arrays
    fitted = slice(0, HELD_OUT)
    rolled = np.stack([np.interp(rows[fitted, 0], path["times"], path["positions"][:, 0, a]) for a in range(3)], 1)
    np.testing.assert_allclose(read(series.after)[fitted], rolled, atol=1e-3 * SIGMA + 1e-5)
    for simulated, residual in ((series.before, series.residual_before), (series.after, series.residual_after)):
        apart, counted = (read(simulated) - read(series.observed))[fitted], read(residual)[fitted]
        sigma = np.median(apart / counted, axis=0)
        np.testing.assert_allclose(counted * sigma, apart, atol=1e-5)
        np.testing.assert_allclose(sigma, SIGMA, rtol=0.3)  # as estimated from 46 samples


def test_held_out_times_are_named_and_the_gap_there_is_the_tools(call: Session, read: Read) -> None:
    shown = read.of("AddEffect")
    assert shown.series[0].held_out == [[pytest.approx(HELD_OUT / 60, abs=1e-5), pytest.approx(1.0, abs=1e-5)]]
    assert shown.series[0].run == ""  # there is but one
    (record,) = EvidenceStore(call.store).evidence.of_case("ball", tool="AddEffect")
    sealed = EvidenceStore(call.store).evidence.get(record.id).payload["data"]["sealed"]
    assert (shown.gap_before, shown.gap_after, shown.noise) == (
        sealed["gap_before"],
        sealed["gap_after"],
        sealed["noise_floor"],
    )
    assert shown.gap_held_out
    assert shown.candidates[0].values[0].value == pytest.approx(DRAG, rel=0.05)


def test_a_jump_is_the_strike_that_nothing_in_the_world_explains(call: Session, read: Read) -> None:
    assert read.of("FindDiscrepancy").verdict == "Something is missing"
    assert read.of("FindDiscrepancy").jumps == []  # air brakes little by little
    (jump,) = Read(EvidenceStore(call.store), "struck").of("FindDiscrepancy").jumps
    assert jump.velocity_change is not None
    np.testing.assert_allclose(jump.velocity_change, STRIKE, atol=0.2)
    assert jump.time == pytest.approx(STRUCK, abs=1 / 60)
    assert jump.sigmas > 5


def test_an_exported_case_keeps_them(call: Session, read: Read, tmp_path: Path) -> None:
    export_case(EvidenceStore(call.store), "ball", tmp_path / "ball.zip")
    other = EvidenceStore(tmp_path / "other.db")
    import_case(other, tmp_path / "ball.zip")
    again = Read(other)
    assert again.views == read.views
    assert again.blocks.joined() == read.blocks.joined()
    assert again.missing == []


def test_results_without_numbers_are_shown_with_a_sentence(call: Session) -> None:
    store = EvidenceStore(call.store)
    (record,) = store.evidence.of_case("ball", tool="FindDiscrepancy")
    whole = store.evidence.get(record.id)
    payload: dict[str, Any] = {k: v for k, v in whole.payload.items() if k != "record"}
    case = store.cases.get("ball")
    older = EvidenceStore(call.store.with_name("older.db"))
    export_case(store, "ball", call.store.with_name("older.zip"))
    import_case(older, call.store.with_name("older.zip"))
    older.evidence.update(type(whole)(**{**vars(whole), "payload": payload}))
    views, missing = gap_views(older, case, Blocks())
    assert [v.series == [] for v in views] == [True, False]
    assert missing == [f"Residuals of {record.id} are not shown: an older version kept pictures of them, not numbers."]


def test_the_page_shows_these_numbers(call: Session, read: Read, pages: Pages, tmp_path: Path) -> None:
    file = tmp_path / "view.html"
    file.write_text(page(packed(*case_document(EvidenceStore(call.store), "ball"))), encoding="utf-8")
    shown = pages.open(file)
    shown.click("#tab-gap")
    added = read.of("AddEffect")
    steps = shown.locator("[data-gap-step]")
    assert [s.get_attribute("data-tool") for s in steps.all()] == ["FindDiscrepancy", "AddEffect"]
    assert steps.nth(0).locator("[data-verdict]").inner_text() == "✗ Something is missing"
    for kind, value in (("before", added.gap_before), ("after", added.gap_after), ("noise", added.noise)):
        assert float(steps.nth(1).locator(f"[data-gap={kind}]").get_attribute("data-value") or "") == value
    sizes = read(added.series[0].residual_before)
    rms = float(steps.nth(1).locator(".gap-small").get_attribute("data-rms") or "")
    assert rms == pytest.approx(np.sqrt(np.mean(sizes**2)), rel=1e-5)
    places = steps.nth(1).locator(".gap-map canvas").first
    places.press("ArrowLeft")  # the last dot
    line = steps.nth(1).locator("[data-size]")
    size = float(line.get_attribute("data-size") or "")
    assert size == pytest.approx(np.sqrt(np.mean(sizes[-1] ** 2)), rel=1e-5)
    assert "held out" in line.inner_text()
    places.press("Enter")  # the only run's time is the page's
    readout = steps.nth(1).locator(".gap-small [data-time]")
    assert float(readout.get_attribute("data-time") or "") == pytest.approx(1.0, abs=1e-5)
    assert float(readout.get_attribute("data-x-after") or "") == pytest.approx(
        read(added.series[0].residual_after)[-1, 0], rel=1e-5
    )


def test_the_page_shows_jumps(call: Session, pages: Pages, tmp_path: Path) -> None:
    store, file = EvidenceStore(call.store), tmp_path / "view.html"
    file.write_text(page(packed(*case_document(store, "struck"))), encoding="utf-8")
    shown = pages.open(file)
    shown.click("#tab-gap")
    (jump,) = Read(store, "struck").of("FindDiscrepancy").jumps
    mark = shown.locator("[data-gap-step] .jump").first
    assert float(mark.get_attribute("data-sigmas") or "") == jump.sigmas
