"""Combine the friction and the restitution of two touching bodies, one law for every solver.

A contact has the geometric mean of both bodies' coefficients. A static may instead leave a coefficient to the touching
object, or be dominant: then its own coefficient is that of the contact. Which of these holds is coded in the sign of
its entry (`polyworld.model.arrays.coded`), so that it costs no memory in the kernels.
"""

from __future__ import annotations

import warp as wp

from polyworld.model import arrays

DOMINANT = wp.constant(wp.float64(arrays.DOMINANT))


@wp.func
def of_contact(a: wp.float64, b: wp.float64) -> wp.float64:
    """Coefficient of a contact of an object with coefficient a and a body or static with (coded) coefficient b."""
    if b <= DOMINANT:
        return DOMINANT - b
    if b < wp.float64(0.0):
        return a
    return wp.sqrt(a * b)
