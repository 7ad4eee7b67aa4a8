"""What the agent says about an object is believed, carried through the clip, and leaves the others alone."""

from __future__ import annotations

import itertools
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from atw_mcp.perception.calibration import calibrate_given
from atw_mcp.perception.correction import correct
from atw_mcp.perception.corrections import Correction
from atw_mcp.perception.masks import RunLengthMask
from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.observe import observe
from atw_mcp.perception.video import VideoError
from tests.atw_mcp.clips import write_film
from tests.atw_mcp.perception.clips import Clip, Disc, overlap, plain, render

RED, BLUE = (40, 40, 170), (170, 70, 40)


def coco(mask: np.ndarray) -> dict[str, Any]:
    return RunLengthMask.encode(mask).to_dict()


def outline(name: str, frame: int, *, add: bool = False, **shape: Any) -> Correction:
    return Correction(kind="add" if add else "outline", object=name, frame=frame, **shape)


def exclude(frame: int, last: int, name: str | None = None, **region: Any) -> Correction:
    return Correction(kind="exclude", object=name, frame=frame, last_frame=last, **region)


def merge(first: str, second: str) -> Correction:
    return Correction(kind="merge", first=first, second=second)


def split(name: str, frame: int, new: str) -> Correction:
    return Correction(kind="split", object=name, frame=frame, name=new)


def rename(name: str, new: str) -> Correction:
    return Correction(kind="rename", object=name, name=new)


def drop(name: str) -> Correction:
    return Correction(kind="drop", object=name)


def stay(name: str, first: int, last: int) -> Correction:
    return Correction(kind="rest", object=name, frame=first, last_frame=last)


def place(name: str, frame: int, *position: float) -> Correction:
    return Correction(kind="place", object=name, frame=frame, position=list(position))


@pytest.fixture(scope="module")
def scene(tmp_path_factory: pytest.TempPathFactory) -> tuple[Clip, ImageObservation]:
    """Blue passes behind red."""
    discs = [Disc(lambda t: (40 + 5.0 * t, 80), 15, BLUE), Disc(lambda t: (150 - 1.0 * t, 90), 18, RED)]
    clip = render(tmp_path_factory.mktemp("correction") / "a.mp4", discs, 28)
    observation = observe(clip.path, expected=["blue ball", "red ball"])
    assert observation.names == ("red_ball", "blue_ball") or observation.names == ("blue_ball", "red_ball")
    return clip, observation


def same(a: ImageObservation, b: ImageObservation, name: str, other: str | None = None) -> bool:
    return all(np.array_equal(a.mask(name, t), b.mask(other or name, t)) for t in a.frames)


def followed(observation: ImageObservation, clip: Clip, name: str, k: int) -> np.ndarray:
    truth = clip.truth[k]
    return np.array([overlap(observation.mask(name, t), truth[t]) for t in range(len(truth)) if truth[t].sum() > 150])


@pytest.fixture(scope="module")
def crossing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Clip, ImageObservation]:
    """Blue passes behind red, with shadows; nothing of either is known."""
    discs = [Disc(lambda t: (40 + 5.0 * t, 70), 14, BLUE), Disc(lambda t: (150 - 1.0 * t, 84), 17, RED)]
    clip = render(tmp_path_factory.mktemp("constraints") / "a.mp4", discs, 24, shadows=True)
    seen = observe(clip.path)
    return clip, correct(seen, clip.path, [drop(name) for name in seen.names])


def blue(t: int, *, add: bool = True) -> Correction:
    return outline("blue", t, circle=(40 + 5.0 * t, 70, 14), add=add)


def red(t: int, *, add: bool = True) -> Correction:
    return outline("red", t, circle=(150 - 1.0 * t, 84, 17), add=add)


@pytest.fixture(scope="module")
def blue_alone(crossing: tuple[Clip, ImageObservation]) -> ImageObservation:
    """Blue followed from one circle."""
    clip, nothing = crossing
    return correct(nothing, clip.path, [blue(3)])


@pytest.fixture(scope="module")
def both(crossing: tuple[Clip, ImageObservation]) -> ImageObservation:
    """Both followed from one circle each."""
    clip, nothing = crossing
    return correct(nothing, clip.path, [blue(3), red(21)])


