"""Highest frequencies of a cloth's mesh, and the longest step that integrates them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import LinearOperator, eigsh

from polyworld.solver.cloth.geometry import ClothGeometry

Array = NDArray[np.float64]

SAFETY = 0.85  # of the limit of the undamped scheme; frequencies are found to 1%, and grow a little under load
EDGES = 3.0  # the edges of one triangle couple its directors: no eigenvalue exceeds 3 times the diagonal
# Square of the directors' highest frequency as part of the membrane's: fast enough to follow, and a step 4% shorter.
DIRECTOR_PART = 0.08


class ClothFrequencies:
    """Squares of the highest frequencies of a free cloth at rest, in units that parameters scale. Remembers them."""

    def __init__(self, geometry: ClothGeometry) -> None:
        self._area = geometry.area
        self._scale = np.repeat(1.0 / np.sqrt(geometry.node_area), 3)
        self._strain = _strain_operator(geometry)
        self._membrane: dict[tuple[float, float], float] = {}
        curvature = _curvature_operator(geometry)
        metric = np.tile([1.0, 1.0, 2.0], len(geometry.area)) * np.repeat(geometry.area, 3)
        self.bending = self._largest(curvature, lambda k: metric * k)

    def membrane(self, poisson: float, shear: float) -> float:
        """omega^2 for E t = 1 and unit mass per area; shear is G / E [1/m^2]."""
        key = (poisson, shear)
        if key not in self._membrane:
            q = 1.0 / (1.0 - poisson**2)
            law = np.array([[q, q * poisson, 0.0], [q * poisson, q, 0.0], [0.0, 0.0, 4.0 * shear]])

            def stress(e: Array) -> Array:
                return np.asarray((e.reshape(-1, 3) @ law) * self._area[:, None]).ravel()

            self._membrane[key] = self._largest(self._strain, stress)
        return self._membrane[key]

    def _largest(self, operator: sparse.csr_matrix, law: Callable[[Array], Array]) -> float:
        """Largest eigenvalue of M^-1/2 B^T C B M^-1/2."""
        scaled = (operator @ sparse.diags(self._scale)).tocsr()
        back = scaled.T.tocsr()
        n = scaled.shape[1]
        start = np.random.default_rng(0).standard_normal(n)
        whole = LinearOperator((n, n), matvec=lambda u: back @ law(scaled @ u.ravel()), dtype=np.float64)
        return 1.02 * float(eigsh(whole, k=1, which="LM", v0=start, tol=1e-2, return_eigenvectors=False)[0])


def stable_step(membrane: Array, bending: Array, delay: Array) -> Array:
    """Longest step of v += h a(x, v), x += h v for the squared frequencies [1/s^2] and the damping time of bending.

    With both in one mode, h^2 omega^2 + 2 h c <= 4, where c = delay times the square for bending.
    """
    damping = delay * bending
    return np.asarray(SAFETY * 4.0 / (damping + np.sqrt(damping**2 + 4.0 * (membrane + bending))))


def director_square(membrane: Array, bending: Array, delay: Array) -> Array:
    """Square of the directors' highest frequency: that of the nodes' bending at least, so that they follow it.

    Faster where that is cheap; but strong damping of fast directors would shorten the step.
    """
    cheap = np.minimum(DIRECTOR_PART * membrane, 0.3 * np.sqrt(membrane) / np.maximum(delay, 1e-12))
    return np.maximum(bending, cheap)


def _strain_operator(g: ClothGeometry) -> sparse.csr_matrix:
    """Displacements (3 k) to (e_11, e_22, e_12) of every triangle, about rest."""
    x = g.nodes[g.corners]
    edges = np.stack([x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]], axis=2)  # (T, 3, 2)
    axes = edges @ g.inverse_rest  # columns are the material axes in space
    # d(displacement)/d(material axis): the same combination of the corners' displacements.
    slope = np.stack([-g.inverse_rest.sum(axis=1), g.inverse_rest[:, 0], g.inverse_rest[:, 1]], axis=1)  # (T, 3, 2)
    rows = np.empty((len(x), 3, 3, 3))  # strain, corner, component
    for c in range(3):
        rows[:, 0, c] = slope[:, c, 0, None] * axes[:, :, 0]
        rows[:, 1, c] = slope[:, c, 1, None] * axes[:, :, 1]
        rows[:, 2, c] = 0.5 * (slope[:, c, 1, None] * axes[:, :, 0] + slope[:, c, 0, None] * axes[:, :, 1])
    return _assembled(g, rows)


def _curvature_operator(g: ClothGeometry) -> sparse.csr_matrix:
    """Displacements to (k_11, k_22, k_12) of every triangle with directors halfway, about rest."""
    x = g.nodes[g.corners]
    side = np.stack([x[:, (k + 2) % 3] - x[:, (k + 1) % 3] for k in range(3)], axis=1)  # (T, edge, 3)
    unit = side / np.linalg.norm(side, axis=2, keepdims=True)
    # Turning of a triangle about its edge j per displacement of corner i, along the normal.
    rotation = -np.einsum("tix,tjx->tji", side, unit) / (2.0 * g.area)[:, None, None]
    t, k = len(x), len(g.nodes)
    values = (rotation[:, :, :, None] * g.normal[:, None, None, :]).reshape(-1)
    rows = np.broadcast_to((g.edges >> 1)[:, :, None, None], (t, 3, 3, 3)).reshape(-1)
    columns = np.broadcast_to((3 * g.corners[:, :, None] + np.arange(3))[:, None], (t, 3, 3, 3)).reshape(-1)
    hinge = sparse.csr_matrix((values, (rows, columns)), shape=(len(g.ends), 3 * k))
    inner = sparse.diags(0.5 * (g.slots[:, 1] >= 0))
    rows = np.repeat(np.arange(3 * t), 3)
    columns = np.broadcast_to((g.edges >> 1)[:, None, :], (t, 3, 3)).reshape(-1)
    shape = sparse.csr_matrix((g.curvature.reshape(-1), (rows, columns)), shape=(3 * t, len(g.ends)))
    return (shape @ inner @ hinge).tocsr()


def _assembled(g: ClothGeometry, rows: Array) -> sparse.csr_matrix:
    t = len(g.corners)
    index = np.repeat(np.arange(3 * t), 9)
    columns = np.broadcast_to((3 * g.corners[:, :, None] + np.arange(3))[:, None], (t, 3, 3, 3)).reshape(-1)
    return sparse.csr_matrix((rows.reshape(-1), (index, columns)), shape=(3 * t, 3 * len(g.nodes)))
