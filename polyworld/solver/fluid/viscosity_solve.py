"""Solve for the velocities after viscosity: conjugate gradients, one thread a world."""

import warp as wp

from polyworld.solver.fluid import viscosity
from polyworld.solver.fluid.conjugate_gradient import conjugate_gradients
from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Pace, Viscous
from polyworld.solver.fluid.stencil import ZERO
from polyworld.solver.fluid.viscosity import Dissipation, dissipate, inertia

wp.set_module_options(OPTIONS)


@wp.func
def _apply(equations: Dissipation, w: int, n: int, x: wp.array[wp.float64], y: wp.array[wp.float64], only: int) -> None:
    """y = (inertia + dt dissipation) x on the liquid's faces; `only` 1: its diagonal alone, x then ignored."""
    inertia(equations, w, n, x, y, only)
    dissipate(equations, w, x, y, only)


@wp.func
def _misfit(equations: Dissipation, w: int, n: int) -> wp.float64:
    """Largest change of velocity that the diagonal asks for [m/s]."""
    residual = equations.viscous.residual[w]
    diagonal = equations.viscous.diagonal[w]
    most = wp.float64(0.0)
    for i in range(n):
        most = wp.max(most, wp.abs(residual[i] / diagonal[i]))
    return most


@wp.func
def _precondition(equations: Dissipation, w: int, n: int) -> None:
    residual = equations.viscous.residual[w]
    diagonal = equations.viscous.diagonal[w]
    z = equations.viscous.z[w]
    for i in range(n):
        z[i] = residual[i] / diagonal[i]


@wp.func
def _multiply(equations: Dissipation, w: int, n: int, x: wp.array[wp.float64], y: wp.array[wp.float64]) -> None:
    _apply(equations, w, n, x, y, 0)


_solve = conjugate_gradients(Dissipation, _misfit, _precondition, _multiply)


@wp.kernel
def diffuse(grid: Grid, fields: Fields, viscous: Viscous, pace: Pace) -> None:
    """Conjugate gradients with the diagonal as preconditioner, from the present velocity."""
    w = wp.tid()
    dt = pace.dt[w]
    if dt <= ZERO or viscous.active[w] == 0:
        return
    x = viscous.x[w]
    r = viscous.residual[w]
    y = viscous.product[w]
    n = viscous.n[w]
    equations = Dissipation()
    equations.grid = grid
    equations.fields = fields
    equations.viscous = viscous
    equations.dt = dt
    _apply(equations, w, n, x, viscous.diagonal[w], 1)
    _apply(equations, w, n, x, y, 0)
    for i in range(n):
        r[i] = viscous.mass[w, i] * x[i] - y[i]
    enough = viscosity.TOLERANCE * _misfit(equations, w, n) + viscosity.LEAST
    viscous.iterations[w] = _solve(
        equations, w, n, x, r, viscous.z[w], viscous.search[w], y, enough, viscosity.ITERATIONS
    )
