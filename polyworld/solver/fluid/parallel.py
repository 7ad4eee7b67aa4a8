"""Conjugate gradients in lanes, for devices on which those of a world run side by side.

The incomplete factor of `conjugate_gradient` is serial: here the preconditioner is the diagonal or, for equations of
cells, two damped Jacobi sweeps, which halve the iterations (Saad, Iterative Methods for Sparse Linear Systems, 2nd ed.
2003, 12.3). All worlds iterate together, those that are done doing nothing; the equations and how accurately they are
solved are the same.
"""

import warp as wp

from polyworld.solver.fluid.bodies import add_outflow, present_motion, respond
from polyworld.solver.fluid.drift import drift_tolerance
from polyworld.solver.fluid.layout import OPTIONS, Grid, Pace, Solids, System, Wetted
from polyworld.solver.fluid.stencil import ZERO
from polyworld.solver.spatial.layout import Body

wp.set_module_options(OPTIONS)

# Of the sweeps: below 1, so that what alternates from cell to cell, which a whole sweep only inverts, is damped too.
DAMPING = wp.float64(0.9)


@wp.struct
class Solve:
    """State of W solves. n (W,) unknowns; x, residual, z (preconditioned), search, product, diagonal (W, N).

    by_diagonal: 1 where the residual is measured over the diagonal. misfit (W,): largest residual, the solve ends where
    it is `enough`. rho, fresh (W,): product of the residual with its preconditioned self, before and after a step.
    ratio, curvature (W,): of search directions. going (W,): 1 while a world iterates; more (1,): while any does.
    """

    n: wp.array[wp.int32]
    x: wp.array2d[wp.float64]
    residual: wp.array2d[wp.float64]
    z: wp.array2d[wp.float64]
    search: wp.array2d[wp.float64]
    product: wp.array2d[wp.float64]
    diagonal: wp.array2d[wp.float64]
    iterations: wp.array[wp.int32]
    misfit: wp.array[wp.float64]
    enough: wp.array[wp.float64]
    rho: wp.array[wp.float64]
    fresh: wp.array[wp.float64]
    ratio: wp.array[wp.float64]
    curvature: wp.array[wp.float64]
    going: wp.array[wp.int32]
    more: wp.array[wp.int32]
    by_diagonal: int


# --- of any equations ---------------------------------------------------------------------------


@wp.kernel
def begin_solve(solve: Solve) -> None:
    w = wp.tid()
    solve.iterations[w] = 0
    solve.misfit[w] = ZERO
    solve.fresh[w] = ZERO
    solve.rho[w] = ZERO
    if w == 0:
        solve.more[0] = 0


@wp.func
def _size(solve: Solve, w: int, i: int) -> wp.float64:
    size = wp.abs(solve.residual[w, i])
    if solve.by_diagonal == 1:
        size = size / solve.diagonal[w, i]
    return size


@wp.kernel
def weigh_residual(grid: Grid, solve: Solve) -> None:
    """misfit of the residual."""
    w, lane = wp.tid()
    largest = wp.float64(0.0)
    for i in range(lane, solve.n[w], grid.lanes):
        largest = wp.max(largest, _size(solve, w, i))
    wp.atomic_max(solve.misfit, w, largest)


@wp.kernel
def precondition_by_diagonal(grid: Grid, solve: Solve) -> None:
    """z and fresh: the residual over the diagonal."""
    w, lane = wp.tid()
    fresh = wp.float64(0.0)
    for i in range(lane, solve.n[w], grid.lanes):
        r = solve.residual[w, i]
        solve.z[w, i] = r / solve.diagonal[w, i]
        fresh += r * r / solve.diagonal[w, i]
    wp.atomic_add(solve.fresh, w, fresh)


@wp.kernel
def set_tolerance(solve: Solve, relative: wp.float64, least: wp.float64) -> None:
    """enough: relative to the misfit now, and no less than some."""
    w = wp.tid()
    solve.enough[w] = relative * solve.misfit[w] + least
    solve.misfit[w] = ZERO


@wp.kernel
def set_drift_tolerance(grid: Grid, solve: Solve, soft: int, pace: Pace) -> None:
    """Set `enough` for the drift of content."""
    w = wp.tid()
    solve.enough[w] = drift_tolerance(grid, soft, w, pace, solve.misfit[w])
    solve.misfit[w] = ZERO


@wp.kernel
def choose_search(solve: Solve, most: int) -> None:
    """Whether a world goes on, and how much of its search direction it keeps."""
    w = wp.tid()
    fresh = solve.fresh[w]
    solve.ratio[w] = ZERO
    if solve.iterations[w] > 0:
        solve.ratio[w] = fresh / solve.rho[w]
    going = wp.int32(0)
    if solve.misfit[w] > solve.enough[w] and solve.iterations[w] < most:
        going = 1
        solve.iterations[w] = solve.iterations[w] + 1
        solve.more[0] = 1
    solve.going[w] = going
    solve.rho[w] = fresh
    solve.fresh[w] = ZERO
    solve.misfit[w] = ZERO
    solve.curvature[w] = ZERO


