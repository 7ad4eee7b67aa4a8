"""Volume: shifts of the particles that undo accumulated errors of density.

Kugelstadt, Longva, Thuerey, Bender, Implicit density projection for volume conserving liquids (2019): a Poisson
problem like the pressure's, whose right side is the excess of content. It moves particles, not velocities.
"""

import warp as wp

from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Pace, System
from polyworld.solver.fluid.stencil import ONE, ZERO

wp.set_module_options(OPTIONS)

OPEN = wp.float64(1.0e-3)
LARGEST = wp.float64(0.5)  # excess of content that is looked at
NEGLIGIBLE = wp.float64(1.0e-4)
PURE = wp.float64(0.05)  # a cell with less liquid than this belongs to a soft body
SMALLEST = wp.float64(1.0e-12)
TOLERANCE = wp.float64(1.0e-2)
ITERATIONS = 50


@wp.func
def _rate(grid: Grid, soft: int, w: int, pace: Pace) -> wp.float64:
    """Share of the excess that a sub-step takes away: in the time to cross half a cell, content is put right."""
    rate = wp.float64(2.0) * pace.dt[w] * pace.fastest[w] / grid.cell
    if soft == 1:
        rate *= wp.float64(5.0)  # soft bodies and liquid creep into each other: their samples move apart
    return wp.min(ONE, rate)


@wp.func
def drift_tolerance(grid: Grid, soft: int, w: int, pace: Pace, largest: wp.float64) -> wp.float64:
    """Excess that may be left, where the largest is given."""
    return wp.max(TOLERANCE * largest, NEGLIGIBLE * _rate(grid, soft, w, pace))


@wp.kernel
def build_drift(grid: Grid, fields: Fields, system: System, soft: int, pace: Pace) -> None:
    """Build the equations: row i is the share of the excess of content at cell i that this sub-step takes away."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    h = grid.cell
    rate = _rate(grid, soft, w, pace)
    for i in range(system.n[w]):
        c = system.cell[w, i]
        diagonal = wp.float64(0.0)
        surface = wp.int32(0)
        for a in range(3):
            system.coupling[w, a, i] = ZERO
            if grid.wide[a] == 0:
                continue
            for side in range(2):
                free = fields.open[w, a, c + side * grid.stride[a]]
                if free <= OPEN:
                    continue
                beyond = c + (2 * side - 1) * grid.stride[a]
                weight = free / (h * h)
                if fields.unknown[w, beyond] >= 0:
                    diagonal += weight
                    if side == 1:
                        system.coupling[w, a, i] = -weight
                elif fields.level[w, beyond] >= ZERO:
                    diagonal += weight / wp.max(
                        fields.level[w, c] / (fields.level[w, c] - fields.level[w, beyond]), wp.float64(0.25)
                    )
                    surface = 1
        excess = wp.clamp(fields.filled[w, c] - ONE, -LARGEST, LARGEST)
        if surface == 1:
            excess = wp.max(excess, ZERO)
        # Inside a soft body elasticity keeps the volume; its samples are no measure of it.
        if diagonal <= ZERO or (soft == 1 and fields.liquid[w, c] < PURE * fields.content[w, c]):
            diagonal = wp.max(diagonal, SMALLEST)
            excess = ZERO
        system.diagonal[w, i] = diagonal
        system.residual[w, i] = rate * excess
        system.x[w, i] = ZERO
    system.x[w, system.rows] = ZERO
    system.search[w, system.rows] = ZERO


@wp.kernel
def find_shift(grid: Grid, fields: Fields, system: System, pace: Pace) -> None:
    """shift of every face [m]; its flow out of a cell is the share of the excess that this sub-step takes away."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    h = grid.cell
    x = system.x[w]
    lo = wp.vec3i(fields.window[w, 0], fields.window[w, 1], fields.window[w, 2])
    hi = wp.vec3i(fields.window[w, 3], fields.window[w, 4], fields.window[w, 5])
    for i in range(lo[0], hi[0]):
        for j in range(lo[1], hi[1]):
            for k in range(lo[2], hi[2]):
                c = i * grid.stride[0] + j * grid.stride[1] + k * grid.stride[2]
                index = wp.vec3i(i, j, k)
                for a in range(3):
                    move = wp.float64(0.0)
                    if grid.wide[a] == 1 and index[a] > lo[a] and fields.open[w, a, c] > OPEN:
                        high = fields.unknown[w, c]
                        low = fields.unknown[w, c - grid.stride[a]]
                        if high >= 0 and low >= 0:
                            move = (x[low] - x[high]) / h
                        elif high >= 0 and fields.level[w, c - grid.stride[a]] >= ZERO:
                            move = -x[high] / h
                        elif low >= 0 and fields.level[w, c] >= ZERO:
                            move = x[low] / h
                    fields.shift[w, a, c] = wp.clamp(move, -h * LARGEST, h * LARGEST)
