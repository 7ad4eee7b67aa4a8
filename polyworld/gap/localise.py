"""Where a fit and the data disagree: by run, object, time, phase of motion, region, speed and axis.

Residuals are whitened, freed of all fitted directions and smoothed to their low cosine modes. What such residuals carry
more than noise would is shared out over the levels of every factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import POSITION_AXES, Design, RunDesign, owner
from polyworld.estimation.goodness import MODES, cosines, projected
from polyworld.estimation.noise import Noise
from polyworld.estimation.profile import Fit
from polyworld.estimation.unknown import Unknown
from polyworld.gap.onset import Onset, onsets
from polyworld.gap.phases import Motion, motions

Array = NDArray[np.float64]
Texts = NDArray[np.str_]

FACTORS = ("run", "object", "time", "phase", "region", "speed", "axis")
PARTS = 6  # of every run's time
CELLS = 3  # of the region along each of the two longest sides
CLEAR = 3.0  # standard errors above noise from which on a level is told


@dataclass(frozen=True)
class Level:
    """One level of a factor. ratio: energy of the smooth residuals there over that of noise, 1 where nothing is
    missing; error: its standard error; share: of the whole excess over noise, 0 where there is none; samples: how many
    measured components."""

    level: str
    ratio: float
    error: float
    share: float
    samples: int

    def to_json(self) -> dict[str, object]:
        """The level as plain data."""
        return {
            "level": self.level,
            "ratio": self.ratio,
            "error": self.error,
            "share": self.share,
            "samples": self.samples,
        }


@dataclass(frozen=True)
class Localisation:
    """Where the gap is. ratio: overall energy of the smooth residuals over that of noise. factors: name -> levels,
    largest ratio first. onsets: earliest first."""

    ratio: float
    error: float
    factors: dict[str, tuple[Level, ...]]
    onsets: tuple[Onset, ...]

    def summary(self) -> str:
        """The gap's place in words."""
        if self.ratio < 1.0 + CLEAR * self.error:
            return f"Residuals are those of noise everywhere (smooth part {self.ratio:.2g} times noise)."
        text = f"Smooth residuals are {self.ratio:.3g} times those of noise"
        told = []
        for name, levels in self.factors.items():
            if len(levels) < 2:
                continue
            most, least = levels[0], levels[-1]
            if most.ratio - least.ratio > CLEAR * np.hypot(most.error, least.error) and most.ratio > 2.0 * least.ratio:
                told.append(
                    f"by {name} most at {most.level} ({most.ratio:.3g}), least at {least.level} ({least.ratio:.3g})"
                )
        text += "; " + "; ".join(told) if told else ", alike in all runs, objects, phases, regions and speeds"
        if self.onsets:
            first = self.onsets[0]
            text += (
                f". {len({o.run for o in self.onsets})} runs show when it begins, the earliest {first.name} in run "
                f"{first.run} at {first.time:.3g} s"
            )
        return text + "."

    def to_json(self) -> dict[str, object]:
        """The localisation as plain data."""
        return {
            "ratio": self.ratio,
            "error": self.error,
            "factors": {name: [level.to_json() for level in levels] for name, levels in self.factors.items()},
            "onsets": [o.to_json() for o in self.onsets],
            "summary": self.summary(),
        }


