"""Points of ropes, cloth and soft bodies that stand for their volume in the fluid's grid."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import DeformableMesh, mesh_of
from polyworld.solver.fluid.immersed import LINE, SHEET, SOFT, Samples
from polyworld.solver.fluid.layout import PER_AXIS
from polyworld.world import World
from polyworld.world.materials import material_of
from polyworld.world.representations.soft import Soft

Array = NDArray[np.float64]

CYLINDER_DRAG = 1.2  # across a line, on its diameter: circular cylinder at Re 1e3 to 1e5 (Hoerner 1965)
CYLINDER_FRICTION = 0.02  # along a line, on its diameter
SEALED = -1.0
FINER = 1.5  # samples of soft bodies lie less evenly than particles: so many times closer


class _Rows:
    """Samples that grow object by object."""

    def __init__(self) -> None:
        self.node: list[NDArray[np.int32]] = []
        self.weight: list[Array] = []
        self.part: list[Array] = []
        self.volume: list[Array] = []
        self.area: list[Array] = []
        self.along: list[Array] = []
        self.across: list[Array] = []
        self.object: list[NDArray[np.int32]] = []
        self.kind: list[int] = []
        self.share: list[float] = []

    def add(
        self,
        first: int,
        elements: NDArray[np.int32],
        counts: NDArray[np.int64],
        measure: Array,
        mass: Array,
        kind: int,
        *,
        volume: float,
        area: float,
        along: float,
        across: float,
        share: float,
    ) -> None:
        """Samples of one object: counts (m,) in each element, of whose measure volume and area are multiples.

        mass (k,): measure that each of its nodes stands for.
        """
        corners = elements.shape[1]
        which = np.repeat(np.arange(len(elements)), counts)
        index = np.arange(len(which)) - np.repeat(np.cumsum(counts) - counts, counts)
        weights = np.zeros((len(which), 4))
        weights[:, :corners] = _spread(index, counts[which], corners)
        nodes = np.zeros((len(which), 4), dtype=np.int32)
        nodes[:, :corners] = elements[which]
        each = measure[which] / counts[which]
        held = np.zeros(len(mass))
        np.add.at(held, nodes, weights * each[:, None])
        self.part.append(weights * each[:, None] / np.where(held > 0, held, 1.0)[nodes])
        self.node.append(nodes + first)
        self.weight.append(weights)
        self.volume.append(each * volume / share)
        self.area.append(each * area / share)
        self.along.append(np.full(len(which), along))
        self.across.append(np.full(len(which), across))
        self.object.append(np.full(len(which), len(self.kind), dtype=np.int32))
        self.kind.append(kind)
        self.share.append(share)


def _spread(index: NDArray[np.int64], counts: NDArray[np.int64], corners: int) -> Array:
    """Barycentric coordinates (m, corners) of the index-th of `counts` points spread over an element."""
    if corners == 2:
        t = (index + 0.5) / counts
        return np.stack([1.0 - t, t], axis=1)
    # Points of an additive sequence, sorted into the simplex: gaps of sorted uniform numbers.
    root = 1.324717957244746 if corners == 3 else 1.2207440846057596
    steps = np.array([root ** -(i + 1) for i in range(corners - 1)])
    u = np.sort(np.mod(0.5 + index[:, None] * steps, 1.0), axis=1)
    weights = np.diff(np.concatenate([np.zeros((len(u), 1)), u, np.ones((len(u), 1))], axis=1), axis=1)
    # Points of one element have their own centroid as mean, so that momentum has the right arm.
    weights[counts == 1] = 1.0 / corners
    result: Array = weights
    return result


def build_samples(world: World, first: dict[str, int], n_worlds: int, cells: int, thin: int) -> Samples | None:
    """Samples of all ropes, cloths and soft bodies, None where there are none. first: their first nodes."""
    rows = _Rows()
    box = world.fluid_grid
    assert box is not None
    spacing = box.cell / PER_AXIS
    for item in world.of_form("line", "sheet", "solid"):
        mesh, form = mesh_of(world, item), material_of(item).form
        if form == "solid":
            _add_soft(rows, item, mesh, first[item.name], spacing, thin)
        elif form == "sheet":
            areas = _triangle_areas(mesh.nodes[mesh.triangles])
            counts = np.maximum(np.rint(areas / spacing**2).astype(int), 1)
            rows.add(
                first[item.name],
                mesh.triangles,
                counts,
                areas,
                mesh.measure,
                SHEET,
                volume=item.thickness,
                area=1.0,
                along=item.drag_tangential,
                across=SEALED,
                share=1.0,
            )
        else:
            ends = mesh.nodes[mesh.segments]
            lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
            rows.add(
                first[item.name],
                mesh.segments,
                np.maximum(np.ceil(lengths / spacing).astype(int), 1),
                lengths,
                mesh.measure,
                LINE,
                volume=float(np.pi * item.radius**2),
                area=2.0 * item.radius,
                along=CYLINDER_FRICTION,
                across=CYLINDER_DRAG,
                share=1.0,
            )
    return _samples(rows, n_worlds, cells) if rows.kind else None


def _add_soft(rows: _Rows, item: Soft, mesh: DeformableMesh, first: int, spacing: float, thin: int) -> None:
    if thin >= 0:
        elements, share = mesh.triangles, item.thickness
        measure = _triangle_areas(mesh.nodes[elements]) * share
        counts = measure / share / (spacing / FINER) ** 2
    else:
        elements, share = mesh.tetrahedra, 1.0
        p = mesh.nodes[elements]
        measure = np.abs(np.linalg.det(p[:, 1:] - p[:, :1])) / 6.0
        counts = measure / (spacing / FINER) ** 3
    rows.add(
        first,
        elements,
        np.maximum(np.rint(counts).astype(int), 1),
        measure,
        mesh.measure,
        SOFT,
        volume=1.0,
        area=0.0,
        along=0.0,
        across=0.0,
        share=share,
    )


def _triangle_areas(corners: Array) -> Array:
    areas: Array = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    return areas


def _samples(rows: _Rows, n_worlds: int, cells: int) -> Samples:
    s = Samples()
    s.node = _array(rows.node, wp.int32)
    for name in ("weight", "part", "volume", "area", "along", "across"):
        setattr(s, name, _array(getattr(rows, name), wp.float64))
    objects = np.concatenate(rows.object)
    s.object = buffers.array(objects, wp.int32)
    ends = np.cumsum([len(o) for o in rows.object])
    s.first = buffers.array(np.concatenate([[0], ends[:-1]]), wp.int32)
    s.last = buffers.array(ends, wp.int32)
    s.kind = buffers.array(rows.kind, wp.int32)
    s.share = buffers.array(rows.share, wp.float64)
    s.wet = buffers.zeros((n_worlds, len(rows.kind)), wp.int32)
    soft = SOFT in rows.kind
    shape = (n_worlds, 3, cells) if soft else (1, 3, 1)
    s.solid_mass = buffers.zeros(shape, wp.float64)
    s.solid_momentum = buffers.zeros(shape, wp.float64)
    return s


def _array(parts: list[Any], dtype: Any) -> Any:
    return buffers.array(np.ascontiguousarray(np.concatenate(parts)), dtype)
