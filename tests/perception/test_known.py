"""Known bodies in drawn clips: balls of known paths on a floor seen from above at an angle."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from atw_mcp.perception.known.bodies import KnownBody
from atw_mcp.perception.known.colour_words import colour_word
from atw_mcp.perception.known.observe import observe_known
from atw_mcp.perception.observation import ObservationError
from polyworld.camera import Camera

WIDTH, HEIGHT, FRAMES, FOCAL, HIGH, RADIUS = 320, 240, 24, 300.0, 2.0, 0.12
PLACES = np.array([[-1.0, -0.7, 0.0], [1.0, -0.7, 0.0], [1.0, 0.7, 0.0], [-1.0, 0.7, 0.0]])


def from_above() -> Camera:
    """A camera that looks straight down on the floor from HIGH [m]."""
    return Camera(
        width=WIDTH,
        height=HEIGHT,
        intrinsics=((FOCAL, 0.0, (WIDTH - 1) / 2), (0.0, FOCAL, (HEIGHT - 1) / 2), (0.0, 0.0, 1.0)),
        rotation=((1.0, 0.0, 0.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
        translation=(0.0, 0.0, HIGH),
    )


def drawn(path: Path) -> dict[str, np.ndarray]:
    """Write a clip of a red ball that rolls past a green one at rest, and of a black mark that is neither; returns
    the balls' centres (T, 2) [px]."""
    rng = np.random.default_rng(7)
    floor = np.full((HEIGHT, WIDTH, 3), 120.0) + rng.normal(0, 6, (HEIGHT, WIDTH, 1))
    centres = {
        "runner": np.stack([np.linspace(40, 260, FRAMES), np.full(FRAMES, 80.0)], axis=1),
        "sleeper": np.tile([200.0, 170.0], (FRAMES, 1)),
    }
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 24, (WIDTH, HEIGHT))
    pixels = RADIUS * FOCAL / (HIGH - RADIUS)
    for t in range(FRAMES):
        frame = floor.copy()
        cv2.rectangle(frame, (20, 190), (60, 200), (10, 10, 10), cv2.FILLED)
        for name, colour in (("runner", (30, 30, 200)), ("sleeper", (40, 150, 30))):
            x, y = centres[name][t]
            cv2.circle(frame, (round(16 * x), round(16 * y)), round(16 * pixels), colour, cv2.FILLED, cv2.LINE_AA, 4)
        writer.write(np.clip(frame + rng.normal(0, 2, frame.shape), 0, 255).astype(np.uint8))
    writer.release()
    return centres


def test_known_bodies_are_found_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    centres = drawn(path)
    bodies = [KnownBody("runner", "red", RADIUS, RADIUS), KnownBody("sleeper", "green ball", RADIUS, RADIUS)]
    seen = observe_known(path, bodies, from_above(), PLACES)
    assert seen.names == ("runner", "sleeper")
    diameter = 2 * RADIUS * FOCAL / (HIGH - RADIUS)
    for name, truth in centres.items():
        off = np.linalg.norm(seen.object(name).centroid - truth, axis=1)
        assert np.nanmedian(off) < 0.03 * diameter
        assert np.isfinite(off).all()


def test_a_body_that_is_not_there_is_named_in_the_warnings(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    drawn(path)
    bodies = [KnownBody("runner", "red", RADIUS, RADIUS), KnownBody("ghost", "purple", RADIUS, RADIUS)]
    seen = observe_known(path, bodies, from_above(), PLACES)
    assert seen.names == ("runner",)
    assert any("ghost" in text for text in seen.warnings)


def test_what_names_no_colour_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "clip.avi"
    drawn(path)
    with pytest.raises(ObservationError, match="names no colour"):
        observe_known(path, [KnownBody("a", "heavy", RADIUS, RADIUS)], from_above(), PLACES)


def test_the_longest_colour_in_a_description_is_taken() -> None:
    assert colour_word("a dark grey cube") == "dark grey"
    assert colour_word("gray") == "grey"
    assert colour_word("metal sphere") is None
