"""The error over the course of a search, as people watch it and as the fit's record keeps it."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

MOST_POINTS = 400  # more than a curve on a screen shows; a longer search keeps every second, fourth, ... point
PREFIXES = ((1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"))
SIGMA = "sigma"  # standard deviations of the measurement


@dataclass
class ErrorCurve:
    """Errors of the present trial and of the best so far, by step.

    step: what is counted, in the singular. unit: "m", or "sigma" for standard deviations of the measurement.
    points: (step, current, best), NaN where a trial diverged.
    """

    step: str
    unit: str
    points: list[tuple[int, float, float]] = field(default_factory=list)
    count: int = 0
    _stride: int = 1

    def add(self, current: float, best: float) -> None:
        """Add the next step."""
        self.count += 1
        if (self.count - 1) % self._stride:
            return
        self.points.append((self.count, current, best))
        if len(self.points) > MOST_POINTS:  # replaced, not changed: other threads read it
            self.points, self._stride = self.points[::2], 2 * self._stride

    def to_dict(self) -> dict[str, Any]:
        """Return it JSON-ready, NaN as None."""
        points = list(self.points)
        return {
            "step": self.step,
            "unit": self.unit,
            "steps": [step for step, _, _ in points],
            "current": [_finite(current) for _, current, _ in points],
            "best": [_finite(best) for _, _, best in points],
        }


def in_words(value: float, unit: str) -> str:
    """Return an error with its unit, e.g. "3.1 mm" or "1.04 sigma"."""
    if not math.isfinite(value):
        return "diverged"
    if unit == SIGMA:
        return f"{value:.3g} {unit}"
    scale, prefix = next((p for p in PREFIXES if abs(value) >= p[0]), (1.0, "") if value == 0.0 else PREFIXES[-1])
    return f"{value / scale:.3g} {prefix}{unit}"


def _finite(value: float) -> float | None:
    return float(f"{value:.6g}") if math.isfinite(value) else None
