"""Orthonormal bases of what a fit can take up, to project it out of residuals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

INDEPENDENT = 1e-8  # least singular value of scaled columns, over the greatest, that counts as a direction


def column_basis(columns: Array) -> Array:
    """Return an orthonormal basis (m, k) of the space of columns (m, n), whatever their units."""
    if not columns.shape[1]:
        return columns
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    basis, size, _ = np.linalg.svd(scaled, full_matrices=False)
    found: Array = basis[:, size > INDEPENDENT * size.max(initial=0.0)]
    return found
