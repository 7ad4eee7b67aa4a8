"""Appearance of an object: a colour's name, metal or rubber, and the solid its silhouette fits."""

from __future__ import annotations

from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.eye.colour_names import chances
from atw_mcp.perception.masks import Mask, window
from atw_mcp.perception.masks import solidity as solidity_of
from atw_mcp.perception.observation import Cue
from atw_mcp.perception.video import Frames

Floats = NDArray[np.float64]

UNKNOWN = Cue("unknown", 0.0, {})


def colour_cue(samples: list[tuple[Frames, Mask]]) -> Cue:
    """Word for the typical colour under masks, by a survey of names; sure where no other word suits it as well.

    Highlights and the darkest parts, where hue is mostly noise or reflection, are left out.
    """
    pixels = np.concatenate([image[mask] for image, mask in samples])
    if len(pixels) < 5:
        return UNKNOWN
    luminance = pixels @ np.array([0.114, 0.587, 0.299])
    low, high = np.percentile(luminance, [25, 90])
    blue, green, red = np.median(pixels[(luminance >= low) & (luminance <= high)], axis=0)
    likely = chances(np.array([[blue, green, red]]).astype(np.uint8))
    second, best = sorted(likely, key=lambda word: likely[word])[-2:]
    sure = likely[best] / (likely[best] + likely[second])
    measured = {"r": float(red), "g": float(green), "b": float(blue)}
    return Cue("gray" if best == "grey" else best, sure, measured)


def material_cue(samples: list[tuple[Frames, Mask]]) -> Cue:
    """Metal, if the object mirrors lights and surroundings; rubber, if it shades smoothly.

    measured: highlight, the brightest of the object over its median; contrast, the range of its luminance
    over its median; texture, the median local change of luminance over the median.
    """
    highlights, contrasts, textures = [], [], []
    for image, mask in samples:
        part = window(mask)
        mask, luminance = mask[part], image[part].astype(float) @ np.array([0.114, 0.587, 0.299])
        values = luminance[mask]
        if len(values) < 30:
            continue
        middle = max(float(np.median(values)), 40.0)  # below, noise would look like texture
        highlights.append(float(np.percentile(values, 99.5)) / middle)
        p10, p90 = np.percentile(values, [8, 92])
        contrasts.append(float(p90 - p10) / middle)
        step = np.abs(np.diff(luminance, axis=0))[mask[1:] & mask[:-1]]
        textures.append(float(np.percentile(step, 90)) / middle if len(step) else 0.0)
    if not highlights:
        return UNKNOWN
    measured = {
        "highlight": float(np.median(highlights)),
        "contrast": float(np.median(contrasts)),
        "texture": float(np.median(textures)),
    }
    # Logistic scores about the levels where diffuse shading under soft light ends.
    score = (
        80.0 * (measured["texture"] - 0.074) + 2.0 * (measured["highlight"] - 1.3) + 3.0 * (measured["contrast"] - 0.28)
    )
    metal = 1 / (1 + np.exp(-score))
    return Cue("metal" if metal > 0.5 else "rubber", float(max(metal, 1 - metal)), measured)


ANGLES = np.arange(36) * np.pi / 36


def silhouette_widths(mask: Mask) -> Floats:
    """Widths (36,) of a mask between parallel tangents whose normals are 0, 5, ... 175 degrees [px]."""
    y, x = np.nonzero(mask)
    normals = np.stack([np.cos(ANGLES), np.sin(ANGLES)])
    along = np.stack([x, y], axis=1) @ normals
    # A pixel has an extent of its own: that of a unit square along the normal.
    pixel = np.abs(normals).sum(axis=0)
    widths: Floats = along.max(axis=0) - along.min(axis=0) + 0.85 * pixel
    return widths


WORST = 1.0  # residual of a solid that fits not at all, as a box does a sliver


