"""The discrete form of a deformable object: where its nodes start and how they are connected."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Ints = NDArray[np.int32]


def _none(width: int) -> Ints:
    return np.zeros((0, width), dtype=np.int32)


@dataclass(frozen=True)
class DeformableMesh:
    """Nodes and elements of one rope, cloth, soft body or fluid; indices count from its own first node.

    nodes (k, 3): initial positions, world axes [m]; particles of a fluid. measure (k,): length, area or volume that
    a node stands for, so that mass = measure times linear_density, areal_density or density. radius (k,): contact
    radius [m]. segments (m, 2): of a rope. triangles (t, 3): of a cloth, or of a soft body's surface,
    counter-clockwise seen from outside. tetrahedra (q, 4).
    """

    nodes: Array
    measure: Array
    radius: Array
    segments: Ints = field(default_factory=lambda: _none(2))
    triangles: Ints = field(default_factory=lambda: _none(3))
    tetrahedra: Ints = field(default_factory=lambda: _none(4))
