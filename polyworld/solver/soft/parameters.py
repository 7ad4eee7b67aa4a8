"""Parameters of soft bodies as the kernels take them, and the time step that they allow."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from polyworld.model.soft_elements import QuadraticMesh
from polyworld.solver.soft.material import Law
from polyworld.solver.soft.spectrum import highest_square_frequency

Array = NDArray[np.float64]

PARAMETERS = ("density", "youngs_modulus", "poisson_ratio", "damping", "yield_stress")

# Held to volume in every point, nearly incompressible tetrahedra would bend too little; held to it on average only,
# one layer of them would bend too much. The part of lam held in every point, at most, in shear moduli: measured on
# cantilevers of one, two and three layers.
POINT_SHARE = 2.25

# Share of the critical step of the body at rest: deformed, it is stiffer, at most about (1 / share)^2 times.
ELASTIC_SHARE = 0.5
PLASTIC_SHARE = 0.4
VISCOUS_MARGIN = 3.3  # of the highest viscous rate of the body at rest, as |F|^2 allows it to grow
WORTH = 0.6  # damping is integrated with the other forces while that costs no more than this share of the step


def laws(form: QuadraticMesh, row: dict[str, Array]) -> tuple[NDArray[np.void], Array]:
    """Return the records `Law` of one body and its longest stable steps [s], both of the parameters' common length.

    `row` has `PARAMETERS`; a yield stress of NaN means that it never flows.
    """
    e, nu, tau, limit = (row[k] for k in ("youngs_modulus", "poisson_ratio", "damping", "yield_stress"))
    shear = e / (2.0 * (1.0 + nu))
    first = 2.0 * shear * nu / (1.0 - 2.0 * nu)
    lam = first + 5.0 / 6.0 * shear
    record = np.zeros(len(e), dtype=Law.numpy_dtype())
    record["mu"] = 4.0 / 3.0 * shear
    record["lam_point"] = np.minimum(lam, POINT_SHARE * shear)
    record["lam_mean"] = lam - record["lam_point"]
    record["alpha"] = 1.0 + shear / lam
    record["viscous_shear"] = tau * shear
    record["viscous_first"] = tau * (2.0 * first * shear / (first + 2.0 * shear) if form.planar else first)
    record["yield_stress"] = np.where(np.isnan(limit), -1.0, limit)
    square = highest_square_frequency(form, e, nu, row["density"])
    share = np.where(np.isnan(limit), ELASTIC_SHARE, PLASTIC_SHARE)
    elastic = 2.0 * share / np.sqrt(square)
    # Symplectic Euler with explicit damping is stable while (w dt)^2 + 2 c dt <= 4, c the viscous rate.
    rate = VISCOUS_MARGIN * tau * square
    stiff = square / share**2
    step = (np.sqrt(rate**2 + 4.0 * stiff) - rate) / stiff
    staged = step < WORTH * elastic
    step = np.where(staged, elastic, step)
    # The fewest stages s with s^2 + s >= c dt; even, since an odd number may reverse the fastest modes.
    count = np.ceil(np.sqrt(0.25 + rate * step) - 0.5)
    record["stages"] = np.where(staged, np.maximum(2.0, 2.0 * np.ceil(0.5 * count)), 0.0).astype(np.int32)
    return record, step