def shape_cue(masks: list[Mask]) -> Cue:
    """Return the solid whose outline, seen from afar, fits the silhouettes: sphere, cylinder, cube or box; else other.

    Each silhouette's widths in 36 directions are compared with those of a ball, of an upright cylinder and of
    an upright box in any view; measured holds each one's residual as a
    share of the size, solidity (area over that of the convex hull) and `roundness`.
    """
    residuals: dict[str, list[float]] = {"sphere": [], "cylinder": [], "box": []}
    solidity, evenness, round_share = [], [], []
    for mask in masks:
        widths = silhouette_widths(mask)
        solidity.append(solidity_of(mask))
        round_share.append(roundness(mask))
        for kind, (error, even) in fit_solids(widths).items():
            residuals[kind].append(error)
            if kind == "box":
                evenness.append(even)
    if not solidity:
        return UNKNOWN
    measured = {k: float(min(np.median(v), WORST)) for k, v in residuals.items()}
    measured["solidity"] = float(np.median(solidity))
    measured["evenness"] = float(np.median(evenness))
    measured["roundness"] = float(np.median(round_share))
    if measured["solidity"] < 0.88:
        return Cue("other", min(1.0, 0.5 + 3 * (0.88 - measured["solidity"])), measured)
    # A solid with more freedom must fit clearly better to be believed.
    bonus = float(np.clip(0.1 * (measured["roundness"] - 0.5), -0.03, 0.03))
    penalised = {
        "sphere": measured["sphere"] - bonus,
        "cylinder": measured["cylinder"] + 0.006,
        "box": measured["box"] + 0.006,
    }
    order = sorted(penalised, key=lambda k: penalised[k])
    best, second = order[0], order[1]
    if penalised[best] > 0.09:
        return Cue("other", 0.5, measured)
    confidence = 1 / (1 + np.exp(-(penalised[second] - penalised[best]) / 0.006))
    name = best if best != "box" else ("cube" if measured["evenness"] > 0.72 else "box")
    return Cue(name, float(confidence), measured)


def fit_solids(widths: Floats) -> dict[str, tuple[float, float]]:
    """Relative RMS residual of each solid's best fit to silhouette widths, and the ratio of a box's extents."""
    scale = float(widths.mean())
    # Off the optical axis a ball's outline is an ellipse, stretched by up to 1 / cos of the angle to the axis.
    stretch = np.stack([np.ones(36), np.cos(2 * ANGLES), np.sin(2 * ANGLES)], axis=1)
    coefficients, *_ = np.linalg.lstsq(stretch, widths, rcond=None)
    size, allowed = np.hypot(coefficients[1], coefficients[2]), 0.05 * coefficients[0]
    if size > allowed:
        coefficients[1:] *= allowed / size
    sphere = float(np.sqrt(np.mean((stretch @ coefficients - widths) ** 2)) / scale)
    cylinders, boxes = _designs()
    cylinder, _, _ = _best_lengths(cylinders, widths)
    box, chosen, lengths = _best_lengths(boxes, widths)
    directions = _BOX_DIRECTIONS[chosen] * (np.pi / 36)
    edges = np.stack([np.cos(directions), np.sin(directions)], axis=1) * lengths[:, None]
    return {"sphere": (sphere, 1.0), "cylinder": (cylinder / scale, 1.0), "box": (box / scale, _evenness(edges))}


_UPRIGHT = (15, 16, 17, 18, 19, 20, 21)  # in steps of 5 degrees: edges that stand, leaning with the perspective
_BOX_DIRECTIONS = np.array([(u, i, j) for u in _UPRIGHT for i in range(36) for j in range(i) if u not in (i, j)])


