"""Numbers and places as MJCF writes them."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.exchange.geoms import quaternion


def placed(position: NDArray[np.float64], rotation: NDArray[np.float64]) -> dict[str, str]:
    """Attributes pos and quat."""
    return {"pos": numbers(position), "quat": numbers(quaternion(rotation))}


def number(value: float) -> str:
    """A number with all its digits."""
    return repr(float(value) + 0.0)


def numbers(values: Iterable[Any]) -> str:
    """Numbers with all their digits, separated by spaces."""
    return " ".join(number(v) for v in values)
