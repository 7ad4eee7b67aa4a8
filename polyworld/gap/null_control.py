"""Null control: data simulated from the base world, in which nothing is missing, for the same procedure."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.estimation.design import Design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import Noise
from polyworld.world import geometry

Array = NDArray[np.float64]


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
        """Return JSON-ready values."""
        return asdict(self)


def simulated_recording(forward: Forward, values: Array, states: Sequence[Array], noise: Noise, seed: int) -> Recording:
    """Simulate a measurement of a world: its motion at all instants that were measured, with noise of the same level
    and correlation in time. Components that were not measured stay so."""
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
    """Return noise (m,) of one run, by the recursion of AR(1)."""
    values = rng.normal(size=plan.runs[run].length)
    rho, previous = noise.rho[run], noise.previous[run]
    if np.any(rho):
        for i in range(len(values)):
            values[i] = rho[i] * values[previous[i]] + np.sqrt(1.0 - rho[i] ** 2) * values[i]
    return values * noise.sigma[run]
