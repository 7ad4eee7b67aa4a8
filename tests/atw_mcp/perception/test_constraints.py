"""What is said of a video holds: later corrections, their order and other objects do not alter it."""

from __future__ import annotations

import itertools
from pathlib import Path

import cv2
import numpy as np
import pytest

from atw_mcp.perception.calibration import calibrate_given
from atw_mcp.perception.correction import correct
from atw_mcp.perception.corrections import Correction, Drop, Exclude, Outline, Place, Rename, Shadow, Split, Stay
from atw_mcp.perception.masks import RunLengthMask
from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.observe import observe
from tests.atw_mcp.perception.clips import Clip, Disc, overlap, plain, render

RED, BLUE, GREY = (40, 40, 170), (170, 70, 40), (98, 98, 98)


@pytest.fixture(scope="module")
def crossing(tmp_path_factory: pytest.TempPathFactory) -> tuple[Clip, ImageObservation]:
    """Blue passes behind red, with shadows; nothing of either is known."""
    discs = [Disc(lambda t: (40 + 5.0 * t, 70), 14, BLUE), Disc(lambda t: (150 - 1.0 * t, 84), 17, RED)]
    clip = render(tmp_path_factory.mktemp("constraints") / "a.mp4", discs, 30, shadows=True)
    seen = observe(clip.path)
    return clip, correct(seen, clip.path, [Drop(name) for name in seen.names])


def box(clip: Clip, k: int, t: int) -> tuple[float, float, float, float]:
    y, x = np.nonzero(clip.truth[k][t])
    return float(x.min() - 2), float(y.min() - 2), float(np.ptp(x) + 5), float(np.ptp(y) + 5)


def blue(clip: Clip, t: int, *, add: bool = True) -> Outline:
    return Outline("blue", t, box=box(clip, 0, t), add=add)


def red(clip: Clip, t: int, *, add: bool = True) -> Outline:
    return Outline("red", t, box=box(clip, 1, t), add=add)


def equal(a: ImageObservation, b: ImageObservation, name: str) -> bool:
    return all(np.array_equal(a.mask(name, t), b.mask(name, t)) for t in a.frames)


def scored(seen: ImageObservation, clip: Clip, name: str, k: int) -> np.ndarray:
    return np.array([overlap(seen.mask(name, t), m) for t, m in enumerate(clip.truth[k]) if m.sum() > 60])


def test_seeds_follow_both_bodies_through_their_crossing(crossing: tuple[Clip, ImageObservation]) -> None:
    clip, nothing = crossing
    seen = correct(nothing, clip.path, [blue(clip, 3), red(clip, 25)])
    assert scored(seen, clip, "blue", 0).mean() > 0.9
    assert scored(seen, clip, "red", 1).mean() > 0.93


def test_masks_in_seeded_frames_outlive_all_later_corrections(crossing: tuple[Clip, ImageObservation]) -> None:
    clip, nothing = crossing
    # Deliberately wrong by a few pixels, so that nothing would find it again by itself.
    given = np.roll(clip.truth[0][4], 4, axis=1)
    first = correct(nothing, clip.path, [Outline("blue", 4, mask=RunLengthMask.encode(given), add=True)])
    assert np.array_equal(first.mask("blue", 4), given)
    second = correct(first, clip.path, [blue(clip, 20, add=False), red(clip, 25)])
    of_twenty = second.mask("blue", 20)
    third = correct(
        second, clip.path, [red(clip, 5, add=False), Outline("red", 4, box=box(clip, 1, 4)), Stay("red", 0, 1)]
    )
    last = correct(third, clip.path, [Rename("blue", "puck"), Exclude(10, 12, box=(0, 120, 40, 40))])
    assert np.array_equal(last.mask("puck", 4), given)
    assert np.array_equal(last.mask("puck", 20), of_twenty)
    back = ImageObservation.from_dict(last.to_dict())
    assert back.constraints == last.constraints
    assert {c.frame for c in back.constraints if hasattr(c, "frame") and c.object == "puck"} == {4, 20}


