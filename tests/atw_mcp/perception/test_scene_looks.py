"""Objects at rest on texture, shadows and pieces beside bodies, motion of a camera held by hand, on drawn scenes."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.perception.camera_motion import as_filmed, camera_motion, stabilised
from atw_mcp.perception.observe import observe
from tests.atw_mcp.clips import write_film

HEIGHT, WIDTH = 180, 240


def checker(rng: np.random.Generator) -> NDArray[np.float64]:
    """A floor of two greys in tiles of 20 pixels, with noise."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    tiles = np.where((x // 20 + y // 20) % 2, 150.0, 95.0)
    return np.repeat(tiles[..., None], 3, axis=2) + rng.normal(0.0, 1.5, (HEIGHT, WIDTH, 3))


def test_a_red_box_at_rest_on_a_checked_floor_is_found_and_no_tile_is(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    floor = checker(rng)
    truth = np.zeros((HEIGHT, WIDTH), dtype=bool)
    truth[70:100, 110:150] = True
    frames = [
        np.where(truth[..., None], (40.0, 40.0, 190.0), floor) + rng.normal(0.0, 1.0, floor.shape) for _ in range(8)
    ]
    (box,) = observe(write_film(tmp_path / "box.avi", frames, code="FFV1")).objects
    found = box.masks[4]
    assert found is not None
    assert (found.decode() & truth).sum() / (found.decode() | truth).sum() > 0.9
    assert (
        observe(
            write_film(
                tmp_path / "none.avi", [floor + rng.normal(0.0, 1.0, floor.shape) for _ in range(8)], code="FFV1"
            )
        ).objects
        == ()
    )


@pytest.mark.parametrize("factor", [0.45, 0.6])
def test_shadows_beside_two_bodies_are_no_objects_and_are_named(tmp_path: Path, factor: float) -> None:
    """A bright and a red body, each with a shadow beside it, slide over a plain floor."""
    rng = np.random.default_rng(2)
    frames = []
    for t in range(16):
        image = np.full((HEIGHT, WIDTH, 3), 160.0)
        for colour, row, start in (((40.0, 40.0, 190.0), 50, 30), ((230.0, 230.0, 230.0), 120, 60)):
            x = start + 7 * t
            image[row : row + 14, x + 24 : x + 40] *= factor
            image[row - 2 : row + 16, x : x + 18] = np.array(colour) * np.linspace(0.8, 1.1, 18)[:, None, None]
        frames.append(image + rng.normal(0.0, 1.0, image.shape))
    seen = observe(write_film(tmp_path / "shadows.avi", frames, code="FFV1"))
    assert sorted(o.colour.name for o in seen.objects) == ["red", "white"]
    assert any("shadow" in w for w in seen.warnings)


def test_a_shaking_camera_is_steadied_and_masks_come_back_to_its_pixels() -> None:
    rng = np.random.default_rng(3)
    scene = np.clip(checker(rng), 0, 255).astype(np.uint8)
    scene = cv2.GaussianBlur(scene, (0, 0), 1.0)
    shifts = np.concatenate([[[0.0, 0.0]], rng.uniform(-2.0, 2.0, (11, 2))])
    maps = [np.array([[1.0, 0.0, dx], [0.0, 1.0, dy]]) for dx, dy in shifts]
    film = np.stack([cv2.warpAffine(scene, m, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REPLICATE) for m in maps])
    motion = camera_motion(film)

    def measuring() -> None:
        raise AssertionError("measured again")

    np.testing.assert_array_equal(camera_motion(film.copy(), measuring), motion)  # known by its content
    assert motion is not None
    np.testing.assert_allclose(motion[:, :, 2], shifts, atol=0.15)
    inner = stabilised(film, motion)[:, 20:-20, 20:-20].astype(float)
    assert np.abs(inner - inner[0]).mean() < 0.3 * np.abs(film.astype(float) - film[0]).mean()
    mask = np.zeros((HEIGHT, WIDTH), dtype=bool)
    mask[80:100, 100:130] = True
    y, x = np.nonzero(as_filmed(mask, motion[5]))
    assert (x.mean() - 114.5, y.mean() - 89.5) == pytest.approx(tuple(shifts[5]), abs=0.5)  # whole pixels


def test_bodies_that_move_before_a_plain_wall_are_no_motion_of_the_camera() -> None:
    film = np.full((12, HEIGHT, WIDTH, 3), 140, dtype=np.uint8)
    for t in range(12):
        cv2.circle(film[t], (60 + 4 * t, 90), 15, (30, 30, 200), -1)
        cv2.circle(film[t], (180 - 4 * t, 60), 15, (200, 30, 30), -1)
    assert camera_motion(film) is None
    assert camera_motion(np.repeat(film[:1], 6, axis=0)) is None


def test_a_brief_slip_beside_a_large_body_is_no_object_and_a_small_body_is(tmp_path: Path) -> None:
    rng, frames = np.random.default_rng(5), []
    for t in range(20):
        image = np.full((HEIGHT, WIDTH, 3), 160.0)
        image[60:100, 20 + 4 * t : 60 + 4 * t] = (190.0, 60.0, 40.0)
        if t >= 16:
            image[102:106, 30 + 4 * t : 40 + 4 * t] = (150.0, 80.0, 60.0)  # a slip under it
        image[130:137, 190 - 6 * t : 200 - 6 * t] = (40.0, 40.0, 190.0)
        frames.append(image + rng.normal(0.0, 1.0, image.shape))
    seen = observe(write_film(tmp_path / "slip.avi", frames, code="FFV1"))
    assert sorted(o.colour.name for o in seen.objects) == ["blue", "red"]


def test_a_grey_ball_whose_lit_side_is_as_dark_as_its_shadow_is_seen_whole(tmp_path: Path) -> None:
    """The ball's shading passes through the shadows' brightness; a red box beside it casts the other shadow."""
    rng = np.random.default_rng(4)
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    frames, truths = [], []
    for t in range(24):
        image = np.full((HEIGHT, WIDTH, 3), 160.0)
        centre = 50.0 + 5.0 * t
        image[((x - centre - 20) / 24) ** 2 + ((y - 70) / 9) ** 2 < 1] = 80.0
        image[125:140, 60 + 4 * t : 100 + 4 * t] = 80.0
        truth = (x - centre) ** 2 + (y - 60) ** 2 < 18**2
        lit = np.clip(1.0 - 0.045 * ((x - centre + 8) + 1.2 * (y - 52)) / 2, 0.4, 1.05)
        image[truth] = (85.0 * lit)[truth][:, None]
        image[105:140, 50 + 4 * t : 80 + 4 * t] = (30.0, 30.0, 180.0)
        image = cv2.GaussianBlur(image, (0, 0), 0.6)
        frames.append(image + rng.normal(0.0, 1.0, image.shape))
        truths.append(truth)
    seen = observe(write_film(tmp_path / "grey.avi", frames, code="FFV1"))
    assert sorted(str(o.colour.name) for o in seen.objects) == ["gray", "red"]
    ball = next(o for o in seen.objects if o.colour.name == "gray")
    for t in (2, 12, 21):
        mask = ball.masks[t]
        assert mask is not None
        found = mask.decode()
        assert (found & truths[t]).sum() / (found | truths[t]).sum() > 0.85