@wp.kernel
def turn_search(grid: Grid, solve: Solve) -> None:
    """Add the preconditioned residual to what is kept of the search direction."""
    w, lane = wp.tid()
    if w == 0 and lane == 0:
        solve.more[0] = 0
    if solve.going[w] == 0:
        return
    ratio = solve.ratio[w]
    for i in range(lane, solve.n[w], grid.lanes):
        kept = wp.float64(0.0)
        if ratio > ZERO:
            kept = ratio * solve.search[w, i]
        solve.search[w, i] = solve.z[w, i] + kept


@wp.kernel
def find_curvature(grid: Grid, solve: Solve) -> None:
    w, lane = wp.tid()
    if solve.going[w] == 0:
        return
    total = wp.float64(0.0)
    for i in range(lane, solve.n[w], grid.lanes):
        total += solve.search[w, i] * solve.product[w, i]
    wp.atomic_add(solve.curvature, w, total)


@wp.kernel
def step_along_search(grid: Grid, solve: Solve) -> None:
    """Move x to the minimum along the search direction; misfit of the residual there."""
    w, lane = wp.tid()
    if solve.going[w] == 0:
        return
    alpha = solve.rho[w] / solve.curvature[w]
    largest = wp.float64(0.0)
    for i in range(lane, solve.n[w], grid.lanes):
        solve.x[w, i] = solve.x[w, i] + alpha * solve.search[w, i]
        r = solve.residual[w, i] - alpha * solve.product[w, i]
        solve.residual[w, i] = r
        largest = wp.max(largest, _size(solve, w, i))
    wp.atomic_max(solve.misfit, w, largest)


@wp.kernel
def subtract_product(grid: Grid, solve: Solve) -> None:
    """Subtract the product from the residual."""
    w, lane = wp.tid()
    for i in range(lane, solve.n[w], grid.lanes):
        solve.residual[w, i] = solve.residual[w, i] - solve.product[w, i]


# --- of cells -----------------------------------------------------------------------------------


@wp.kernel
def multiply_cells(grid: Grid, system: System, x: wp.array2d[wp.float64]) -> None:
    """product = A x, without the bodies' part; x is 0 in row `rows`."""
    w, lane = wp.tid()
    for i in range(lane, system.n[w], grid.lanes):
        total = system.diagonal[w, i] * x[w, i]
        for a in range(3):
            below = system.minus[w, a, i]
            total += system.coupling[w, a, i] * x[w, system.plus[w, a, i]] + system.coupling[w, a, below] * x[w, below]
        system.product[w, i] = total


@wp.func
def _scaled(system: System, w: int, i: int) -> wp.float64:
    return system.residual[w, i] / system.diagonal[w, i]


@wp.kernel
def precondition_cells(grid: Grid, system: System, solve: Solve) -> None:
    """z and fresh: two damped Jacobi sweeps from zero, without the bodies' part."""
    w, lane = wp.tid()
    fresh = wp.float64(0.0)
    for i in range(lane, system.n[w], grid.lanes):
        own = _scaled(system, w, i)
        beside = wp.float64(0.0)
        for a in range(3):
            above = system.plus[w, a, i]
            below = system.minus[w, a, i]
            beside += system.coupling[w, a, i] * _scaled(system, w, above)
            beside += system.coupling[w, a, below] * _scaled(system, w, below)
        z = DAMPING * (wp.float64(2.0) * own - DAMPING * (own + beside / system.diagonal[w, i]))
        solve.z[w, i] = z
        fresh += z * system.residual[w, i]
    wp.atomic_add(solve.fresh, w, fresh)


@wp.kernel
def clear_product(grid: Grid, system: System) -> None:
    w, lane = wp.tid()
    for i in range(lane, system.n[w], grid.lanes):
        system.product[w, i] = ZERO


@wp.kernel
def take_motion(solids: Solids, wetted: Wetted, bodies: wp.array2d[Body]) -> None:
    """Set push and spin to the velocities of the bodies."""
    present_motion(bodies, wetted, wp.tid(), solids.bodies)


@wp.kernel
def yield_bodies(grid: Grid, solids: Solids, wetted: Wetted, bodies: wp.array2d[Body], pace: Pace) -> None:
    """push and spin by force and torque in the sub-step."""
    w = wp.tid()
    respond(grid, solids, bodies, wetted, w, pace.dt[w])


@wp.kernel
def add_flow(grid: Grid, system: System, wetted: Wetted) -> None:
    """Add the divergence of push and spin to the product."""
    w, lane = wp.tid()
    add_outflow(grid, wetted, w, lane, system.product[w], system.rows)
