"""The progressively extended horizon: short windows first, so that later events refine what earlier ones told."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Stage:
    """A part of the search: compare the first `samples` sample times for `generations` generations."""

    samples: int
    generations: int


def stages(sample_count: int, fractions: tuple[float, ...], generations: int, final_share: float) -> list[Stage]:
    """Stages that reach the given fractions of `sample_count`, the last one the whole.

    `final_share` of the generations go to the last stage, the rest in equal parts to the earlier ones; stages
    of equal length after rounding are merged. Raises ValueError unless fractions increase to 1.
    """
    if not fractions or fractions[-1] != 1.0 or fractions[0] <= 0.0 or np.any(np.diff(fractions) <= 0.0):
        raise ValueError(f"stages must increase within (0, 1] and end at 1, got {fractions}")
    if not 0.0 < final_share <= 1.0:
        raise ValueError(f"final_share must lie in (0, 1], got {final_share}")
    if generations < 1:
        raise ValueError(f"generations must be at least 1, got {generations}")
    lengths = sorted({max(min(2, sample_count), round(f * sample_count)) for f in fractions})
    lengths = lengths[-generations:]  # fewer generations than stages: drop the shortest windows
    earlier = len(lengths) - 1
    last = generations if earlier == 0 else min(generations - earlier, max(1, round(final_share * generations)))
    shares = [(generations - last) // earlier + (i < (generations - last) % earlier) for i in range(earlier)]
    return [Stage(samples, count) for samples, count in zip(lengths, [*shares, last], strict=True)]
