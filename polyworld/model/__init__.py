"""Make a world into a model: the parts that solvers, readouts and pictures work with, made once and kept.

Read `model` first, then `arrays` (rigid bodies), `mesh`, `rope`, `cloth`, `soft`; a fluid's particles are placed by
`polyworld.solver.fluid.seeding`.
"""

from __future__ import annotations

from polyworld.model.mesh import DeformableMesh
from polyworld.model.model import Model, mesh_of, model_of

__all__ = ["DeformableMesh", "Model", "mesh_of", "model_of"]
