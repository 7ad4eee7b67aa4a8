"""How noisy the measurements are: level, correlation in time, outliers; and residuals freed of all three.

Noise of a component is taken for a first-order autoregressive process (AR(1)) in continuous time: its correlation over
dt is exp(-dt / tau). tau is shared by all positions, all rotations and all spins; levels by the axes of an object.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import autoregression, differences, spectrum
from polyworld.estimation.design import Design, RunDesign, Series
from polyworld.estimation.noise_levels import levels as levels_of
from polyworld.estimation.noise_levels import raw as raw_of
from polyworld.estimation.sample_outliers import outliers, repeats

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]
Ints = NDArray[np.int64]
Kind = Literal["position", "rotation", "spin"]

KINDS: tuple[Kind, ...] = ("position", "rotation", "spin")
UNITS: dict[Kind, str] = {"position": "m", "rotation": "rad", "spin": "rad/s"}
LOW = 3  # cosine modes that initial states take up
FURTHEST = 3.0  # standard errors of a correlation by which the residuals' spectrum may put it right
EXCESS = 1.3  # innovations of more than this variance hold model error, and show nothing about correlation


@dataclass(frozen=True)
class Correlation:
    """phi: correlation over `interval` [s]; error: its standard error; tau [s]: correlation time, 0 for white noise."""

    phi: float
    error: float
    interval: float

    @property
    def tau(self) -> float:
        """Correlation time [s]."""
        return -self.interval / float(np.log(self.phi)) if self.phi > 0.0 else 0.0

    def over(self, seconds: Array) -> Array:
        """Correlation over some time [s]."""
        result: Array = np.where(self.phi > 0.0, self.phi ** (seconds / self.interval), 0.0)
        return result


@dataclass(frozen=True)
class NoiseLevel:
    """Standard deviation [unit] of one object's positions, rotations or spins, root mean square over runs and axes."""

    name: str
    kind: Kind
    sigma: float
    unit: str


@dataclass(frozen=True)
class Noise:
    """Noise of every measured component of every run.

    sigma[r] (m_r,): standard deviation [m, rad or rad/s]. kept[r] (m_r,): False for outliers, which count for nothing.
    previous[r] (m_r,): the entry before in the same series (itself where there is none), rho[r] (m_r,): the
    correlation with it. correlation: by kind. repeated: rows that were shown twice. notes: what was not as stated.
    """

    sigma: tuple[Array, ...]
    kept: tuple[Bools, ...]
    previous: tuple[Ints, ...]
    rho: tuple[Array, ...]
    levels: tuple[NoiseLevel, ...] = ()
    correlation: dict[Kind, Correlation] = field(default_factory=dict)
    repeated: int = 0
    notes: tuple[str, ...] = ()

    @property
    def count(self) -> int:
        """Number of measured components that count."""
        return sum(int(k.sum()) for k in self.kept)

    @property
    def outlier_share(self) -> float:
        """Share of the components that were set aside."""
        return 1.0 - self.count / max(sum(len(k) for k in self.kept), 1)

    def only(self, chosen: Sequence[int]) -> Noise:
        """Return the noise of some of the runs, which are renumbered."""
        return replace(
            self,
            sigma=tuple(self.sigma[k] for k in chosen),
            kept=tuple(self.kept[k] for k in chosen),
            previous=tuple(self.previous[k] for k in chosen),
            rho=tuple(self.rho[k] for k in chosen),
        )

    def whiten(self, run: int, values: Array) -> Array:
        """Return residuals or derivatives (..., m) in units in which the noise is white with unit variance.

        Outliers become 0. The exact filter of AR(1): (r_i - rho r_{i-1}) / sqrt(1 - rho^2), the first of a series as
        it is; over gaps and outliers the correlation falls with their length.
        """
        scaled: Array = values / self.sigma[run]
        rho, kept = self.rho[run], self.kept[run]
        if np.any(rho):
            scaled = (scaled - rho * scaled[..., self.previous[run]]) / np.sqrt(1.0 - rho**2)
        return scaled if kept.all() else scaled * kept

    def summary(self) -> str:
        """Return the noise in words."""
        parts = [f"{n.name} {n.kind} {n.sigma:.3g} {n.unit}" for n in self.levels]
        text = "noise: " + ", ".join(parts)
        for kind, c in self.correlation.items():
            if c.phi > 2.0 * c.error and c.phi > 0.05:
                text += f"; {kind}s correlated over {c.tau:.3g} s ({c.phi:.2f} from sample to sample)"
            else:
                text += f"; {kind}s uncorrelated in time"
        if self.outlier_share > 0.0:
            text += f"; {100.0 * self.outlier_share:.2g}% of the samples set aside as outliers"
        if self.repeated:
            text += f", of them {self.repeated} rows shown twice"
        return "; ".join((text, *self.notes)) + "."

    def to_json(self) -> dict[str, object]:
        """Return the noise as plain data."""
        return {
            "levels": [{"name": n.name, "kind": n.kind, "sigma": n.sigma, "unit": n.unit} for n in self.levels],
            "correlation_time": {k: c.tau for k, c in self.correlation.items()},
            "correlation": {k: c.phi for k, c in self.correlation.items()},
            "outlier_share": self.outlier_share,
            "repeated_rows": self.repeated,
            "summary": self.summary(),
        }


