"""Masks and identities in synthetic clips whose truth is known to the pixel."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import numpy as np
import pytest

from atw_mcp.perception.observation import ImageObservation, ObservationError
from atw_mcp.perception.observe import observe
from atw_mcp.perception.video import PerceptionCancelled
from tests.atw_mcp.clips import write_film
from tests.atw_mcp.perception.clips import Clip, Disc, overlap, plain, render, textured

RED, BLUE, GREEN = (40, 40, 170), (170, 70, 40), (50, 130, 40)
GRAY, BLACK, WHITE = (85, 85, 85), (25, 25, 25), (230, 230, 230)


def matched(observation: ImageObservation, clip: Clip) -> list[str]:
    """Name of the object that overlaps each disc most, over all frames in which the disc is seen."""
    names = []
    for truth in clip.truth:
        seen = [t for t in range(len(truth)) if truth[t].sum() > 20]
        score = {n: np.mean([overlap(observation.mask(n, t), truth[t]) for t in seen]) for n in observation.names}
        names.append(max(score, key=score.__getitem__))
    return names


def overlaps(observation: ImageObservation, clip: Clip, name: str, k: int, least: int = 60) -> np.ndarray:
    """Overlap of an object's mask with disc k wherever at least `least` pixels of the disc are seen."""
    truth = clip.truth[k]
    return np.array(
        [overlap(observation.mask(name, t), truth[t]) for t in range(len(truth)) if truth[t].sum() >= least]
    )


def check(observation: ImageObservation, clip: Clip, *, mean: float = 0.93, worst: float = 0.8) -> list[str]:
    """One object for each disc and no other, each with the right pixels in every frame."""
    assert len(observation.objects) == len(clip.truth), observation.names
    names = matched(observation, clip)
    assert len(set(names)) == len(names), names
    for k, name in enumerate(names):
        values = overlaps(observation, clip, name, k)
        assert values.mean() > mean, (name, values.mean())
        assert values.min() > worst, (name, values.min())
    return names


def test_objects_that_cross_keep_their_identity(tmp_path: Path) -> None:
    discs = [
        Disc(lambda t: (40 + 5.0 * t, 80), 16, BLUE),
        Disc(lambda t: (200 - 5.0 * t, 84), 18, RED),
    ]
    clip = render(tmp_path / "a.mp4", discs, 32)
    observation = observe(clip.path)
    blue, red = check(observation, clip, worst=0.7)
    assert observation.object(blue).colour.name == "blue"
    assert observation.object(red).colour.name == "red"
    assert observation.object(blue).status.count("occluded") > 2
    assert "occluded" not in observation.object(red).status
    confidence = observation.object(blue).confidence
    hardest = int(np.argmin([m.sum() for m in clip.truth[0]]))
    assert confidence[hardest] < 0.6 < confidence[0]


def test_object_is_found_again_after_full_occlusion(tmp_path: Path) -> None:
    discs = [Disc(lambda t: (30 + 4.0 * t, 80), 9, BLUE), Disc(lambda _t: (120, 82), 24, RED)]
    clip = render(tmp_path / "a.mp4", discs, 44)
    observation = observe(clip.path)
    blue, _ = check(observation, clip, worst=0.7)
    hidden = [t for t in range(44) if clip.truth[0][t].sum() == 0]
    assert len(hidden) > 3
    assert all(observation.object(blue).status[t] == "hidden" for t in hidden)
    assert np.all(observation.object(blue).confidence[hidden] == 0)


def test_two_objects_of_one_colour_stay_two_through_contact(tmp_path: Path) -> None:
    discs = [
        Disc(lambda t: (40 + 4.1 * min(t, 14), 80), 16, BLUE),
        Disc(lambda t: (130 + 4.1 * max(t - 14, 0), 80), 16, BLUE),
    ]
    check(observe((clip := render(tmp_path / "a.mp4", discs, 28)).path), clip)


@pytest.mark.parametrize("second", [RED, BLUE])
def test_objects_that_touch_from_the_first_frame_are_separated_from_the_first(
    tmp_path: Path, second: tuple[float, float, float]
) -> None:
    discs = [
        Disc(lambda t: (98 - 5.0 * max(t - 4, 0), 80), 15, BLUE),
        Disc(lambda t: (126 + 5.0 * max(t - 4, 0), 80), 15, second),
    ]
    check(observe((clip := render(tmp_path / "a.mp4", discs, 18)).path), clip)


def test_entry_exit_and_truncation_at_the_border(tmp_path: Path) -> None:
    discs = [Disc(lambda t: (-25 + 8.0 * t, 60), 14, GREEN), Disc(lambda t: (60, 190 - 7.0 * t), 14, RED)]
    clip = render(tmp_path / "a.mp4", discs, 37)
    observation = observe(clip.path)
    green, red = check(observation, clip)
    for k, name in ((0, green), (1, red)):
        seen = np.flatnonzero(clip.truth[k].sum(axis=(1, 2)) > 40)
        observed = observation.object(name)
        assert abs(observed.entry_frame - seen[0]) <= 1
        assert abs(observed.exit_frame - seen[-1]) <= 1
        assert observed.enters
        assert observed.status[0] == "absent"
        assert observed.status[seen[0] + 1] == "truncated"
    assert observation.object(red).exits
    assert observation.object(red).status[-1] == "absent"


def test_object_that_never_moves_is_an_object(tmp_path: Path) -> None:
    discs = [Disc(lambda _t: (60, 50), 14, GREEN), Disc(lambda t: (60 + 5.0 * t, 110), 14, RED)]
    check(observe((clip := render(tmp_path / "a.mp4", discs, 18)).path), clip)


