"""Discovery on drawn pictures whose truth is known."""

from __future__ import annotations

import cv2
import numpy as np

from atw_mcp.perception.eye.discover import Proposal, discover
from atw_mcp.perception.eye.observe import observe
from atw_mcp.perception.eye.seeds import Seed, outline_body
from tests.atw_mcp.perception.eye import drawn

COUNT = 20


def _off(proposal: Proposal, places: np.ndarray) -> float:
    """Distance [px] of a proposal's outline from where a body is."""
    seed = proposal.seeds[0]
    centre = seed.centre()
    assert centre is not None
    assert seed.frame is not None
    return float(np.linalg.norm(centre - places[seed.frame]))


def test_moving_discs_are_proposed_where_they_are_and_nothing_else() -> None:
    one, other = drawn.line((25.0, 30.0), (5.0, 1.0), COUNT), drawn.line((130.0, 90.0), (-5.0, 0.0), COUNT)
    found = discover(drawn.frames([(one, 9.0, drawn.RED), (other, 11.0, drawn.BLUE)]))
    assert len(found) == 2
    assert not any(p.ask for p in found)
    assert min(_off(p, one) for p in found) < 1.0
    assert min(_off(p, other) for p in found) < 1.0


def test_body_that_stands_for_most_of_the_clip_is_proposed_once() -> None:
    places = np.concatenate([np.tile([[50.0, 60.0]], (COUNT - 6, 1)), drawn.line((56.0, 60.0), (7.0, 0.0), 6)])
    found = discover(drawn.frames([(places, 9.0, drawn.RED)]))
    assert len(found) == 1
    assert _off(found[0], places) < 1.0


def test_shadow_is_no_sure_body() -> None:
    places = drawn.line((25.0, 40.0), (5.0, 1.0), COUNT)
    frames = drawn.frames([(places, 9.0, drawn.RED)])
    for frame, place in zip(frames, places, strict=True):
        dark = np.zeros(frame.shape[:2], np.float32)
        cv2.circle(dark, (round(place[0]) + 2, round(place[1]) + 26), 8, 1.0, -1)
        frame[:] = frame * (1 - 0.4 * cv2.GaussianBlur(dark, (0, 0), 1.5))[..., None]
    found = discover(frames)
    sure = [p for p in found if not p.ask]
    assert len(sure) == 1
    assert _off(sure[0], places) < 1.0
    assert all(p.kind == "shadow" for p in found if p.ask)


def test_still_pictures_with_noise_propose_what_stands_out_and_nothing_else() -> None:
    places = np.tile([[60.0, 50.0]], (COUNT, 1))
    (found,) = discover(drawn.frames([(places, 9.0, drawn.RED)], noise=4.0))
    assert _off(found, places) < 1.0
    assert discover(drawn.frames([(places - 200.0, 9.0, drawn.RED)], noise=4.0)) == []


def test_dark_place_that_looks_like_the_body_does_not_take_its_place_unsaid() -> None:
    """A body with a dark half, and its shadow that has the colour of that half."""
    places = drawn.line((25.0, 40.0), (5.0, 1.0), COUNT)
    frames = drawn.frames([(places + np.array([2.0, 13.0]), 8.0, (75.0, 75.0, 75.0)), (places, 8.0, drawn.RED)])
    for frame, place in zip(frames, places, strict=True):
        cv2.circle(frame, (round(place[0]) + 1, round(place[1]) + 3), 4, (75, 75, 75), -1, cv2.LINE_AA)
    seed = Seed("ball", "circle", 8, (places[8, 0], places[8, 1], 8.0))
    (track,) = observe(frames, [outline_body("ball", seed)], [seed])[0]
    error = np.linalg.norm(track.centres - places, axis=1)
    assert not ((error > 4.0) & (track.confidence > 0.8)).any()
    assert np.nanmedian(error) < 1.0
