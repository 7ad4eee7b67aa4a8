"""The document of a case holds the numbers of its store, and says what it lacks."""

from __future__ import annotations

import gzip
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose
from numpy.typing import NDArray

from atw_mcp.calls.app import App
from atw_mcp.viewer import records
from atw_mcp.viewer.case_document import case_document
from atw_mcp.viewer.document import ViewDocument
from atw_mcp.viewer.packing import packed, unpacked
from atw_mcp.viewer.parts import Block
from atw_mcp.worlds.rollouts import compute_rollout, rollout_from
from evidence_store import Evidence, EvidenceStore, UnknownRecord
from tests.atw_mcp.two_discs import FRAME, GAP, MEETING, SPEED, case_with, two_discs
from tests.atw_mcp.viewer.stores import ASIDE, HORIZON, SEEN, SIGMA, SIZE, discs_store, mask, opened
from tests.evidence_store.records import filled, tamper

CASE = "discs"


class Shown:
    """A document as the page gets it, with the arrays of its blocks."""

    def __init__(self, store: EvidenceStore, case: str = CASE, **options: Any) -> None:
        self.bytes = packed(*case_document(store, case, **options))
        self.document, self._arrays = unpacked(self.bytes)

    def __call__(self, block: Block | None) -> NDArray[Any]:
        assert block is not None
        return self._arrays[block.offset]


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, str, str]:
    path = tmp_path_factory.mktemp("discs") / "atw.db"
    return (path, *discs_store(path))


@pytest.fixture(scope="module")
def shown(written: tuple[Path, str, str]) -> Iterator[Shown]:
    store = opened(written[0])
    yield Shown(store)
    store.close()


@pytest.fixture
def copied(written: tuple[Path, str, str], tmp_path: Path) -> Path:
    """A copy of the store, to be damaged."""
    return Path(shutil.copy(written[0], tmp_path / "atw.db"))


def read(path: Path, case: str = CASE, **options: Any) -> ViewDocument:
    store = opened(path)
    try:
        return case_document(store, case, **options)[0]
    finally:
        store.close()


def test_motion_is_that_of_the_stored_rollouts(written: tuple[Path, str, str], shown: Shown) -> None:
    path, *ids = written
    store = opened(path)
    for view, identifier in zip(shown.document.rollouts, ids, strict=True):
        content = store.rollouts.get(identifier)
        run = rollout_from(content.document, content.arrays).trajectory
        assert view.id == identifier
        assert view.names == list(run.names)
        assert (view.status, view.why_ended, view.sampled) == ("completed", None, "")
        for block, values in (
            (view.times, run.times),
            (view.positions, run.positions),
            (view.orientations, run.orientations),
            (view.velocities, run.velocities),
            (view.spins, run.angular_velocities),
        ):
            assert_allclose(shown(block), values, rtol=1e-6, atol=1e-7)
        assert np.array_equal(shown(view.active), run.active)
    store.close()


def test_a_branch_names_its_edit_and_its_base(written: tuple[Path, str, str], shown: Shown) -> None:
    _, base, edited = written
    first, second = shown.document.rollouts
    assert (first.base, first.edits, first.label) == (None, [], "as built")
    assert (second.base, second.label) == (base, "without target")
    assert [edit.action for edit in second.edits] == ["remove"]
    world = shown.document.worlds[-1]
    assert (world.id, world.parent) == (second.world, first.world)
    assert [w.committed for w in shown.document.worlds] == [True, False]
    (comparison,) = shown.document.comparisons
    assert (comparison.base, comparison.edited, comparison.evidence) == (base, edited, "ev-4")
    (moved,) = comparison.displaced
    assert moved.object == "striker"
    assert_allclose(moved.most, SPEED * (HORIZON - MEETING), rtol=1e-3)  # the elastic disc stopped there
    assert {e.kind for e in comparison.gone} >= {"contact_begin"}


def test_time_of_a_video_without_a_world_is_that_of_its_file(tmp_path: Path) -> None:
    store = EvidenceStore(tmp_path / "atw.db")
    store.cases.add("fast", content="a", kind="video", path="fast.avi", facts={"frames_per_second": 60.0})
    store.cases.add("silent", content="b", kind="video", path="silent.avi", facts={"frames_per_second": 0.0})
    uneven = {"frames_per_second": 30.0, "clock": [0.0, 1.0, 3.0]}
    store.cases.add("uneven", content="c", kind="video", path="uneven.mp4", facts=uneven)
    store.close()
    assert read(tmp_path / "atw.db", "uneven").case.clock == [0.0, 1.0, 3.0]
    assert read(tmp_path / "atw.db", "fast").case.clock is None
    assert read(tmp_path / "atw.db", "fast").case.file_seconds_per_frame == 1 / 60
    assert read(tmp_path / "atw.db", "silent").case.file_seconds_per_frame is None


