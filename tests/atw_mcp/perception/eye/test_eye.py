"""The eye on drawn pictures whose truth is known."""

from __future__ import annotations

import numpy as np
import pytest

from atw_mcp.perception.eye.masks import body_mask
from atw_mcp.perception.eye.observe import Track, observe
from atw_mcp.perception.eye.seeds import Seed, outline_body
from atw_mcp.perception.masks import RunLengthMask
from tests.atw_mcp.perception.eye import drawn

COUNT = 16


def _follow(frames: np.ndarray, *seeds: Seed) -> list[Track]:
    names = list(dict.fromkeys(s.object for s in seeds))
    bodies = [outline_body(n, next(s for s in seeds if s.object == n)) for n in names]
    return observe(frames, bodies, seeds)[0]


def _circle(name: str, frame: int, place: np.ndarray, radius: float) -> Seed:
    return Seed(name, "circle", frame, (place[0], place[1], radius))


def _error(track: Track, places: np.ndarray) -> np.ndarray:
    return np.asarray(np.linalg.norm(track.centres - places, axis=1))


def test_disc_is_followed_to_a_fraction_of_a_pixel_from_one_rough_circle() -> None:
    places = drawn.line((25.3, 60.2), (6.4, 1.1), COUNT)
    (track,) = _follow(drawn.frames([(places, 9.0, drawn.RED)]), _circle("red", 5, places[5] + [1.0, -1.0], 9.5))
    assert np.nanmedian(_error(track, places)) < 0.15
    assert np.isfinite(track.centres).all()
    assert track.confidence.min() > 0.8
    assert track.breaks == ()


def test_disc_that_passes_behind_another_keeps_its_place() -> None:
    behind, front = drawn.line((20.0, 58.0), (7.5, 0.0), COUNT), drawn.line((80.0, 64.0), (0.0, 0.0), COUNT)
    frames = drawn.frames([(behind, 9.0, drawn.RED), (front, 11.0, drawn.BLUE)])
    seeds = (_circle("red", 1, behind[1], 9.0), _circle("blue", 1, front[1], 11.0))
    red, blue = _follow(frames, *seeds)
    assert np.nanmax(_error(blue, front)) < 0.5
    error = _error(red, behind)
    assert np.isfinite(error).sum() >= COUNT - 3  # hidden for up to three frames
    wrong = (error > 4.5) & (red.confidence > 0.8)
    assert not wrong.any()
    assert np.nanmedian(error) < 0.3


def test_disc_that_enters_across_the_border_is_found_where_it_is() -> None:
    places = drawn.line((-14.0, 50.0), (5.5, 1.0), COUNT)
    (track,) = _follow(drawn.frames([(places, 9.0, drawn.RED)]), _circle("red", 12, places[12], 9.0))
    half_in = np.flatnonzero(places[:, 0] > 0)
    assert np.isfinite(track.centres[half_in]).all()
    assert _error(track, places)[half_in].max() < 0.6


def test_look_alikes_that_touch_are_not_exchanged() -> None:
    one, other = drawn.line((30.0, 45.0), (6.0, 1.0), COUNT), drawn.line((126.0, 78.0), (-6.0, -1.0), COUNT)
    frames = drawn.frames([(one, 8.0, drawn.RED), (other, 8.0, drawn.RED)])
    first, second = _follow(frames, _circle("one", 0, one[0], 8.0), _circle("other", 0, other[0], 8.0))
    for track, places in ((first, one), (second, other)):
        error = _error(track, places)
        assert np.nanmedian(error) < 0.3
        assert not ((error > 4) & (track.confidence > 0.8)).any()
        assert error[-1] < 1.0


@pytest.mark.parametrize("frame", [2, 14])
def test_body_that_stands_for_half_the_clip_is_not_background(frame: int) -> None:
    places = np.concatenate([np.tile([[60.0, 50.0]], (9, 1)), drawn.line((60.0, 50.0), (7.0, 2.0), 8)[1:]])
    (track,) = _follow(drawn.frames([(places, 9.0, drawn.RED)]), _circle("red", frame, places[frame], 9.0))
    error = _error(track, places)
    assert np.isfinite(error).all()
    assert error.max() < 0.6


