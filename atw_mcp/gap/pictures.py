"""Pictures of a gap: residuals over time, where in space they are, simulated over observed paths; before and after."""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image  # matplotlib writes its pictures with it

from polyworld.gap.report import Compared

Array = NDArray[np.float64]

AXES = "xyz"
COLORS = ("#0072b2", "#d55e00", "#009e73")  # of x, y, z; Okabe & Ito (2008), as on the viewer's page
BEFORE, AFTER, SEEN = "#d55e00", "#0072b2", "#222222"
NOISE = 2.0  # standard deviations: 95% of noise is within
PANELS = 12  # most panels of one picture; the rest is said in its title
FLAT = 0.1  # of the largest extent; what rises less moves on a plane
PALETTE = 128  # colours of a picture: its lines, their edges, and the shades of a map
RESOLUTION = 110  # [dots per inch]


def residual_picture(before: Sequence[Compared], after: Sequence[Compared] | None = None) -> bytes:
    """Standardised residuals over time, to one scale, one panel for every run, object and kind of measurement, largest
    first; PNG.

    after: the same with an effect added, drawn dashed.
    """
    panelled = _by_kind(before)
    others = {} if after is None else {(index, kind): residual for index, kind, residual in _by_kind(after)}
    panelled.sort(key=lambda panel: -_mean_square(panel[2]))
    figure, panels = _grid(min(len(panelled), PANELS), "simulated less observed, in σ of the noise", len(panelled))
    everything = np.concatenate([residual.ravel() for *_, residual in panelled] or [np.zeros(1)])
    most = 1.08 * float(np.nanmax(np.abs(everything))) if np.isfinite(everything).any() else 0.0
    handles: dict[str, Artist] = {}
    for panel, (index, kind, residual) in zip(panels, panelled, strict=False):
        item = before[index]
        handles["±2 σ"] = panel.axhspan(-NOISE, NOISE, color="#dddddd", lw=0)
        for axis in np.flatnonzero(np.isfinite(residual).any(axis=0)):
            name = AXES[axis] if after is None else f"{AXES[axis]} without the effect"
            (handles[name],) = panel.plot(item.times, residual[:, axis], color=COLORS[axis], lw=1.0)
            if (index, kind) in others:
                (handles[f"{AXES[axis]} with the effect"],) = panel.plot(
                    item.times, others[index, kind][:, axis], color=COLORS[axis], lw=1.0, ls="--"
                )
        panel.set_title(f"{item.name}{'' if kind == 'position' else f' {kind}'}, run {item.run}", fontsize=8)
        panel.set_xlabel("time [s]", fontsize=7)
        panel.set_ylabel("residual [σ]", fontsize=7)
        panel.set_ylim(-max(most, 1.5 * NOISE), max(most, 1.5 * NOISE))
    _legend(figure, handles)
    return _png(figure)


def path_picture(before: Sequence[Compared], after: Sequence[Compared] | None = None) -> bytes:
    """Observed paths as dots and simulated ones as lines, in the plane in which each extends most; PNG."""
    order = _largest_first(before)
    figure, panels = _grid(len(order), "paths", len(before))
    handles: dict[str, Artist] = {}
    for panel, index in zip(panels, order, strict=True):
        item = before[index]
        plane = _plane([item])
        (handles["observed"],) = panel.plot(*plane.of(item.observed, item.times), ".", color=SEEN, ms=2.5)
        name = "simulated" if after is None else "simulated without the effect"
        (handles[name],) = panel.plot(*plane.of(item.simulated, item.times), color=BEFORE, lw=0.9)
        if after is not None:
            (handles["simulated with the effect"],) = panel.plot(
                *plane.of(after[index].simulated, item.times), color=AFTER, lw=0.9, ls="--"
            )
        panel.set_title(f"{item.name}, run {item.run}", fontsize=8)
        panel.set_xlabel(plane.across, fontsize=7)
        panel.set_ylabel(plane.up, fontsize=7)
    _legend(figure, handles)
    return _png(figure)


