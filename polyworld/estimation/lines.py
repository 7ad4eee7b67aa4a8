"""Detect spectral lines in residuals above the continuum around them.

What oscillates faster than the low modes of `goodness`, as a table that shakes, leaves its energy in a few neighbouring
modes. Compared with the median of the modes around, it is distinguished from noise of any level and colour (Fisher
1929, Proc. R. Soc. A 125, 54, with the level from the modes around and not from all).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import median_filter
from scipy.special import chdtri, fdtrc

from polyworld.estimation.design import Design, Series
from polyworld.estimation.noise import Noise
from polyworld.estimation.noise_levels import resolution
from polyworld.estimation.spectrum import modes

Array = NDArray[np.float64]

AROUND = 151  # modes whose median is the level; a line fills a few of them
FEWEST = 96  # modes of a series, below which too few are around a line to know the level
TOGETHER = 3  # neighbouring modes that hold most of a line, whatever its phase
MEDIAN = float(chdtri(1, 0.5))  # of the chi-squared distribution with one degree of freedom
EFFICIENCY = 0.37  # of a median, against a mean, for the level of such modes
ROUNDED = 0.5  # share of the noise by rounding, beyond which rounding may beat with the motion: a line by itself


@dataclass(frozen=True)
class Line:
    """The strongest line: p of one as strong anywhere in noise, its frequency [Hz], and the series that it is in."""

    p: float
    frequency: float
    run: str
    name: str
    kind: str
    axis: int

    def summary(self) -> str:
        """Return the line in words."""
        return (
            f"a rhythm of {self.frequency:.3g} Hz in {self.name} {self.kind} {'xyz'[self.axis]} in run {self.run} "
            f"(p = {self.p:.2g})"
        )

    def to_json(self) -> dict[str, object]:
        """Return the line as plain data."""
        where = {"run": self.run, "name": self.name, "kind": self.kind, "axis": "xyz"[self.axis]}
        return {"frequency": self.frequency, "p": self.p, **where}


NO_LINE = Line(1.0, 0.0, "", "", "position", 0)


def strongest_line(design: Design, noise: Noise, whitened: Sequence[Array], lowest: int) -> Line:
    """Find the most significant line among the modes from `lowest` on of whitened residuals, run by run."""
    best, places = NO_LINE, 0
    for s in design.series:
        if len(s.rows) < FEWEST or _is_rounded(design, noise, s):
            continue
        power = modes(whitened[s.run][s.where], 0.0).power
        around = min(AROUND, len(power) // 2)
        level = median_filter(power, around, mode="reflect") / MEDIAN
        if not level.min() > 0.0:
            continue  # nothing that could be noise
        sums = np.convolve(power / level, np.ones(TOGETHER), mode="valid")[lowest:]
        places += len(sums)
        k = int(np.argmax(sums))
        p = float(fdtrc(TOGETHER, EFFICIENCY * around, sums[k] / TOGETHER))
        if p < best.p:
            run = design.runs[s.run]
            times = run.times[s.rows]
            frequency = 0.5 * (lowest + k + TOGETHER // 2) / float(times[-1] - times[0])
            best = Line(p, frequency, run.run.name, s.name, s.kind, s.axis)
    return replace(best, p=min(1.0, best.p * max(places, 1)))


def _is_rounded(design: Design, noise: Noise, s: Series) -> bool:
    return resolution(design, s) > ROUNDED * float(np.median(noise.sigma[s.run][s.where]))