def first_kind(series: Sequence[Series]) -> Kind:
    """Return the kind that stands for all: positions where any was measured, else rotations, else spins."""
    there = {s.kind for s in series}
    return next(kind for kind in KINDS if kind in there)


def measured_noise(design: Design) -> Noise:
    """Estimate the noise from the data alone, before any model: by third differences of every series.

    Only rows that were shown twice are set aside: a motion without a model may leap like an outlier.
    """
    kept = tuple(~_repeated(r) for r in design.runs)

    def raw(run: int, s: Series) -> Array:
        return raw_of(design.runs[run], s)

    spreads = _spreads(design, kept, raw)
    return _noise(design, spreads, kept, _correlations(design, spreads, kept, raw))


def refined_noise(design: Design, noise: Noise, residuals: Sequence[Array]) -> Noise:
    """Estimate the noise after a fit, from raw residuals (m,) of every run [m, rad, rad/s] at its best values.

    Outliers are set aside; levels are the smaller of those of data and residuals; the correlation is corrected by the
    residuals' spectrum, as far as third differences leave it open, so that a model that is wrong does not pass for
    noise. Fit again with the result; may be called again with the residuals of a better model.
    """
    kept = tuple(_without_outliers(r, noise, residuals[r.index], ~_repeated(r)) for r in design.runs)
    raw = _spreads(design, kept, lambda run, s: raw_of(design.runs[run], s))
    left = _spreads(design, kept, lambda run, s: residuals[run][s.where])
    spreads = [differences.least(a, b) for a, b in zip(raw, left, strict=True)]
    known = _correlations(design, spreads, kept, lambda run, s: residuals[run][s.where])
    first = _noise(design, spreads, kept, known)
    better = {kind: _from_spectrum(design, first, residuals, kind) for kind in first.correlation}
    return _noise(design, spreads, kept, better)


def spectral_modes(design: Design, noise: Noise, whitened: Sequence[Array], kind: Kind) -> list[spectrum.Modes]:
    """Cosine modes of whitened residuals, series by series, of one kind."""
    interval = noise.correlation[kind].interval
    found = []
    for s in design.series:
        if s.kind == kind and len(s.rows) >= 2 * differences.FEWEST:
            seconds = float(np.median(np.diff(design.runs[s.run].times[s.rows]))) / interval
            used = float(noise.correlation[kind].phi ** seconds)
            found.append(spectrum.modes(whitened[s.run][s.where], used, seconds))
    return found


def _from_spectrum(design: Design, noise: Noise, residuals: Sequence[Array], kind: Kind) -> Correlation:
    known = noise.correlation[kind]
    whitened = [noise.whiten(r.index, residuals[r.index]) for r in design.runs]
    series = spectral_modes(design, noise, whitened, kind)
    fitted = spectrum.fitted(series, known.phi, known.error, LOW, FURTHEST * known.error)
    # What innovations would be, were the shortest differences all noise.
    supposed = differences.innovation(fitted.correlation) / differences.innovation(known.phi)
    if fitted.scale > EXCESS * supposed:
        return known
    return Correlation(fitted.correlation, fitted.error, known.interval)


def _repeated(run: RunDesign) -> Bools:
    again = np.zeros(run.length, dtype=bool)
    shown = np.concatenate([run.run.positions, run.run.orientations, run.run.angular_velocities], axis=-1)
    for column, name in enumerate(run.run.names):
        own = [s for s in run.series if s.name == name]
        if not own:
            continue
        rows = np.unique(np.concatenate([s.rows for s in own]))
        twice = np.zeros(len(run.run.times), dtype=bool)
        twice[rows] = repeats(np.nan_to_num(shown[rows, column]))
        for s in own:
            again[s.where] = twice[s.rows]
    return again


