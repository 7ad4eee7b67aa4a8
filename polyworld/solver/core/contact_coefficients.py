"""Combine the friction and the restitution of two touching bodies, one law for every solver.

A contact has the geometric mean of both bodies' coefficients. A static may instead leave a coefficient to the touching
object, or be dominant: then its own coefficient is that of the contact. Which of these holds is coded in the sign of
its entry, so that it costs no memory in the kernels.
"""

from __future__ import annotations

import numpy as np
import warp as wp
from numpy.typing import NDArray

OWN = -1.0  # a coefficient that is left to the touching object
DOMINANT = wp.constant(wp.float64(-2.0))  # minus a coefficient c >= 0 that is the contact's own: -2 - c


def coded(values: NDArray[np.float64], dominant: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return coefficients (R, s) of statics as the solvers read them; `OWN` and what is coded already stay."""
    found: NDArray[np.float64] = np.where(dominant & (values >= 0.0), -2.0 - values, values)
    return found


@wp.func
def of_contact(a: wp.float64, b: wp.float64) -> wp.float64:
    """Coefficient of a contact of an object with coefficient a and a body or static with (coded) coefficient b."""
    if b <= DOMINANT:
        return DOMINANT - b
    if b < wp.float64(0.0):
        return a
    return wp.sqrt(a * b)
