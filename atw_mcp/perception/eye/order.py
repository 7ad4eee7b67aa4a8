"""Order: which of the outlines that cover each other lies in front, by the colours that are seen there."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from atw_mcp.perception.eye.bodies import Outline
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.pixels import filled


def order_outlines(scene: Scene) -> None:
    """Put outlines that overlap in order of depth: the one whose colours more of the pixels show that both cover."""
    outlines = [i for i, body in enumerate(scene.bodies) if isinstance(body, Outline)]
    before = dict.fromkeys(outlines, 0)
    for i, j in itertools.combinations(outlines, 2):
        total = sum(_shown_more(scene, i, j, k) for k in range(scene.film.count))
        if total:
            before[j if total > 0 else i] += 1
    for i in outlines:
        body = scene.bodies[i]
        assert isinstance(body, Outline)
        scene.bodies[i] = replace(body, layer=float(before[i]))


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
