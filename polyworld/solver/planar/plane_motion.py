"""Motion of the bodies of a batch of planar worlds, in plane coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class PlaneMotion:
    """Motion of n bodies at T times in W worlds.

    axes (3, 3): rows x, y and normal of the plane in the world. times (W, T) [s]. pose (W, T, n, 3): x, y [m] and angle
    [rad] counted from the orientation that the world describes, `described` (1, n, 4). rate (W, T, n, 3): their rates.
    height (W, n) [m] along the normal. diverged (W,): or truncated.
    """

    names: tuple[str, ...]
    axes: Array
    times: Array
    pose: Array
    rate: Array
    height: Array
    described: Array
    diverged: NDArray[np.bool_]
