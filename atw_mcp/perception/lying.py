"""Whether solids have a place on their plane of motion, and cylinders stand there or lie."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception import eye
from atw_mcp.perception.eye.likelihood import Scene
from atw_mcp.perception.eye.silhouette import fit_pose

COMPARED = 8  # frames in which a cylinder is tried on its side
PRICE = 0.07  # of misfit: errors of a quarter of a pixel all along an outline can favour lying, or standing


def lying(scene: Scene, tracks: Sequence[eye.Track]) -> frozenset[str]:
    """Return the upright cylinders on a plane whose edges lie nearer to their silhouettes on their side."""
    found = set()
    for i, track in enumerate(tracks):
        body, seen = track.body, np.flatnonzero(np.isfinite(track.poses[:, 0]))
        if not isinstance(body, eye.Solid) or body.kind != "cylinder" or body.upright or body.lies or not len(seen):
            continue
        misfits: dict[bool, list[float]] = {False: [], True: []}
        for k in seen[np.unique(np.linspace(0, len(seen) - 1, min(COMPARED, len(seen))).astype(int))]:
            for lies, own in misfits.items():
                scene.bodies[i] = tried = replace(body, lies=lies)
                starts = [track.poses[k] + np.array([0.0, 0.0, a, 0.0]) for a in tried.angles()]
                own.append(min(fit_pose(scene, i, int(k), start).misfit for start in starts))
        scene.bodies[i] = body
        if lies_better(np.square(misfits[False]), np.square(misfits[True])):
            found.add(body.name)
    return frozenset(found)


def lies_better(standing: NDArray[np.float64], lying: NDArray[np.float64]) -> bool:
    """Whether squared misfits (F,) [px^2] of a solid on its side are less than those of a standing one."""
    return bool(len(lying) and (not len(standing) or np.median(lying) + PRICE < np.median(standing)))


def has_place(body: eye.Solid, seed: eye.Seed) -> bool:
    """Whether a seed's centre is on the plane of motion, and not above its horizon."""
    centre = seed.centre()
    return centre is None or bool(np.isfinite(body.placed(centre, np.zeros(4))).all())