def test_outlines_and_masks_say_where_an_object_is(tmp_path: Path) -> None:
    """In a clip of few frames: what follows is that of a box."""
    clip = render(tmp_path / "short.mp4", [Disc(lambda t: (40 + 5.0 * t, 80), 15, BLUE)], 8)
    seen = observe(clip.path)
    corners = [(60 + 15 * np.cos(a), 80 + 15 * np.sin(a)) for a in np.linspace(0, 2 * np.pi, 13)[:-1]]
    for hint in (
        outline("found", 4, outline=corners, add=True),
        outline("found", 4, mask=coco(clip.truth[0][4]), add=True),
    ):
        found = correct(seen, clip.path, [*(drop(name) for name in seen.names), hint])
        assert found.names == ("found",)
        assert min(overlap(found.mask("found", t), clip.truth[0][t]) for t in range(8)) > 0.8


def test_centre_moves_a_found_object_where_it_was_wrong(scene: tuple[Clip, ImageObservation]) -> None:
    clip, observation = scene
    gone = correct(observation, clip.path, [exclude(5, 9, "blue_ball")])
    assert not gone.mask("blue_ball", 7).any()
    found = replace(gone, constraints=())  # as if it had not been found there
    repaired = correct(found, clip.path, [outline("blue_ball", 7, centre=(40 + 5.0 * 7, 80.0))])
    assert followed(repaired, clip, "blue_ball", 0)[:12].mean() > 0.9
    assert overlap(repaired.mask("blue_ball", 7), clip.truth[0][7]) > 0.9


def equal(a: ImageObservation, b: ImageObservation, name: str) -> bool:
    return all(np.array_equal(a.mask(name, t), b.mask(name, t)) for t in a.frames)


def scored(seen: ImageObservation, clip: Clip, name: str, k: int) -> np.ndarray:
    return np.array([overlap(seen.mask(name, t), m) for t, m in enumerate(clip.truth[k]) if m.sum() > 60])


def test_seeds_follow_both_bodies_through_their_crossing(
    crossing: tuple[Clip, ImageObservation], both: ImageObservation
) -> None:
    clip, seen = crossing[0], both
    for name, start, step in (("blue", (40.0, 70.0), 5.0), ("red", (150.0, 84.0), -1.0)):
        own = seen.object(name)
        assert own.colour.name == name
        truth = np.stack([start[0] + step * np.arange(24), np.full(24, start[1])], axis=1)
        off = np.linalg.norm(own.centroid - truth, axis=1)
        whole = [t for t in range(24) if own.status[t] == "visible"]
        assert np.nanmedian(off[whole]) < 0.5
        assert not (off[whole] > 7.0).any()
    assert scored(seen, clip, "red", 1).mean() > 0.9


@pytest.mark.benchmark
def test_masks_in_seeded_frames_outlive_all_later_corrections(crossing: tuple[Clip, ImageObservation]) -> None:
    clip, nothing = crossing
    # Deliberately wrong by a few pixels, so that nothing would find it again by itself.
    given = np.roll(clip.truth[0][4], 4, axis=1)
    first = correct(nothing, clip.path, [outline("blue", 4, mask=coco(given), add=True)])
    assert np.array_equal(first.mask("blue", 4), given)
    second = correct(first, clip.path, [blue(20, add=False), red(21)])
    of_twenty = second.mask("blue", 20)
    third = correct(second, clip.path, [red(5, add=False), red(4, add=False), stay("red", 0, 1)])
    last = correct(third, clip.path, [rename("blue", "puck"), exclude(10, 12, box=(0, 120, 40, 40))])
    assert np.array_equal(last.mask("puck", 4), given)
    assert np.array_equal(last.mask("puck", 20), of_twenty)
    back = ImageObservation.from_dict(last.to_dict())
    assert back.constraints == last.constraints
    assert {c.frame for c in back.constraints if hasattr(c, "frame") and c.object == "puck"} == {4, 20}


@pytest.mark.benchmark
def test_order_of_corrections_does_not_matter(crossing: tuple[Clip, ImageObservation]) -> None:
    clip, nothing = crossing
    said: list[Correction] = [
        blue(3),
        red(21),
        blue(22, add=False),
        exclude(14, 16, box=(0, 0, 30, 30)),
    ]
    results = [
        correct(nothing, clip.path, list(order)) for order in itertools.islice(itertools.permutations(said), 0, 24, 23)
    ]
    step_by_step = nothing
    for one in said:
        step_by_step = correct(step_by_step, clip.path, [one])
    for other in [*results[1:], step_by_step]:
        assert equal(results[0], other, "blue")
        assert equal(results[0], other, "red")
        assert results[0].constraints == other.constraints