def test_what_the_pixels_do_not_decide_has_a_large_error_or_is_not_seen() -> None:
    places = drawn.line((25.3, 60.2), (6.4, 1.1), COUNT)
    frames = drawn.frames([(places, 9.0, (151.0, 151.0, 151.0))], noise=2.0)
    (track,) = _follow(frames, _circle("grey", 5, places[5], 9.0))
    wrong = _error(track, places) > 4.5
    assert not (wrong & (track.confidence > 0.8)).any()
    assert not (wrong & (track.errors < 2.0)).any()


def test_jump_of_many_radii_is_stated() -> None:
    places = np.concatenate([drawn.line((25.0, 30.0), (2.0, 0.0), 8), drawn.line((110.0, 95.0), (2.0, 0.0), 8)])
    (track,) = _follow(drawn.frames([(places, 8.0, drawn.RED)]), _circle("red", 2, places[2], 8.0))
    after = np.isfinite(track.centres[8:, 0])
    assert not after.any() or (track.breaks and (track.confidence[8:] < 0.8).all())


def test_every_seed_holds_at_its_frame() -> None:
    places = drawn.line((25.3, 60.2), (6.4, 1.1), COUNT)
    other = drawn.line((25.3, 20.2), (6.4, 0.0), COUNT)
    frames = drawn.frames([(places, 8.0, drawn.RED), (other, 8.0, drawn.RED)])
    (track,) = _follow(frames, _circle("red", 2, places[2], 8.0), _circle("red", 12, other[12], 8.0))
    assert _error(track, places)[2] < 1.0
    assert _error(track, other)[12] < 1.0
    assert track.breaks


def test_seeds_of_every_kind_give_the_same_track() -> None:
    places = drawn.line((40.3, 60.2), (4.4, 1.1), 8)
    frames = drawn.frames([(places, 9.0, drawn.BLUE)])
    u, v = places[3]
    mask = np.hypot(*(np.mgrid[0 : drawn.HEIGHT, 0 : drawn.WIDTH][::-1] - places[3][:, None, None])) < 9.0
    angle = np.linspace(0, 2 * np.pi, 20, endpoint=False)
    outline = np.stack([u + 9 * np.cos(angle), v + 9 * np.sin(angle)], axis=1)
    for seed in (Seed("b", "mask", 3, RunLengthMask.encode(mask)), Seed.outlined("b", 3, outline)):
        (track,) = _follow(frames, seed)
        assert np.nanmax(_error(track, places)) < 0.5


def test_mask_of_a_body_whose_shape_changes_has_its_place_and_area() -> None:
    places = drawn.line((40.0, 60.0), (5.0, 0.0), 8)
    frames = drawn.frames(
        [(places, 9.0, drawn.BLUE), (places + [5.0, 0.0] * np.arange(8)[:, None] / 7, 9.0, drawn.BLUE)]
    )
    seed = _circle("b", 0, places[0], 9.0)
    tracks, scene = observe(frames, [outline_body("b", seed)], [seed])
    found = body_mask(scene, 0, 7)
    v, u = np.mgrid[0 : drawn.HEIGHT, 0 : drawn.WIDTH].astype(float)
    true = (np.hypot(u - 75, v - 60) < 9) | (np.hypot(u - 80, v - 60) < 9)
    assert np.linalg.norm(found.centre() - [77.5, 60.0]) < 0.6
    assert found.mask.sum() == pytest.approx(true.sum(), rel=0.1)
    assert len(found.outline()) > 20
    assert tracks[0].confidence[7] > 0.5


def test_unknown_names_and_frames_are_refused() -> None:
    places = drawn.line((40.3, 60.2), (4.4, 1.1), 4)
    frames = drawn.frames([(places, 9.0, drawn.BLUE)])
    body = outline_body("b", _circle("b", 0, places[0], 9.0))
    with pytest.raises(ValueError, match="names 'c'"):
        observe(frames, [body], [_circle("c", 0, places[0], 9.0)])
    with pytest.raises(ValueError, match=r"0\.\.3"):
        observe(frames, [body], [_circle("b", 9, places[0], 9.0)])
