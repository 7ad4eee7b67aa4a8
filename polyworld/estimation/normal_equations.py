"""Normal equations of shared unknowns and initial states, block-bordered: every run's initial state is eliminated."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.forward import Forward

Array = NDArray[np.float64]

LONGEST = 20.0  # typical changes: an initial state goes no further in one step
PRIOR = 1e-4  # weight of an ordinary change in the curvature, so that what the data do not determine stays where it is
HELD = 0.3  # the same of states in a step: where a body rests on friction, slopes by its speed are next to nothing


@dataclass(frozen=True)
class Linearised:
    """Whitened residuals r[run] (m,), slopes by shared unknowns a[run] (m, S), initial states b[run] (m, N)."""

    r: tuple[Array, ...]
    a: tuple[Array, ...]
    b: tuple[Array, ...]

    @property
    def chi2(self) -> float:
        """Sum of squared whitened residuals."""
        return float(sum(float(r @ r) for r in self.r))


@dataclass(frozen=True)
class Hold:
    """Values (S,) that shared unknowns are drawn to, with weights (S,) [1/unit^2]."""

    values: Array
    weight: Array

    def cost(self, values: Array) -> float:
        """Return what is added to chi2."""
        return float(self.weight @ (values - self.values) ** 2)


class NormalEquations:
    """The normal equations at a linearisation, run by run, filled up with zeros to the longest initial state N.

    A run whose rollout diverges asks for no step.

    bb (R, N, N), ba (R, N, S), br (R, N): products of slopes by states, with those by shared unknowns and residuals.
    aa (S, S), ar (S,): of shared unknowns, all runs together. typical (R, N), shared (S,): ordinary changes.
    """

    def __init__(self, forward: Forward, linear: Linearised) -> None:
        runs = forward.design.runs
        self.shared = np.array([u.typical for u in forward.unknowns])
        self.counts = [r.count for r in runs]
        s, n = len(self.shared), max(self.counts, default=0)
        self.bb, self.ba = np.zeros((len(runs), n, n)), np.zeros((len(runs), n, s))
        self.br, self.typical = np.zeros((len(runs), n)), np.ones((len(runs), n))
        self.aa, self.ar = np.zeros((s, s)), np.zeros(s)
        for i, (r, a, b, raw) in enumerate(zip(runs, linear.a, linear.b, linear.r, strict=True)):
            own, res = slice(0, r.count), np.where(np.isfinite(raw), raw, 0.0)
            self.bb[i, own, own], self.ba[i, own], self.br[i, own] = b.T @ b, b.T @ a, b.T @ res
            self.typical[i, own] = r.typical
            self.aa += a.T @ a
            self.ar += a.T @ res

    def hold(self, hold: Hold, values: Array) -> None:
        """Draw shared unknowns to where they are held."""
        self.aa += np.diag(hold.weight)
        self.ar += hold.weight * (values - hold.values)

    def stepped(self, states: Sequence[Array], damping: Array) -> tuple[Array, ...]:
        """Return initial states[run] (N,) after a step with shared unknowns held; damping (R, 1)."""
        change = np.einsum("rnm,rm->rn", damped_inverse(self.bb, self.typical, damping, HELD), self.br)
        return self._changed(states, change)

    def _changed(self, states: Sequence[Array], change: Array) -> tuple[Array, ...]:
        change = within_reach(change, self.typical)
        return tuple(old - change[i, :n] for i, (old, n) in enumerate(zip(states, self.counts, strict=True)))

    def carried(self, states: Sequence[Array], inverse: Array, step: Array) -> tuple[Array, ...]:
        """Return initial states[run] (N,) that follow a step (S,) of the shared unknowns; inverse as from `reduced`."""
        return self._changed(states, np.einsum("rnm,rm->rn", inverse, self.br + self.ba @ step))

    def reduced(self, damping: float, prior: float) -> tuple[Array, Array, Array]:
        """Return inverses (R, N, N) of the states' blocks, and the Schur complement (S, S) with its right side (S,).

        prior: weight of an ordinary change of a state.
        """
        inverse = damped_inverse(self.bb, self.typical, damping, prior)
        carried = inverse @ self.ba
        matrix = self.aa - np.einsum("rns,rnt->st", self.ba, carried)
        vector = self.ar - np.einsum("rns,rn->s", carried, self.br)
        return inverse, matrix, vector


def within_reach(change: Array, typical: Array) -> Array:
    """Return changes (..., N) of initial states, none longer than one step may be: what the data do not determine,
    as a spin that shows nowhere, slopes would change without limit."""
    reached: Array = np.clip(change, -LONGEST * typical, LONGEST * typical)
    return reached


def damped_inverse(matrix: Array, typical: Array, damping: float | Array, prior: float = PRIOR) -> Array:
    """Return inverses of damped matrices (..., N, N); typical (..., N); damping of all, or (..., 1) of each; prior:
    weight of an ordinary change."""
    scale = np.sqrt(np.maximum(np.diagonal(matrix, axis1=-2, axis2=-1), 0.0)) + PRIOR / typical
    outer = scale[..., :, None] * scale[..., None, :]
    diagonal = damping + (prior / typical / scale) ** 2
    scaled = matrix / outer + diagonal[..., None] * np.eye(matrix.shape[-1])
    result: Array = np.linalg.inv(scaled) / outer
    return result