def test_two_seeds_of_an_object_are_met_from_both_sides(tmp_path: Path) -> None:
    """A body that jumps, as no motion does, is followed from each seed on its side of the jump."""
    clip = render(tmp_path / "jump.mp4", [Disc(lambda t: (40 + t, 40) if t < 10 else (190 - t, 125), 14, BLUE)], 20)
    seen = observe(clip.path)
    nothing = correct(seen, clip.path, [drop(name) for name in seen.names])
    seeded = correct(
        nothing,
        clip.path,
        [outline("blue", 4, circle=(44, 40, 14), add=True), outline("blue", 15, circle=(175, 125, 14))],
    )
    values = scored(seeded, clip, "blue", 0)
    assert (values > 0.8).sum() >= 18


def test_excluded_region_holds_nothing(
    crossing: tuple[Clip, ImageObservation], both: ImageObservation, blue_alone: ImageObservation
) -> None:
    clip, seen = crossing[0], both
    x, y, w, h = 40 + 5.0 * 8 - 14, 70.0 - 14, 28.0, 28.0
    barred = correct(seen, clip.path, [exclude(7, 9, "blue", box=(x - 8, y - 8, w + 16, h + 16))])
    for t in (7, 8, 9):
        assert not barred.mask("blue", t)[round(y) : round(y + h), round(x) : round(x + w)].any()
    assert scored(barred, clip, "red", 1).mean() > 0.9
    assert overlap(barred.mask("blue", 22), clip.truth[0][22]) > 0.85
    gone = correct(blue_alone, clip.path, [exclude(20, 23, "blue")])
    assert all(not gone.mask("blue", t).any() for t in range(20, 24))
    assert np.array_equal(gone.mask("blue", 3), blue_alone.mask("blue", 3))


def test_contradictory_statements_are_refused(
    crossing: tuple[Clip, ImageObservation], blue_alone: ImageObservation
) -> None:
    clip, nothing = crossing
    with pytest.raises(ObservationError, match="blue was given in frame 3 where it, or anything, was said not to be"):
        correct(blue_alone, clip.path, [exclude(0, 9, box=(0, 0, 240, 160))])
    with pytest.raises(ObservationError, match="two seeds of blue in frame 3"):
        correct(nothing, clip.path, [blue(3), blue(3, add=False)])
    with pytest.raises(ObservationError, match="needs a camera"):
        correct(nothing, clip.path, [blue(3), place("blue", 8, 0.0, 0.0, 0.0)])
    found = ImageObservation(nothing.video, nothing.frames, blue_alone.objects)
    gone = correct(found, clip.path, [split("blue", 8, "later"), drop("later")])
    with pytest.raises(ObservationError, match=r"seen in none of frames 9\.\.12"):
        correct(gone, clip.path, [stay("blue", 9, 12)])


def test_objects_that_were_found_keep_off_what_a_seed_owns(scene: tuple[Clip, ImageObservation]) -> None:
    clip, observation = scene
    seeded = correct(observation, clip.path, [outline("mine", 4, circle=(60, 80, 15), add=True)])
    assert {"red_ball", "mine"} <= set(seeded.names)
    said = [w for w in seeded.warnings if "blue_ball" in w]
    assert ("blue_ball" in seeded.names) != any("mine" in w for w in said)  # the seed is on the blue ball
    for t in seeded.frames:
        for other in seeded.names:
            assert other == "mine" or not (seeded.mask("mine", t) & seeded.mask(other, t)).any()


def test_small_remains_are_not_said_to_be_in_full_view(tmp_path: Path) -> None:
    """A body that fades into the background: what is left of its mask is never called visible with confidence."""
    fading = [Disc(lambda t: (60 + 2.0 * t, 80), 16, BLUE)]
    clip = render(tmp_path / "f.mp4", fading, 12)
    frames = clip.frames.copy()
    ground = plain()
    frames = np.concatenate([frames, np.repeat(ground.astype(np.uint8)[None], 12, axis=0)])
    path = write_film(tmp_path / "gone.mp4", frames)
    seen = observe(path)
    nothing = correct(seen, path, [drop(name) for name in seen.names])
    seeded = correct(nothing, path, [outline("blue", 5, circle=(70, 80, 16), add=True)]).object("blue")
    area = seeded.area[5]
    for t in range(24):
        if seeded.area[t] < 0.3 * area:
            assert seeded.confidence[t] < 0.5
            assert seeded.status[t] != "visible"
    assert seeded.area[12:].max() < 0.3 * area