def map_picture(before: Sequence[Compared], after: Sequence[Compared] | None = None) -> bytes:
    """Where in space the residuals are large: every observed place, coloured by the size of its residual; PNG."""
    plane = _plane(before)
    shown = [before] if after is None else [before, after]
    figure = Figure(figsize=(5.0 * len(shown), 4.4), layout="constrained")
    FigureCanvasAgg(figure)
    sizes = np.concatenate([item.size for item in before])
    top = max(float(np.nanquantile(sizes, 0.98)) if np.isfinite(sizes).any() else 3.0, 3.0)
    for number, items in enumerate(shown):
        panel = figure.add_subplot(1, len(shown), number + 1)
        columns = [plane.of(item.observed, item.times) for item in items]
        dots = panel.scatter(
            np.concatenate([c[0] for c in columns]),
            np.concatenate([c[1] for c in columns]),
            c=np.concatenate([item.size for item in items]),
            s=6,
            cmap="cividis_r",
            vmin=0.0,
            vmax=top,
        )
        figure.colorbar(dots, ax=panel, extend="max", label="size of the residual [σ of the noise]")
        title = "with the effect" if number else "without the effect" if after is not None else "where residuals are"
        panel.set_title(title)
        if plane.along is not None:
            panel.set_aspect("equal", adjustable="datalim")  # both axes are lengths
        panel.set_xlabel(plane.across)
        panel.set_ylabel(plane.up)
    return _png(figure)


@dataclass(frozen=True)
class _Plane:
    """Two directions (3,) to draw in, and what they are; along None: time instead."""

    along: Array | None
    upward: Array
    across: str
    up: str

    def of(self, places: Array, times: Array) -> tuple[Array, Array]:
        """Coordinates (T,) to the right and upwards."""
        return times if self.along is None else _component(places, self.along), _component(places, self.upward)


def _component(places: Array, direction: Array) -> Array:
    used = np.flatnonzero(direction)
    component: Array = places[:, used] @ direction[used]
    return component


def _plane(items: Sequence[Compared]) -> _Plane:
    """Height over the main horizontal direction where things rise and fall, else y over x; one component over time."""
    everywhere = np.concatenate([item.observed for item in items])
    measured = [a for a in range(3) if np.isfinite(everywhere[:, a]).any()]
    axes = np.eye(3)
    if len(measured) == 1:
        return _Plane(None, axes[measured[0]], "time [s]", f"{AXES[measured[0]]} [m]")
    extent = {a: float(np.nanmax(everywhere[:, a]) - np.nanmin(everywhere[:, a])) for a in measured}
    if measured != [0, 1, 2]:
        return _Plane(axes[measured[0]], axes[measured[1]], f"{AXES[measured[0]]} [m]", f"{AXES[measured[1]]} [m]")
    if extent[2] < FLAT * max(extent.values()):
        return _Plane(axes[0], axes[1], "x [m]", "y [m]")
    flat = everywhere[np.all(np.isfinite(everywhere), axis=1)][:, :2]
    _, _, rows = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)
    heading = rows[0] * (1.0 if rows[0][np.argmax(np.abs(rows[0]))] > 0 else -1.0)
    angle = np.degrees(np.arctan2(heading[1], heading[0]))
    return _Plane(np.array([*heading, 0.0]), axes[2], f"horizontal, {angle:.0f}° from x [m]", "z [m]")


def _by_kind(items: Sequence[Compared]) -> list[tuple[int, str, Array]]:
    """Return index, kind of measurement and residual (T, 3) of everything that was measured."""
    found = [
        (i, kind, r) for i, item in enumerate(items) for kind, r in [("position", item.residual), *item.turning.items()]
    ]
    return [panel for panel in found if np.isfinite(panel[2]).any()]


def _mean_square(residual: Array) -> float:
    return float(np.nanmean(residual**2)) if np.isfinite(residual).any() else 0.0


def _largest_first(items: Sequence[Compared]) -> list[int]:
    return sorted(range(len(items)), key=lambda i: -_mean_square(items[i].size))[:PANELS]


def _grid(count: int, title: str, of: int) -> tuple[Figure, list[Axes]]:
    columns = min(3, max(count, 1))
    rows = -(-max(count, 1) // columns)
    figure = Figure(figsize=(3.6 * columns, 2.3 * rows + 0.3), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title if count == of else f"{title}: the {count} largest of {of}", fontsize=9)
    panels = [figure.add_subplot(rows, columns, i + 1) for i in range(count)]
    for panel in panels:
        panel.tick_params(labelsize=6)
        panel.grid(alpha=0.3, lw=0.5)
    return figure, panels


def _legend(figure: Figure, handles: dict[str, Artist]) -> None:
    """Explain lines and bands below the panels, where they cover no data."""
    figure.legend(list(handles.values()), list(handles), loc="outside lower center", ncols=4, fontsize=7)


def _png(figure: Figure) -> bytes:
    """Encode with a palette: a third of the bytes, so that three pictures of many runs fit into one message."""
    buffer, packed = io.BytesIO(), io.BytesIO()
    figure.savefig(buffer, format="png", dpi=RESOLUTION)
    image = Image.open(buffer).convert("RGB")
    image.quantize(PALETTE, dither=Image.Dither.NONE).save(packed, "png", optimize=True)
    return packed.getvalue()