def test_shadows_are_no_objects_and_a_grey_ball_is(tmp_path: Path) -> None:
    discs = [Disc(lambda t: (60 + 2.5 * t, 70), 15, GRAY), Disc(lambda _t: (70, 120), 14, RED)]
    check(observe((clip := render(tmp_path / "a.mp4", discs, 30, shadows=True)).path), clip)


def test_flicker_and_slowly_changing_light_make_no_objects(tmp_path: Path) -> None:
    discs = [Disc(lambda t: (40 + 6.0 * t, 70), 15, BLUE), Disc(lambda _t: (150, 120), 14, RED)]

    def light(t: int) -> float:
        return float(1 + 0.15 * np.sin(t / 5) + 0.03 * (-1) ** t)

    check(observe((clip := render(tmp_path / "a.mp4", discs, 24, light=light)).path), clip)


def test_strong_sensor_noise_makes_no_objects(tmp_path: Path) -> None:
    discs = [Disc(lambda t: (40 + 6.0 * t, 70), 15, BLUE), Disc(lambda _t: (150, 120), 14, GREEN)]
    check(observe((clip := render(tmp_path / "a.mp4", discs, 20, noise=7)).path), clip)


@pytest.mark.parametrize(("bgr", "level", "name"), [(BLACK, 200, "black"), (WHITE, 40, "white")])
def test_dark_on_bright_and_bright_on_dark(
    tmp_path: Path, bgr: tuple[float, float, float], level: float, name: str
) -> None:
    clip = render(tmp_path / "a.mp4", [Disc(lambda t: (40 + 6.0 * t, 70), 12, bgr)], 18, background=plain(level, 10))
    observation = observe(clip.path)
    check(observation, clip)
    assert observation.objects[0].colour.name == name


def test_bouncing_ball_before_a_textured_wall(tmp_path: Path) -> None:
    ball = Disc(lambda t: (30 + 5.0 * t, 130 - abs(90 * np.sin(t * 0.2 + 0.3))), 10, RED)
    clip = render(tmp_path / "a.mp4", [ball], 30, background=textured())
    observation = observe(clip.path)
    (name,) = check(observation, clip)
    error = np.hypot(*(observation.object(name).centroid - clip.centres(0)).T)
    assert np.nanmax(error) < 1.0
    assert any("textured" in w for w in observation.warnings)


def test_ball_that_moves_two_diameters_a_frame_is_one_ball(tmp_path: Path) -> None:
    discs = [
        Disc(lambda t: (10 + 14.0 * t if t < 16 else 220 - 14.0 * (t - 15), 70), 7, RED),
        Disc(lambda _t: (120, 120), 8, BLUE),
    ]
    check(observe((clip := render(tmp_path / "a.mp4", discs, 28)).path), clip, mean=0.9)


@pytest.fixture(scope="module")
def simple(tmp_path_factory: pytest.TempPathFactory) -> Clip:
    discs = [Disc(lambda t: (40 + 4.0 * t, 70), 15, BLUE), Disc(lambda _t: (150, 120), 14, RED)]
    return render(tmp_path_factory.mktemp("simple") / "a.mp4", discs, 16)


def test_equal_inputs_give_equal_bytes_and_survive_json(simple: Clip) -> None:
    first, second = (json.dumps(observe(simple.path).to_dict()) for _ in range(2))
    assert first == second
    again = ImageObservation.from_dict(json.loads(first))
    assert json.dumps(again.to_dict()) == first
    for name in again.names:
        mask = again.mask(name, 7)
        y, x = np.nonzero(mask)
        assert np.allclose(again.object(name).centroid[7], [x.mean(), y.mean()])
        assert again.object(name).area[7] == mask.sum()


def test_expected_objects_give_their_names_and_missing_ones_are_named(simple: Clip) -> None:
    observation = observe(simple.path, expected=["red ball", "blue ball", "yellow cube"])
    assert set(observation.names) == {"red_ball", "blue_ball"}
    assert any("yellow cube" in w for w in observation.warnings)
    assert observation.object("red_ball").centroid[0][0] == pytest.approx(150, abs=1)


def test_limits_are_stated_not_silent(simple: Clip) -> None:
    observation = observe(simple.path, max_objects=1)
    assert len(observation.objects) == 1
    assert any("max_objects" in w for w in observation.warnings)
    with pytest.raises(ObservationError, match=r"1\.\.200"):
        observe(simple.path, max_objects=0)
    with pytest.raises(ObservationError, match="unknown object 'ball'"):
        observation.object("ball")
    with pytest.raises(ObservationError, match=r"0\.\.15"):
        observation.mask(observation.names[0], 16)


def test_observation_can_be_cancelled_and_reports_its_progress(simple: Clip) -> None:
    shares: list[float] = []
    observe(simple.path, progress=lambda share, _what: shares.append(share))
    assert shares == sorted(shares)
    assert shares[-1] == 1.0
    with pytest.raises(PerceptionCancelled):
        observe(simple.path, cancelled=lambda: True)


def test_clip_without_objects_says_so(tmp_path: Path) -> None:
    observation = observe(render(tmp_path / "a.mp4", [], 12).path)
    assert observation.objects == ()
    assert any("no object" in w for w in observation.warnings)


def test_moving_camera_is_noticed(tmp_path: Path) -> None:
    rng = np.random.default_rng(5)
    wall = cv2.GaussianBlur(rng.uniform(0, 255, (160, 700, 3)).astype(np.float32), (0, 0), 3)
    wall = np.clip(128 + 6 * (wall - wall.mean()), 0, 255).astype(np.uint8)
    film = write_film(tmp_path / "pan.mp4", (wall[:, 20 * t : 20 * t + 240] for t in range(20)))
    assert any("does the camera move" in w for w in observe(film).warnings)
