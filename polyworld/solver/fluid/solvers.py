"""Solvers of the fluid's equations: one thread a world, or in lanes."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, Protocol

import warp as wp

from polyworld.core import buffers
from polyworld.solver.fluid import (
    bodies,
    drift,
    parallel,
    parallel_viscosity,
    pressure,
    serial,
    serial_viscosity,
    viscosity,
)

if TYPE_CHECKING:
    from polyworld.solver.fluid.storage import Records

# Most iterations with Jacobi sweeps as preconditioner for one with the incomplete factor: for 200 to 5,000 unknowns
# they take 1 to 4 times as many.
PER_ITERATION = 6


class Solvers(Protocol):
    """Launches that solve the equations which a sub-step has built."""

    def diffuse(self, r: Records) -> None:
        """Solve for the velocities after viscosity."""
        ...

    def project(self, r: Records) -> None:
        """Solve for the pressure."""
        ...

    def spread(self, r: Records) -> None:
        """Solve for the shift that evens out the content."""
        ...


class Serial:
    """One thread a world, which ends at its own accuracy."""

    def diffuse(self, r: Records) -> None:
        """See `Solvers`."""
        r.launch_worlds(serial_viscosity.diffuse, r.grid, r.fields, r.viscosity, r.pace)

    def project(self, r: Records) -> None:
        """See `Solvers`."""
        r.launch_worlds(serial.solve_pressure, r.grid, r.solids, r.system, r.wetted, r.bodies, r.pace)

    def spread(self, r: Records) -> None:
        """See `Solvers`."""
        r.launch_worlds(serial.solve_drift, r.grid, r.system, int(r.immersed_soft), r.pace)


class Parallel:
    """All lanes of a world, all worlds until the last is done. `Solve` holds the arrays that records hold."""

    def __init__(self, worlds: int) -> None:
        self._sums = {n: buffers.zeros((worlds,), wp.float64) for n in _SUMS}
        self._going, self._more = buffers.zeros((worlds,), wp.int32), buffers.zeros((1,), wp.int32)
        self._iterations = buffers.zeros((worlds,), wp.int32)  # where equations do not record theirs

    def diffuse(self, r: Records) -> None:
        """See `Solvers`."""
        v = r.viscosity
        solve = self._solve(v, 1)

        def multiply(x: Any, y: Any, only: int) -> None:
            r.launch_lanes(parallel_viscosity.multiply_mass, r.grid, r.fields, v, x, y, only, r.pace)
            r.launch_lanes(parallel_viscosity.add_dissipation, r.grid, r.fields, v, x, y, only, r.pace)

        r.launch_worlds(parallel.begin_solve, solve)
        multiply(v.x, v.diagonal, 1)
        multiply(v.x, v.product, 0)
        r.launch_lanes(parallel_viscosity.find_imbalance, r.grid, v)
        r.launch_lanes(parallel.weigh_residual, r.grid, solve)
        r.launch_worlds(parallel.set_tolerance, solve, viscosity.TOLERANCE, viscosity.LEAST)

        def precondition() -> None:
            r.launch_lanes(parallel.precondition_by_diagonal, r.grid, solve)

        _iterate(r, solve, lambda: multiply(v.search, v.product, 0), precondition, viscosity.ITERATIONS)

    def project(self, r: Records) -> None:
        """See `Solvers`."""
        s = r.system
        solve = self._solve(s, 0)

        def multiply(x: Any) -> None:
            r.launch_lanes(parallel.multiply_cells, r.grid, s, x)
            if r.solids.bodies:
                r.launch_worlds(bodies.reset_wrench, r.wetted)
                r.launch_lanes(bodies.gather_wrench, r.grid, x, r.wetted, r.pace)
                r.launch_worlds(parallel.yield_bodies, r.grid, r.solids, r.wetted, r.bodies, r.pace)
                r.launch_lanes(parallel.add_flow, r.grid, s, r.wetted)

        r.launch_worlds(parallel.begin_solve, solve)
        if r.solids.bodies:
            r.launch_worlds(parallel.take_motion, r.solids, r.wetted, r.bodies)
            r.launch_lanes(parallel.clear_product, r.grid, s)
            r.launch_lanes(parallel.add_flow, r.grid, s, r.wetted)
            r.launch_lanes(parallel.subtract_product, r.grid, solve)
        r.launch_lanes(parallel.weigh_residual, r.grid, solve)
        r.launch_worlds(parallel.set_tolerance, solve, pressure.TOLERANCE, 0.0)
        multiply(s.x)
        r.launch_lanes(parallel.subtract_product, r.grid, solve)
        _iterate(r, solve, lambda: multiply(s.search), _of_cells(r, solve), PER_ITERATION * pressure.ITERATIONS)

    def spread(self, r: Records) -> None:
        """See `Solvers`."""
        s = r.system
        solve = self._solve(s, 0)
        solve.iterations = self._iterations
        r.launch_worlds(parallel.begin_solve, solve)
        r.launch_lanes(parallel.weigh_residual, r.grid, solve)
        r.launch_worlds(parallel.set_drift_tolerance, r.grid, solve, int(r.immersed_soft), r.pace)

        def multiply() -> None:
            r.launch_lanes(parallel.multiply_cells, r.grid, s, s.search)

        _iterate(r, solve, multiply, _of_cells(r, solve), PER_ITERATION * drift.ITERATIONS)

    def _solve(self, equations: Any, by_diagonal: int) -> Any:
        solve = parallel.Solve()
        for name in ("n", "x", "residual", "z", "search", "product", "diagonal", "iterations"):
            setattr(solve, name, getattr(equations, name))
        for name, values in self._sums.items():
            setattr(solve, name, values)
        solve.going, solve.more, solve.by_diagonal = self._going, self._more, by_diagonal
        return solve


_SUMS = ("misfit", "enough", "rho", "fresh", "ratio", "curvature")


def _of_cells(r: Records, solve: Any) -> Callable[[], None]:
    """Return what launches the preconditioner of equations of cells."""
    return lambda: r.launch_lanes(parallel.precondition_cells, r.grid, r.system, solve)


def _iterate(r: Records, solve: Any, multiply: Callable[[], None], precondition: Callable[[], None], most: int) -> None:
    def iteration() -> None:
        r.launch_lanes(parallel.turn_search, r.grid, solve)
        multiply()
        r.launch_lanes(parallel.find_curvature, r.grid, solve)
        r.launch_lanes(parallel.step_along_search, r.grid, solve)
        precondition()
        r.launch_worlds(parallel.choose_search, solve, most)

    r.launch_lanes(parallel.weigh_residual, r.grid, solve)
    precondition()
    r.launch_worlds(parallel.choose_search, solve, most)
    wp.capture_while(solve.more, iteration)


def solvers_of(lanes: int, worlds: int) -> Solvers:
    """Return the solvers for a number of lanes."""
    return Serial() if lanes == 1 else Parallel(worlds)