def _without_outliers(run: RunDesign, noise: Noise, residual: Array, kept: Bools) -> Bools:
    kept = kept.copy()
    for s in run.series:
        own = np.flatnonzero(kept[s.where]) + s.where.start
        rho = noise.correlation[s.kind].over(
            np.array([np.median(np.diff(run.times[s.rows])) if len(s.rows) > 1 else 1.0])
        )
        floor = float(np.median(noise.sigma[run.index][s.where])) * np.sqrt(1.0 - rho[0])
        rows = s.rows[own - s.where.start]
        kept[own[outliers(run.times[rows], residual[own], floor)]] = False
    return kept


def _spreads(design: Design, kept: Sequence[Bools], values: Callable[[int, Series], Array]) -> list[differences.Spread]:
    found = []
    for s in design.series:
        own = kept[s.run][s.where]
        found.append(differences.spread(design.runs[s.run].times[s.rows[own]], values(s.run, s)[own]))
    return found


def _correlations(
    design: Design,
    spreads: Sequence[differences.Spread],
    kept: Sequence[Bools],
    values: Callable[[int, Series], Array],
) -> dict[Kind, Correlation]:
    """Return correlations by kind, of third differences or, where short series leave these too few, of what cubics
    leave."""
    found: dict[Kind, Correlation] = {}
    for kind in dict.fromkeys(s.kind for s in design.series):
        members = [(s, spread) for s, spread in zip(design.series, spreads, strict=True) if s.kind == kind]
        interval = members[0][1].interval
        phi, error = differences.correlation([spread for _, spread in members])
        if error >= differences.UNSURE[3]:
            pieces = []
            for s, spread in members:
                own = kept[s.run][s.where]
                steps = design.runs[s.run].times[s.rows[own]] / interval
                if spread.order == 3:  # or cubics do not follow the motion
                    pieces += autoregression.pieces((s.name, s.axis), steps, values(s.run, s)[own])
            phi, error = min((phi, error), autoregression.correlation(pieces) or (0.0, 1.0), key=lambda x: x[1])
        found[kind] = Correlation(phi, error, interval)
    return found


def _noise(
    design: Design,
    spreads: Sequence[differences.Spread],
    kept: tuple[Bools, ...],
    correlation: dict[Kind, Correlation],
) -> Noise:
    series = design.series
    sigma = [np.empty(r.length) for r in design.runs]
    notes: list[str] = []
    for kind in KINDS:
        members = [i for i, s in enumerate(series) if s.kind == kind]
        if not members:
            continue
        levels = levels_of(
            design, [series[i] for i in members], [spreads[i] for i in members], correlation[kind], notes
        )
        for i, value in zip(members, levels, strict=True):
            sigma[series[i].run][series[i].where] = value
    previous, rho = [], []
    for r in design.runs:
        p, q = _links(r, kept[r.index], correlation)
        previous.append(p)
        rho.append(q)
    return Noise(
        tuple(sigma),
        kept,
        tuple(previous),
        tuple(rho),
        _levels_by_kind(design, sigma),
        correlation,
        sum(_repeated_rows(r) for r in design.runs),
        tuple(dict.fromkeys(notes)),
    )


def _repeated_rows(run: RunDesign) -> int:
    again = _repeated(run)
    rows = {(s.name, int(row)) for s in run.series for row in s.rows[again[s.where]]}
    return len(rows)


def _links(run: RunDesign, kept: Bools, correlation: dict[Kind, Correlation]) -> tuple[Ints, Array]:
    previous = np.arange(run.length)
    rho = np.zeros(run.length)
    for s in run.series:
        own = np.flatnonzero(kept[s.where]) + s.where.start
        if len(own) < 2:
            continue
        times = run.times[s.rows[own - s.where.start]]
        previous[own[1:]] = own[:-1]
        rho[own[1:]] = correlation[s.kind].over(np.diff(times))
    return previous, rho


def _levels_by_kind(design: Design, sigma: Sequence[Array]) -> tuple[NoiseLevel, ...]:
    squares: dict[tuple[str, Kind], list[float]] = {}
    for s in design.series:
        squares.setdefault((s.name, s.kind), []).append(float((sigma[s.run][s.where] ** 2).mean()))
    return tuple(NoiseLevel(name, kind, float(np.sqrt(np.mean(v))), UNITS[kind]) for (name, kind), v in squares.items())
