"""From particles to the grid (mass, volume, momentum, content) and the sub-step they allow.

Affine particle-in-cell (Jiang, Schroeder, Selle, Teran, Stomakhin 2015) with linear weights on staggered faces.
"""

import warp as wp

from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Liquids, Pace, Particles, System, Wetted
from polyworld.solver.fluid.stencil import ONE, ZERO, scatter, scatter_linear, stencil
from polyworld.solver.spatial.layout import Body

wp.set_module_options(OPTIONS)

COURANT = wp.float64(1.0)  # edges that the fastest particle crosses in a sub-step
TOO_FAST = wp.float64(1.0e4)  # no liquid of a scene moves like this [m/s]
CAPILLARY = wp.float64(0.28)  # 1 / sqrt(4 pi)
MARGIN = 3  # cells of the window around the particles
NONE = 2147483647  # no particle


@wp.kernel
def begin_step(pace: Pace, h: wp.array[wp.float64]) -> None:
    w = wp.tid()
    pace.left[w] = h[w]
    pace.steps[w] = 0
    pace.go[0] = 1


@wp.kernel
def begin_substep(grid: Grid, fields: Fields, system: System, wetted: Wetted, pace: Pace) -> None:
    """Reset what a sub-step gathers."""
    w = wp.tid()
    if w == 0:
        pace.go[0] = 0
    pace.dt[w] = ZERO
    system.n[w] = 0
    wetted.found[w] = 0
    wetted.count[w] = 0
    pace.whole[w] = ZERO
    pace.gained[w] = wp.vec3d()
    pace.given[w] = wp.vec3d()
    pace.touching[w] = 0
    pace.fastest[w] = ZERO
    pace.present[w] = 0
    pace.lost[w] = NONE
    for a in range(3):
        fields.window[w, a] = grid.count[a]
        fields.window[w, 3 + a] = 0


@wp.kernel
def measure(grid: Grid, particles: Particles, fields: Fields, pace: Pace) -> None:
    """fastest: largest component of a particle's velocity. window: the cells around the particles. present, lost."""
    w = wp.tid()
    if pace.left[w] <= ZERO or pace.halted[0] != 0:
        return
    fastest = wp.float64(0.0)
    lo = grid.count
    hi = wp.vec3i(0, 0, 0)
    present = wp.int32(0)
    for p in range(particles.used[w]):
        if particles.fluid[w, p] < 0:
            continue
        present = 1
        v = particles.v[w, p]
        speed = wp.length(v)
        if not (speed < TOO_FAST):  # not a number, too
            wp.atomic_min(pace.lost, w, p)
            return
        g = (particles.x[w, p] - grid.origin) / grid.cell
        for a in range(3):
            fastest = wp.max(fastest, wp.abs(v[a]))
            if grid.wide[a] == 1:
                i = wp.int32(wp.floor(g[a]))
                lo[a] = wp.min(lo[a], i - MARGIN)
                hi[a] = wp.max(hi[a], i + MARGIN + 1)
    if present == 0:
        return
    wp.atomic_max(pace.present, w, 1)
    wp.atomic_max(pace.fastest, w, fastest)
    for a in range(3):
        wp.atomic_min(fields.window, w, a, lo[a])
        wp.atomic_max(fields.window, w, 3 + a, hi[a])


