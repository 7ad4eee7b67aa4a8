"""The equations of viscosity in lanes, for the solver of `parallel`."""

import warp as wp

from polyworld.solver.fluid.layout import OPTIONS, Fields, Grid, Pace, Viscous
from polyworld.solver.fluid.viscosity import Dissipation, dissipate, inertia

wp.set_module_options(OPTIONS)


@wp.func
def _dissipation(grid: Grid, fields: Fields, viscous: Viscous, dt: wp.float64) -> Dissipation:
    equations = Dissipation()
    equations.grid = grid
    equations.fields = fields
    equations.viscous = viscous
    equations.dt = dt
    return equations


@wp.kernel
def multiply_mass(
    grid: Grid,
    fields: Fields,
    viscous: Viscous,
    x: wp.array2d[wp.float64],
    y: wp.array2d[wp.float64],
    only: int,
    pace: Pace,
) -> None:
    """y: momentum of velocities x; `only` 1: the mass alone."""
    w, lane = wp.tid()
    if viscous.active[w] == 1:
        equations = _dissipation(grid, fields, viscous, pace.dt[w])
        inertia(equations, w, lane, viscous.n[w], x[w], y[w], only)


@wp.kernel
def add_dissipation(
    grid: Grid,
    fields: Fields,
    viscous: Viscous,
    x: wp.array2d[wp.float64],
    y: wp.array2d[wp.float64],
    only: int,
    pace: Pace,
) -> None:
    """Add to y what viscosity takes from velocities x in the sub-step; `only` 1: its diagonal alone."""
    w, lane = wp.tid()
    if viscous.active[w] == 1:
        dissipate(_dissipation(grid, fields, viscous, pace.dt[w]), w, lane, x[w], y[w], only)


@wp.kernel
def find_imbalance(grid: Grid, viscous: Viscous) -> None:
    """residual: momentum now less the product."""
    w, lane = wp.tid()
    for i in range(lane, viscous.n[w], grid.lanes):
        viscous.residual[w, i] = viscous.mass[w, i] * viscous.x[w, i] - viscous.product[w, i]
