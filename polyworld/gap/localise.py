"""Where a fit and the data disagree: by run, object, time, phase of motion, region, speed and axis.

Residuals are whitened, freed of all fitted directions and smoothed to their low cosine modes. What such residuals carry
more than noise would is shared out over the levels of every factor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import POSITION_AXES, Design, owner
from polyworld.estimation.goodness import MODES, cosines, projected
from polyworld.estimation.noise import Noise
from polyworld.estimation.profile import Fit
from polyworld.estimation.unknown import Unknown
from polyworld.gap.onset import Onset, onsets
from polyworld.gap.phases import motions
from polyworld.gap.settings import LocaliseSettings

Array = NDArray[np.float64]
Texts = NDArray[np.str_]

FACTORS = ("run", "object", "time", "phase", "region", "speed", "axis")


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


@dataclass(frozen=True)
class Localisation:
    """Where the gap is.

    ratio, error: overall energy of the smooth residuals over that of noise. factors: name -> levels, largest ratio
    first. onsets: earliest first. clear: standard errors that count as a difference.
    """

    ratio: float
    error: float
    factors: dict[str, tuple[Level, ...]]
    onsets: tuple[Onset, ...]
    clear: float

    def summary(self) -> str:
        """Describe in words where the gap is."""
        if self.ratio < 1.0 + self.clear * self.error:
            return f"On the whole, residuals are those of noise (smooth part {self.ratio:.2g} times noise)."
        text = f"Smooth residuals are {self.ratio:.3g} times those of noise"
        contrasts = []
        for name, levels in self.factors.items():
            if len(levels) < 2:
                continue
            most, least = levels[0], levels[-1]
            difference = most.ratio - least.ratio
            if difference > max(self.clear * np.hypot(most.error, least.error), least.ratio):
                contrasts.append(
                    f"by {name} most at {most.level} ({most.ratio:.3g}), least at {least.level} ({least.ratio:.3g})"
                )
        text += "; " + "; ".join(contrasts) if contrasts else ", alike in all runs, objects, phases, regions and speeds"
        if self.onsets:
            first = self.onsets[0]
            count = len({o.run for o in self.onsets})
            text += (
                f". {count} {'run shows' if count == 1 else 'runs show'} when it begins, the earliest {first.name} in "
                f"run {first.run} at {first.time:.3g} s"
            )
        return text + "."

    def to_json(self) -> dict[str, object]:
        """Return the localisation as plain data."""
        return {
            "ratio": self.ratio,
            "error": self.error,
            "factors": {name: [asdict(level) for level in levels] for name, levels in self.factors.items()},
            "onsets": [o.to_json() for o in self.onsets],
            "summary": self.summary(),
        }


def localise(
    design: Design,
    noise: Noise,
    fit: Fit,
    *,
    unknowns: Sequence[Unknown] = (),
    settings: LocaliseSettings | None = None,
) -> Localisation:
    """Share the residuals of a fit out over the factors.

    unknowns: those fitted, whose values then move the world that gives phases and speeds; without them it moves as
    `design.world` does from the fitted initial states.
    """
    settings = settings or LocaliseSettings()
    whitened, _, _ = projected(fit)
    labels: dict[str, list[Texts]] = {name: [] for name in FACTORS}
    energy, expected = [], []
    moved = [motions(design, r, fit.values, fit.states[r.index], unknowns, settings) for r in design.runs]
    box = _box(design, settings.cells)
    speeds = np.concatenate([m.speeds for motion in moved for m in motion.values()])
    thirds = np.quantile(speeds[np.isfinite(speeds)], np.linspace(0.0, 1.0, 4))
    for r, motion in zip(design.runs, moved, strict=True):
        parts = np.linspace(r.times[0], r.times[-1], settings.parts + 1)
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
            sides = [_binned(here.positions[rows, a], e, f"{POSITION_AXES[a]} ", "m") for a, e in box.items()]
            found = {
                "run": _same(r.run.name, len(rows)),
                "object": _same(owner(s.name), len(rows)),
                "time": _binned(r.times[rows], parts, "", "s"),
                "phase": here.phases[rows],
                "region": np.char.add(np.char.add(sides[0], ", "), sides[1]),
                "speed": _binned(here.speeds[rows], thirds, "", "m/s"),
                "axis": _same(f"{s.kind} {POSITION_AXES[s.axis]}", len(rows)),
            }
            for name, texts in found.items():
                labels[name].append(texts)
    if not energy:
        return Localisation(float("nan"), float("nan"), {}, (), settings.clear)
    e, x = np.concatenate(energy), np.concatenate(expected)
    whole = max(float(e.sum() - x.sum()), 0.0)
    factors = {name: _levels(np.concatenate(texts), e, x, whole) for name, texts in labels.items()}
    begins = [o for r in design.runs for o in onsets(r, fit, noise.kept[r.index], settings)]
    ratio = float(e.sum() / x.sum())
    return Localisation(
        ratio,
        float(np.sqrt(2.0 / x.sum())),
        factors,
        tuple(sorted(begins, key=lambda o: (o.time, o.run, o.name))),
        settings.clear,
    )


def _levels(texts: Texts, energy: Array, expected: Array, whole: float) -> tuple[Level, ...]:
    """Return the energy by level; its degrees of freedom are the modes that fall there."""
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


def _binned(values: Array, edges: Array, prefix: str, unit: str) -> Texts:
    """Return the interval between edges that each value (m,) lies in, in words."""
    words = np.array([f"{prefix}{low:.3g} to {high:.3g} {unit}" for low, high in pairwise(edges)])
    texts: Texts = words[np.clip(np.searchsorted(edges, values, side="right") - 1, 0, len(words) - 1)]
    return texts


def _box(design: Design, cells: int) -> dict[int, Array]:
    """Return edges of cells along the two longest sides of the region that was measured, by axis."""
    places = np.concatenate([r.run.positions.reshape(-1, 3) for r in design.runs])
    seen = [v[np.isfinite(v)] for v in places.T]
    spans = [(float(v.min()), float(v.max())) if len(v) else (0.0, 0.0) for v in seen]
    longest = sorted(range(3), key=lambda axis: spans[axis][0] - spans[axis][1])[:2]
    return {axis: np.linspace(*spans[axis], cells + 1) for axis in sorted(longest)}
