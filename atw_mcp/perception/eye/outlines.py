"""Outlines: their shapes by the edges that the frames show, and which of those that cover each other lies in front."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import replace

import cv2
import numpy as np

from atw_mcp.perception.eye.bodies import Outline, outline_of
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import Floats, filled
from atw_mcp.perception.eye.settings import EyeSettings
from atw_mcp.perception.eye.silhouette import edges_beyond
from atw_mcp.perception.eye.states import State


def learn_shapes(scene: Scene, states: Sequence[Mapping[int, State]], held: Sequence[Mapping[int, Floats]]) -> None:
    """Move the points of each outline to the median edge that the frames show there, as far as a drawn one may be off.

    Poses of the scene and those held move with the centroid.
    """
    for i, body in enumerate(scene.bodies):
        if not isinstance(body, Outline) or not states[i]:
            continue
        frames = sorted(states[i])[:: max(1, len(states[i]) // 24)]
        count = len(body.contour(np.zeros(4), scene.settings.normals).points)
        seen = [(edges_beyond(scene, i, k, scene.poses[i, k]), scene.poses[i, k, 3]) for k in frames]
        own = [edges[np.arange(count) * len(edges) // count] * np.exp(-scale) for edges, scale in seen]
        shape = _moved_out(body, np.array(own), scene.settings)
        new, (u, v, *_) = outline_of(body.name, shape)
        scene.bodies[i] = replace(body, shape=new.shape)
        for pose in [*scene.poses[i], *held[i].values()]:
            pose[:2] += body.rotation(pose) @ [u, v]


def _moved_out(body: Outline, beyond: Floats, settings: EyeSettings) -> Floats:
    """Polygon (V, 2) of an outline about its origin, its points moved by the median of edges (T, N) beyond it [px]."""
    contour = body.contour(np.zeros(4), settings.normals)
    known = np.isfinite(beyond)
    count = known.sum(axis=0)
    middle = np.array(
        [np.median(column[shown]) if shown.any() else 0.0 for column, shown in zip(beyond.T, known.T, strict=True)]
    )
    weight = count / (count + 1.0)  # a drawn point is as good as the edge of one frame
    if body.round:
        off = np.full(len(middle), np.percentile(beyond[known], 50) if known.any() else 0.0)
    else:
        sigma = 1.0 / contour.spacing
        blurred = [cv2.GaussianBlur(np.tile(x, 3)[None], (0, 0), sigma)[0] for x in (middle * weight, weight)]
        off = (blurred[0] / (blurred[1] + 1e-9))[len(middle) : 2 * len(middle)] * weight
    off = np.clip(off, -settings.hold_pixels, settings.hold_pixels)
    finer, outward, along = _with_normals(body.shape, 1.5)
    at = (np.arange(len(off)) + 0.5) * contour.spacing
    return np.asarray(finer + outward * np.interp(along, at, off, period=contour.spacing * len(off))[:, None])


def _with_normals(polygon: Floats, most: float) -> tuple[Floats, Floats, Floats]:
    """Points of a polygon at most so far apart, its vertices among them, how they move where its edges move outward by
    one, and their distances along it."""
    edge = np.roll(polygon, -1, axis=0) - polygon
    length = np.maximum(np.linalg.norm(edge, axis=1), 1e-9)
    x, y = polygon.T
    turn = np.sign(np.sum(x * np.roll(y, -1) - np.roll(x, -1) * y))
    normal = turn * edge[:, ::-1] * [1.0, -1.0] / length[:, None]
    before = np.roll(normal, 1, axis=0)
    corner = (normal + before) / np.maximum(1 + (normal * before).sum(axis=1), 0.5)[:, None]
    parts = np.ceil(length / most).astype(int)
    starts = np.cumsum(length) - length
    points, moves, along = [], [], []
    for k, count in enumerate(parts):
        share = np.arange(count) / count
        points.append(polygon[k] + share[:, None] * edge[k])
        moves.append(np.where(share[:, None] > 0, normal[k], corner[k]))
        along.append(starts[k] + share * length[k])
    return np.concatenate(points), np.concatenate(moves), np.concatenate(along)


def order_outlines(scene: Scene) -> None:
    """Put outlines that overlap in order of depth: the one whose colours more of the pixels show that both cover."""
    outlines = [i for i, body in enumerate(scene.bodies) if isinstance(body, Outline)]
    before = []
    for i, j in itertools.combinations(outlines, 2):
        total = sum(_shown_more(scene, i, j, k) for k in range(scene.film.count))
        if total:
            before.append((i, j) if total > 0 else (j, i))
    layers = dict.fromkeys(outlines, 0)
    for _ in outlines:  # the longest row of bodies before each; those that go round in a ring have no order
        for i, j in before:
            layers[j] = max(layers[j], min(layers[i] + 1, len(outlines)))
    for i in outlines:
        body = scene.bodies[i]
        assert isinstance(body, Outline)
        scene.bodies[i] = replace(body, layer=float(layers[i]))


def _shown_more(scene: Scene, one: int, other: int, frame: int) -> float:
    """Log odds [nats] that pixels covered by two bodies show the one, of one pixel: they are wrong together."""
    a, b = scene.poses[one, frame], scene.poses[other, frame]
    if not (np.isfinite(a[0]) and np.isfinite(b[0])):
        return 0.0
    apart = np.linalg.norm(scene.bodies[one].centre(a) - scene.bodies[other].centre(b))
    corner, size = scene.window(one, a, 0.0)
    if min(size) < 2 or apart > scene.settings.meeting * (scene.bodies[one].radius(a) + scene.bodies[other].radius(b)):
        return 0.0
    both = filled(scene.bodies[one].polygon(a), corner, size) & filled(scene.bodies[other].polygon(b), corner, size)
    points = np.argwhere(both)[:, ::-1] + np.array(corner, float)
    if len(points) < scene.settings.least_pixels:
        return 0.0
    values, limit = scene.film.at(frame, points), scene.settings.decided
    odds = scene.log_body(one, values, points, a) - scene.log_body(other, values, points, b)
    return float(np.clip(odds, -limit, limit).mean())