@lru_cache(maxsize=1)
def _designs() -> tuple[tuple[Floats, Floats], tuple[Floats, Floats]]:
    """Widths per unit length, (k, 36, m), and their pseudo-inverses, (k, m, 36), of cylinders and boxes.

    Seen from afar under any skew, a box's outline is the sum of three segments and an upright cylinder's that
    of a segment and a flattened ellipse; widths of a sum of figures add.
    """
    segment = np.abs(np.cos(ANGLES[:, None] - ANGLES[None, :]))  # (normal, direction of a unit segment)
    boxes = np.moveaxis(segment[:, _BOX_DIRECTIONS], 0, 1)
    cylinders = []
    for flatness in np.linspace(0.05, 0.9, 12):
        for lean in np.deg2rad(np.arange(-15, 16, 5.0)):
            ellipse = np.hypot(np.cos(ANGLES - lean), flatness * np.sin(ANGLES - lean))
            cylinders += [np.stack([ellipse, segment[:, u]], axis=1) for u in _UPRIGHT]
    tall = np.stack(cylinders)
    return (tall, np.linalg.pinv(tall)), (boxes, np.linalg.pinv(boxes))


def _best_lengths(designs: tuple[Floats, Floats], widths: Floats) -> tuple[float, int, Floats]:
    """RMS residual [px], index and lengths [px] of the design that fits best with lengths >= 0, none tiny."""
    forward, inverse = designs
    lengths = inverse @ widths
    error = np.sqrt(np.mean(((forward @ lengths[..., None])[..., 0] - widths) ** 2, axis=1))
    # A cylinder without height or a box without depth would be any flat figure.
    error[lengths.min(axis=1) < 0.05 * widths.mean()] = np.inf
    best = int(np.argmin(error))
    return float(error[best]), best, lengths[best]


def _evenness(edges: Floats) -> float:
    """Ratio (<= 1) of height to width of a box with square base, from its edges' images (3, 2), upright first.

    With unit base edges turned by any angle, the sum of squares of the images' x is 1 and of their y the
    squared sine of the view's tilt, by whose cosine the upright edge is shortened.
    """
    base = float(np.hypot(edges[1, 0], edges[2, 0]))
    if base < 1e-6:
        return 0.0
    sine = min(float(np.hypot(edges[1, 1], edges[2, 1])) / base, 0.98)
    height = float(np.hypot(*edges[0])) / np.sqrt(1 - sine**2)
    return float(min(height / base, base / max(height, 1e-6)))


def roundness(mask: Mask) -> float:
    """Share of the outline that lies on one ellipse near a circle, contact shadows and the like apart.

    In polar coordinates about the centroid the radius is fitted by 1, cos, sin (a shifted centre), cos 2, sin 2
    (a stretch), robustly and more tolerant outwards than inwards.
    """
    contours, _ = cv2.findContours(mask.astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    outline = max(contours, key=len)[:, 0, :].astype(float)
    if len(outline) < 12:
        return 0.0
    offset = outline - outline.mean(axis=0)
    for _ in range(2):
        angle, radius = np.arctan2(offset[:, 1], offset[:, 0]), np.hypot(offset[:, 0], offset[:, 1])
        design = np.stack(
            [np.ones(len(angle)), np.cos(angle), np.sin(angle), np.cos(2 * angle), np.sin(2 * angle)], axis=1
        )
        coefficients = np.array([float(np.median(radius)), 0.0, 0.0, 0.0, 0.0])
        for _ in range(12):
            error = radius - design @ coefficients
            scale = np.where(error > 0, 0.5, 1.0)
            weighted = design / (1 + (error / scale) ** 2)[:, None]
            coefficients = np.linalg.solve(weighted.T @ design + 1e-6 * np.eye(5), weighted.T @ radius)
            stretch, allowed = float(np.hypot(coefficients[3], coefficients[4])), 0.06 * float(coefficients[0])
            if stretch > allowed:
                coefficients[3:] *= allowed / stretch
        offset = offset - coefficients[1:3]  # again about the fitted centre, where the harmonics are exact
    return float(np.mean(np.abs(error) < max(0.6, 0.025 * float(coefficients[0]))))
