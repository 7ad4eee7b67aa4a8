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
    _worlds(r, transfer.begin_substep, grid, fields, system, wetted, pace)
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
    _lanes(r, covering.take_statics, grid, fields, pace)
    if solids.bodies:
        _lanes(r, covering.cover_by_bodies, grid, solids, fields, held, pace, wetted)
    if r.samples is not None:
        _worlds(r, immersed.drag_thin, *immersed_by)
    _lanes(r, surface.find_surface, grid, fields, pace)
    _lanes(r, surface.continue_level, grid, fields, pace)

    # Forces: surface tension, viscosity, then the pressure that keeps the volume.
    if r.tense:
        _find_tension(r)
    if r.viscous:
        _diffuse(r)
    _lanes(r, pressure.number_unknowns, grid, fields, system, pace)
    _lanes(r, pressure.build_pressure, grid, fields, system, r.tension, int(r.tense), pace)
    if solids.bodies:
        _lanes(r, pressure.list_touching, grid, fields, system, wetted, pace)
    _worlds(r, pressure.solve_pressure, grid, solids, system, wetted, held, pace)
    _lanes(r, pressure.take_pressure, grid, fields, system, pace)
    _lanes(r, pressure.push_liquid, grid, fields, r.tension, int(r.tense), pace)

    # What bodies and nodes take of it.
    if solids.bodies:
        _worlds(r, bodies.reset_wrench, wetted)
        _lanes(r, bodies.gather_wrench, grid, system, wetted, pace)
        _worlds(r, bodies.push_bodies, grid, solids, wetted, held, clock.h, pace)
    if r.immersed_soft:
        _worlds(r, immersed.lift_soft, *immersed_by)
    if r.samples is not None:
        _worlds(r, immersed.lift_thin, *immersed_by)

    # Grid to particles, which move; what piles up is spread, and solids keep particles out.
    for layer in range(1, motion.LAYERS + 1):
        _lanes(r, motion.continue_velocity, grid, fields, layer, pace)
    _worlds(r, bodies.reset_wrench, wetted)
    _lanes(r, motion.slide_along_solids, grid, solids, fields, wetted, held, pace)
    if r.viscous:
        _lanes(r, viscosity.mirror_at_walls, grid, solids, fields, r.viscosity, held, pace)
    _lanes(r, drift.build_drift, grid, fields, system, int(r.immersed_soft), pace)
    _worlds(r, drift.solve_drift, grid, system, int(r.immersed_soft), pace)
    _lanes(r, drift.find_shift, grid, fields, system, pace)
    if r.immersed_soft:
        _worlds(r, immersed.shift_soft, *immersed_by)
    _lanes(r, motion.move_particles, grid, solids, particles, liquids, fields, wetted, held, pace)
    _lanes(r, motion.restore_momentum, grid, particles, wetted, solids.bodies, pace)
    if solids.bodies:
        _worlds(r, bodies.bump_bodies, grid, solids, wetted, held, pace)


def _find_tension(r: Records) -> None:
    grid, fields, pace = r.grid, r.fields, r.pace
    _lanes(r, tension.fill_solids, grid, fields, r.tension, pace)
    _lanes(r, tension.spread_strength, grid, r.particles, r.liquids, r.tension, pace)
    smooth, other = r.tension.smooth, r.tension.other
    for axis in (a for _ in range(tension.PASSES) for a in range(3) if grid.wide[a]):
        _lanes(r, tension.smooth_along, grid, fields, axis, smooth, other, pace)
        smooth, other = other, smooth
    _lanes(r, tension.find_normals, grid, fields, smooth, r.tension, pace)
    _lanes(r, tension.find_jump, grid, fields, r.tension, pace)


def _diffuse(r: Records) -> None:
    grid, fields, viscous, pace = r.grid, r.fields, r.viscosity, r.pace
    _worlds(r, viscosity.begin_viscosity, grid, r.liquids, viscous, pace)
    _lanes(r, viscosity.clear_viscosity, grid, fields, viscous, pace)
    _lanes(r, viscosity.spread_viscosity, grid, r.particles, r.liquids, viscous, pace)
    _lanes(r, viscosity.classify_faces, grid, r.solids, fields, viscous, r.bodies, pace)
    _lanes(r, viscosity.number_walls, grid, fields, viscous, pace)
    _worlds(r, viscosity.diffuse, grid, fields, viscous, pace)
    _lanes(r, viscosity.take_velocity, grid, fields, viscous, pace)


def _worlds(r: Records, kernel: Any, *inputs: Any) -> None:
    buffers.launch(kernel, r.pace.dt.shape[0], list(inputs))


def _lanes(r: Records, kernel: Any, *inputs: Any) -> None:
    buffers.launch(kernel, (r.pace.dt.shape[0], r.grid.lanes), list(inputs))
