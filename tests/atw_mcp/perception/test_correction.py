"""What the agent says about an object is believed, carried through the clip, and leaves the others alone."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.perception.correction import correct
from atw_mcp.perception.corrections import Correction, Drop, Merge, Outline, Rename, Split, correction_of
from atw_mcp.perception.masks import RunLengthMask
from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.observe import observe
from atw_mcp.perception.video import VideoError
from tests.atw_mcp.perception.clips import Clip, Disc, overlap, render

RED, BLUE = (40, 40, 170), (170, 70, 40)


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[Clip, ImageObservation]:
    """Blue passes behind red."""
    discs = [Disc(lambda t: (40 + 5.0 * t, 80), 15, BLUE), Disc(lambda t: (150 - 1.0 * t, 90), 18, RED)]
    clip = render(tmp_path_factory.mktemp("correction") / "a.mp4", discs, 34)
    observation = observe(clip.path, expected=["blue ball", "red ball"])
    assert observation.names == ("red_ball", "blue_ball") or observation.names == ("blue_ball", "red_ball")
    return clip, observation


def same(a: ImageObservation, b: ImageObservation, name: str, other: str | None = None) -> bool:
    return all(np.array_equal(a.mask(name, t), b.mask(other or name, t)) for t in a.frames)


def followed(observation: ImageObservation, clip: Clip, name: str, k: int) -> np.ndarray:
    truth = clip.truth[k]
    return np.array([overlap(observation.mask(name, t), truth[t]) for t in range(len(truth)) if truth[t].sum() > 150])


@pytest.mark.parametrize("way", ["box", "point", "mask"])
def test_object_added_in_one_frame_is_followed_through_all(scene: tuple[Clip, ImageObservation], way: str) -> None:
    clip, observation = scene
    x, y = 40 + 5.0 * 4, 80.0
    hint = {
        "box": Outline("found", 4, box=(x - 18, y - 18, 36, 36), add=True),
        "point": Outline("found", 4, positive=((x, y), (x + 6, y)), add=True),
        "mask": Outline("found", 4, mask=RunLengthMask.encode(clip.truth[0][4]), add=True),
    }[way]
    corrected = correct(observation, clip.path, [Drop("blue_ball"), hint])
    assert set(corrected.names) == {"red_ball", "found"}
    values = followed(corrected, clip, "found", 0)
    assert values.mean() > 0.9
    assert values.min() > 0.6
    assert corrected.object("found").colour.name == "blue"
    assert followed(corrected, clip, "red_ball", 1).min() > 0.85


def test_wrong_mask_is_repaired_by_a_box_where_it_was_wrong(scene: tuple[Clip, ImageObservation]) -> None:
    clip, observation = scene
    # Spoil the blue ball between frames 5 and 9: all masks moved far off.
    wrong = Outline("blue_ball", 7, mask=RunLengthMask.encode(np.roll(clip.truth[0][7], -50, axis=0)))
    spoilt = correct(observation, clip.path, [wrong])
    assert overlap(spoilt.mask("blue_ball", 7), clip.truth[0][7]) < 0.1
    x, y = 40 + 5.0 * 7, 80.0
    repaired = correct(spoilt, clip.path, [Outline("blue_ball", 7, box=(x - 18, y - 18, 36, 36))])
    assert followed(repaired, clip, "blue_ball", 0).mean() > 0.9
    assert overlap(repaired.mask("blue_ball", 7), clip.truth[0][7]) > 0.9


def test_negative_point_takes_a_part_away(scene: tuple[Clip, ImageObservation]) -> None:
    clip, observation = scene
    both = RunLengthMask.encode(clip.truth[0][14] | clip.truth[1][14])
    x0, y0 = 40 + 5.0 * 14, 80.0
    x1, y1 = 150 - 14.0, 90.0
    points = Outline(
        "blue_ball", 14, mask=both, positive=((x0 - 5, y0),), negative=((x1, y1), (x1 + 8, y1), (x1, y1 + 10))
    )
    corrected = correct(observation, clip.path, [points])
    assert overlap(corrected.mask("blue_ball", 14), clip.truth[0][14]) > 0.8


def test_split_and_merge_undo_each_other(scene: tuple[Clip, ImageObservation]) -> None:
    clip, observation = scene
    halves = correct(observation, clip.path, [Split("blue_ball", 12, "later")])
    assert halves.object("blue_ball").exit_frame == 11
    assert halves.object("later").entry_frame == 12
    assert same(halves, observation, "red_ball")
    whole = correct(halves, clip.path, [Merge("blue_ball", "later")])
    assert "later" not in whole.names
    assert same(whole, observation, "blue_ball")


def test_rename_and_drop_change_nothing_else(scene: tuple[Clip, ImageObservation]) -> None:
    clip, observation = scene
    renamed = correct(observation, clip.path, [Rename("red_ball", "target")])
    assert same(renamed, observation, "target", "red_ball")
    assert same(renamed, observation, "blue_ball")
    assert correct(renamed, clip.path, [Drop("target")]).names == ("blue_ball",)


@pytest.mark.parametrize(
    ("correction", "says"),
    [
        (Drop("ball"), r"unknown object 'ball'; objects: \["),
        (Rename("red_ball", "blue_ball"), "taken"),
        (Rename("red_ball", "a ball!"), "not a name"),
        (Merge("red_ball", "red_ball"), "two different"),
        (Split("red_ball", 0, "x"), r"1\.\.33"),
        (Outline("red_ball", 34, box=(1, 1, 9, 9)), r"0\.\.33"),
        (Outline("red_ball", 3), "needs a box"),
        (Outline("red_ball", 3, box=(500, 1, 9, 9)), "outside the image of 240 x 160"),
        (Outline("red_ball", 3, positive=((10, 500),)), "outside the image"),
        (Outline("red_ball", 3, mask=RunLengthMask(2, 2, (0, 4))), "2 x 2"),
        (Outline("blue_ball", 3, box=(1, 1, 9, 9), add=True), "taken"),
    ],
)
def test_impossible_corrections_name_what_is_possible(
    scene: tuple[Clip, ImageObservation], correction: Correction, says: str
) -> None:
    clip, observation = scene
    with pytest.raises(ObservationError, match=says):
        correct(observation, clip.path, [correction])


def test_corrections_need_the_video_they_are_about(scene: tuple[Clip, ImageObservation]) -> None:
    clip, observation = scene
    with pytest.raises(VideoError, match="no file"):
        correct(observation, clip.path.with_name("b.mp4"), [Drop("red_ball")])
    other = render(clip.path.with_name("other.mp4"), [], 6)
    with pytest.raises(ObservationError, match="not the video of this observation"):
        correct(observation, other.path, [Drop("red_ball")])


def test_corrections_are_read_from_json() -> None:
    assert correction_of({"kind": "merge", "first": "a", "second": "b"}) == Merge("a", "b")
    read = correction_of({"kind": "add", "object": "a", "frame": 3, "box": [1, 2, 30, 40], "positive": [[5, 6]]})
    assert read == Outline("a", 3, box=(1.0, 2.0, 30.0, 40.0), positive=((5.0, 6.0),), add=True)
    with pytest.raises(ObservationError, match="kinds: "):
        correction_of({"kind": "erase", "object": "a"})
    with pytest.raises(ObservationError, match="fields are"):
        correction_of({"kind": "merge", "first": "a"})