@wp.kernel
def choose_step(grid: Grid, liquids: Liquids, fields: Fields, pace: Pace, bodies: wp.array2d[Body], count: int) -> None:
    """Length of the next sub-step, an equal part of what is left, and the window within the grid.

    A world stops where a particle diverges; `diverged` is that particle.
    """
    w = wp.tid()
    left = pace.left[w]
    if left <= ZERO or pace.halted[0] != 0:
        return
    if pace.lost[w] < NONE:
        if pace.diverged[w] < 0:
            pace.diverged[w] = pace.lost[w]
        pace.left[w] = ZERO
        return
    present = pace.present[w]
    for a in range(3):
        if grid.wide[a] == 0 or present == 0:
            fields.window[w, a] = 0
            fields.window[w, 3 + a] = present
        fields.window[w, a] = wp.max(fields.window[w, a], 0)
        fields.window[w, 3 + a] = wp.min(fields.window[w, 3 + a], grid.count[a])
    fastest = pace.fastest[w]
    for b in range(count):
        if bodies[w, b].active == 1:
            fastest = wp.max(fastest, wp.length(bodies[w, b].v))
    fastest += wp.length(liquids.gravity[w % liquids.gravity.shape[0]]) * left
    pace.fastest[w] = fastest
    parts = left * fastest / (COURANT * grid.cell)
    for f in range(liquids.density.shape[1]):
        # Capillary waves of two cells' length (Brackbill, Kothe, Zemach 1992).
        sigma = liquids.surface_tension[w % liquids.surface_tension.shape[0], f]
        rho = liquids.density[w % liquids.density.shape[0], f]
        shortest = CAPILLARY * wp.sqrt(rho * grid.cell * grid.cell * grid.cell)
        parts = wp.max(parts, left * wp.sqrt(sigma) / shortest)
    parts = wp.ceil(parts)
    parts = wp.max(parts, ONE)
    pace.dt[w] = left / parts
    pace.steps[w] = pace.steps[w] + 1
    if parts < wp.float64(1.5):
        pace.left[w] = ZERO
        pace.dt[w] = left
    else:
        pace.left[w] = left - pace.dt[w]
        pace.go[0] = 1


@wp.kernel
def clear(grid: Grid, fields: Fields, pace: Pace) -> None:
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    for i in range(fields.window[w, 0], fields.window[w, 3]):
        for j in range(fields.window[w, 1], fields.window[w, 4]):
            for k in range(fields.window[w, 2], fields.window[w, 5]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                for a in range(3):
                    fields.velocity[w, a, c] = ZERO
                    fields.mass[w, a, c] = ZERO
                    fields.bulk[w, a, c] = ZERO
                fields.content[w, c] = ZERO
                fields.unknown[w, c] = -1


@wp.kernel
def particles_to_grid(grid: Grid, particles: Particles, liquids: Liquids, fields: Fields, pace: Pace) -> None:
    """Adds the particles' volume, mass and momentum, gravity's included, to the faces, their volume to the cells."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    volume = particles.volume
    fall = liquids.gravity[w % liquids.gravity.shape[0]] * pace.dt[w]
    content = fields.content[w]
    for p in range(particles.used[w]):
        f = particles.fluid[w, p]
        if f < 0:
            continue
        mass = volume * liquids.density[w % liquids.density.shape[0], f]
        x = particles.x[w, p]
        v = particles.v[w, p] + fall
        gradient = particles.gradient[w, p]
        for a in range(3):
            if grid.wide[a] == 0:
                continue
            s = stencil(grid, x, a)
            slope = wp.vec3d(gradient[a, 0], gradient[a, 1], gradient[a, 2])
            scatter_linear(grid, fields.velocity[w, a], s, mass, v[a], slope)
            scatter(grid, fields.bulk[w, a], s, volume)
            scatter(grid, fields.mass[w, a], s, mass)
        scatter(grid, content, stencil(grid, x, 3), volume)


@wp.kernel
def momentum_to_velocity(grid: Grid, fields: Fields, pace: Pace) -> None:
    """Faces' velocity from their momentum."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    for i in range(fields.window[w, 0], fields.window[w, 3]):
        for j in range(fields.window[w, 1], fields.window[w, 4]):
            for k in range(fields.window[w, 2], fields.window[w, 5]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                for a in range(3):
                    m = fields.mass[w, a, c]
                    u = wp.float64(0.0)
                    if m > ZERO:
                        u = fields.velocity[w, a, c] / m
                    fields.velocity[w, a, c] = u
