"""The elements of all solid soft bodies, and of all slices, as arrays for the kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model.soft import soft_form
from polyworld.model.soft_elements import QuadraticMesh
from polyworld.solver.soft import readout, slices, solids, solids_plastic, solids_viscous
from polyworld.world import World
from polyworld.world.representations.soft import Soft

Array = NDArray[np.float64]


class Kind:
    """Elements of one kind. forms: those bodies' meshes by name; count: elements; undo, strain (W, count, points):
    inverse of the plastic deformation and equivalent plastic strain at each point, None until something may flow."""

    elements: Any
    elastic_forces: Any
    viscous_forces: Any
    plastic_forces: Any
    read: Any
    points: int

    def __init__(self, world: World, items: Sequence[Soft], first: dict[str, int], *, planar: bool) -> None:
        chosen = {k: item for k, item in enumerate(items) if (item.representation == "soft_planar") == planar}
        self.forms: dict[str, QuadraticMesh] = {item.name: soft_form(world, item) for item in chosen.values()}
        self.spans: dict[str, slice] = {}
        self.count = 0
        for name, form in self.forms.items():
            self.spans[name] = slice(self.count, self.count + len(form.elements))
            self.count += len(form.elements)
        self._first = first
        self._columns = tuple(chosen)
        self.undo: Any = None
        self.strain: Any = None
        self._none: Any = None
        self._readings: Any = None

    def fill(self, record: Any) -> None:
        """Write the bodies' meshes into a record of the kernels."""
        nodes, body, slopes, volume = [], [], [], []
        for k, (name, form) in zip(self._columns, self.forms.items(), strict=True):
            gradient, weight = form.gradients()
            nodes.append(form.elements + self._first[name])
            body.append(np.full(len(form.elements), k))
            rows = np.zeros((*weight.shape, 3, 3))
            rows[:, :, : form.corners - 1] = gradient[:, :, 1:]
            slopes.append(rows)
            volume.append(weight)
        record.nodes = buffers.array(np.concatenate(nodes), wp.int32)
        record.body = buffers.array(np.concatenate(body), wp.int32)
        record.slopes = buffers.array(np.concatenate(slopes), wp.mat33d)
        record.volume = buffers.array(np.concatenate(volume), wp.float64)
        self.elements = record
        self._none = buffers.array(np.tile(np.eye(3), (1, 1, self.points, 1, 1)), wp.mat33d)

    def allow_flow(self, worlds: int) -> bool:
        """Make room for plastic deformation; True where there was none."""
        if self.undo is not None:
            return False
        self.undo = buffers.zeros((worlds, self.count, self.points), wp.mat33d)
        self.strain = buffers.zeros((worlds, self.count, self.points), wp.float64)
        self.reset()
        return True

    def reset(self) -> None:
        """Nothing has flowed yet."""
        if self.undo is not None:
            buffers.write(self.undo, np.eye(3))
            buffers.write(self.strain, 0.0)

    def quantities(self, x: Any, laws: Any, *, flows: bool) -> dict[str, dict[str, Array]]:
        """Compute readings of each body at positions x (W, N)."""
        worlds = x.shape[0]
        if self._readings is None:
            self._readings = readout.Readings()
            for name in ("stress", "strain", "volume"):
                setattr(self._readings, name, buffers.zeros((worlds, self.count), wp.float64))
        out = self._readings
        for values in (out.stress, out.strain, out.volume):
            buffers.clear(values)
        undo = self.undo if flows else self._none
        buffers.launch(self.read, (worlds, self.count), [self.elements, laws, x, undo, out])
        found = {}
        for name, span in self.spans.items():
            found[name] = {
                "von_mises": buffers.read(out.stress)[:, span].copy(),
                "strain": buffers.read(out.strain)[:, span].copy(),
                "volume": buffers.read(out.volume)[:, span].sum(axis=1, keepdims=True),
            }
            if flows:
                found[name]["plastic_strain"] = buffers.read(self.strain)[:, span].mean(axis=2)
        return found


class SolidKind(Kind):
    """Quadratic tetrahedra."""

    points = 4
    elastic_forces = solids.elastic_forces
    viscous_forces = solids_viscous.viscous_forces
    plastic_forces = solids_plastic.plastic_forces
    read = readout.read_solids

    def __init__(self, world: World, items: Sequence[Soft], first: dict[str, int]) -> None:
        super().__init__(world, items, first, planar=False)
        if self.count:
            self.fill(solids.Elements())


class SliceKind(Kind):
    """Quadratic triangles in the motion plane."""

    points = 3
    elastic_forces = slices.elastic_forces
    viscous_forces = slices.viscous_forces
    plastic_forces = slices.plastic_forces
    read = readout.read_slices

    def __init__(self, world: World, items: Sequence[Soft], first: dict[str, int]) -> None:
        super().__init__(world, items, first, planar=True)
        if self.count:
            record = slices.Slices()
            normal = np.asarray(world.environment.motion_plane.normal, dtype=float)
            record.normal = wp.vec3d(*(normal / np.linalg.norm(normal)))
            self.fill(record)
