"""The forward model: a world and a horizon in, motion and events out."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from polyworld.trajectory import BatchTrajectory, Rollout
from polyworld.world import World

Array = NDArray[np.float64]


class Simulator(Protocol):
    """W variants of one world, stepped together; buffers and graphs are kept from one run to the next."""

    names: tuple[str, ...]
    n_worlds: int

    def run(self, overrides: Mapping[str, Array] | None = None, *, samples: int | None = None) -> BatchTrajectory:
        """Roll all variants out from their initial state.

        overrides: parameter path -> values (n_worlds,), see `polyworld.parameters`. samples: how many leading
        sample times to reach (default all).
        """
        ...


def simulator(
    world: World,
    sample_times: Array,
    *,
    n_worlds: int = 1,
    record_events: bool = False,
    threads: int | None = None,
) -> Simulator:
    """The simulator fitting the world's representations.

    sample_times (T,): increasing, >= 0 [s], at the world's own seconds_per_frame; a variant with another
    seconds_per_frame is sampled at proportionally other times. threads: default all cores; the result does
    not depend on it, to the bit.
    """
    raise NotImplementedError


def rollout(world: World, horizon: float, *, sample_interval: float | None = None) -> Rollout:
    """Roll one world out to `horizon` [s], sampled every `sample_interval` [s] (default: one frame).

    Raises ValueError for a horizon that is not positive or asks for more than MAX_SUBSTEPS substeps.
    """
    raise NotImplementedError
