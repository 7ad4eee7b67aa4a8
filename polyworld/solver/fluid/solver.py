"""W variants of a world's fluids, advanced by coupling steps together with its rigid bodies and nodes."""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.solver.coupled.nodes import Clock, Fields, Nodes
from polyworld.solver.fluid import covering, pressure, step, storage
from polyworld.solver.fluid.sampling import build_samples
from polyworld.solver.fluid.scene import build_grid, build_solids
from polyworld.solver.fluid.seeding import fluid_particles
from polyworld.solver.fluid.supply import build_sources, particles_needed
from polyworld.solver.spatial.layout import Body
from polyworld.world import World
from polyworld.world.representations.fluid import Fluid

Array = NDArray[np.float64]

# Viscosity times step over density and cell^2: below this in all worlds nobody needs the kernels of viscosity, which
# themselves pass over a world that is below twice this.
INVISCID = 5e-6
FLUID_PARAMETERS = ("density", "viscosity", "surface_tension")


class FluidSolver:
    """The fluids of a world in `n_worlds` variants over at most `horizon` seconds.

    A coupling step is `apply_prediction` before the rigid step (so that joints and contacts resist the fluid's push),
    the rigid step, then `step`. Both are launches of kernels alone and may be captured in a graph.
    """

    def __init__(self, world: World, n_worlds: int, horizon: float) -> None:
        """Raises ValueError for a plane across the axes, and for more particles than fit."""
        self.world, self.n_worlds, self.horizon = world, n_worlds, horizon
        self.fluids: tuple[Fluid, ...] = world.of_form("liquid")
        self.names = tuple(f.name for f in self.fluids)
        self.grid = g = build_grid(world)
        self.solids, self._meshes = build_solids(world)
        self._seeds = [fluid_particles(world, f) for f in self.fluids]
        self._rates = {e.name: e.rate for e in world.emitters}
        w = n_worlds
        self.records = storage.Records(
            grid=g,
            solids=self.solids,
            particles=storage.particle_arrays(g, w, 1),
            liquids=_liquids(self.fluids),
            fields=storage.field_arrays(g, w),
            system=storage.system_arrays(g, w),
            wetted=storage.wetted_arrays(self.solids, w, storage.faces_at_first(g, self.solids)),
            viscosity=storage.viscous_arrays(g, w),
            tension=storage.tension_arrays(g, w, False),
            pace=storage.pace_arrays(w),
            sources=build_sources(world, self.names, w, g.thin),
            bodies=storage.zeros((w, max(len(world.objects), 1)), Body),
        )
        buffers.launch(covering.cover_by_statics, g.cells, [g, self.solids, self.records.fields])
        self.write({})
        self.reset()

    def bind(self, bodies: Any, nodes: Nodes | None = None, first: dict[str, int] | None = None) -> None:
        """Take part with bodies (W, n + s) `spatial.layout.Body` (None where there are none) and nodes, in place.

        first: the row of each object's first node.
        """
        if bodies is not None:
            self.records.bodies = bodies
        if nodes is not None and first:
            self.records.nodes = nodes
            self.records.samples = build_samples(self.world, first, self.n_worlds, self.grid.cells, self.grid.thin)

    def write(self, fields: Fields) -> bool:
        """Take values (1,) or (W,): fluid -> density, viscosity, surface_tension; emitter -> rate; else the world's.

        Returns True where arrays were reallocated, so that a captured graph must be captured again.
        """
        r = self.records
        recapture = False
        for parameter in FLUID_PARAMETERS:
            rows = [fields.get(f.name, {}).get(parameter, np.array([getattr(f, parameter)])) for f in self.fluids]
            recapture |= _write(r.liquids, parameter, rows)
        rates = [fields.get(e.name, {}).get("rate", np.array([e.rate])) for e in self.world.emitters]
        if rates:
            recapture |= _write(r.sources, "rate", rates)
        self._rates = {e.name: float(np.max(rate)) for e, rate in zip(self.world.emitters, rates, strict=True)}
        seeded = sum(len(s.nodes) for s in self._seeds)
        needed = particles_needed(self.world, seeded, self._rates, self.particle_volume, self.horizon)
        if needed > r.particles.x.shape[1]:
            r.particles = storage.particle_arrays(self.grid, self.n_worlds, needed)
            self.reset()
            recapture = True
        thickest = float((buffers.read(r.liquids.viscosity) / buffers.read(r.liquids.density)).max(initial=0.0))
        viscous = self.world.time.substep * thickest / float(self.grid.cell) ** 2 > INVISCID
        tense = bool((buffers.read(r.liquids.surface_tension) > 0.0).any())
        recapture |= (viscous, tense) != (r.viscous, r.tense)
        if tense != r.tense:
            r.tension = storage.tension_arrays(self.grid, self.n_worlds, tense)
        r.viscous, r.tense = viscous, tense
        return recapture

    def reset(self) -> None:
        """Back to the initial state."""
        p = self.records.particles
        counts = [len(s.nodes) for s in self._seeds]
        seeded = sum(counts)
        if p.x.shape[1] < seeded:
            return  # the first `write` makes room
        buffers.fill(p.fluid, -1)
        buffers.clear(p.gradient)
        if seeded:
            buffers.write(p.x, np.concatenate([s.nodes for s in self._seeds]), np.s_[:, :seeded])
            v = np.repeat(np.array([f.velocity for f in self.fluids]), counts, axis=0)
            if self.grid.thin >= 0:
                v[:, self.grid.thin] = 0.0
            buffers.write(p.v, v, np.s_[:, :seeded])
            buffers.write(p.fluid, np.repeat(np.arange(len(counts)), counts), np.s_[:, :seeded])
        buffers.fill(p.used, seeded)
        buffers.fill(p.free, seeded)
        buffers.clear(self.records.fields.pressure)
        buffers.fill(self.records.pace.diverged, -1)
        buffers.clear(self.records.pace.halted)
        wet, s = self.records.wetted, self.records.sources
        arrays: list[Any] = [
            wet.forecast,
            wet.forecast_torque,
            wet.before,
            wet.torque_before,
            wet.predicted_push,
            wet.predicted_spin,
            wet.full,
            self.records.system.overflow,
        ]
        arrays += [s.due, s.allowed, s.emitted, s.drained, s.full]
        for array in arrays:
            buffers.clear(array)

    def enlarge(self) -> bool:
        """Double the room for faces that bodies cover where there was too little: return whether it was.

        The arrays are others then, and the run is to begin again.
        """
        wetted = self.records.wetted
        if not buffers.read(wetted.full).any():
            return False
        self.records.wetted = storage.wetted_arrays(self.solids, self.n_worlds, 2 * int(wetted.capacity))
        return True

    def apply_prediction(self, clock: Clock) -> None:
        """Before the rigid step, apply the fluid's last impulse to bodies as a prediction, which `step` removes.

        Joints and contacts then bear the weight of the fluid. Without it a light body held under a heavy fluid
        gives way.
        """
        step.apply_prediction(self.records, clock)

    def step(self, clock: Clock) -> None:
        """Advance by clock.h, in sub-steps; bodies and nodes take the fluid's impulses."""
        step.advance(self.records, clock)

    def halt(self) -> None:
        """End a step that another thread runs; its result is of no use, and `reset` has to follow."""
        buffers.write(self.records.pace.halted, 1)

    def particles(self) -> tuple[Array, Array, NDArray[np.int32]]:
        """Positions (W, P, 3), velocities (W, P, 3), nan where absent, and fluid (W, P), -1 where absent."""
        p = self.records.particles
        fluid = buffers.read(p.fluid).copy()
        x, v = buffers.read(p.x).copy(), buffers.read(p.v).copy()
        x[fluid < 0], v[fluid < 0] = np.nan, np.nan
        return x, v, fluid

    def amount(self, lower: Array, upper: Array) -> Array:
        """Volume (W, F) of each fluid inside a box [m^3]; per metre of thickness in a plane [m^2]."""
        x, _, fluid = self.particles()
        low, high = np.array(lower, dtype=float), np.array(upper, dtype=float)
        if self.grid.thin >= 0:
            low[self.grid.thin], high[self.grid.thin] = -np.inf, np.inf
        inside = ((x >= low) & (x <= high)).all(axis=2)
        counts = [(inside & (fluid == f)).sum(axis=1) for f in range(len(self.fluids))]
        return np.stack(counts, axis=1) * self.particle_volume

    def flow(self) -> dict[str, Array]:
        """Volume (W,) that each emitter has sent, and each drain has taken, so far [m^3]; [m^2] in a plane."""
        sent = buffers.read(self.records.sources.emitted) * self.particle_volume
        taken = buffers.read(self.records.sources.drained) * self.particle_volume
        flows = {e.name: sent[:, i].copy() for i, e in enumerate(self.world.emitters)}
        flows.update({d.name: taken[:, i].copy() for i, d in enumerate(self.world.drains)})
        return flows

    def pressure_at(self, points: Array) -> Array:
        """Pressure (W, k) above the air's at points (k, 3) [Pa], linear between the centres of cells."""
        return self._read(self.records.fields.pressure, points)

    def level_at(self, points: Array) -> Array:
        """Signed distance (W, k) of points (k, 3) from the free surface, negative in the liquid [m].

        As the last sub-step began, linear between the centres of cells, at most one cell either way.
        """
        return self._read(self.records.fields.level, points)

    def _read(self, rows: Any, points: Array) -> Array:
        out = storage.zeros((self.n_worlds, len(points)), wp.float64)
        at: Any = buffers.array(np.ascontiguousarray(points, dtype=float), wp.vec3d)
        buffers.launch(pressure.read_cells, out.shape, [self.grid, rows, at, out])
        result: Array = buffers.read(out)
        return result

    @property
    def particle_volume(self) -> float:
        """Volume of a particle [m^3]; per metre in a plane [m^2]."""
        return float(self.records.particles.volume)

    @property
    def substeps(self) -> NDArray[np.int32]:
        """Sub-steps (W,) that the last coupling step took."""
        result: NDArray[np.int32] = buffers.read(self.records.pace.steps)
        return result

    @property
    def diverged(self) -> Any:
        """Warp array (W,) int32: the first particle that was not a number or too fast, -1 for none; its world stops."""
        return self.records.pace.diverged

    @property
    def particles_at_most(self) -> int:
        """Particles that a world has room for."""
        return int(self.records.particles.x.shape[1])

    @property
    def full(self) -> NDArray[np.bool_]:
        """Worlds (W,) in which an emitter found no room for a particle."""
        result: NDArray[np.bool_] = buffers.read(self.records.sources.full) > 0
        return result


def _liquids(fluids: tuple[Fluid, ...]) -> Any:
    from polyworld.solver.fluid.layout import Liquids

    q = Liquids()
    q.slip = buffers.array([int(f.slip) for f in fluids], wp.int32)
    for name in FLUID_PARAMETERS:
        setattr(q, name, storage.zeros((0, 0), wp.float64))
    return q


def _write(holder: Any, name: str, columns: list[Array]) -> bool:
    """Write columns of (1,) or (W,) values as (R, n) in place; return True where the array was reallocated."""
    rows = max(len(np.atleast_1d(c)) for c in columns)
    values = np.stack([np.broadcast_to(c, (rows,)) for c in columns], axis=1)
    kept = getattr(holder, name)
    if tuple(kept.shape) == values.shape:
        buffers.write(kept, values)
        return False
    setattr(holder, name, buffers.array(np.ascontiguousarray(values, dtype=float), wp.float64))
    return True
