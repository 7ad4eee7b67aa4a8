"""Speed of the fluid solver: `python -m tests.benchmarks.fluid_speed`.

A column of water collapses in a box: 20,000 particles in space in one world, and 2,000 in 1 and in 64 worlds. Processor
time, so that other work on the machine does not count; one core. Newton's implicit MPM (`pip install newton`) is put
beside it on the same particles where it is installed and can run on this machine; a row says so where it is not.
"""

from __future__ import annotations

import time

import numpy as np
import warp as wp

from polyworld.world import World
from polyworld.world.representations.fluid import Fluid, FluidGrid, FluidVolume
from polyworld.world.shapes import Box
from tests.polyworld.solver.fluid.scenes import Run

STEP = 0.002


def column(particles: int) -> World:
    """Return a cube of about so many particles, half a metre wide, in a box 1 x 0.5 x 1 m."""
    cell = 0.5 / round((particles / 8) ** (1 / 3))
    volume = FluidVolume(shape=Box(half_extents=(0.25, 0.25, 0.25)), position=(0.25, 0.25, 0.25))
    grid = FluidGrid(lower=(0, 0, 0), upper=(round(1.0 / cell) * cell, 0.5, round(1.0 / cell) * cell), cell=cell)
    return World(deformables=(Fluid(name="water", volumes=(volume,)),), fluid_grid=grid)


def measure(particles: int, worlds: int, duration: float) -> tuple[int, float, int]:
    """Particles in a world, processor seconds per simulated second, and sub-steps taken."""
    run = Run(column(particles), step=STEP, n_worlds=worlds)
    run.run(2 * STEP)  # compiled and warm
    began, steps = time.process_time(), 0
    for _ in run.advance(duration):
        steps += int(run.fluid.substeps.sum())
    return len(run.present()[0]), (time.process_time() - began) / duration, steps


def newton_row(particles: int, duration: float) -> str:
    """Return the same column in Newton's SolverImplicitMPM, or why not."""
    try:
        import newton
        from newton.solvers import SolverImplicitMPM
    except ImportError as error:
        return f"Newton: not run ({error})"
    try:
        cell = 0.5 / round((particles / 8) ** (1 / 3))
        builder = newton.ModelBuilder()
        SolverImplicitMPM.register_custom_attributes(builder)
        n = round(1.0 / cell)
        builder.add_particle_grid(
            pos=wp.vec3(cell / 4, cell / 4, cell / 4),
            rot=wp.quat_identity(),
            vel=wp.vec3(0.0, 0.0, 0.0),
            dim_x=n,
            dim_y=n,
            dim_z=n,
            cell_x=cell / 2,
            cell_y=cell / 2,
            cell_z=cell / 2,
            mass=1000 * (cell / 2) ** 3,
            jitter=0.0,
        )
        builder.add_ground_plane()
        model = builder.finalize()
        solver = SolverImplicitMPM(model, SolverImplicitMPM.Config(voxel_size=cell))
        before, after = model.state(), model.state()
        solver.step(before, after, None, None, STEP)
        began = time.process_time()
        steps = round(duration / STEP)
        for _ in range(steps):
            solver.step(before, after, None, None, STEP)
            before, after = after, before
        spent = (time.process_time() - began) / duration
    except Exception as error:
        return f"Newton: not run ({type(error).__name__}: {error})"
    return f"Newton implicit MPM, {n**3} particles: {spent:.1f} s per simulated second, dt {STEP} s"


def main() -> None:
    for particles, worlds, duration in ((20_000, 1, 0.5), (2_000, 1, 0.5), (2_000, 64, 0.1)):
        count, spent, steps = measure(particles, worlds, duration)
        nanoseconds = 1e9 * spent * duration / (steps * count)
        print(
            f"{count} particles, {worlds} worlds: {spent:.2f} s per simulated second ({spent / worlds:.3f} a world), "
            f"{steps / worlds / duration:.0f} sub-steps a second, {nanoseconds:.0f} ns per particle and sub-step"
        )
    print(newton_row(20_000, 0.02))


if __name__ == "__main__":
    np.seterr(all="raise")
    main()