def test_events_energies_and_floor(shown: Shown) -> None:
    first = shown.document.rollouts[0]
    contact = next(e for e in first.events if e.kind == "contact_begin")
    assert_allclose(contact.time, MEETING, atol=1e-3)
    assert contact.participants == ["striker", "target"]
    assert_allclose(contact.impulse or 0.0, SPEED, rtol=1e-6)  # of 1 kg that stops
    energy = {q.object: shown(q.values) for q in first.quantities if q.name == "kinetic_energy"}
    assert_allclose(energy["striker"][:: len(energy["striker"]) - 1], [0.5 * SPEED**2, 0.0], atol=1e-6)
    assert_allclose(energy["striker"] + energy["target"], 0.5 * SPEED**2, rtol=1e-5)
    floor = shown.document.worlds[0].floor
    assert floor is not None
    assert (floor.normal, floor.offset) == ([0.0, 0.0, 1.0], 0.0)


def test_misfits_are_distances_in_the_plane_and_in_standard_deviations(shown: Shown) -> None:
    misfits = {m.object: m for m in shown.document.rollouts[0].misfits}
    assert shown.document.rollouts[1].misfits == []  # a branch is meant to differ
    striker, target = shown(misfits["striker"].distance), shown(misfits["target"].distance)
    assert_allclose(shown(misfits["striker"].times), np.arange(0, 40, 5) * FRAME, rtol=1e-6)
    assert_allclose(striker, ASIDE, rtol=1e-4)
    assert_allclose(shown(misfits["striker"].sigmas), ASIDE / SIGMA, rtol=1e-4)
    assert_allclose(misfits["striker"].rms or 0.0, ASIDE, rtol=1e-4)
    assert np.isnan(target[2])
    assert_allclose(np.delete(target, 2), 0.0, atol=1e-6)


def test_tracks_are_in_the_time_base_of_the_world(shown: Shown) -> None:
    (tracks,) = shown.document.tracks
    assert_allclose(shown(tracks.times), np.arange(0, 40, 5) * FRAME, rtol=1e-6)
    positions = shown(tracks.positions)
    assert_allclose(positions[:, 0, 1], ASIDE, rtol=1e-6)
    assert np.isnan(positions[2, 1]).all()
    assert_allclose(positions[0, 1, 0], GAP + 0.2, rtol=1e-6)
    assert_allclose(shown(tracks.sigma)[0], SIGMA, rtol=1e-6)


def test_outlines_filled_again_are_the_masks(shown: Shown) -> None:
    observed = shown.document.observed
    assert observed is not None
    assert shown(observed.frames).tolist() == list(SEEN)
    for row, outlined in enumerate(observed.objects):
        points, starts, frames = (shown(b) for b in (outlined.points, outlined.starts, outlined.frames))
        assert sorted(set(frames.tolist())) == [f for f, s in zip(SEEN, outlined.status, strict=True) if s == "visible"]
        for frame in sorted(set(frames.tolist())):
            rings = [points[starts[q] : starts[q + 1]].astype(np.int32) for q in np.flatnonzero(frames == frame)]
            filled_again = np.zeros(SIZE, dtype=np.uint8)
            cv2.fillPoly(filled_again, rings, 1)
            truth = mask(frame, row)
            wrong = (filled_again > 0) ^ truth
            edge = cv2.morphologyEx(truth.astype(np.uint8), cv2.MORPH_GRADIENT, np.ones((3, 3), np.uint8)) > 0
            assert not (wrong & ~edge).any()
            assert wrong.sum() < 0.02 * truth.sum()


def test_objects_of_equal_colour_get_distinct_ones(shown: Shown) -> None:
    observed = shown.document.observed
    assert observed is not None
    colors = {o.name: o.color for o in observed.objects}
    assert colors["striker"] != colors["target"]
    assert {m.name: m.color for m in shown.document.worlds[0].moving} == colors


def test_the_case_and_its_evidence(shown: Shown) -> None:
    document = shown.document
    assert (document.case.kind, document.case.file) == ("video", "discs.mp4")
    assert [a.evidence for a in document.case.answers] == [["ev-4"]]
    assert [e.id for e in document.evidence] == ["ev-1", "ev-2", "ev-3", "ev-4"]
    assert document.evidence[2].interval == [0.0, HORIZON]


def test_equal_stores_give_equal_bytes(shown: Shown, copied: Path) -> None:
    store = opened(copied)
    assert Shown(store).bytes == shown.bytes
    store.close()


def test_rollouts_asked_for_are_shown_first(written: tuple[Path, str, str]) -> None:
    path, base, edited = written
    assert read(path, first=[edited, base]).shown == [edited, base]
    with pytest.raises(UnknownRecord, match=base):
        read(path, first=["rollout-0"])


def test_an_unknown_case_names_those_there_are(written: tuple[Path, str, str]) -> None:
    with pytest.raises(UnknownRecord, match="discs"):
        read(written[0], case="dics")


