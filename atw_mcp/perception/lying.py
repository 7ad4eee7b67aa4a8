"""Whether solids have a place on their plane of motion, and cylinders stand there or lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from atw_mcp.perception import eye
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.states import state_at

COMPARED = 8  # frames in which a cylinder is tried on its side
SHOWN = 0.4  # share of its normals whose edges must be seen, from which on it stands: 0.05 lying, 0.84 standing


def lying(scene: Scene, tracks: Sequence[eye.Track]) -> frozenset[str]:
    """Return the upright cylinders on a plane that explain their pixels clearly better on their side."""
    found = set()
    for i, track in enumerate(tracks):
        body, seen = track.body, np.flatnonzero(np.isfinite(track.poses[:, 0]))
        if not isinstance(body, eye.Solid) or body.kind != "cylinder" or body.upright or body.lies or not len(seen):
            continue
        gains, standing = [], []
        for k in seen[np.unique(np.linspace(0, len(seen) - 1, min(COMPARED, len(seen))).astype(int))]:
            pose = track.poses[k]
            standing.append(state_at(scene, i, int(k), pose))
            on_side = replace(body, lies=True)
            scene.bodies[i] = on_side
            tried = [state_at(scene, i, int(k), pose + np.array([0, 0, a, 0])).contrast for a in on_side.angles()]
            scene.bodies[i] = body
            gains.append(max(tried) - standing[-1].contrast)
        shown = float(np.median([state.fit.decided for state in standing]))
        if np.median(gains) > scene.settings.present and shown < SHOWN:
            found.add(body.name)
    return frozenset(found)


def has_place(body: eye.Solid, seed: eye.Seed) -> bool:
    """Whether a seed's centre is on the plane of motion, and not above its horizon."""
    centre = seed.centre()
    return centre is None or bool(np.isfinite(body.placed(centre, np.zeros(4))).all())