def test_order_of_corrections_does_not_matter(crossing: tuple[Clip, ImageObservation]) -> None:
    clip, nothing = crossing
    said: list[Correction] = [
        blue(clip, 3),
        red(clip, 25),
        Outline("blue", 27, box=box(clip, 0, 27)),
        Exclude(14, 16, box=(0, 0, 30, 30)),
    ]
    results = [
        correct(nothing, clip.path, list(order)) for order in itertools.islice(itertools.permutations(said), 0, 24, 11)
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
    clip = render(tmp_path / "jump.mp4", [Disc(lambda t: (40 + t, 40) if t < 14 else (190 - t, 125), 14, BLUE)], 28)
    seen = observe(clip.path)
    nothing = correct(seen, clip.path, [Drop(name) for name in seen.names])
    seeded = correct(nothing, clip.path, [blue(clip, 4), Outline("blue", 22, box=box(clip, 0, 22))])
    values = scored(seeded, clip, "blue", 0)
    assert (values > 0.8).sum() >= 26


def test_excluded_region_holds_nothing(crossing: tuple[Clip, ImageObservation]) -> None:
    clip, nothing = crossing
    seen = correct(nothing, clip.path, [blue(clip, 3), red(clip, 25)])
    x, y, w, h = box(clip, 0, 8)
    barred = correct(seen, clip.path, [Exclude(7, 9, "blue", box=(x - 8, y - 8, w + 16, h + 16))])
    for t in (7, 8, 9):
        assert not barred.mask("blue", t)[round(y) : round(y + h), round(x) : round(x + w)].any()
    assert scored(barred, clip, "red", 1).mean() > 0.93
    assert overlap(barred.mask("blue", 25), clip.truth[0][25]) > 0.85
    gone = correct(seen, clip.path, [Exclude(20, 29, "blue")])
    assert all(not gone.mask("blue", t).any() for t in range(20, 30))
    assert np.array_equal(gone.mask("blue", 3), seen.mask("blue", 3))


def test_contradictory_statements_are_refused(crossing: tuple[Clip, ImageObservation]) -> None:
    clip, nothing = crossing
    with pytest.raises(ObservationError, match=r"outline given for blue in frame 3 are in a region"):
        correct(correct(nothing, clip.path, [blue(clip, 3)]), clip.path, [Exclude(0, 9, box=(0, 0, 240, 160))])
    with pytest.raises(ObservationError, match="outlined twice in frame 3"):
        correct(nothing, clip.path, [blue(clip, 3), blue(clip, 3, add=False)])
    with pytest.raises(ObservationError, match="needs a camera"):
        correct(nothing, clip.path, [blue(clip, 3), Place("blue", 8, (0.0, 0.0, 0.0))])
    found = ImageObservation(nothing.video, nothing.frames, correct(nothing, clip.path, [blue(clip, 3)]).objects)
    gone = correct(found, clip.path, [Split("blue", 8, "later"), Drop("later")])
    with pytest.raises(ObservationError, match=r"seen in none of frames 9\.\.12"):
        correct(gone, clip.path, [Stay("blue", 9, 12)])
    with pytest.raises(ObservationError, match="needs a box or a mask"):
        correct(nothing, clip.path, [blue(clip, 3), Shadow(3, "blue")])


def test_no_neighbour_takes_what_a_seed_owns_or_its_shadow(tmp_path: Path) -> None:
    discs = [Disc(lambda t: (50 + 4.0 * t, 70), 15, BLUE)]
    clip = render(tmp_path / "s.mp4", discs, 30, shadows=True)
    # What was found is the body with its shadow, under another name.
    grown = [RunLengthMask.encode(np.roll(m, 12, axis=1) | np.roll(m, 6, axis=0) | m) for m in clip.truth[0]]
    seen = observe(clip.path)
    only = correct(seen, clip.path, [Drop(name) for name in seen.names])
    ghost = correct(only, clip.path, [Outline("ghost", t, mask=m, add=t == 0) for t, m in enumerate(grown)])
    found = ImageObservation(ghost.video, ghost.frames, ghost.objects)  # as if nobody had said it
    seeded = correct(found, clip.path, [blue(clip, 10)])
    assert scored(seeded, clip, "blue", 0).mean() > 0.9
    left = sum(int(seeded.mask("ghost", t).sum()) for t in seeded.frames) if "ghost" in seeded.names else 0
    assert left < 0.02 * sum(m.area for m in grown)


def test_body_at_rest_on_its_own_colour_keeps_its_outline(tmp_path: Path) -> None:
    """Grey on grey, at rest all the time: the background shows it, and red passes in front."""
    discs = [Disc(lambda _t: (120, 80), 16, GREY), Disc(lambda t: (20 + 7.0 * t, 84), 12, RED)]
    clip = render(tmp_path / "rest.mp4", discs, 30, background=plain(112.0, 6.0))
    seen = observe(clip.path)
    nothing = correct(seen, clip.path, [Drop(name) for name in seen.names])
    still = correct(nothing, clip.path, [Outline("grey", 2, box=box(clip, 0, 2), add=True), Stay("grey", 0, 29)])
    assert scored(still, clip, "grey", 0).mean() > 0.85
    clear = [t for t in range(30) if clip.truth[0][t].all() == clip.truth[0][0].all() and abs(20 + 7 * t - 120) > 40]
    assert len({still.mask("grey", t).tobytes() for t in clear}) == 1
    covered = still.object("grey")
    assert covered.confidence[14] < 0.6 < covered.confidence[0]


def test_small_remains_are_not_said_to_be_in_full_view(tmp_path: Path) -> None:
    """A body that fades into the background: what is left of its mask is never called visible with confidence."""
    fading = [Disc(lambda t: (60 + 2.0 * t, 80), 16, BLUE)]
    clip = render(tmp_path / "f.mp4", fading, 12)
    frames = clip.frames.copy()
    ground = plain()
    frames = np.concatenate([frames, np.repeat(ground.astype(np.uint8)[None], 12, axis=0)])
    path = _written(tmp_path / "gone.mp4", frames)
    seen = observe(path)
    nothing = correct(seen, path, [Drop(name) for name in seen.names])
    seeded = correct(nothing, path, [blue(clip, 5)]).object("blue")
    area = seeded.area[5]
    for t in range(24):
        if seeded.area[t] < 0.3 * area:
            assert seeded.confidence[t] < 0.5
            assert seeded.status[t] != "visible"
    assert seeded.area[12:].max() < 0.3 * area


def _written(path: Path, frames: np.ndarray) -> Path:
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), 25.0, (frames.shape[2], frames.shape[1]))
    for frame in frames:
        writer.write(frame)
    writer.release()
    return path