def localise(design: Design, noise: Noise, fit: Fit, *, unknowns: Sequence[Unknown] = ()) -> Localisation:
    """Share the residuals of a fit out over the factors. unknowns: those fitted, whose values then move the world that
    tells phases and speeds; without them it moves as `design.world` does from the fitted initial states."""
    whitened, _, _ = projected(fit)
    labels: dict[str, list[Texts]] = {name: [] for name in FACTORS}
    energy, expected = [], []
    moved = [motions(design, r, fit.values, fit.states[r.index], unknowns) for r in design.runs]
    regions, speeds = _Regions(design), _Speeds(moved)
    for r, motion in zip(design.runs, moved, strict=True):
        for s in r.series:
            kept = np.flatnonzero(noise.kept[r.index][s.where])
            count = min(MODES, len(kept) // 3)
            if count < 1:
                continue
            rows = s.rows[kept]
            q = cosines(r.times[rows], count)
            energy.append((q @ (q.T @ whitened[r.index][kept + s.where.start])) ** 2)
            expected.append((q**2).sum(axis=1))
            here = motion[s.name]
            told = {
                "run": _same(r.run.name, len(rows)),
                "object": _same(owner(s.name), len(rows)),
                "time": _times(r, rows),
                "phase": here.phases[rows],
                "region": regions.of(here.positions[rows]),
                "speed": speeds.of(here.speeds[rows]),
                "axis": _same(f"{s.kind} {POSITION_AXES[s.axis]}", len(rows)),
            }
            for name, texts in told.items():
                labels[name].append(texts)
    if not energy:
        return Localisation(float("nan"), float("nan"), {}, ())
    e, x = np.concatenate(energy), np.concatenate(expected)
    whole = max(float(e.sum() - x.sum()), 0.0)
    factors = {name: _levels(np.concatenate(texts), e, x, whole) for name, texts in labels.items()}
    begins = sorted(
        (o for r in design.runs for o in onsets(r, fit, noise.kept[r.index])), key=lambda o: (o.time, o.run, o.name)
    )
    ratio = float(e.sum() / x.sum())
    return Localisation(ratio, float(np.sqrt(2.0 / x.sum())), factors, tuple(begins))


def _levels(texts: Texts, energy: Array, expected: Array, whole: float) -> tuple[Level, ...]:
    """The energy by level; its degrees of freedom are the modes that fall there."""
    found = []
    for text in np.unique(texts):
        here = texts == text
        e, x = float(energy[here].sum()), float(expected[here].sum())
        ratio = e / x
        error = max(ratio, 1.0) * float(np.sqrt(2.0 / max(x, 1.0)))
        share = max(e - x, 0.0) / whole if whole > 0.0 else 0.0
        found.append(Level(str(text), ratio, error, share, int(here.sum())))
    return tuple(sorted(found, key=lambda level: -level.ratio))


def _same(text: str, count: int) -> Texts:
    return np.full(count, text)


def _times(run: RunDesign, rows: NDArray[np.int64]) -> Texts:
    times = run.times
    edges = np.linspace(times[0], times[-1], PARTS + 1)
    part = np.clip(np.searchsorted(edges, times[rows], side="right") - 1, 0, PARTS - 1)
    return np.array([f"{edges[i]:.3g} to {edges[i + 1]:.3g} s" for i in range(PARTS)])[part]


class _Regions:
    """Cells of a coarse grid over what was measured, along its two longest sides."""

    def __init__(self, design: Design) -> None:
        places = np.concatenate([r.run.positions.reshape(-1, 3) for r in design.runs])
        seen = [places[np.isfinite(places[:, axis]), axis] for axis in range(3)]
        spans = [(float(v.min()), float(v.max())) if len(v) else (0.0, 0.0) for v in seen]
        self.axes = sorted(sorted(range(3), key=lambda axis: spans[axis][0] - spans[axis][1])[:2])
        self.edges = [np.linspace(spans[axis][0], spans[axis][1], CELLS + 1) for axis in self.axes]

    def of(self, positions: Array) -> Texts:
        """The cell of each position (m, 3), in words."""
        texts: Texts = np.full(len(positions), "", dtype="U1")
        for axis, edges in zip(self.axes, self.edges, strict=True):
            cell = np.clip(np.searchsorted(edges, positions[:, axis], side="right") - 1, 0, CELLS - 1)
            words = np.array([f"{POSITION_AXES[axis]} {edges[i]:.2g} to {edges[i + 1]:.2g} m" for i in range(CELLS)])[
                cell
            ]
            texts = words if texts.dtype.itemsize == 4 else np.char.add(np.char.add(texts, ", "), words)
        return texts


class _Speeds:
    """Thirds of all speeds."""

    def __init__(self, moved: Sequence[dict[str, Motion]]) -> None:
        speeds = np.concatenate([m.speeds for motion in moved for m in motion.values()])
        self.edges = np.quantile(speeds[np.isfinite(speeds)], np.linspace(0.0, 1.0, 4))

    def of(self, speeds: Array) -> Texts:
        """The third of each speed (m,), in words."""
        third = np.clip(np.searchsorted(self.edges, speeds, side="right") - 1, 0, 2)
        return np.array([f"{self.edges[i]:.2g} to {self.edges[i + 1]:.2g} m/s" for i in range(3)])[third]
