"""The cloth of W worlds: its parameters, state, and the launches of its kernels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.model import mesh_of
from polyworld.model.mesh import DeformableMesh
from polyworld.solver.cloth import bending, damping, forces
from polyworld.solver.cloth.damping import stages_for
from polyworld.solver.cloth.geometry import ClothGeometry, cloth_geometry
from polyworld.solver.cloth.layout import BLOCK, Bending, Damping, Material, Surface
from polyworld.solver.cloth.readout import cloth_quantities
from polyworld.solver.cloth.stability import EDGES, ClothFrequencies, director_square, stable_step
from polyworld.solver.coupled.attachment_targets import held_nodes
from polyworld.solver.coupled.needs import Need
from polyworld.solver.coupled.nodes import Clock, Fields, Nodes
from polyworld.world import World
from polyworld.world.representations.cloth import Cloth

Array = NDArray[np.float64]

PARAMETERS = (
    "areal_density",
    "stretch_stiffness",
    "poisson_ratio",
    "shear_stiffness",
    "bending_stiffness",
    "stretch_damping",
    "bending_damping",
    "drag_normal",
    "drag_tangential",
)


class ClothStage:
    """See `polyworld.solver.coupled.stage.MaterialStage`. The forces of an inner step are launched once in it."""

    def __init__(self, world: World, items: Sequence[Cloth], nodes_first: dict[str, int], n_worlds: int) -> None:
        self._names = tuple(item.name for item in items)
        self._air_density = world.environment.air_density
        self._first = {name: nodes_first[name] for name in self._names}
        self._geometry = {item.name: cloth_geometry(item, mesh_of(world, item)) for item in items}
        self._frequencies = {name: ClothFrequencies(g) for name, g in self._geometry.items()}
        parts = list(self._geometry.values())
        self._triangles = sum(len(g.corners) for g in parts)
        self._edges = sum(len(g.ends) for g in parts)
        self._surface = _surface(parts, list(self._first.values()))
        fixed = np.concatenate([_fixed(world, item.name, g) for item, g in zip(items, parts, strict=True)])
        self._surface.fixed = buffers.array(fixed, wp.int32)
        self._surface.wind = wp.vec3d(*world.environment.wind)
        self._bending = _bending(n_worlds, self._triangles, self._edges)
        self._damping = _damping(n_worlds, parts, list(self._first.values()))
        self._stages = 0  # that are launched: as many as any world has needed so far
        self._n_worlds = n_worlds
        # One row a world even where all are equal: the kernels need not ask.
        self._surface.materials = buffers.zeros((n_worlds, len(items)), Material)
        self._rows: list[dict[str, Array]] = []
        self._step: Array = np.full(1, np.inf)
        self.write({item.name: {p: np.array([_given(getattr(item, p))]) for p in PARAMETERS} for item in items})

    def bind(self, bodies: Any) -> None:
        """Cloth meets bodies through contacts alone."""

    def write(self, fields: Fields) -> bool:
        """See MaterialStage. A shear stiffness of NaN is that of an isotropic sheet."""
        given = [{p: np.atleast_1d(fields[name][p]).astype(float) for p in PARAMETERS} for name in self._names]
        count = max(len(v) for row in given for v in row.values())
        self._rows = [{p: np.broadcast_to(v, (count,)) for p, v in row.items()} for row in given]
        values = np.zeros((self._n_worlds, len(self._names)), dtype=Material.numpy_dtype())
        steps = np.full((count, len(self._names)), np.inf)
        rates = np.zeros((count, len(self._names)))
        for o, (name, row) in enumerate(zip(self._names, self._rows, strict=True)):
            steps[:, o], rates[:, o] = self._material(values[:, o], self._frequencies[name], row)
        self._step = steps.min(axis=1)
        self._steps = steps.min(axis=0)
        buffers.write(self._surface.materials, values)
        buffers.write(self._damping.stages, stages_for(self._step * rates.max(axis=1)))
        launched, self._stages = self._stages, max(self._stages, int(buffers.read(self._damping.stages).max()))
        return self._stages > launched

    def _material(self, out: Any, frequencies: ClothFrequencies, row: dict[str, Array]) -> tuple[Array, Array]:
        """Fill the record of one cloth in all worlds; returns its stable step and its highest rate of damping."""
        e, nu, g = row["stretch_stiffness"], row["poisson_ratio"], row["shear_stiffness"]
        g = np.where(np.isnan(g), e / (2.0 * (1.0 + nu)), g)
        density, plate = row["areal_density"], row["bending_stiffness"]
        ratios = np.stack([nu, g / e], axis=1)
        membrane = np.array([frequencies.membrane(*ratio) for ratio in ratios.tolist()]) * e / density
        bends = frequencies.bending * (1.0 + np.abs(nu)) * plate / density
        directors = np.where(plate > 0, director_square(membrane, bends, row["bending_damping"]), 0.0)
        out["stretch"] = e / (1.0 - nu**2)
        out["cross"] = out["stretch"] * nu
        out["shear"] = 2.0 * g
        out["stretch_delay"] = row["stretch_damping"]
        out["bend_delay"] = row["bending_damping"]
        out["plate"] = plate
        out["poisson"] = nu
        out["director"] = directors / (EDGES * np.where(plate > 0, plate, 1.0))
        out["inverse_density"] = 1.0 / density
        out["drag_normal"] = 0.5 * self._air_density * row["drag_normal"]
        out["drag_tangential"] = 0.5 * self._air_density * row["drag_tangential"]
        return stable_step(membrane, bends + directors, row["bending_damping"]), row["stretch_damping"] * membrane

    def reset(self) -> None:
        """Directors halfway between the normals, and at rest."""
        buffers.clear(self._bending.angle)
        buffers.clear(self._bending.rate)

    def stable_step(self) -> Array:
        """See MaterialStage."""
        return self._step

    def needs(self) -> list[Need]:
        """See MaterialStage."""
        cure = "with half the divisions, or a mesh twice as coarse, twice that and more"
        named = zip(self._names, self._steps, strict=True)
        return [Need(float(step), f"cloth {name!r}: its stretching and bending", cure) for name, step in named]

    def launch_forces(self, nodes: Nodes, clock: Clock) -> None:
        """Forces of all triangles; the directors take their step here as well."""
        surface, bend = self._surface, self._bending
        triangles, edges = (self._n_worlds, -(-self._triangles // BLOCK)), (self._n_worlds, -(-self._edges // BLOCK))
        buffers.launch(bending.find_normals, triangles, [clock, nodes, surface, bend])
        buffers.launch(bending.find_bends, edges, [clock, nodes, surface, bend])
        buffers.launch(bending.find_moments, triangles, [clock, surface, bend])
        buffers.launch(bending.turn_directors, edges, [clock, nodes, surface, bend])
        buffers.launch(forces.add_forces, triangles, [clock, nodes, surface, bend, self._damping])

    def launch_velocities(self, nodes: Nodes, clock: Clock) -> None:
        """Damping of stretch; the other forces are explicit."""
        if self._stages == 0:
            return
        surface, d = self._surface, self._damping
        triangles = (self._n_worlds, -(-self._triangles // BLOCK))
        points = (self._n_worlds, -(-d.nodes.shape[0] // BLOCK))
        buffers.launch(damping.begin_damping, points, [clock, nodes, d])
        v_in, v_out = d.last, d.other
        for stage in range(1, self._stages + 1):
            buffers.launch(damping.add_damping_forces, triangles, [stage, clock, nodes, v_in, surface, d])
            buffers.launch(damping.take_stage, points, [stage, clock, nodes, v_in, v_out, d])
            v_in, v_out = v_out, v_in
        buffers.launch(damping.end_damping, points, [clock, nodes, d])

    def launch_positions(self, nodes: Nodes, clock: Clock) -> None:
        """Nothing: the rest shape does not change."""

    def quantities(self, nodes: Nodes) -> dict[str, dict[str, Array]]:
        """See `readout.cloth_quantities`."""
        x, angle, rate = buffers.read(nodes.x), buffers.read(self._bending.angle), buffers.read(self._bending.rate)
        found: dict[str, dict[str, Array]] = {}
        edge = 0
        for name, g in self._geometry.items():
            own = x[:, self._first[name] : self._first[name] + len(g.nodes)]
            material = buffers.read(self._surface.materials)[:, len(found)]
            keep = slice(edge, edge + len(g.ends))
            found[name] = cloth_quantities(g, material, own, angle[:, keep], rate[:, keep])
            edge += len(g.ends)
        return found


def _given(value: float | None) -> float:
    return float("nan") if value is None else value


def _fixed(world: World, name: str, geometry: ClothGeometry) -> NDArray[np.int32]:
    """1 for the triangles (T,) that one attachment holds to a rigid body, all three corners and for good.

    Those held to the world are found while it runs, by the inverse mass of their nodes, so that they may be released.
    """
    fixed = np.zeros(len(geometry.corners), dtype=np.int32)
    mesh = DeformableMesh(geometry.nodes, geometry.node_area, geometry.node_area, triangles=geometry.corners)
    for attachment in world.attachments:
        lasting = attachment.release is None and attachment.strength is None
        if attachment.object == name and lasting and any(o.name == attachment.to for o in world.objects):
            fixed |= np.isin(geometry.corners, held_nodes({name: mesh}, attachment)).all(axis=1)
    return fixed


def _surface(parts: list[ClothGeometry], first: list[int]) -> Any:
    """All cloths one after the other, with nodes, edges and triangles counted through."""
    triangle = np.cumsum([0] + [len(g.corners) for g in parts])
    edge = np.cumsum([0] + [len(g.ends) for g in parts])

    def joined(columns: list[Any], dtype: Any) -> Any:
        return buffers.array(np.ascontiguousarray(np.concatenate(columns)), dtype)

    surface = Surface()
    surface.corners = joined([g.corners + n for g, n in zip(parts, first, strict=True)], wp.vec3i)
    surface.edges = joined([g.edges + 2 * int(e) for g, e in zip(parts, edge, strict=False)], wp.vec3i)
    surface.cloth = joined([np.full(len(g.corners), o, dtype=np.int32) for o, g in enumerate(parts)], wp.int32)
    surface.area = joined([g.area for g in parts], wp.float64)
    surface.inverse_rest = joined([g.inverse_rest for g in parts], wp.mat22d)
    surface.curvature = joined([g.curvature for g in parts], wp.mat33d)
    surface.rest_curvature = joined([g.rest_curvature for g in parts], wp.vec3d)
    surface.ends = joined([g.ends + n for g, n in zip(parts, first, strict=True)], wp.vec2i)
    slots = [np.where(g.slots >= 0, g.slots + 4 * int(t), -1) for g, t in zip(parts, triangle, strict=False)]
    surface.slots = joined([s.astype(np.int32) for s in slots], wp.vec2i)
    surface.softness = joined([g.softness for g in parts], wp.float64)
    return surface


def _damping(w: int, parts: list[ClothGeometry], first: list[int]) -> Any:
    points = sum(len(g.nodes) for g in parts)
    offset = np.cumsum([0] + [len(g.nodes) for g in parts])
    corners = np.concatenate([g.corners + int(o) for g, o in zip(parts, offset, strict=False)])
    own = np.concatenate([np.arange(n, n + len(g.nodes)) for g, n in zip(parts, first, strict=True)])

    def vectors(count: int) -> Any:
        return buffers.zeros((w, count), wp.vec3d)

    d = Damping()
    d.nodes = buffers.array(own.astype(np.int32), wp.int32)
    d.corners = buffers.array(np.ascontiguousarray(corners), wp.vec3i)
    d.stages = buffers.zeros((w,), wp.int32)
    d.first, d.second, d.stretch = vectors(len(corners)), vectors(len(corners)), vectors(len(corners))
    d.start, d.push, d.rate, d.last, d.other, d.force = (vectors(points) for _ in range(6))
    return d


def _bending(w: int, triangles: int, edges: int) -> Any:
    def zeros(count: int, dtype: Any) -> Any:
        return buffers.zeros((w, count), dtype)

    b = Bending()
    b.angle, b.rate = zeros(edges, wp.float64), zeros(edges, wp.float64)
    b.normal, b.spread = zeros(triangles, wp.vec3d), zeros(triangles, wp.float64)
    b.turning = zeros(triangles, wp.vec3d)
    b.bend, b.bend_rate = zeros(edges, wp.vec2d), zeros(edges, wp.vec2d)
    b.share, b.inverse_length = zeros(edges, wp.float64), zeros(edges, wp.float64)
    b.moment, b.torque = zeros(triangles, wp.vec3d), zeros(edges, wp.float64)
    return b
