"""Cut runs into segments at which a trajectory may be restarted: where the recorded paths are smooth.

Multiple shooting (Bock 1983, in Numerical Treatment of Inverse Problems, p. 95) gives every segment an initial state of
its own. A cut just before an impact would leave the state at the cut undetermined, so cuts are moved to instants around
which the paths are smooth.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.parts import roughness, smooth_near
from polyworld.recording import Run

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SegmentSettings:
    """How runs are cut.

    samples: least number of instants of a segment; a state has about six coordinates per body, and as many instants
    with two or three measured components determine it. most: largest number of segments of a run; more cost more
    unknowns and gain nothing once a segment spans less than one impact.
    """

    samples: int = 10
    most: int = 8


def cut_instants(run: Run, settings: SegmentSettings) -> list[int]:
    """Return the first instants of a run's segments, ascending, beginning with 0."""
    count = len(run.times)
    pieces = int(np.clip(count // settings.samples, 1, settings.most))
    if pieces == 1:
        return [0]
    rough = np.maximum(roughness(run), np.concatenate([np.zeros(2), roughness(run)[:-2]]))
    size = count / pieces
    reach = int(size // 3)
    cuts = [0]
    for k in range(1, pieces):
        wanted = round(k * size)
        there = [i for i in range(wanted - reach, wanted + reach + 1) if cuts[-1] + reach < i < count - reach]
        if there:
            cuts.append(smooth_near(rough, wanted, there))
    return cuts


def segment_runs(run: Run, cuts: Sequence[int]) -> list[Run]:
    """Return one run per segment; each but the last ends at the next one's first instant, where nothing is measured.

    That last instant is where the segment's trajectory is compared with the next segment's initial state.
    """
    if len(cuts) == 1:
        return [run]
    found: list[Run] = []
    edges = [*cuts, len(run.times)]
    for k, first in enumerate(cuts):
        last = k == len(cuts) - 1
        rows = np.arange(first, edges[k + 1] + (0 if last else 1))
        keep = np.zeros(len(run.times), dtype=bool)
        keep[rows] = True
        piece = run.rows(keep)
        if not last:
            positions, orientations = piece.positions.copy(), piece.orientations.copy()
            positions[-1], orientations[-1] = np.nan, np.nan
            piece = replace(piece, positions=positions, orientations=orientations)
        found.append(replace(piece, name=f"{run.name}@{first}", window_of=run.window_of or run.name))
    return found
