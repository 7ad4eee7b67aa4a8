"""Name the frames that a fit down-weights: positions farther from the simulated ones than noise explains."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polyworld.estimation.world_fit.problem import FitProblem
from polyworld.estimation.world_fit.result import FitResult
from polyworld.estimation.world_fit.settings import OutlyingSettings


@dataclass(frozen=True)
class Outlying:
    """Frames of an object whose positions are off by more than Huber's threshold; worst: in standard deviations."""

    object: str
    frames: tuple[int, ...]
    worst: float


def outlying_frames(
    problem: FitProblem, result: FitResult, settings: OutlyingSettings | None = None
) -> tuple[Outlying, ...]:
    """Return frames, by object, of which at most a share `settings.most` of its positions exceeds Huber's threshold."""
    most = (settings or OutlyingSettings()).most
    batch = problem.run_one(result)
    if batch.stopped[0]:
        return ()
    entry = problem.objective.entries[0]
    sizes = np.linalg.norm(entry.standardised(batch)[0], axis=-1)
    found = []
    for owner, name in enumerate(entry.names):
        own = entry.owner[: len(sizes)] == owner
        far = own & (sizes > problem.objective.settings.huber)
        if 0 < far.sum() <= most * own.sum():
            frames = tuple(int(f) for f in problem.window.frames[entry.sample[: len(sizes)][far]])
            found.append(Outlying(name, frames, float(sizes[far].max())))
    return tuple(found)
