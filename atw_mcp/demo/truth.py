"""The demo clips' ground truth, and how far observation and worlds are from it."""

from __future__ import annotations

import json
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

FOLDER = Path(str(resources.files("atw_mcp"))) / "demo"


@dataclass(frozen=True)
class Collision:
    """Two bodies met at a time [s]."""

    pair: frozenset[str]
    time: float

    def in_words(self) -> str:
        """Return the collision in words."""
        return f"{' and '.join(sorted(self.pair))} at {self.time:.3f} s"


@dataclass(frozen=True)
class TrueRun:
    """True run: positions (T, 3) [m] of each body, one a frame, and the collisions in order."""

    positions: dict[str, Array]
    collisions: tuple[Collision, ...]

    @classmethod
    def of(cls, document: dict[str, Any]) -> TrueRun:
        """A run as the ground truth file has it."""
        places = np.asarray(document["positions"], dtype=float)
        return cls(
            {name: places[:, i] for i, name in enumerate(document["names"])},
            tuple(Collision(frozenset(c["pair"]), float(c["time"])) for c in document["collisions"]),
        )


def true_runs() -> tuple[TrueRun, TrueRun]:
    """The filmed run, and the same scene without the body that the question removes."""
    document = json.loads((FOLDER / "collision.json").read_text(encoding="utf-8"))
    return TrueRun.of(document), TrueRun.of(document["counterfactual"])


@dataclass(frozen=True)
class HiddenPull:
    """Effect hidden in the clip of the gap: its name and acceleration along x and y [m/s^2]."""

    effect: str
    acceleration: tuple[float, float]


def hidden_pull() -> tuple[HiddenPull, TrueRun]:
    """Return the effect hidden in the clip of the gap, and a run of the scene from other places, not in the clip."""
    document = json.loads((FOLDER / "gap.json").read_text(encoding="utf-8"))
    x, y = document["hidden"]["acceleration"]
    return HiddenPull(document["hidden"]["effect"], (x, y)), TrueRun.of(document["unfilmed"])


def rms_distance(frames: list[int], places: list[list[float]], true: Array) -> float:
    """Root mean square distance [m] on the table of places (k, 3) at given frames from the true ones (T, 3)."""
    apart = np.asarray(places, dtype=float)[:, :2] - true[frames, :2]
    return float(np.sqrt((apart**2).sum(axis=1).mean()))
