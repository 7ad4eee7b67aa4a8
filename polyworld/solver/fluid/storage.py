"""Records of the fluid solver: their arrays, allocated once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from polyworld.core import buffers
from polyworld.solver.coupled.nodes import Nodes
from polyworld.solver.fluid import layout
from polyworld.solver.fluid.immersed import Samples
from polyworld.solver.fluid.sources import Sources


@dataclass
class Records:
    """All that the kernels of W worlds read and write, as `fluid.layout` describes it.

    bodies (W, n + s): the rigid solver's. nodes, samples: of ropes, cloth and soft bodies, None where there are none.
    viscous, tense: whether any fluid has viscosity or surface tension that counts.
    """

    grid: layout.Grid
    solids: layout.Solids
    particles: layout.Particles
    liquids: layout.Liquids
    fields: layout.Fields
    system: layout.System
    wetted: layout.Wetted
    viscosity: layout.Viscous
    tension: layout.Tension
    pace: layout.Pace
    sources: Sources
    bodies: Any
    nodes: Nodes | None = None
    samples: Samples | None = None
    viscous: bool = False
    tense: bool = False

    def launch_worlds(self, kernel: Any, *inputs: Any) -> None:
        """Launch a kernel with one thread a world."""
        buffers.launch(kernel, self.pace.dt.shape[0], list(inputs))

    @property
    def immersed_soft(self) -> bool:
        """Whether soft bodies share the grid's momentum."""
        return self.samples is not None and self.samples.solid_mass.shape[2] > 1


def zeros(shape: tuple[int, ...], dtype: Any) -> Any:
    """Return a Warp array of zeros on the CPU."""
    return buffers.zeros(shape, dtype)


def particle_arrays(grid: layout.Grid, worlds: int, rows: int) -> layout.Particles:
    p = layout.Particles()
    p.x, p.v = zeros((worlds, rows), wp.vec3d), zeros((worlds, rows), wp.vec3d)
    p.gradient, p.fluid = zeros((worlds, rows), wp.mat33d), zeros((worlds, rows), wp.int32)
    p.used, p.free = zeros((worlds,), wp.int32), zeros((worlds,), wp.int32)
    p.volume = grid.volume / layout.PER_AXIS ** (3 if grid.thin < 0 else 2)
    return p


def field_arrays(grid: layout.Grid, worlds: int) -> layout.Fields:
    w, c = worlds, grid.cells
    f = layout.Fields()
    for name in ("velocity", "push", "mass", "bulk", "open", "shift"):
        setattr(f, name, zeros((w, 3, c), wp.float64))
    for name in ("room", "content", "liquid", "filled", "level", "pressure"):
        setattr(f, name, zeros((w, c), wp.float64))
    f.known, f.unknown = zeros((w, 3, c), wp.int32), buffers.full((w, c), -1, wp.int32)
    f.static_open, f.static_room = zeros((3, c), wp.float64), zeros((c,), wp.float64)
    f.static_distance, f.window = zeros((c,), wp.float64), zeros((w, 6), wp.int32)
    return f


def system_arrays(grid: layout.Grid, worlds: int) -> layout.System:
    """Equations for as many cells as the box has: a few thin splashes fill many cells with few particles."""
    w = worlds
    rows = int(np.prod(np.array(list(grid.upper)) - np.array(list(grid.lower))))
    s = layout.System()
    s.rows = rows
    s.n, s.iterations, s.overflow = (zeros((w,), wp.int32) for _ in range(3))
    s.cell = zeros((w, rows + 1), wp.int32)
    s.plus, s.minus = zeros((w, 3, rows + 1), wp.int32), zeros((w, 3, rows + 1), wp.int32)
    s.coupling = zeros((w, 3, rows + 1), wp.float64)
    for name in ("diagonal", "precondition", "x", "residual", "z", "search", "product"):
        setattr(s, name, zeros((w, rows + 1), wp.float64))
    return s


def faces_at_first(grid: layout.Grid, solids: layout.Solids) -> int:
    """Return how many faces bodies have room to cover: three layers of cells around a ball that holds each solid."""
    capacity = 1
    for solid in buffers.read(solids.solids)[: solids.moving]:
        r = min(float(solid["bound"]), 1e3) / grid.cell + 2.0
        layers = 4.0 * np.pi * r**2 * 4.0 if grid.thin < 0 else 2.0 * np.pi * r * 4.0
        capacity += int(min(layers, grid.cells) * 3)
    return capacity


def wetted_arrays(solids: layout.Solids, worlds: int, capacity: int) -> layout.Wetted:
    """Room for `capacity` faces that bodies cover."""
    w, n = worlds, max(solids.bodies, 1)
    wet = layout.Wetted()
    wet.capacity = capacity
    wet.found, wet.count, wet.full = (zeros((w,), wp.int32) for _ in range(3))
    for name in ("lower", "upper", "body", "axis", "face", "touching", "beside"):
        setattr(wet, name, zeros((w, capacity), wp.int32))
    wet.cover, wet.through = zeros((w, capacity), wp.float64), zeros((w, capacity), wp.float64)
    wet.arm = zeros((w, capacity), wp.vec3d)
    by_body = ("force", "torque", "push", "spin", "predicted_push", "predicted_spin")
    for name in (*by_body, "forecast", "forecast_torque", "before", "torque_before"):
        setattr(wet, name, zeros((w, n), wp.vec3d))
    return wet


def viscous_arrays(grid: layout.Grid, worlds: int) -> layout.Viscous:
    w, c = worlds, grid.cells
    v, r = layout.Viscous(), layout.Resistance()
    r.amount, r.sticky = zeros((w, c), wp.float64), zeros((w, c), wp.float64)
    r.kind, v.row = zeros((w, 3, c), wp.int32), zeros((w, 3, c), wp.int32)
    v.resistance = r
    for name in ("mass", "diagonal", "x", "residual", "z", "search", "product"):
        setattr(v, name, zeros((w, 3 * c), wp.float64))
    v.n, v.walls, v.active, v.iterations = (zeros((w,), wp.int32) for _ in range(4))
    v.reach = zeros((w,), wp.float64)
    return v


def tension_arrays(grid: layout.Grid, worlds: int, tense: bool) -> layout.Tension:
    w, c = (worlds, grid.cells) if tense else (1, 1)
    t = layout.Tension()
    for name in ("jump", "smooth", "other", "strength"):
        setattr(t, name, zeros((w, c), wp.float64))
    t.normal = zeros((w, 3, c), wp.float64)
    return t


def pace_arrays(worlds: int) -> layout.Pace:
    p = layout.Pace()
    p.left, p.dt, p.fastest, p.whole = (zeros((worlds,), wp.float64) for _ in range(4))
    p.given, p.gained = zeros((worlds,), wp.vec3d), zeros((worlds,), wp.vec3d)
    p.touching = zeros((worlds,), wp.int32)
    p.diverged = buffers.full((worlds,), -1, wp.int32)
    p.go, p.halted = zeros((1,), wp.int32), zeros((1,), wp.int32)
    p.steps, p.present, p.lost = (zeros((worlds,), wp.int32) for _ in range(3))
    return p
