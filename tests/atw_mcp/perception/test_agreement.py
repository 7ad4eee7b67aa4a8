"""Two observations of one video: what they agree on, and which is taken."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.perception.agreement import agreement, by_agreement
from atw_mcp.perception.import_images import observation_of_masks
from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.video import load
from tests.atw_mcp.perception.clips import Clip, Disc, render

Masks = NDArray[np.bool_]
COUNT = 16


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    red = Disc(lambda t: (40.0 + 4.0 * t, 60.0), 14.0, (40, 40, 200))
    blue = Disc(lambda t: (200.0 - 4.0 * t, 110.0), 17.0, (200, 70, 40))
    return render(tmp_path_factory.mktemp("clip") / "clip.mp4", [red, blue], COUNT)


def seen(clip: Clip, masks: dict[str, Masks]) -> ImageObservation:
    info, frames = load(clip.path)
    lists = {name: list(own) for name, own in masks.items()}
    return observation_of_masks(lists, frames, ImageObservation(info, tuple(range(COUNT)), ()))


def jittered(masks: Masks) -> Masks:
    """Outlines that come and go: every second frame lacks its lower half."""
    result = masks.copy()
    for t in range(0, len(masks), 2):
        y = np.nonzero(masks[t])[0]
        result[t, int(y.mean()) :] = False
    return result


def test_objects_are_matched_by_overlap_whatever_their_names(clip: Clip) -> None:
    one = seen(clip, {"a": clip.truth[0], "b": clip.truth[1]})
    other = seen(clip, {"x": clip.truth[1], "y": jittered(clip.truth[0])})
    found = {item.first: item for item in agreement(one, other, clip.frames)}
    assert found["b"].second == "x"
    assert found["b"].mean == pytest.approx(1.0)
    assert found["a"].second == "y"
    assert found["a"].iou[1] == pytest.approx(1.0)
    assert 0.35 < found["a"].iou[0] < 0.6  # half a disc
    assert found["a"].to_dict()["frames_disagreeing"][:2] == [[0, 0], [2, 2]]
    assert found["a"].better == "first"


def test_the_steadier_of_two_outlines_is_taken(clip: Clip) -> None:
    prompted = seen(clip, {"red": jittered(clip.truth[0]), "blue": clip.truth[1]})
    other = seen(clip, {"p": clip.truth[0], "q": jittered(clip.truth[1]), "ghost": np.roll(clip.truth[0], 60, axis=1)})
    joined, _ = by_agreement(prompted, other, clip.frames, ["red", "blue"])
    assert joined.names == ("red", "blue")
    for k, name in enumerate(joined.names):
        for t in range(COUNT):
            assert (joined.mask(name, t) == clip.truth[k][t]).all()
    assert joined.object("red").confidence[0] < 0.6  # the two disagree there
    assert joined.object("red").confidence[1] == pytest.approx(0.97)
    assert any("ghost" in text for text in joined.warnings)


def test_an_object_that_one_method_loses_comes_from_the_other(clip: Clip) -> None:
    lost = clip.truth[0].copy()
    lost[6:] = False
    prompted = seen(clip, {"red": lost, "blue": clip.truth[1]})
    joined, compared = by_agreement(prompted, seen(clip, {"red": clip.truth[0]}), clip.frames, ["red"])
    assert (joined.mask("red", COUNT - 1) == clip.truth[0][-1]).all()
    assert next(c for c in compared if c.first == "red").better == "second"
    assert joined.object("blue").confidence[3] == pytest.approx(0.97 / 2, abs=1e-3)
    assert any("blue" in text and "one method" in text for text in joined.warnings)


def test_a_mask_of_nothing_in_particular_loses_however_steady_it_is(clip: Clip) -> None:
    shape = clip.truth[0].shape
    whole, corner = np.ones(shape, bool), np.zeros(shape, bool)
    corner[:, 5:45, 100:150] = True  # bare floor
    other = seen(clip, {"red": clip.truth[0], "blue": clip.truth[1]})
    joined, compared = by_agreement(seen(clip, {"red": whole, "blue": corner}), other, clip.frames, [])
    assert {c.first: c.better for c in compared} == {"red": "second", "blue": "second"}
    assert (joined.mask("red", 5) == clip.truth[0][5]).all()
    assert (joined.mask("blue", 5) == clip.truth[1][5]).all()


def test_a_known_object_that_the_first_method_never_finds_is_kept(clip: Clip) -> None:
    other = seen(clip, {"red": clip.truth[0], "blue": clip.truth[1]})
    joined, _ = by_agreement(seen(clip, {"red": clip.truth[0]}), other, clip.frames, ["red", "blue"])
    assert joined.names == ("red", "blue")
    assert (joined.mask("blue", 5) == clip.truth[1][5]).all()
    assert joined.object("blue").confidence[5] == pytest.approx(0.97 / 2, abs=1e-3)
    fewer, _ = by_agreement(seen(clip, {"red": clip.truth[0]}), other, clip.frames, ["red"])
    assert fewer.names == ("red",)


def test_other_videos_are_refused(clip: Clip) -> None:
    one = seen(clip, {"red": clip.truth[0]})
    other = replace(one, video=replace(one.video, sha256="0" * 64))
    with pytest.raises(ObservationError, match="not the same video"):
        agreement(one, other, clip.frames)
