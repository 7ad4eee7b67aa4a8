"""Figures of motion over time, simulated beside measured."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from polyworld.data.recording import Run
from polyworld.trajectory import Rollout

Array = NDArray[np.float64]
AXES = "xyz"


def plot(rollout: Rollout, measured: Run | None = None, band: tuple[Array, Array] | None = None) -> Figure:
    """Return a figure of places [m] over time [s], a panel for each coordinate.

    Lines are simulated; dots are what a run measured, from its first instant on, in the colours of its objects. band:
    lower and upper ends (T, n, 3) [m] of an interval to shade about the lines. Save the figure by
    `figure.savefig("motion.svg")`. Raises ValueError where no measured object is in the rollout.
    """
    motion = rollout.trajectory
    if measured is not None and not {*measured.names} & {*motion.names}:
        raise ValueError(f"the run measured {list(measured.names)}, the rollout holds {list(motion.names)}")
    figure = Figure(figsize=(7.0, 6.0), layout="constrained")
    panels = figure.subplots(len(AXES), 1, sharex=True)
    for axis, panel in enumerate(panels):
        for column, name in enumerate(motion.names):
            shown = motion.active[:, column]
            colour = f"C{column % 10}"
            panel.plot(motion.times[shown], motion.positions[shown, column, axis], color=colour, label=name)
            if band is not None:
                low, high = (end[shown, column, axis] for end in band)
                panel.fill_between(motion.times[shown], low, high, color=colour, alpha=0.25, linewidth=0.0)
            if measured is not None and name in measured.names:
                places = measured.positions[:, measured.names.index(name), axis]
                panel.plot(measured.times - measured.origin, places, ".", color=colour)
        panel.set_ylabel(f"{AXES[axis]} [m]")
    panels[-1].set_xlabel("time [s]")
    panels[0].legend(loc="best")
    return figure
