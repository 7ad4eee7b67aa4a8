"""Solve for the pressure, and for the shift that evens out the content: conjugate gradients, one thread a world."""

import warp as wp

from polyworld.solver.fluid import drift, pressure
from polyworld.solver.fluid.bodies import add_outflow, add_wrench, clear_wrench, present_motion, respond
from polyworld.solver.fluid.conjugate_gradient import (
    conjugate_gradients,
    factorise,
    largest,
    multiply,
    precondition,
    step_along,
)
from polyworld.solver.fluid.drift import drift_tolerance
from polyworld.solver.fluid.layout import OPTIONS, Grid, Pace, Solids, System, Wetted
from polyworld.solver.fluid.stencil import ONE, ZERO
from polyworld.solver.spatial.layout import Body

wp.set_module_options(OPTIONS)


@wp.struct
class Coupled:
    """The liquid's equations, and what the bodies in it need to answer pressure within dt [s]."""

    system: System
    grid: Grid
    solids: Solids
    wetted: Wetted
    bodies: wp.array2d[Body]
    dt: wp.float64


@wp.func
def _left(equations: Coupled, w: int, n: int) -> wp.float64:
    return largest(equations.system.residual[w], n)


@wp.func
def _precondition(equations: Coupled, w: int, n: int) -> None:
    precondition(equations.system, w, n)


@wp.func
def _multiply(equations: Coupled, w: int, n: int, x: wp.array[wp.float64], y: wp.array[wp.float64]) -> None:
    """y = A x, with the bodies' part; x[rows] must be 0."""
    multiply(equations.system, w, n, x, y)
    if equations.wetted.count[w] > 0:
        clear_wrench(equations.wetted, w)
        add_wrench(equations.grid, equations.wetted, w, x)
        respond(equations.grid, equations.solids, equations.bodies, equations.wetted, w, equations.dt)
        add_outflow(equations.grid, equations.wetted, w, y, equations.system.rows)


_solve_coupled = conjugate_gradients(Coupled, _left, _precondition, _multiply)


@wp.kernel
def solve_pressure(
    grid: Grid, solids: Solids, system: System, wetted: Wetted, bodies: wp.array2d[Body], pace: Pace
) -> None:
    """Conjugate gradients from the last sub-step's pressure."""
    w = wp.tid()
    dt = pace.dt[w]
    if dt <= ZERO:
        return
    n = system.n[w]
    none = system.rows
    x = system.x[w]
    r = system.residual[w]
    z = system.z[w]
    s = system.search[w]
    y = system.product[w]
    equations = Coupled()
    equations.system = system
    equations.grid = grid
    equations.solids = solids
    equations.wetted = wetted
    equations.bodies = bodies
    equations.dt = dt
    if wetted.count[w] > 0:
        present_motion(bodies, wetted, w, solids.bodies)
        for i in range(n):
            y[i] = ZERO
        add_outflow(grid, wetted, w, y, none)
        step_along(r, y, -ONE, n)
    enough = pressure.TOLERANCE * largest(r, n)
    _multiply(equations, w, n, x, y)
    step_along(r, y, -ONE, n)
    factorise(system, w, n)
    system.iterations[w] = _solve_coupled(equations, w, n, x, r, z, s, y, enough, pressure.ITERATIONS)


@wp.func
def _excess(system: System, w: int, n: int) -> wp.float64:
    return largest(system.residual[w], n)


_solve_cells = conjugate_gradients(System, _excess, precondition, multiply)


@wp.kernel
def solve_drift(grid: Grid, system: System, soft: int, pace: Pace) -> None:
    """Conjugate gradients from no shift."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    n = system.n[w]
    x = system.x[w]
    r = system.residual[w]
    z = system.z[w]
    s = system.search[w]
    y = system.product[w]
    enough = drift_tolerance(grid, soft, w, pace, largest(r, n))
    factorise(system, w, n)
    _solve_cells(system, w, n, x, r, z, s, y, enough, drift.ITERATIONS)
