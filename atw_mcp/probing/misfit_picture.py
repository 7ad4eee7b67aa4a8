"""Where and when a world is off the measured positions: a map, and the distance over time in m and in sigma."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from atw_mcp.looking.plan_frame import PlanFrame
from atw_mcp.probing.misfits import Misfit

Array = NDArray[np.float64]

# Okabe & Ito (2008), with a marker each so that no curve is known by its colour alone.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000", "#999999")
MARKERS = "osD^vPX*"
NOISE = 2.0  # standard deviations: 95% of noise is within
SIZE, RESOLUTION = (10.0, 4.6), 100  # [inch], [dots per inch]
# Left, bottom, width, height of the map, its colours, and the two courses: fixed, as finding them takes half a second.
BOXES = ((0.07, 0.2, 0.35, 0.72), (0.435, 0.2, 0.012, 0.72), (0.57, 0.6, 0.415, 0.32), (0.57, 0.2, 0.415, 0.32))
LEAST = 3.0  # standard deviations at the end of the colours; what is below is noise


def misfit_picture(misfits: list[Misfit], frame: PlanFrame) -> NDArray[np.uint8]:
    """Draw `misfit_figure`; returns blue, green, red (h, w, 3)."""
    buffer = io.BytesIO()
    misfit_figure(misfits, frame).savefig(buffer, format="raw", dpi=RESOLUTION)
    width, height = (round(side * RESOLUTION) for side in SIZE)
    red_green_blue = np.frombuffer(buffer.getvalue(), np.uint8).reshape(height, width, 4)[..., :3]
    return np.ascontiguousarray(red_green_blue[..., ::-1])


def misfit_figure(misfits: list[Misfit], frame: PlanFrame) -> Figure:
    """Return a map of the largest misfits and their course.

    Left: measured places on the axes of a plan, coloured by the distance to where the object is simulated, in standard
    deviations of the measurement. Right: the distance over time in metres and in standard deviations.
    """
    worst = sorted(misfits, key=lambda m: -m.largest)[: len(COLORS)]
    figure = Figure(figsize=SIZE)
    FigureCanvasAgg(figure)
    where, bar, metres, sigmas = (figure.add_axes(box) for box in BOXES)
    stated = any(np.isfinite(m.sigmas).any() for m in worst)
    shades = [m.sigmas if stated else m.distance for m in worst]
    every = np.concatenate(shades)
    top = float(np.nanquantile(every, 0.98)) if np.isfinite(every).any() else LEAST
    top = max(top, LEAST) if stated else top
    signs = [-1.0 if axis.min() < -0.5 else 1.0 for axis in frame.axes[:2]]
    middle = frame.centre[0] * signs[0]
    for misfit, shade, color, marker in zip(worst, shades, COLORS, MARKERS, strict=False):
        flat = frame.flat(misfit.measured) * signs
        dots = where.scatter(flat[:, 0], flat[:, 1], c=shade, s=18, marker=marker, cmap="cividis_r", vmin=0.0, vmax=top)
        first = flat[np.flatnonzero(np.isfinite(flat).all(axis=1))[0]]
        box = {"fc": "w", "ec": "0.7", "pad": 1}
        aside = "left" if (first[0] - middle) * signs[0] < 0 else "right"
        where.annotate(misfit.name, first, xytext=(0, 6), textcoords="offset points", ha=aside, fontsize=8, bbox=box)
        style: dict[str, Any] = {"color": color, "marker": marker, "markevery": 0.15, "ms": 4, "lw": 1.2}
        metres.plot(misfit.times, misfit.distance, label=misfit.name, **style)
        sigmas.plot(misfit.times, misfit.sigmas, **style)
    for k, side in enumerate("xy"):
        if signs[k] < 0:
            getattr(where, f"invert_{side}axis")()
    unit = "σ of the measurement" if stated else "m"
    figure.colorbar(dots, cax=bar, extend="max", label=f"distance [{unit}]")
    where.set_aspect("equal", adjustable="datalim")
    where.set_xlabel(f"{frame.axis_names[0]} [m]")
    where.set_ylabel(f"{frame.axis_names[1]} [m]")
    left_out = "" if len(worst) == len(misfits) else f", the {len(worst)} largest of {len(misfits)}"
    where.set_title(f"where the world is off: measured places{left_out}", fontsize=10)
    metres.set_title("when: distance of simulated from measured", fontsize=10)
    metres.set_ylabel("distance [m]")
    metres.set_ylim(bottom=0.0)
    metres.tick_params(labelbottom=False)
    sigmas.axhspan(0.0, NOISE, color="#dddddd", lw=0, label="within 2 σ: as noise")
    if not stated:
        sigmas.text(0.5, 0.5, "no noise is stated", transform=sigmas.transAxes, ha="center")
    sigmas.set_ylabel("distance [σ]")
    sigmas.set_xlabel("time [s]")
    sigmas.set_ylim(0.0, None)
    figure.legend(loc="lower center", ncols=5, fontsize=8)
    for panel in (where, metres, sigmas):
        panel.grid(alpha=0.3, lw=0.5)
        panel.tick_params(labelsize=8)
    return figure
