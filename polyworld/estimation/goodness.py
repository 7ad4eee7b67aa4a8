"""Whether a fit explains the data: the gate that every name has to pass.

Model error is smooth, noise is not: what a fit lacks fills the lowest cosine modes of the residuals. Their energy is
held against what noise leaves there once everything fitted is projected out. Noise level and correlation are known
with an error of their own, which widens the null distribution. Of the higher modes, only lines are asked for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import fdtrc  # scipy.stats is slow to import

from polyworld.estimation import differences, spectrum
from polyworld.estimation.design import Design, Series
from polyworld.estimation.lines import NO_LINE, Line, strongest_line
from polyworld.estimation.noise import EXCESS, Kind, Noise, spectral_modes
from polyworld.estimation.noise_levels import resolution
from polyworld.estimation.profile import Fit
from polyworld.estimation.projection import column_basis
from polyworld.estimation.settings import GATE

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

MODES = 12


@dataclass(frozen=True)
class SeriesFit:
    """One series: p-value of the energy in its low modes, that energy over the expected one, and modes counted."""

    run: str
    name: str
    kind: Kind
    axis: int
    p: float
    ratio: float
    count: int


@dataclass(frozen=True)
class Goodness:
    """The verdict on a fit.

    passes: p >= GATE.level. p: of the data under the hypothesis that the fit explains them, all tests taken together.
    statistic: energy of the low modes over its expectation, about 1 for noise. modes: how many count. p_total: of the
    sum over all runs; p_lowest: of the lowest modes alone; p_worst: of the worst series, the number of them
    accounted for. series: worst first. line: the strongest rhythm in higher modes, looked for where all else passes;
    it counts where its p is below GATE.line.
    """

    passes: bool
    p: float
    statistic: float
    modes: int
    p_total: float
    p_lowest: float
    p_worst: float
    series: tuple[SeriesFit, ...]
    line: Line = NO_LINE

    @property
    def worst(self) -> SeriesFit | None:
        """The series that fits worst."""
        return self.series[0] if self.series else None

    def summary(self) -> str:
        """Return the verdict in words."""
        if not self.modes:
            return "the fit cannot be judged: the series are too short."
        head = "the fit explains the data" if self.passes else "the fit does not explain the data"
        text = f"{head} (p = {self.p:.2g}; smooth residuals {self.statistic:.2g} times those of noise)"
        if not self.passes and self.worst is not None:
            w = self.worst
            text += f"; worst: {w.name} {w.kind} {'xyz'[w.axis]} in run {w.run}, {w.ratio:.3g} times"
        if self.line.p < GATE.line:
            text += f"; {self.line.summary()}"
        return text + "."

    def to_json(self) -> dict[str, object]:
        """Return the verdict as plain data, with the five worst series."""
        return {
            "passes": self.passes,
            "p": self.p,
            "statistic": self.statistic,
            "modes": self.modes,
            "worst": [
                {"run": s.run, "name": s.name, "kind": s.kind, "axis": "xyz"[s.axis], "p": s.p, "ratio": s.ratio}
                for s in self.series[:5]
            ],
            "rhythm": self.line.to_json() if self.line.p < GATE.line else None,
            "summary": self.summary(),
        }


@dataclass(frozen=True)
class LowModes:
    """Low cosine modes of one run: amplitudes (L,), their covariance (L, L) under noise, and the series of each."""

    amplitudes: Array
    covariance: Array
    owner: NDArray[np.int64]
    number: NDArray[np.int64]


def goodness(design: Design, noise: Noise, fit: Fit, *, level: float = GATE.level) -> Goodness:
    """Judge a fit made with this noise. level: the share of good fits that are allowed to fail."""
    whitened, own, shared = projected(fit)
    runs = [_low_modes(design, noise, r.index, whitened[r.index], own[r.index], shared[r.index]) for r in design.runs]
    scale = {kind: _Scale(design, noise, whitened, runs, kind) for kind in noise.correlation}
    energies: list[float] = []
    counts: list[int] = []
    lowest: list[tuple[float, int]] = []
    total_error: list[float] = []
    found: list[SeriesFit] = []
    for r, low in zip(design.runs, runs, strict=True):
        if not len(low.amplitudes):
            continue
        gains = np.empty(len(low.amplitudes))
        errors = np.empty(len(r.series))
        for i, s in enumerate(r.series):
            mine = low.owner == i
            gains[mine] = scale[s.kind].gains(s, low.number[mine])
            errors[i] = scale[s.kind].error
        z = low.amplitudes / np.sqrt(gains)
        energy, count = _energy(z, low.covariance)
        energies.append(energy)
        counts.append(count)
        few = low.number < GATE.lowest
        lowest.append(_energy(z[few], low.covariance[np.ix_(few, few)]))
        total_error.append(float(errors.max()))
        for i, s in enumerate(r.series):
            mine = low.owner == i
            if not mine.any():
                continue
            e, c = _energy(z[mine], low.covariance[np.ix_(mine, mine)])
            if c:
                p = _tail(e, c, float(errors[i]), scale[s.kind].own_error(s))
                found.append(SeriesFit(r.run.name, s.name, s.kind, s.axis, p, e / c, c))
    modes = int(sum(counts))
    if not modes:
        return Goodness(False, float("nan"), float("nan"), 0, float("nan"), float("nan"), float("nan"), ())
    statistic = float(sum(energies) / modes)
    p_total = _tail(float(sum(energies)), modes, max(total_error), 0.0)
    found.sort(key=lambda s: s.p)
    p_worst = min(1.0, found[0].p * len(found))
    slow, left = (float(sum(e for e, _ in lowest)), sum(c for _, c in lowest))
    p_lowest = _tail(slow, left, max(x.lowest_error for x in scale.values()), 0.0) if left else 1.0
    p = min(1.0, GATE.tests * min(p_total, p_lowest, p_worst))
    if _loudest(design, noise, fit) > GATE.loud:
        p = 0.0  # whatever their course, such residuals are not the noise that the fit was made under
    line = NO_LINE
    if p >= level:  # what is wrong in low modes leaks into all
        line = strongest_line(design, noise, whitened, MODES)
        p = min(p, line.p) if line.p < GATE.line else p
    return Goodness(p >= level, p, statistic, modes, p_total, p_lowest, p_worst, tuple(found), line)


def _loudest(design: Design, noise: Noise, fit: Fit) -> float:
    """Mean square of the whitened residuals of the kind, positions or rotations, in which it is largest."""
    energy: dict[Kind, float] = {}
    count: dict[Kind, int] = {}
    for s in design.series:
        kept = fit.linear.r[s.run][s.where][noise.kept[s.run][s.where]]
        energy[s.kind] = energy.get(s.kind, 0.0) + float(kept @ kept)
        count[s.kind] = count.get(s.kind, 0) + len(kept)
    return max((energy[kind] / max(count[kind], 1) for kind in energy), default=0.0)


def projected(fit: Fit) -> tuple[list[Array], list[Array], list[Array]]:
    """Whitened residuals (m,) with all fitted directions taken out, and orthonormal bases of these directions: of the
    initial states (m, n) of each run, and of the shared unknowns (m, S), orthonormal over all runs together."""
    own, residuals, rest = [], [], []
    for r, a, b in zip(fit.linear.r, fit.linear.a, fit.linear.b, strict=True):
        basis = column_basis(b)
        own.append(basis)
        residuals.append(r - basis @ (basis.T @ r))
        rest.append(a - basis @ (basis.T @ a))
    s = rest[0].shape[1]
    if not s:
        return residuals, own, rest
    length = np.sqrt(sum((a**2).sum(axis=0) for a in rest))
    rest = [a / np.maximum(length, 1e-300) for a in rest]
    values, vectors = np.linalg.eigh(sum((a.T @ a for a in rest), np.zeros((s, s))))
    use = values > 1e-10
    turn = vectors[:, use] / np.sqrt(values[use])
    shared = [a @ turn for a in rest]
    along = sum((u.T @ r for u, r in zip(shared, residuals, strict=True)), np.zeros(int(use.sum())))
    return [r - u @ along for r, u in zip(residuals, shared, strict=True)], own, shared


def cosines(times: Array, count: int) -> Array:
    """Orthonormal cosine modes (m, count) on instants (m,); on even ones those of the discrete cosine transform."""
    m = len(times)
    x = (times - times[0]) / max(times[-1] - times[0], 1e-300) * (m - 1) / m + 0.5 / m
    basis: Array = np.linalg.qr(np.cos(np.pi * x[:, None] * np.arange(count)))[0]
    return basis


def _low_modes(design: Design, noise: Noise, run: int, whitened: Array, own: Array, shared: Array) -> LowModes:
    r = design.runs[run]
    fitted = np.concatenate([own, shared], axis=1)
    amplitudes, taken, owner, number = [], [], [], []
    for i, s in enumerate(r.series):
        kept = np.flatnonzero(noise.kept[run][s.where])
        count = min(MODES, len(kept) // 3)
        if count < 1:
            continue
        q = cosines(r.times[s.rows[kept]], count)
        rows = kept + s.where.start
        amplitudes.append(q.T @ whitened[rows])
        taken.append(q.T @ fitted[rows])
        owner.append(np.full(count, i))
        number.append(np.arange(count))
    if not amplitudes:
        none = np.zeros(0, dtype=np.int64)
        return LowModes(np.zeros(0), np.zeros((0, 0)), none, none)
    t = np.concatenate(taken)
    return LowModes(np.concatenate(amplitudes), np.eye(len(t)) - t @ t.T, np.concatenate(owner), np.concatenate(number))


def _energy(amplitudes: Array, covariance: Array) -> tuple[float, int]:
    """Squared amplitudes in units of their variance, and how many directions they are."""
    values, vectors = np.linalg.eigh(covariance)
    use = values > GATE.left
    return float(((vectors[:, use].T @ amplitudes) ** 2 / values[use]).sum()), int(use.sum())


def _tail(energy: float, count: int, *errors: float) -> float:
    """Probability of at least this energy: chi-squared over a scale known with relative errors (of the variance)."""
    variance = sum(e**2 for e in errors)
    return float(fdtrc(count, 2.0 / max(variance, 1e-6), energy / count))


class _Scale:
    """Power that noise has in the low modes of whitened residuals of one kind, as estimated from the other modes."""

    def __init__(self, design: Design, noise: Noise, whitened: list[Array], runs: list[LowModes], kind: Kind) -> None:
        known = noise.correlation[kind]
        left = _left(design, runs)
        series = spectral_modes(design, noise, whitened, kind)
        index = [i for i, s in enumerate(design.series) if s.kind == kind and len(s.rows) >= 16]
        series = [
            spectrum.Modes(m.power, np.concatenate([left[i], np.ones(len(m.power))])[: len(m.power)], m.used, m.seconds)
            for m, i in zip(series, index, strict=True)
        ]
        self.known = known
        found = spectrum.fitted(series, known.phi, max(GATE.loose * known.error, 1e-3), 0)
        # A model that is wrong passes for long-lived noise, but leaves more than the shortest differences have.
        supposed = differences.innovation(found.correlation) / differences.innovation(known.phi)
        self.louder = found.scale > EXCESS * supposed
        self.found = spectrum.Correction(known.phi, known.error, 1.0) if self.louder else found
        self.design = design
        self.members = [s for s in design.series if s.kind == kind]
        length = sum(int(noise.kept[s.run][s.where].sum()) for s in self.members)
        level = np.sqrt(2.0 / max(length, 1))
        most = GATE.louder if self.louder else np.inf
        self.error = min(float(np.hypot(level, self._slope(MODES) * self.found.error)), most) + GATE.edge
        self.lowest_error = min(float(np.hypot(level, self._slope(GATE.lowest) * self.found.error)), most) + GATE.edge
        self._level = {id(s): 1.0 for s in self.members}
        self._own: dict[int, float] = {}
        self._levels(noise, whitened)

    def gains(self, s: Series, number: NDArray[np.int64]) -> Array:
        """Expected power of modes of a series."""
        return self._level[id(s)] * self._gain(s, number)

    def own_error(self, s: Series) -> float:
        """Relative error of the level of one series."""
        return self._own[id(s)]

    def _levels(self, noise: Noise, whitened: list[Array]) -> None:
        """Variance of the high modes of each object's axis, over all runs."""
        groups: dict[tuple[str, int], list[Series]] = {}
        for s in self.members:
            groups.setdefault((s.name, s.axis), []).append(s)
        for group in groups.values():
            energy, supposed, count = 0.0, 0.0, 0
            for s in group:
                values = whitened[s.run][s.where][noise.kept[s.run][s.where]]
                if len(values) < 2 * MODES:
                    continue
                q = cosines(np.arange(len(values), dtype=float), MODES)
                energy += float(values @ values - ((q.T @ values) ** 2).sum())
                high = self._gain(s, np.arange(MODES, len(s.rows)))
                supposed += float(high.mean()) * (len(values) - MODES)
                count += len(values) - MODES
            level = energy / supposed if count and not self.louder else 1.0
            # What the engine does not resolve is not held against a fit, however smooth the data are.
            level = max(
                level, *((resolution(self.design, s) / float(noise.sigma[s.run][s.where].min())) ** 2 for s in group)
            )
            if any(self.design.runs[s.run].run.sigma is not None for s in group):
                level = max(level, 1.0)  # an accuracy that the recording states covers what is smooth in its errors
            for s in group:
                self._level[id(s)] = level
                self._own[id(s)] = float(np.sqrt(2.0 / count)) if count else 0.5

    def _gain(self, s: Series, number: NDArray[np.int64]) -> Array:
        seconds = self._seconds(s)
        w = np.pi * number / len(s.rows)
        return spectrum.gain(w, self.known.phi**seconds, self.found.correlation**seconds)

    def _seconds(self, s: Series) -> float:
        times = self.design.runs[s.run].times[s.rows]
        return float(np.median(np.diff(times))) / self.known.interval if len(times) > 1 else 1.0

    def _slope(self, count: int) -> float:
        """Change of the log power of the first modes with the correlation, on average."""
        phi = self.found.correlation
        slopes = []
        for s in self.members:
            w = np.pi * np.arange(min(count, len(s.rows))) / len(s.rows)
            slopes.append(float(np.mean(2.0 * (np.cos(w) - phi) / (1.0 - 2.0 * phi * np.cos(w) + phi**2))))
        return abs(float(np.mean(slopes)))


def _left(design: Design, runs: list[LowModes]) -> list[Array]:
    """Return the part of each low mode of each series that the fit left."""
    found = []
    for r, low in zip(design.runs, runs, strict=True):
        for i in range(len(r.series)):
            found.append(np.clip(np.diag(low.covariance)[low.owner == i], 0.0, 1.0))
    return found