def test_region_said_to_be_shadow_is_taken_from_the_object_in_all_frames(tmp_path: Path) -> None:
    clip = render(tmp_path / "sh.mp4", [Disc(lambda t: (60 + 4.0 * t, 60), 15, BLUE)], 24, shadows=True)
    seen = observe(clip.path)
    only = correct(seen, clip.path, [Drop(name) for name in seen.names])
    shade = [np.roll(m, (12, 8), axis=(0, 1)) & ~m for m in clip.truth[0]]
    both = [RunLengthMask.encode(s | m) for s, m in zip(shade, clip.truth[0], strict=True)]
    wrong = correct(only, clip.path, [Outline("puck", t, mask=m, add=t == 0) for t, m in enumerate(both)])
    found = ImageObservation(wrong.video, wrong.frames, wrong.objects)
    before = scored(found, clip, "puck", 0).mean()
    freed = correct(found, clip.path, [Shadow(10, "puck", mask=RunLengthMask.encode(shade[10]))])
    after = scored(freed, clip, "puck", 0)
    assert after.mean() > 0.85 > before
    assert not (freed.mask("puck", 10) & shade[10]).any()


def test_place_in_the_world_moves_the_mask_there(crossing: tuple[Clip, ImageObservation]) -> None:
    """A camera that looks straight down from 1 m: a place is seen where the pinhole model says."""
    clip, nothing = crossing
    camera = calibrate_given(
        [[200.0, 0.0, 120.0], [0.0, 200.0, 80.0], [0.0, 0.0, 1.0]],
        [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]],
        [0.0, 0.0, 1.0],
        (240, 160),
    ).camera
    seen = correct(nothing, clip.path, [blue(clip, 3)])
    u, v = 40 + 5.0 * 26, 70.0
    position = ((u - 120.0) / 200.0, -(v - 80.0) / 200.0, 0.0)
    placed = correct(seen, clip.path, [Place("blue", 26, position)], camera=camera)
    assert placed.object("blue").centroid[26] == pytest.approx([u, v], abs=1.0)
    assert overlap(placed.mask("blue", 26), clip.truth[0][26]) > 0.85
    assert [c.position for c in placed.constraints if getattr(c, "frame", None) == 26] == [position]
