"""One coupling step of the fluids of W worlds, in as many sub-steps as each world needs.

Each line launches a stage of its own module: particles to grid, forces and pressure on the grid, grid to particles
(APIC).
"""

from __future__ import annotations

import warp as wp

from polyworld.solver.coupled.nodes import Clock
from polyworld.solver.fluid import (
    bodies,
    covering,
    drift,
    immersed,
    motion,
    pressure,
    pressure_solve,
    sources,
    surface,
    tension,
    transfer,
    viscosity,
    viscosity_solve,
)
from polyworld.solver.fluid.storage import Records


def apply_prediction(r: Records, clock: Clock) -> None:
    """Launch the prediction of the fluid's push on bodies, before the rigid step."""
    if r.solids.bodies:
        r.launch_worlds(bodies.apply_prediction, r.grid, r.solids, r.wetted, r.bodies, clock.h)


def advance(r: Records, clock: Clock) -> None:
    """Launch one coupling step of clock.h; r.pace says what is left of it."""
    r.liquids.gravity = clock.gravity
    if r.sources.emitters or r.sources.drains:
        r.launch_worlds(sources.emit_and_drain, r.grid, r.particles, r.sources, clock.time, clock.h)
    if r.solids.bodies:
        r.launch_worlds(bodies.remove_prediction, r.solids, r.wetted, r.bodies)
    r.launch_worlds(transfer.begin_step, r.pace, clock.h)
    wp.capture_while(r.pace.go, lambda: substep(r, clock))


def substep(r: Records, clock: Clock) -> None:
    """Launch one sub-step."""
    grid, solids, particles, liquids, fields = r.grid, r.solids, r.particles, r.liquids, r.fields
    system, wetted, pace, held = r.system, r.wetted, r.pace, r.bodies
    immersed_by = (grid, fields, r.samples, r.nodes, pace)
    r.launch_worlds(transfer.begin_substep, grid, fields, system, wetted, pace)
    r.launch_worlds(transfer.measure, grid, particles, fields, pace)
    r.launch_worlds(transfer.choose_step, grid, liquids, fields, pace, held, solids.bodies)

    # Particles to grid: momentum and volume of liquids, then of soft bodies among them.
    if r.immersed_soft:
        r.launch_worlds(immersed.widen_window, *immersed_by)
    r.launch_worlds(transfer.clear, grid, fields, pace)
    r.launch_worlds(transfer.particles_to_grid, grid, particles, liquids, fields, pace)
    if r.immersed_soft:
        r.launch_worlds(immersed.immerse_soft, *immersed_by)
    r.launch_worlds(transfer.momentum_to_velocity, grid, fields, pace)

    # What bounds the liquid: bodies, ropes and sheets, its free surface.
    r.launch_worlds(covering.take_statics, grid, fields, pace)
    if solids.bodies:
        r.launch_worlds(covering.cover_by_bodies, grid, solids, fields, held, pace, wetted)
    if r.samples is not None:
        r.launch_worlds(immersed.drag_thin, *immersed_by)
    r.launch_worlds(surface.find_surface, grid, fields, pace)
    r.launch_worlds(surface.continue_level, grid, fields, pace)

    # Forces: surface tension, viscosity, then the pressure that keeps the volume.
    if r.tense:
        _find_tension(r)
    if r.viscous:
        _diffuse(r)
    r.launch_worlds(pressure.number_unknowns, grid, fields, system, pace)
    r.launch_worlds(pressure.build_pressure, grid, fields, system, r.tension, int(r.tense), pace)
    if solids.bodies:
        r.launch_worlds(pressure.list_touching, grid, fields, system, wetted, pace)
    r.launch_worlds(pressure_solve.solve_pressure, grid, solids, system, wetted, held, pace)
    r.launch_worlds(pressure.take_pressure, fields, system, pace)
    r.launch_worlds(pressure.push_liquid, grid, fields, r.tension, int(r.tense), pace)

    # What bodies and nodes take of it.
    if solids.bodies:
        r.launch_worlds(bodies.reset_wrench, wetted)
        r.launch_worlds(bodies.gather_wrench, grid, system.x, wetted, pace)
        r.launch_worlds(bodies.push_bodies, grid, solids, wetted, held, clock.h, pace)
    if r.immersed_soft:
        r.launch_worlds(immersed.lift_soft, *immersed_by)
    if r.samples is not None:
        r.launch_worlds(immersed.lift_thin, *immersed_by)

    # Grid to particles, which move; what piles up is spread, and solids keep particles out.
    for layer in range(1, motion.LAYERS + 1):
        r.launch_worlds(motion.continue_velocity, grid, fields, layer, pace)
    r.launch_worlds(bodies.reset_wrench, wetted)
    r.launch_worlds(motion.slide_along_solids, grid, solids, fields, wetted, held, pace)
    r.launch_worlds(motion.take_slid, grid, fields, pace)
    if r.viscous:
        r.launch_worlds(viscosity.mirror_at_walls, grid, solids, fields, r.viscosity, held, pace)
    r.launch_worlds(drift.build_drift, grid, fields, system, int(r.immersed_soft), pace)
    r.launch_worlds(pressure_solve.solve_drift, grid, system, int(r.immersed_soft), pace)
    r.launch_worlds(drift.find_shift, grid, fields, system, pace)
    if r.immersed_soft:
        r.launch_worlds(immersed.shift_soft, *immersed_by)
    r.launch_worlds(motion.move_particles, grid, solids, particles, liquids, fields, wetted, held, pace)
    r.launch_worlds(motion.restore_momentum, grid, particles, wetted, solids.bodies, pace)
    if solids.bodies:
        r.launch_worlds(bodies.bump_bodies, grid, solids, wetted, held, pace)


def _find_tension(r: Records) -> None:
    grid, fields, pace = r.grid, r.fields, r.pace
    r.launch_worlds(tension.fill_solids, grid, fields, r.tension, pace)
    r.launch_worlds(tension.spread_strength, grid, r.particles, r.liquids, r.tension, pace)
    smooth, other = r.tension.smooth, r.tension.other
    for axis in (a for _ in range(tension.PASSES) for a in range(3) if grid.wide[a]):
        r.launch_worlds(tension.smooth_along, grid, fields, axis, smooth, other, pace)
        smooth, other = other, smooth
    r.launch_worlds(tension.find_normals, grid, fields, smooth, r.tension, pace)
    r.launch_worlds(tension.find_jump, grid, fields, r.tension, pace)


def _diffuse(r: Records) -> None:
    grid, fields, viscous, pace = r.grid, r.fields, r.viscosity, r.pace
    r.launch_worlds(viscosity.begin_viscosity, grid, r.liquids, viscous, pace)
    r.launch_worlds(viscosity.clear_viscosity, grid, fields, viscous, pace)
    r.launch_worlds(viscosity.spread_viscosity, grid, r.particles, r.liquids, viscous, pace)
    r.launch_worlds(viscosity.classify_faces, grid, r.solids, fields, viscous, r.bodies, pace)
    r.launch_worlds(viscosity.number_walls, grid, fields, viscous, pace)
    r.launch_worlds(viscosity_solve.diffuse, grid, fields, viscous, pace)
    r.launch_worlds(viscosity.take_velocity, grid, fields, viscous, pace)
