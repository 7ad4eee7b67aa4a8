"""The highest natural frequency of a mesh, which limits the explicit time step."""

from __future__ import annotations

import numpy as np
import scipy.sparse
from numpy.typing import NDArray
from scipy.sparse.linalg import eigsh

from polyworld.core.kept import BOUNDS, kept
from polyworld.model.soft_elements import (
    TETRAHEDRON_EDGES,
    TETRAHEDRON_FAR,
    TETRAHEDRON_NEAR,
    TRIANGLE_EDGES,
    TRIANGLE_FAR,
    TRIANGLE_NEAR,
    QuadraticMesh,
)

Array = NDArray[np.float64]

# lambda / (lambda + 2 G). The highest eigenvalue is the largest of functions linear in the moduli, hence convex along
# this line, and linear interpolation in the table bounds it from above.
_LINE = np.array([0.0, 0.3, 0.6, 0.8, 0.9, 1.0])


def highest_square_frequency(mesh: QuadraticMesh, youngs_modulus: Array, poisson_ratio: Array, density: Array) -> Array:
    """Square of the highest angular frequency [1/s^2] of small vibrations, an upper bound within a few percent.

    Moduli [Pa], ratios and densities [kg/m^3] are arrays of one shape, which is that of the result. Plane stress for
    a slice.
    """
    shear = youngs_modulus / (2.0 * (1.0 + poisson_ratio))
    first = 2.0 * shear * poisson_ratio / (1.0 - 2.0 * poisson_ratio)
    if mesh.planar:
        first = 2.0 * first * shear / (first + 2.0 * shear)
    longitudinal = first + 2.0 * shear
    bound: Array = np.interp(first / longitudinal, _LINE, _table(mesh)) * longitudinal / density
    return bound


def shape_gradients(mesh: QuadraticMesh) -> tuple[Array, Array]:
    """Gradients of all shape functions (q, c, m, 3) at the quadrature points [1/m], and the points' weights (q, c)."""
    slope, weight = mesh.gradients()
    c = mesh.corners
    near, far = (TRIANGLE_NEAR, TRIANGLE_FAR) if mesh.planar else (TETRAHEDRON_NEAR, TETRAHEDRON_FAR)
    edges = TRIANGLE_EDGES if mesh.planar else TETRAHEDRON_EDGES
    place = np.where(np.eye(c) > 0, near, far)  # (point, coordinate)
    at_corner = (4.0 * place - 1.0)[None, :, :, None] * slope
    i, j = edges.T
    at_middle = 4.0 * (place[None, :, i, None] * slope[:, :, j] + place[None, :, j, None] * slope[:, :, i])
    return np.concatenate([at_corner, at_middle], axis=2), weight


@kept(BOUNDS.shapes)
def _table(mesh: QuadraticMesh) -> Array:
    """Largest eigenvalue at each point of `_LINE` with lambda + 2 G = 1 and density 1."""
    d = 2 if mesh.planar else 3
    slope, weight = shape_gradients(mesh)
    slope = slope[..., :d]
    q, m = mesh.elements.shape
    flat = slope.reshape(q, -1, m * d)
    volume = np.einsum("qp,qpa,qpb->qab", weight, flat, flat)
    laplace = np.einsum("qp,qpmi,qpni->qmn", weight, slope, slope)
    crossed = np.einsum("qp,qpmj,qpni->qminj", weight, slope, slope).reshape(q, m * d, m * d)
    shear = np.einsum("qmn,ij->qminj", laplace, np.eye(d)).reshape(q, m * d, m * d) + crossed
    rows = (mesh.elements[:, :, None] * d + np.arange(d)).reshape(q, -1)
    scale = 1.0 / np.sqrt(np.repeat(mesh.measure(), d))
    size = len(scale)
    where = (np.repeat(rows, m * d, axis=1).ravel(), np.tile(rows, (1, m * d)).ravel())
    scaled = [
        scipy.sparse.diags_array(scale)
        @ scipy.sparse.coo_array((k.ravel(), where), shape=(size, size)).tocsr()
        @ scipy.sparse.diags_array(scale)
        for k in (volume, shear)
    ]
    return np.array([_largest(s * scaled[0] + 0.5 * (1.0 - s) * scaled[1]) for s in _LINE])


def _largest(matrix: scipy.sparse.csr_array) -> float:
    size = matrix.shape[0]
    if size < 200:
        return float(np.linalg.eigvalsh(matrix.toarray())[-1])
    start = np.cos(np.arange(size) * 2.0)  # any vector that favours no mode; the same on every call
    value = eigsh(matrix, k=1, which="LA", v0=start, tol=1e-3, return_eigenvectors=False)[0]
    return float(value) * 1.005
