"""Soft bodies in the coupled solver: what is allocated, and the order of launches."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.meshing.soft import soft_form
from polyworld.meshing.soft_elements import QuadraticMesh
from polyworld.representations.soft import Soft
from polyworld.solver.coupled.nodes import Clock, Fields, Nodes
from polyworld.solver.soft import solids
from polyworld.solver.soft.spectrum import highest_square_frequency
from polyworld.world import World

Array = NDArray[np.float64]

# Share of the critical step of the undeformed mesh: a deformed one is stiffer, at most about (1 / SAFETY)^2 times.
SAFETY = 0.6


class SoftStage:
    """Elastic, viscous and plastic forces of the soft bodies of W worlds; see `MaterialStage`."""

    def __init__(self, world: World, items: tuple[Soft, ...], nodes_first: dict[str, int], n_worlds: int) -> None:
        self.names = tuple(item.name for item in items)
        self.n_worlds = n_worlds
        self._forms = tuple(soft_form(world, item) for item in items)
        self._first = tuple(nodes_first[name] for name in self.names)
        self._parameters: Any = None
        self._fields: Fields = {}
        self._solids, self._solid_count = _elements(self._forms, self._first)

    def write(self, fields: Fields) -> bool:
        """Take parameter values: object name -> parameter -> (1,) or (W,). True where arrays were made anew."""
        self._fields = {name: {k: np.atleast_1d(v) for k, v in fields[name].items()} for name in self.names}
        rows = max((len(v) for f in self._fields.values() for v in f.values()), default=1)
        kept = self._parameters
        new = kept is None or kept.youngs_modulus.shape[0] != rows
        if new:
            kept = self._parameters = solids.Parameters()
        for parameter in ("youngs_modulus", "poisson_ratio", "damping"):
            columns = [np.broadcast_to(self._fields[name][parameter], (rows,)) for name in self.names]
            values = np.ascontiguousarray(np.stack(columns, axis=1), dtype=np.float64)
            if new:
                setattr(kept, parameter, wp.array(values, dtype=wp.float64, device="cpu"))
            else:
                getattr(kept, parameter).numpy()[:] = values
        return new

    def reset(self) -> None:
        """Back to the initial state."""

    def stable_step(self) -> Array:
        """Longest inner step (1,) or (W,) [s]."""
        steps = []
        for name, form in zip(self.names, self._forms, strict=True):
            f = self._fields[name]
            square = highest_square_frequency(form, f["youngs_modulus"], f["poisson_ratio"], f["density"])
            steps.append(SAFETY * 2.0 / np.sqrt(square))
        rows = max(len(s) for s in steps)
        step: Array = np.min([np.broadcast_to(s, (rows,)) for s in steps], axis=0)
        return step

    def launch_forces(self, nodes: Nodes, clock: Clock) -> None:
        """Add elastic forces to nodes.f."""
        if self._solid_count:
            wp.launch(
                solids.elastic_forces,
                dim=(self.n_worlds, self._solid_count),
                inputs=[self._solids, self._parameters, nodes.x, clock.dt],
                outputs=[nodes.f],
                device="cpu",
            )

    def launch_velocities(self, nodes: Nodes, clock: Clock) -> None:
        """Nothing yet."""

    def launch_positions(self, nodes: Nodes, clock: Clock) -> None:
        """Nothing: plastic flow happens with the forces."""

    def quantities(self, nodes: Nodes) -> dict[str, dict[str, Array]]:
        """Object name -> quantity -> values (W, m)."""
        return {}


def _elements(forms: tuple[QuadraticMesh, ...], first: tuple[int, ...]) -> tuple[Any, int]:
    """Tetrahedra of all solid bodies as the kernels' record, and their number."""
    nodes, body, slopes, volume = [], [], [], []
    for k, (form, start) in enumerate(zip(forms, first, strict=True)):
        if form.planar:
            continue
        gradient, weight = form.gradients()
        nodes.append(form.elements + start)
        body.append(np.full(len(form.elements), k))
        slopes.append(gradient[:, :, 1:])
        volume.append(weight)
    e = solids.Elements()
    if not nodes:
        return e, 0
    e.nodes = wp.array(np.concatenate(nodes), dtype=wp.int32, device="cpu")
    e.body = wp.array(np.concatenate(body), dtype=wp.int32, device="cpu")
    e.slopes = wp.array(np.concatenate(slopes), dtype=wp.mat33d, device="cpu")
    e.volume = wp.array(np.concatenate(volume), dtype=wp.float64, device="cpu")
    return e, sum(len(n) for n in nodes)
