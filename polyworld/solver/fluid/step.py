"""One coupling step of the fluids of W worlds, in as many sub-steps as each world needs.

Each line launches a stage of its own module: particles to grid, forces and pressure on the grid, grid to particles
(APIC).
"""

from __future__ import annotations

from typing import Any

import warp as wp

from polyworld.core import buffers
from polyworld.solver.coupled.nodes import Clock
from polyworld.solver.fluid import (
    bodies,
    covering,
    drift,
    immersed,
    motion,
    pressure,
    sources,
    surface,
    tension,
    transfer,
    viscosity,
)
from polyworld.solver.fluid.storage import Records


def apply_prediction(r: Records, clock: Clock) -> None:
    """Launch the prediction of the fluid's push on bodies, before the rigid step."""
    if r.solids.bodies:
        _worlds(r, bodies.apply_prediction, r.grid, r.solids, r.wetted, r.bodies, clock.h)


def advance(r: Records, clock: Clock) -> None:
    """Launch one coupling step of clock.h; r.pace says what is left of it."""
    r.liquids.gravity = clock.gravity
    if r.sources.emitters or r.sources.drains:
        _worlds(r, sources.emit_and_drain, r.grid, r.particles, r.sources, clock.time, clock.h)
    if r.solids.bodies:
        _worlds(r, bodies.remove_prediction, r.solids, r.wetted, r.bodies)
    _worlds(r, transfer.begin_step, r.pace, clock.h)
    wp.capture_while(r.pace.go, lambda: substep(r, clock))


def substep(r: Records, clock: Clock) -> None:
    """Launch one sub-step."""
    grid, solids, particles, liquids, fields = r.grid, r.solids, r.particles, r.liquids, r.fields
    system, wetted, pace, held = r.system, r.wetted, r.pace, r.bodies
    immersed_by = (grid, fields, r.samples, r.nodes, pace)
    _worlds(r, transfer.begin_substep, grid, fields, pace)
    _lanes(r, transfer.measure, grid, particles, fields, pace)
    _worlds(r, transfer.choose_step, grid, liquids, fields, pace, held, solids.bodies)

    # Particles to grid: momentum and volume of liquids, then of soft bodies among them.
    if r.immersed_soft:
        _worlds(r, immersed.widen_window, *immersed_by)
    _lanes(r, transfer.clear, grid, fields, pace)
    _lanes(r, transfer.particles_to_grid, grid, particles, liquids, fields, pace)
    if r.immersed_soft:
        _worlds(r, immersed.immerse_soft, *immersed_by)
    _lanes(r, transfer.momentum_to_velocity, grid, fields, pace)

    # What bounds the liquid: bodies, ropes and sheets, its free surface.
    _worlds(r, covering.cover_by_bodies, grid, solids, fields, held, pace, wetted)
    if r.samples is not None:
        _worlds(r, immersed.drag_thin, *immersed_by)
    _worlds(r, surface.find_surface, grid, fields, pace)

    # Forces: surface tension, viscosity, then the pressure that keeps the volume.
    if r.tense:
        _worlds(r, tension.find_tension, grid, particles, liquids, fields, r.tension, pace)
    if r.viscous:
        _worlds(r, viscosity.gather_viscosity, grid, particles, liquids, solids, fields, r.viscosity, held, pace)
        _worlds(r, viscosity.diffuse, grid, fields, r.viscosity, pace)
    _worlds(r, pressure.build_pressure, grid, fields, system, wetted, r.tension, int(r.tense), pace)
    _worlds(r, pressure.solve_pressure, grid, solids, fields, system, wetted, held, pace)
    _worlds(r, pressure.push_liquid, grid, fields, r.tension, int(r.tense), pace)

    # What bodies and nodes take of it.
    if solids.bodies:
        _worlds(r, bodies.push_bodies, grid, solids, system, wetted, held, clock.h, pace)
    if r.immersed_soft:
        _worlds(r, immersed.lift_soft, *immersed_by)
    if r.samples is not None:
        _worlds(r, immersed.lift_thin, *immersed_by)

    # Grid to particles, which move; what piles up is spread, and solids keep particles out.
    _worlds(r, motion.continue_velocity, grid, fields, pace)
    _worlds(r, motion.slide_along_solids, grid, solids, fields, wetted, held, pace)
    if r.viscous:
        _worlds(r, viscosity.mirror_at_walls, grid, solids, fields, r.viscosity, held, pace)
    _worlds(r, drift.find_shift, grid, fields, system, int(r.immersed_soft), pace)
    if r.immersed_soft:
        _worlds(r, immersed.shift_soft, *immersed_by)
    _worlds(r, motion.move_particles, grid, solids, particles, liquids, fields, wetted, held, pace)
    if solids.bodies:
        _worlds(r, bodies.bump_bodies, grid, solids, wetted, held, pace)


def _worlds(r: Records, kernel: Any, *inputs: Any) -> None:
    buffers.launch(kernel, r.pace.dt.shape[0], list(inputs))


def _lanes(r: Records, kernel: Any, *inputs: Any) -> None:
    buffers.launch(kernel, (r.pace.dt.shape[0], r.grid.lanes), list(inputs))
