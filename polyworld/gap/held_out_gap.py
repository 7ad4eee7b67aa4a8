"""What an added effect is worth on data that no step has seen, and the same on data in which nothing is missing."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld import geometry
from polyworld.estimation import profile
from polyworld.estimation.design import Design, design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import UNITS, Noise, first_kind, measured_noise
from polyworld.estimation.parts import in_parts
from polyworld.recording import Recording
from polyworld.world import World

Array = NDArray[np.float64]

STILL_OPEN = 0.5  # share of the gap before, beyond which one has hardly been closed


@dataclass(frozen=True)
class SealedGap:
    """Root-mean-square residuals of positions [m] (else of orientations [rad] or spins [rad/s]) beyond the noise.

    noise_floor: the noise itself. closed: share of the gap that the effect closes, 1 - gap_after / gap_before; None
    where there was none to close.
    """

    gap_before: float
    gap_after: float
    noise_floor: float
    closed: float | None
    unit: str

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return asdict(self)

    @property
    def contradicts(self) -> str | None:
        """In words, that a world which explains the fitted data does not explain these; None where it does."""
        if not self.gap_after > max(self.noise_floor, STILL_OPEN * self.gap_before):
            return None
        return (
            f"the sealed data do not bear this out: of a gap of {self.gap_before:.3g} {self.unit} there "
            f"{self.gap_after:.3g} {self.unit} are left, with a noise of {self.noise_floor:.3g} {self.unit}; what "
            "explains the data fitted is not all that acts, or not what does"
        )


def sealed_gap(before: World, after: World, recording: Recording, known: Noise | None = None) -> SealedGap:
    """The gap on sealed runs before and after: everything that runs share stays as it was fitted, each run's own
    initial state, or that of each part of a long one, is fitted to it.

    known: noise of the same measurements in other runs, which is no less in these: few samples hide its correlation."""
    worlds = (before, after)
    cut = in_parts(recording, *worlds)
    plans = [design(world, cut) for world in worlds]
    plan = plans[0]
    noise = measured_noise(plan)
    kind = first_kind(plan.series)
    floor = _noise_level(plan, noise, kind)
    if known is not None:
        levels = [level.sigma**2 for level in known.levels if level.kind == kind]
        floor = max(floor, float(np.sqrt(np.mean(levels)))) if levels else floor
    forwards = [Forward(p, world, ()) for p, world in zip(plans, worlds, strict=True)]
    none, horizons = np.zeros(0), profile.horizons_for(plan)
    fits = [profile.fit(f, noise, none, profile.start_states(f.design), horizons=horizons) for f in forwards]
    gaps = []
    for forward, own, other, theirs in zip(forwards, fits, reversed(fits), reversed(plans), strict=True):
        # Neither world is to lose by a fit that was trapped.
        again = profile.fit(forward, noise, none, _carried(forward.design, theirs, other.states))
        gaps.append(_beyond_noise(forward.design, forward, min(own, again, key=lambda f: f.chi2), kind, floor))
    closed = 1.0 - gaps[1] / gaps[0] if gaps[0] > 0.0 else None
    return SealedGap(gaps[0], gaps[1], floor, closed, UNITS[kind])


def _carried(plan: Design, other: Design, states: Sequence[Array]) -> tuple[Array, ...]:
    """Initial states of another design of the same runs, as far as they are coordinates of this one too."""
    carried = []
    for own, theirs, known in zip(plan.runs, other.runs, states, strict=True):
        told = dict(zip(theirs.labels, known, strict=True))
        carried.append(np.array([told.get(label, v) for label, v in zip(own.labels, own.start, strict=True)]))
    return tuple(carried)


def _noise_level(plan: Design, noise: Noise, kind: str) -> float:
    levels = [noise.sigma[s.run][s.where] for s in plan.series if s.kind == kind]
    return float(np.sqrt(np.mean(np.concatenate(levels) ** 2)))


def _beyond_noise(plan: Design, forward: Forward, fit: profile.Fit, kind: str, floor: float) -> float:
    """The residual's mean square, corrected for the initial states fitted, less the noise's; as a root."""
    settings = [Settings(r.index, np.zeros((1, 0)), fit.states[r.index][None]) for r in plan.runs]
    total, count = 0.0, 0
    for r, raw in zip(plan.runs, forward.residuals(settings), strict=True):
        for s in r.series:
            if s.kind == kind:
                total += float(np.sum(raw[0, s.where] ** 2))
                count += len(s.rows)
    fitted = sum(r.count for r in plan.runs) * count / plan.length  # unknowns that these components paid for
    if not np.isfinite(total):
        return float("inf")
    return float(np.sqrt(max(total / max(count - fitted, 1.0) - floor**2, 0.0)))


@dataclass(frozen=True)
class NullControl:
    """The same procedure on data made from the base world, with its noise.

    verdict: what was found there; nothing is missing. chi2_before, chi2_after: of the base world and with the named
    effect fitted, over `count` measurements: what the effect gains where it is not. None where no effect was named.
    """

    verdict: str
    chi2_before: float
    chi2_after: float | None
    count: int
    seed: int

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return asdict(self)


def simulated_recording(forward: Forward, values: Array, states: Sequence[Array], noise: Noise, seed: int) -> Recording:
    """What a world would have shown: its motion at all instants that were measured, with noise of the same level and
    correlation in time. Components that were not measured stay so."""
    rng = np.random.default_rng(seed)
    plan = forward.design
    settings = [Settings(r.index, values[None], states[r.index][None]) for r in plan.runs]
    runs = []
    for r, raw in zip(plan.runs, forward.residuals(settings), strict=True):
        change = raw[0] + _drawn(plan, noise, r.index, rng)
        positions, orientations = r.run.positions.copy(), r.run.orientations.copy()
        spins = r.run.angular_velocities.copy()
        turns: dict[str, Array] = {}
        for s in r.series:
            column = r.run.names.index(s.name)
            if s.kind == "position":
                positions[s.rows, column, s.axis] += change[s.where]
            elif s.kind == "spin":
                spins[s.rows, column, s.axis] += change[s.where]
            else:
                turns.setdefault(s.name, np.zeros((len(s.rows), 3)))[:, s.axis] = change[s.where]
        for name, vectors in turns.items():
            column = r.run.names.index(name)
            rows = next(s.rows for s in r.series if s.name == name and s.kind == "rotation")
            orientations[rows, column] = geometry.quaternion_product(
                geometry.rotation_quaternion(vectors), orientations[rows, column]
            )
        runs.append(replace(r.run, positions=positions, orientations=orientations, angular_velocities=spins))
    return Recording(tuple(runs))


def _drawn(plan: Design, noise: Noise, run: int, rng: np.random.Generator) -> Array:
    """Noise (m,) of one run, by the recursion of AR(1)."""
    values = rng.normal(size=plan.runs[run].length)
    rho, previous = noise.rho[run], noise.previous[run]
    if np.any(rho):
        for i in range(len(values)):
            values[i] = rho[i] * values[previous[i]] + np.sqrt(1.0 - rho[i] ** 2) * values[i]
    return values * noise.sigma[run]
