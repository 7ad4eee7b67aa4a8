"""Shapes of deformable objects over a video, from their masks: centrelines, outlines, occupancy; and which deform."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.masks import Mask
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject
from atw_mcp.perception.skeleton import centreline
from atw_mcp.perception.video import Cancelled, Progress, report
from polyworld.data.shape_series import ShapeSeries
from polyworld.probing.readouts import Centreline, Curve, ImageOccupancy, Outline

Floats = NDArray[np.float64]
Material = Literal["rope", "cloth", "soft", "fluid"]

POINTS = 16  # of a centreline
DIRECTIONS = 8  # of an outline
CELLS = 24  # of an occupancy grid along the longer side of the image
CENTRELINE_SIGMA, OUTLINE_SIGMA = 1.0, 0.8  # [px]
BORDER_ERROR = 0.7  # [px] by which the border of a mask is wrong
LEAST_CONFIDENCE = 0.3  # of a frame that is measured

ELONGATED = 10.0  # length over width from which a shape is taken for a rope
CHANGING = 0.12  # spread of the logarithm of an outline's slenderness from which a shape is said to deform
HOLLOW = 0.08  # spread of the share of its hull that a shape fills, likewise
LOOKED_AT = 16  # frames


@dataclass(frozen=True)
class Deforming:
    """An object that seems to change its shape: what it may be, and the numbers that say so.

    length_over_width: of its centreline (median). slenderness_spread: standard deviation over time of the logarithm of
    the ratio of its principal axes. hull_spread: standard deviation of the share of its convex hull that it fills.
    """

    object: str
    suggests: Literal["rope", "cloth, soft or fluid"]
    length_over_width: float
    slenderness_spread: float
    hull_spread: float

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return {
            "object": self.object,
            "may_be": self.suggests,
            "length_over_width": round(self.length_over_width, 1),
            "slenderness_spread": round(self.slenderness_spread, 3),
            "hull_spread": round(self.hull_spread, 3),
        }


def deforming(observation: ImageObservation) -> list[Deforming]:
    """Objects whose shape in the image is drawn out or changes more than a rigid one's does while in full view.

    Perspective and turning change a rigid object's outline too: this is a hint, not a finding.
    """
    found = []
    for observed in observation.objects:
        rows = _clear_rows(observed)
        if len(rows) < 5:
            continue
        picked = rows[np.unique(np.rint(np.linspace(0, len(rows) - 1, LOOKED_AT)).astype(int))]
        masks = [_mask(observed, int(t)) for t in picked]
        slender = np.array([_slenderness(m) for m in masks])
        spread = float(np.std(np.log(np.maximum(slender, 1.0))))
        hull = float(np.std([_filled_share(m) for m in masks]))
        if hull <= 0.5 * HOLLOW:  # it fills its hull alike all the time, as rigid things do
            continue
        lines = [centreline(m) for m in masks]
        ratio = float(np.median([line.length / line.width for line in lines if line is not None] or [0.0]))
        # A rigid bar is drawn out too, but stays straight: its outline fills its hull whatever it does.
        if ratio > ELONGATED:
            found.append(Deforming(observed.name, "rope", ratio, spread, hull))
        elif hull > HOLLOW or spread > CHANGING:
            found.append(Deforming(observed.name, "cloth, soft or fluid", ratio, spread, hull))
    return found


def image_shapes(
    observation: ImageObservation,
    kinds: Mapping[str, Material],
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> tuple[ShapeSeries, ...]:
    """Measure each named object in every frame, in pixels; rows are those of the observation.

    rope: its centreline where it is seen from end to end, else the curve of the part that is seen. soft: how far its
    outline reaches in eight directions. cloth: the same, and the share of cells of the image it covers. fluid: that
    share alone. Cells that another object covers, and frames of low confidence, have confidence 0. Raises
    ObservationError for an unknown object or kind.
    """
    series: list[ShapeSeries] = []
    for done, (name, kind) in enumerate(kinds.items()):
        report(progress, cancelled, done / len(kinds), f"shape of {name}")
        observed = observation.object(name)
        if kind == "rope":
            series += _rope(observation, observed)
        elif kind == "soft":
            series += [_outline(observation, observed)]
        elif kind == "cloth":
            series += [_outline(observation, observed), _occupancy(observation, observed)]
        elif kind == "fluid":
            series += [_occupancy(observation, observed)]
        else:
            raise ObservationError(f"unknown kind {kind!r} of {name!r}; kinds: rope, cloth, soft, fluid")
    return tuple(s for s in series if np.any(s.confidence > 0.0))


def _rope(observation: ImageObservation, observed: ObservedObject) -> list[ShapeSeries]:
    count = len(observation.frames)
    values = {whole: np.full((count, POINTS, 2), np.nan) for whole in (True, False)}
    confidence = {whole: np.zeros((count, POINTS)) for whole in (True, False)}
    lines = [centreline(_mask(observed, t)) if observed.masks[t] is not None else None for t in range(count)]
    hidden = _occluded(observed)
    lengths = [line.length for t, line in enumerate(lines) if line is not None and line.whole and not hidden[t]]
    usual = float(np.median(lengths)) if lengths else np.inf
    before: Floats | None = None
    for t, line in enumerate(lines):
        if line is None or line.covered < 0.5 or observed.confidence[t] < LEAST_CONFIDENCE:
            continue
        points = line.evenly(POINTS)
        # One direction for the whole video: that of the frame before.
        if before is not None and _turned(points, before):
            points = points[::-1]
        # A rope that is shorter than it was lies across itself, or is partly hidden.
        whole = line.whole and not hidden[t] and abs(line.length / usual - 1.0) < 0.25
        values[whole][t] = points
        confidence[whole][t] = observed.confidence[t] * line.covered
        before = points
    name, sigma = observed.name, np.full((count, POINTS), CENTRELINE_SIGMA)
    return [
        ShapeSeries(
            Centreline(object=name, count=POINTS, view="image", directed=False), values[True], sigma, confidence[True]
        ),
        ShapeSeries(Curve(object=name, count=POINTS, view="image"), values[False], sigma, confidence[False]),
    ]


def _outline(observation: ImageObservation, observed: ObservedObject) -> ShapeSeries:
    angle = 2.0 * np.pi * np.arange(DIRECTIONS) / DIRECTIONS
    directions = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    count = len(observation.frames)
    values, confidence = np.full((count, DIRECTIONS, 1), np.nan), np.zeros((count, DIRECTIONS))
    hidden = _occluded(observed)
    for t in range(count):
        if observed.masks[t] is None or hidden[t] or observed.confidence[t] < LEAST_CONFIDENCE:
            continue
        v, u = np.nonzero(_mask(observed, t))
        pixels = np.stack([u, v], axis=1).astype(float)
        # A pixel is a square: it reaches half a pixel further, a little more along the diagonal.
        square = 0.5 * np.abs(directions).sum(axis=1)
        values[t, :, 0] = (pixels @ directions.T).max(axis=0) + square
        reaches = _reaches_border(pixels, directions, observation)
        confidence[t] = observed.confidence[t] * ~reaches
    readout = Outline(
        object=observed.name, directions=tuple((float(x), float(y), 0.0) for x, y in directions), view="image"
    )
    return ShapeSeries(readout, values, np.full((count, DIRECTIONS), OUTLINE_SIGMA), confidence)


def _occupancy(observation: ImageObservation, observed: ObservedObject) -> ShapeSeries:
    width, height = observation.video.width, observation.video.height
    side = max(width, height) / CELLS
    columns, rows = max(1, round(width / side)), max(1, round(height / side))
    count = len(observation.frames)
    values, confidence = np.full((count, rows * columns, 1), np.nan), np.zeros((count, rows * columns))
    number = observation.names.index(observed.name) + 1
    for t, frame in enumerate(observation.frames):
        if observed.masks[t] is None or observed.confidence[t] < LEAST_CONFIDENCE:
            continue
        labels = observation.label_image(frame)
        values[t, :, 0] = np.round(_cell_means(labels == number, columns, rows), 4)
        others = _cell_means((labels != number) & (labels > 0), columns, rows)
        confidence[t] = observed.confidence[t] * (others < 0.05)
    sigma = max(0.03, BORDER_ERROR / side)
    return ShapeSeries(
        ImageOccupancy(object=observed.name, columns=columns, rows=rows),
        np.where(confidence[..., None] > 0.0, values, np.nan),
        np.full((count, rows * columns), sigma),
        confidence,
    )


def _cell_means(mask: Mask, columns: int, rows: int) -> Floats:
    means = cv2.resize(np.asarray(mask, dtype=np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
    return np.asarray(means, dtype=float).ravel()


def _turned(points: Floats, before: Floats) -> bool:
    ahead = ((points - before) ** 2).sum()
    return bool(((points[::-1] - before) ** 2).sum() < ahead)


def _mask(observed: ObservedObject, row: int) -> Mask:
    stored = observed.masks[row]
    assert stored is not None  # asked only of rows with a mask
    return stored.decode()


def _occluded(observed: ObservedObject) -> NDArray[np.bool_]:
    return np.array([s in ("occluded", "hidden", "absent") for s in observed.status])


def _clear_rows(observed: ObservedObject) -> NDArray[np.intp]:
    clear = [s == "visible" and m is not None for s, m in zip(observed.status, observed.masks, strict=True)]
    return np.flatnonzero(clear)


def _reaches_border(pixels: Floats, directions: Floats, observation: ImageObservation) -> NDArray[np.bool_]:
    """For each direction whether the outline there is cut off by the image's border."""
    size = np.array([observation.video.width, observation.video.height]) - 1.0
    farthest = pixels[np.argmax(pixels @ directions.T, axis=0)]
    reaches: NDArray[np.bool_] = np.any((farthest <= 1.0) | (farthest >= size - 1.0), axis=1)
    return reaches


def _slenderness(mask: Mask) -> float:
    """Ratio of the longer to the shorter principal axis of a mask."""
    v, u = np.nonzero(mask)
    covariance = np.cov(np.stack([u, v])) + np.eye(2) / 12.0  # a pixel has an extent
    low, high = np.linalg.eigvalsh(covariance)
    return float(np.sqrt(high / low))


def _filled_share(mask: Mask) -> float:
    """Area of a mask over that of its convex hull."""
    v, u = np.nonzero(mask)
    hull = cv2.convexHull(np.stack([u, v], axis=1).astype(np.int32))
    area = float(cv2.contourArea(hull)) + 0.5 * float(cv2.arcLength(hull, True)) + 1.0  # pixels are squares
    return min(len(u) / area, 1.0)
