"""W variants of a world's fluids, advanced by coupling steps together with its rigid bodies and nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.meshing.fluid import fluid_particles
from polyworld.representations.fluid import Fluid
from polyworld.solver.coupled.nodes import Clock, Fields, Nodes, parameter_row
from polyworld.solver.fluid import covering, drift, layout, motion, pressure, surface, transfer, viscosity
from polyworld.solver.fluid.scene import build_grid, build_solids
from polyworld.solver.spatial.layout import Body
from polyworld.world import World

Array = NDArray[np.float64]

FLIP = 0.0
FLUID_PARAMETERS = ("density", "viscosity", "surface_tension")


class FluidSolver:
    """The fluids of a world in `n_worlds` variants over at most `horizon` seconds."""

    def __init__(self, world: World, n_worlds: int, horizon: float) -> None:
        self.world, self.n_worlds, self.horizon = world, n_worlds, horizon
        self.fluids: tuple[Fluid, ...] = tuple(d for d in world.deformables if isinstance(d, Fluid))
        self.names = tuple(f.name for f in self.fluids)
        self.grid = build_grid(world)
        self.solids, self._meshes = build_solids(world)
        self._seeds = [fluid_particles(world, f) for f in self.fluids]
        self._allocate()
        self._bodies: Any = _zeros((n_worlds, max(len(world.objects), 1)), Body)
        self._nodes: Nodes | None = None
        wp.launch(
            covering.cover_by_statics, dim=self.grid.cells, inputs=[self.grid, self.solids, self._fields], device="cpu"
        )
        self.write({f.name: {p: np.array([getattr(f, p)]) for p in FLUID_PARAMETERS} for f in self.fluids})
        self.reset()

    def bind(self, bodies: Any, nodes: Nodes | None = None) -> None:
        """Take part with the bodies (W, n + s) `layout.Body`, or None, and the nodes of another solver's state."""
        if bodies is not None:
            self._bodies = bodies
        self._nodes = nodes

    def write(self, fields: Fields) -> None:
        """Parameter values: fluid or emitter -> parameter -> (1,) or (W,)."""
        names = self.names
        for name in FLUID_PARAMETERS:
            setattr(self._liquids, name, parameter_row(fields, names, name))

    def reset(self) -> None:
        """Back to the initial state."""
        p = self._particles
        x = np.concatenate([s.nodes for s in self._seeds])
        count = len(x)
        p.x.numpy()[:, :count] = x
        p.v.numpy()[:, :count] = np.concatenate(
            [np.tile(f.velocity, (len(s.nodes), 1)) for f, s in zip(self.fluids, self._seeds, strict=True)]
        )
        p.gradient.zero_()
        p.fluid.fill_(-1)
        p.fluid.numpy()[:, :count] = np.repeat(np.arange(len(self.fluids)), [len(s.nodes) for s in self._seeds])
        p.used.fill_(count)
        self._fields.pressure.zero_()

    def step(self, clock: Clock) -> None:
        """Advance by clock.h; bodies and nodes take the fluid's impulses."""
        self._liquids.gravity = clock.gravity
        self._launch(transfer.begin_step, self._pace, clock.h)
        wp.capture_while(self._pace.go, self._substep)

    def particles(self) -> tuple[Array, Array, NDArray[np.int32]]:
        """Positions (W, P, 3), velocities (W, P, 3), nan where absent, and fluid (W, P), -1 where absent."""
        p = self._particles
        fluid = p.fluid.numpy().copy()
        x, v = p.x.numpy().copy(), p.v.numpy().copy()
        x[fluid < 0], v[fluid < 0] = np.nan, np.nan
        return x, v, fluid

    @property
    def particle_volume(self) -> float:
        """Volume of a particle [m^3]; per metre in a plane [m^2]."""
        return float(self._particles.volume)

    def _substep(self) -> None:
        g, f, s, pace, b = self.grid, self._fields, self.solids, self._pace, self._bodies
        p, q, wet, sys = self._particles, self._liquids, self._wetted, self._system
        go = self._launch
        go(transfer.choose_step, g, p, q, f, pace, b, len(self.world.objects))
        go(transfer.clear, g, f, pace)
        go(transfer.particles_to_grid, g, p, q, f, pace)
        go(transfer.momentum_to_velocity, g, f, pace)
        go(covering.cover_by_bodies, g, s, f, b, pace, wet)
        go(surface.find_surface, g, f, pace)
        go(transfer.add_gravity, g, q, f, pace)
        if self._has_viscosity:
            go(viscosity.gather_viscosity, g, p, q, s, f, self._viscous, b, pace)
            go(viscosity.diffuse, g, f, self._viscous, pace)
        go(pressure.build_pressure, g, f, sys, wet, pace)
        go(pressure.solve_pressure, g, s, f, sys, wet, b, pace)
        go(pressure.push_liquid, g, f, sys, pace)
        go(pressure.push_bodies, g, s, sys, wet, b, pace)
        go(motion.continue_velocity, g, f, pace)
        go(motion.slide_along_solids, g, s, f, b, pace)
        if self._has_viscosity:
            go(viscosity.mirror_at_walls, g, s, f, self._viscous, b, pace)
        go(drift.find_shift, g, f, sys, pace)
        go(motion.move_particles, g, s, p, f, b, pace, wp.float64(FLIP))

    def _launch(self, kernel: Any, *inputs: Any) -> None:
        wp.launch(kernel, dim=self.n_worlds, inputs=list(inputs), device="cpu")

    def _allocate(self) -> None:
        w, c = self.n_worlds, self.grid.cells
        particles = max(sum(len(s.nodes) for s in self._seeds), 1)
        p = layout.Particles()
        p.x, p.v = _zeros((w, particles), wp.vec3d), _zeros((w, particles), wp.vec3d)
        p.gradient, p.fluid = _zeros((w, particles), wp.mat33d), _zeros((w, particles), wp.int32)
        p.used, p.volume = _zeros((w,), wp.int32), self.grid.volume / layout.PER_AXIS ** (3 if self.grid.thin < 0 else 2)
        f = layout.Fields()
        for name in ("velocity", "old", "mass", "bulk", "open", "shift"):
            setattr(f, name, _zeros((w, 3, c), wp.float64))
        for name in ("room", "content", "filled", "level", "pressure"):
            setattr(f, name, _zeros((w, c), wp.float64))
        f.known, f.unknown = _zeros((w, 3, c), wp.int32), _zeros((w, c), wp.int32)
        f.static_open, f.static_room = _zeros((3, c), wp.float64), _zeros((c,), wp.float64)
        f.static_distance, f.window = _zeros((c,), wp.float64), _zeros((w, 6), wp.int32)
        rows = min(c, 4 * particles + 1000)
        s = layout.System()
        s.rows = rows
        s.n, s.iterations, s.overflow = (_zeros((w,), wp.int32) for _ in range(3))
        s.cell = _zeros((w, rows + 1), wp.int32)
        s.plus, s.minus = _zeros((w, 3, rows + 1), wp.int32), _zeros((w, 3, rows + 1), wp.int32)
        s.coupling = _zeros((w, 3, rows + 1), wp.float64)
        for name in ("diagonal", "precondition", "x", "residual", "z", "search", "product"):
            setattr(s, name, _zeros((w, rows + 1), wp.float64))
        f.unknown.fill_(-1)
        self._particles, self._fields, self._system = p, f, s
        self._wetted = self._allocate_wetted()
        pace = layout.Pace()
        pace.left, pace.dt, pace.fastest = (_zeros((w,), wp.float64) for _ in range(3))
        pace.go, pace.steps = _zeros((1,), wp.int32), _zeros((w,), wp.int32)
        self._pace = pace
        self._viscous = self._allocate_viscous()
        q = layout.Liquids()
        q.slip = wp.array([int(f.slip) for f in self.fluids] or [1], dtype=wp.int32, device="cpu")
        q.gravity = wp.array([self.world.environment.gravity], dtype=wp.vec3d, device="cpu")
        self._liquids = q

    def _allocate_viscous(self) -> layout.Viscous:
        w, c = self.n_worlds, self.grid.cells
        self._has_viscosity = True
        v = layout.Viscous()
        v.amount, v.sticky = _zeros((w, c), wp.float64), _zeros((w, c), wp.float64)
        v.kind = _zeros((w, 3, c), wp.int32)
        for name in ("mass", "residual", "search", "product", "diagonal"):
            setattr(v, name, _zeros((w, 3, c), wp.float64))
        v.active, v.iterations = _zeros((w,), wp.int32), _zeros((w,), wp.int32)
        return v

    def _allocate_wetted(self) -> layout.Wetted:
        w, n = self.n_worlds, max(len(self.world.objects), 1)
        rows = self.solids.solids.numpy()[: self.solids.moving]
        capacity = 1
        for solid in rows:
            # Cells of three layers around a ball that holds the solid, three faces each.
            r = min(float(solid["bound"]), 1e3) / self.grid.cell + 2.0
            layers = 4.0 * np.pi * r**2 * 3.0 if self.grid.thin < 0 else 2.0 * np.pi * r * 3.0
            capacity += int(min(layers, self.grid.cells) * 3)
        wet = layout.Wetted()
        wet.capacity = capacity
        wet.count = _zeros((w,), wp.int32)
        for name in ("lower", "upper", "body", "axis", "face"):
            setattr(wet, name, _zeros((w, capacity), wp.int32))
        wet.cover, wet.arm = _zeros((w, capacity), wp.float64), _zeros((w, capacity), wp.vec3d)
        for name in ("force", "torque", "push", "turn"):
            setattr(wet, name, _zeros((w, n), wp.vec3d))
        return wet


def _zeros(shape: tuple[int, ...], dtype: Any) -> Any:
    return wp.zeros(shape, dtype=dtype, device="cpu")
