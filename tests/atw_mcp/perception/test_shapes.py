"""Shapes measured from masks that were drawn from known curves and discs."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from atw_mcp.perception.cues import shape_cue
from atw_mcp.perception.masks import RunLengthMask
from atw_mcp.perception.observation import Cue, ImageObservation, ObservationError, ObservedObject, measure
from atw_mcp.perception.shapes import DIRECTIONS, deforming, image_shapes
from atw_mcp.perception.video import VideoInfo
from polyworld.data.shape_series import ShapeSeries
from polyworld.probing.readouts import Centreline, Curve, ImageOccupancy, Outline

Floats = NDArray[np.float64]
Mask = NDArray[np.bool_]
WIDTH, HEIGHT, FRAMES = 240, 180, 12


def canvas() -> NDArray[np.uint8]:
    return np.zeros((HEIGHT, WIDTH), dtype=np.uint8)


def seen(name: str, masks: list[Mask]) -> ObservedObject:
    stored = tuple(RunLengthMask.encode(m) if m.any() else None for m in masks)
    centroid, box, area = measure(stored)
    cue = Cue("unknown", 0.0, {})
    return ObservedObject(
        name=name,
        colour=cue,
        material=cue,
        shape=cue,
        status=tuple("absent" if m is None else "visible" for m in stored),
        confidence=np.array([0.0 if m is None else 0.9 for m in stored]),
        centroid=centroid,
        box=box,
        area=area,
        masks=stored,
        entry_frame=0,
        exit_frame=len(masks) - 1,
        enters=False,
        exits=False,
    )


def observation(*objects: ObservedObject) -> ImageObservation:
    info = VideoInfo("drawn.mp4", FRAMES, WIDTH, HEIGHT, 25.0, "", FRAMES)
    return ImageObservation(info, tuple(range(FRAMES)), objects)


def pendulum(t: int) -> Floats:
    """A rope hung at (120, 20) that swings and bows, 120 px long."""
    s = np.linspace(0.0, 1.0, 200)
    angle = 0.6 * np.sin(0.5 * t) + 0.8 * np.cos(0.4 * t) * s
    step = np.stack([np.sin(angle), np.cos(angle)], axis=1) * 120.0 / 200.0
    return np.array([120.0, 20.0]) + np.cumsum(step, axis=0)


def rope_mask(t: int, width: int = 4) -> Mask:
    image = canvas()
    cv2.polylines(image, [np.round(pendulum(t) * 16).astype(np.int32)], False, 255, width, cv2.LINE_8, 4)
    return image > 0


def ellipse_mask(t: int, wobble: float) -> Mask:
    image = canvas()
    half = 30.0 * np.array([1.0 + wobble * np.sin(0.9 * t), 1.0 / (1.0 + wobble * np.sin(0.9 * t))])
    cv2.ellipse(image, ((100.0 + 3 * t, 90.0), tuple(2 * half), 0.0), 255, -1)
    return image > 0


def one(series: tuple[ShapeSeries, ...], kind: type) -> ShapeSeries:
    return next(s for s in series if isinstance(s.readout, kind))


def test_a_rope_is_followed_along_its_centreline_in_one_direction_throughout() -> None:
    series = image_shapes(observation(seen("rope", [rope_mask(t) for t in range(FRAMES)])), {"rope": "rope"})
    line = one(series, Centreline)
    assert np.all(line.confidence.min(axis=1) > 0.5)
    truth = np.stack([pendulum(t)[np.linspace(0, 199, 16).round().astype(int)] for t in range(FRAMES)])
    first = line.values if np.abs(line.values[0, 0] - truth[0, 0]).max() < 20 else line.values[:, ::-1]
    away = np.linalg.norm(first - truth, axis=2)
    assert np.sqrt((away**2).mean()) < 1.2 * float(line.sigma[0, 0])
    assert away.max() < 4.0


def test_a_rope_that_is_partly_hidden_gives_a_part_of_a_curve_instead() -> None:
    masks = [rope_mask(t) for t in range(FRAMES)]
    for t in (4, 5):
        masks[t][90:, :] = False  # its lower part is behind something of its own colour
    series = image_shapes(observation(seen("rope", masks)), {"rope": "rope"})
    whole, part = one(series, Centreline), one(series, Curve)
    assert (whole.confidence.max(axis=1) > 0).tolist() == [t not in (4, 5) for t in range(FRAMES)]
    assert (part.confidence.max(axis=1) > 0).tolist() == [t in (4, 5) for t in range(FRAMES)]
    away = np.linalg.norm(part.values[4][:, None] - pendulum(4)[None], axis=2).min(axis=1)
    assert away.max() < 1.8


def test_an_outline_reaches_as_far_as_the_ellipse_it_was_drawn_from() -> None:
    masks = [ellipse_mask(t, 0.2) for t in range(FRAMES)]
    (outline,) = image_shapes(observation(seen("ball", masks)), {"ball": "soft"})
    assert isinstance(outline.readout, Outline)
    directions = np.asarray(outline.readout.directions)[:, :2]
    for t in range(FRAMES):
        half = 30.0 * np.array([1.0 + 0.2 * np.sin(0.9 * t), 1.0 / (1.0 + 0.2 * np.sin(0.9 * t))])
        support = np.sqrt(((directions * half) ** 2).sum(axis=1)) + directions @ [100.0 + 3 * t, 90.0]
        assert outline.values[t, :, 0] == pytest.approx(support, abs=1.3)
    assert outline.values.shape == (FRAMES, DIRECTIONS, 1)


def test_a_direction_in_which_the_image_ends_is_not_measured() -> None:
    image = canvas()
    cv2.circle(image, (WIDTH - 20, 90), 30, 255, -1)
    (outline,) = image_shapes(observation(seen("ball", [image > 0] * FRAMES)), {"ball": "soft"})
    assert isinstance(outline.readout, Outline)
    directions = np.asarray(outline.readout.directions)
    right = directions @ [1.0, 0.0, 0.0] > 0.9
    assert np.all(outline.confidence[:, right] == 0.0)
    assert np.all(outline.confidence[:, directions[:, 0] < -0.5] > 0.5)


def test_occupancy_reports_areas_and_leaves_out_what_something_else_covers() -> None:
    pool, post = canvas(), canvas()
    pool[100:150, 40:200] = 1
    post[60:180, 110:130] = 1
    pool[post > 0] = 0
    both = observation(seen("water", [pool > 0] * FRAMES), seen("post", [post > 0] * FRAMES))
    (grid,) = image_shapes(both, {"water": "fluid"})
    assert isinstance(grid.readout, ImageOccupancy)
    cell = (WIDTH / grid.readout.columns) * (HEIGHT / grid.readout.rows)
    known = grid.confidence[3] > 0
    share = grid.values[3, :, 0].reshape(grid.readout.rows, grid.readout.columns)
    hidden = ~known.reshape(share.shape)
    assert hidden[:, int(120 / WIDTH * grid.readout.columns)].sum() >= 10
    assert np.nansum(share[:, : int(100 / WIDTH * grid.readout.columns)]) * cell == pytest.approx(60 * 50, rel=0.03)


def test_what_swings_as_a_bow_or_wobbles_is_noticed_and_a_rigid_disc_is_not() -> None:
    disc = seen("disc", [ellipse_mask(t, 0.0) for t in range(FRAMES)])
    rope = seen("rope", [rope_mask(t) for t in range(FRAMES)])
    splash = []
    for t in range(FRAMES):
        image = canvas()
        image[120:150, 60 : 80 + 8 * t] = 1  # a sheet that spreads below a column that sinks
        image[60 + 5 * t : 150, 60:90] = 1
        splash.append(image > 0)
    noticed = {item.object: item.suggests for item in deforming(observation(disc, rope, seen("splash", splash)))}
    assert noticed == {"rope": "rope", "splash": "cloth, soft or fluid"}


def test_an_unknown_object_is_refused_with_those_there_are() -> None:
    drawn = observation(seen("rope", [rope_mask(t) for t in range(FRAMES)]))
    with pytest.raises(ObservationError, match="objects: \\['rope'\\]"):
        image_shapes(drawn, {"string": "rope"})


def test_a_sliver_has_a_shape_that_can_be_stored() -> None:
    """A line of pixels, as edges and reflections leave, is fitted by no box at all: numbers stay finite."""
    slivers = []
    for row in (40, 41, 44):
        mask = np.zeros((80, 120), dtype=bool)
        mask[row, 20:100] = True
        slivers.append(mask)
    cue = shape_cue(slivers)
    assert all(np.isfinite(value) for value in cue.measured.values())
    assert np.isfinite(cue.confidence)