def test_place_in_the_world_moves_the_mask_there(
    crossing: tuple[Clip, ImageObservation], blue_alone: ImageObservation
) -> None:
    """A camera that looks straight down from 1 m: a place is seen where the pinhole model says."""
    clip, seen = crossing[0], blue_alone
    camera = calibrate_given(
        [[200.0, 0.0, 120.0], [0.0, 200.0, 80.0], [0.0, 0.0, 1.0]],
        [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        [0.0, 0.0, 1.0],
        (240, 160),
    ).camera
    u, v = 40 + 5.0 * 22, 70.0
    position = ((u - 120.0) / 200.0, -(v - 80.0) / 200.0, 0.0)
    placed = correct(seen, clip.path, [place("blue", 22, *position)], camera=camera)
    assert placed.object("blue").centroid[22] == pytest.approx([u, v], abs=1.0)
    assert overlap(placed.mask("blue", 22), clip.truth[0][22]) > 0.85
    assert [c.position for c in placed.constraints if getattr(c, "frame", None) == 22] == [position]


def test_split_and_merge_undo_each_other(scene: tuple[Clip, ImageObservation]) -> None:
    clip, observation = scene
    halves = correct(observation, clip.path, [split("blue_ball", 12, "later")])
    assert halves.object("blue_ball").exit_frame == 11
    assert halves.object("later").entry_frame == 12
    assert same(halves, observation, "red_ball")
    whole = correct(halves, clip.path, [merge("blue_ball", "later")])
    assert "later" not in whole.names
    assert same(whole, observation, "blue_ball")


def test_rename_and_drop_change_nothing_else(scene: tuple[Clip, ImageObservation]) -> None:
    clip, observation = scene
    renamed = correct(observation, clip.path, [rename("red_ball", "target")])
    assert same(renamed, observation, "target", "red_ball")
    assert same(renamed, observation, "blue_ball")
    assert correct(renamed, clip.path, [drop("target")]).names == ("blue_ball",)


@pytest.mark.parametrize(
    ("correction", "says"),
    [
        (drop("ball"), r"unknown object 'ball'; objects: \["),
        (rename("red_ball", "blue_ball"), "taken"),
        (rename("red_ball", "a ball!"), "not a name"),
        (merge("red_ball", "red_ball"), "two different"),
        (split("red_ball", 0, "x"), r"1\.\.27"),
        (outline("red_ball", 28, box=(1, 1, 9, 9)), r"0\.\.27"),
        (outline("red_ball", 3), "give one of outline, circle, box, centre, mask, not none"),
        (outline("red_ball", 3, box=(1, 1, 9, 9), centre=(4, 4)), "not box, centre"),
        (outline("new", 3, centre=(4, 4), add=True), "its shape is not known: give an outline, a circle"),
        (outline("red_ball", 3, box=(500, 1, 9, 9)), "outside the image of 240 x 160"),
        (outline("red_ball", 3, centre=(10, 500)), "outside the image"),
        (outline("red_ball", 3, mask=RunLengthMask(2, 2, (0, 4)).to_dict()), "2 x 2"),
        (outline("blue_ball", 3, box=(1, 1, 9, 9), add=True), "taken"),
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
        correct(observation, clip.path.with_name("b.mp4"), [drop("red_ball")])
    other = render(clip.path.with_name("other.mp4"), [], 6)
    with pytest.raises(ObservationError, match="not the video of this observation"):
        correct(observation, other.path, [drop("red_ball")])


def test_corrections_say_which_fields_are_missing_or_do_not_belong_to_them(
    scene: tuple[Clip, ImageObservation],
) -> None:
    clip, observation = scene
    with pytest.raises(ObservationError, match="second is missing"):
        correct(observation, clip.path, [Correction(kind="merge", first="red_ball")])
    with pytest.raises(ObservationError, match="box does not belong to it"):
        correct(observation, clip.path, [Correction(kind="drop", object="red_ball", box=[1, 1, 9, 9])])
