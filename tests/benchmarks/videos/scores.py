"""Scores of what perception makes of a rendered clip: which bodies were found, where, and how well outlined."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

Labels = NDArray[np.uint8]
Floats = NDArray[np.float64]

SEEN = 30  # visible pixels from which a body counts in a frame
FOUND = 0.5  # mean IoU over a body's frames from which it was found


@dataclass(frozen=True)
class BodyScore:
    """Outcome of one body.

    observed: the object it was found as, None where it was not. iou: mean over its frames. off: median distance of
    centroids, in diameters of a disc of its visible area. seen: share of its frames in which the object was there.
    """

    body: str
    observed: str | None
    iou: float
    off: float
    seen: float


@dataclass(frozen=True)
class ClipScore:
    """bodies: of each body that is visible in some frame; ghosts: objects that are none of them."""

    bodies: tuple[BodyScore, ...]
    ghosts: tuple[str, ...]

    @property
    def complete(self) -> bool:
        """Whether all bodies were found and nothing else."""
        return not self.ghosts and all(b.observed is not None for b in self.bodies)

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {"complete": self.complete, "ghosts": list(self.ghosts), "bodies": [asdict(b) for b in self.bodies]}


def score_masks(truth: Labels, bodies: list[str], masks: Mapping[str, NDArray[np.bool_]]) -> ClipScore:
    """Score masks (T, H, W) by object's name against labels (T, H, W): 0, or 1 + the place of a body in `bodies`.

    Objects and bodies are matched one to one by the sum of their IoU over frames in which the body can be seen.
    """
    counts = np.array([(truth == k + 1).sum(axis=(1, 2)) for k in range(len(bodies))])
    rows = [np.flatnonzero(c >= SEEN) for c in counts]
    there = [k for k in range(len(bodies)) if len(rows[k])]
    names = list(masks)
    iou = np.zeros((len(there), len(names)))
    for i, k in enumerate(there):
        for j, name in enumerate(names):
            iou[i, j] = np.mean([_iou(truth[t] == k + 1, masks[name][t]) for t in rows[k]])
    pairs = dict(zip(*linear_sum_assignment(-iou), strict=True)) if iou.size else {}
    scores, used = [], set()
    for i, k in enumerate(there):
        j = pairs.get(i)
        if j is None or iou[i, j] < FOUND:
            scores.append(BodyScore(bodies[k], None, float(iou[i, j]) if j is not None else 0.0, np.inf, 0.0))
            continue
        used.add(j)
        own = masks[names[j]]
        both = [t for t in rows[k] if own[t].any()]
        off = [_distance(truth[t] == k + 1, own[t]) for t in both]
        scores.append(BodyScore(bodies[k], names[j], float(iou[i, j]), float(np.median(off)), len(both) / len(rows[k])))
    return ClipScore(tuple(scores), tuple(n for j, n in enumerate(names) if j not in used))


def _iou(one: NDArray[np.bool_], other: NDArray[np.bool_]) -> float:
    return float((one & other).sum() / max((one | other).sum(), 1))


def _centroid(mask: NDArray[np.bool_]) -> Floats:
    y, x = np.nonzero(mask)
    return np.array([x.mean(), y.mean()])


def _distance(truth: NDArray[np.bool_], own: NDArray[np.bool_]) -> float:
    diameter = 2.0 * np.sqrt(truth.sum() / np.pi)
    return float(np.linalg.norm(_centroid(truth) - _centroid(own)) / diameter)
