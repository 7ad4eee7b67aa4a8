"""Describe what an answer leaves undone: how large beside the noise, where, when, and what it correlates with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.noise import UNITS, first_kind
from polyworld.gap.localise import Localisation, localise
from polyworld.gap.settings import LocaliseSettings

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Remainder:
    """Residuals of an answer beyond the noise.

    rms, noise: of positions [m] (else of rotations [rad] or spins [rad/s]), and of their noise. before: rms of the
    base without effects. where: by run, object, time, phase, region, speed and axis. correlation: quantity -> Pearson
    correlation of the residual's size with it, over all samples; named: absolute value from which on it is reported.
    """

    rms: float
    noise: float
    before: float
    unit: str
    where: Localisation
    correlation: dict[str, float]
    named: float

    @property
    def beyond_noise(self) -> float:
        """Root mean square of what exceeds the noise."""
        return float(np.sqrt(max(self.rms**2 - self.noise**2, 0.0)))

    def summary(self) -> str:
        """Describe it in a sentence or two."""
        text = (
            f"What remains is {self.beyond_noise:.3g} {self.unit} rms beside a noise of {self.noise:.3g} {self.unit} "
            f"(without the effects {max(self.before**2 - self.noise**2, 0.0) ** 0.5:.3g} {self.unit})"
        )
        named = [f"{k} ({v:+.2f})" for k, v in self.correlation.items() if abs(v) >= self.named]
        text += (
            f"; its size correlates with {', '.join(named)}" if named else "; its size correlates with nothing tested"
        )
        return f"{text}. {self.where.summary()}"

    def to_json(self) -> dict[str, Any]:
        """Return it as plain data."""
        return {
            "rms": self.rms,
            "noise": self.noise,
            "beyond_noise": self.beyond_noise,
            "without_effects": self.before,
            "unit": self.unit,
            "correlation": self.correlation,
            "where": self.where.to_json(),
            "summary": self.summary(),
        }


def remainder_of(
    trial: FittedHypothesis, base: FittedHypothesis, settings: LocaliseSettings | None = None
) -> Remainder:
    """Describe the residuals of a fit, compared with those of the base."""
    settings = settings or LocaliseSettings()
    design, noise = trial.context.design, trial.context.noise
    kind = first_kind(design.series)
    left, size = _rms(trial, kind)
    before, _ = _rms(base, kind)
    sigma = np.concatenate([noise.sigma[s.run][s.where] for s in design.series if s.kind == kind])
    where = localise(design, noise, trial.fit, unknowns=trial.hypothesis.unknowns, settings=settings)
    level = float(np.sqrt(np.mean(sigma**2)))
    return Remainder(left, level, before, UNITS[kind], where, _correlations(trial, size), settings.named)


def _rms(trial: FittedHypothesis, kind: str) -> tuple[float, list[Array]]:
    """Return the root mean square of raw residuals of one kind, and each run's residual size (m,) per series entry."""
    raw = trial.context.raw_residuals(trial)
    squares, sizes = [], []
    for s in trial.context.design.series:
        if s.kind == kind:
            own = raw[s.run][s.where][trial.context.noise.kept[s.run][s.where]]
            squares.append(own**2)
        sizes.append(np.abs(raw[s.run][s.where]) / trial.context.noise.sigma[s.run][s.where])
    total = np.concatenate(squares)
    return float(np.sqrt(np.mean(total))) if np.all(np.isfinite(total)) else float("inf"), sizes


def _correlations(trial: FittedHypothesis, sizes: list[Array]) -> dict[str, float]:
    """Correlate the residual's size with time, speed, height and the distance travelled, all series together."""
    columns: dict[str, list[Array]] = {"time": [], "speed": [], "height": [], "distance travelled": []}
    size: list[Array] = []
    for s, own in zip(trial.context.design.series, sizes, strict=True):
        run = trial.context.design.runs[s.run].run
        if s.name not in run.names or len(s.rows) < 4:
            continue
        path = run.positions[s.rows, run.names.index(s.name)]
        times = run.times[s.rows]
        stride = max(1, len(times) // 24)
        step = np.nan_to_num(path[stride:] - path[:-stride])
        speed = np.linalg.norm(step, axis=1) / (times[stride:] - times[:-stride])
        speed = np.concatenate([speed, np.full(stride, speed[-1])])
        gone = np.concatenate([[0.0], np.cumsum(speed[:-1] * np.diff(times))])
        size.append(own)
        columns["time"].append(times - times[0])
        columns["speed"].append(speed)
        columns["height"].append(np.nan_to_num(path[:, 2]))
        columns["distance travelled"].append(gone)
    found = {}
    if size:
        whole = np.concatenate(size)
        for name, parts in columns.items():
            values = np.concatenate(parts)
            if np.all(np.isfinite(whole)) and values.std() > 1e-9 and whole.std() > 1e-9:
                found[name] = float(np.corrcoef(values, whole)[0, 1])
    return found