def test_records_that_are_no_worlds_are_said_to_be_missing(tmp_path: Path) -> None:
    filled(tmp_path / "atw.db").close()
    document = read(tmp_path / "atw.db", case="ball")
    assert document.worlds == document.rollouts == []
    assert len([m for m in document.missing if m.startswith("World world-")]) == 2
    assert any(m.startswith("Rollout rollout-") for m in document.missing)


@pytest.mark.parametrize(
    ("damage", "missing"),
    [
        ("UPDATE rollouts SET document = '{}' WHERE id = '{base}'", "Rollout {base} cannot be shown"),
        ("UPDATE observations SET kind = 'x' WHERE kind = 'objects'", "Observation obs-"),
        ("UPDATE evidence SET summary = 'x' WHERE seq = 2", "ev-2 is damaged"),
        ("DELETE FROM rollouts WHERE id = '{base}'", "Rollout {base} cannot be shown"),
        ("UPDATE case_worlds SET origin = 'x'", "list of worlds cannot be read"),
        ("UPDATE answers SET answer = 'maybe'", "Questions and answers cannot be shown"),
    ],
)
def test_damaged_records_are_left_out_and_named(
    written: tuple[Path, str, str], copied: Path, damage: str, missing: str
) -> None:
    base = written[1]
    tamper(copied, damage.replace("{base}", base))
    document = read(copied)
    assert any(missing.replace("{base}", base) in sentence for sentence in document.missing), document.missing
    assert document.rollouts  # the rest is shown


def test_a_case_without_a_world_shows_what_was_observed(tmp_path: Path) -> None:
    store = EvidenceStore(tmp_path / "atw.db")
    store.cases.add("empty", content="x", kind="data", path="", facts={})
    store.evidence.add(Evidence("OpenCase", {}, case="empty"))
    document, _ = case_document(store, "empty")
    assert (document.case.kind, document.worlds, document.observed) == ("none", [], None)
    assert document.missing == ["The case has no world yet."]


def test_of_very_many_rollouts_those_used_last_are_shown(
    written: tuple[Path, str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    path, base, edited = written
    monkeypatch.setattr(records, "MOST_ROLLOUTS", 1)
    document = read(path)
    assert [r.id for r in document.rollouts] == [edited]
    assert any("1 of 2 rollouts are not shown" in sentence for sentence in document.missing)
    assert [r.id for r in read(path, first=[base]).rollouts] == [base]


def test_a_rollout_of_another_case_of_the_same_file_may_be_shown_beside(copied: Path) -> None:
    app = App(copied)
    twin = case_with(app, two_discs(), committed=False, video=Path("/clips/discs.mp4"), name="twin")
    other = two_discs().with_substep(0.001)
    app.keep_world(twin, other, how="built")
    foreign, _ = compute_rollout(app, other, 0.4)
    app.close()
    document = read(copied, first=[foreign])
    assert document.shown == [foreign]
    assert document.rollouts[-1].world == other.id


def test_several_worlds_and_rollouts_of_a_kind_are_labelled_apart(copied: Path) -> None:
    app = App(copied)
    case, world = app.store.cases.get(CASE), two_discs()
    app.keep_world(case, world.with_substep(0.001), how="built")
    longer, _ = compute_rollout(app, world, 1.4)
    app.store.evidence.add(Evidence("Rollout", {}, case=CASE, rollout=longer))
    app.close()
    document = read(copied)
    assert [w.label for w in document.worlds] == ["as built", "without target", "as built (2)"]
    assert [r.label for r in document.rollouts] == ["as built, to 1.2 s", "without target", "as built, to 1.4 s"]
    assert document.rollouts[1].base == document.rollouts[0].id  # of the same length


def test_a_document_tampered_with_is_refused() -> None:
    with pytest.raises(ValueError, match="packed view document"):
        unpacked(gzip.compress(b"some other file, long enough"))


def test_spread_is_that_of_the_members_of_the_ensemble(written: tuple[Path, str, str], copied: Path) -> None:
    app = App(copied)
    content = app.store.rollouts.get(written[1])
    rng = np.random.default_rng(0)
    middle = content.arrays["positions"]
    off = 0.01 * rng.standard_normal((40, *middle.shape))
    arrays = {
        f"{i}/{name}": values + off[i] if name == "positions" else values
        for i in range(40)
        for name, values in content.arrays.items()
    }
    inputs = {"world": content.document["world"], "members": 40}
    app.store.rollouts.put("ensemble", inputs, {"members": [content.document] * 40}, arrays)
    app.close()
    store = opened(copied)
    shown = Shown(store)
    store.close()
    view = next(r for r in shown.document.rollouts if r.id == written[1])
    assert view.spread is not None
    assert view.spread.members == 40
    assert_allclose(shown(view.spread.low), np.quantile(middle + off, 0.05, axis=0), atol=1e-6)
    assert_allclose(shown(view.spread.high), np.quantile(middle + off, 0.95, axis=0), atol=1e-6)
    assert next(r for r in shown.document.rollouts if r.id == written[2]).spread is None
