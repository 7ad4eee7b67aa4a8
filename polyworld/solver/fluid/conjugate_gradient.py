"""Preconditioned conjugate gradients for the pressure, the volume's drift and viscosity.

Bridson, Fluid Simulation for Computer Graphics (2nd ed. 2015), ch. 5: a modified incomplete Cholesky preconditioner, in
compressed rows. One thread a world: the factorisation is serial by nature, and each world stops at its own accuracy.
"""

from typing import Any

import warp as wp

from polyworld.solver.fluid.layout import System
from polyworld.solver.fluid.stencil import ONE, ZERO

TUNING = wp.float64(0.97)  # how far dropped fill is moved to the diagonal
SAFETY = wp.float64(0.25)


@wp.func(inline=False)
def factorise(system: System, w: int, n: int) -> None:
    """MIC(0): the inverse of the factor's diagonal."""
    diagonal = system.diagonal[w]
    inverse = system.precondition[w]
    mx = system.minus[w, 0]
    my = system.minus[w, 1]
    mz = system.minus[w, 2]
    cx = system.coupling[w, 0]
    cy = system.coupling[w, 1]
    cz = system.coupling[w, 2]
    inverse[system.rows] = ZERO
    for i in range(n):
        x = mx[i]
        y = my[i]
        z = mz[i]
        px = inverse[x]
        py = inverse[y]
        pz = inverse[z]
        ax = cx[x] * px
        ay = cy[y] * py
        az = cz[z] * pz
        fill = ax * (cy[x] + cz[x]) * px + ay * (cx[y] + cz[y]) * py + az * (cx[z] + cy[z]) * pz
        e = diagonal[i] - ax * ax - ay * ay - az * az - TUNING * fill
        if e < SAFETY * diagonal[i]:
            e = diagonal[i]
        inverse[i] = ONE / wp.sqrt(e)


@wp.func(inline=False)
def precondition(system: System, w: int, n: int) -> None:
    """z from the residual, by forward and backward substitution."""
    inverse = system.precondition[w]
    residual = system.residual[w]
    z = system.z[w]
    mx = system.minus[w, 0]
    my = system.minus[w, 1]
    mz = system.minus[w, 2]
    px = system.plus[w, 0]
    py = system.plus[w, 1]
    pz = system.plus[w, 2]
    cx = system.coupling[w, 0]
    cy = system.coupling[w, 1]
    cz = system.coupling[w, 2]
    none = system.rows
    z[none] = ZERO
    for i in range(n):
        x = mx[i]
        y = my[i]
        k = mz[i]
        t = residual[i] - cx[x] * inverse[x] * z[x] - cy[y] * inverse[y] * z[y] - cz[k] * inverse[k] * z[k]
        z[i] = t * inverse[i]
    for m in range(n):
        i = n - 1 - m
        e = inverse[i]
        t = z[i] - e * (cx[i] * z[px[i]] + cy[i] * z[py[i]] + cz[i] * z[pz[i]])
        z[i] = t * e


@wp.func(inline=False)
def multiply(system: System, w: int, n: int, x: wp.array[wp.float64], y: wp.array[wp.float64]) -> None:
    """y = A x, without the bodies' part; x[rows] must be 0."""
    diagonal = system.diagonal[w]
    mx = system.minus[w, 0]
    my = system.minus[w, 1]
    mz = system.minus[w, 2]
    px = system.plus[w, 0]
    py = system.plus[w, 1]
    pz = system.plus[w, 2]
    cx = system.coupling[w, 0]
    cy = system.coupling[w, 1]
    cz = system.coupling[w, 2]
    for i in range(n):
        y[i] = (
            diagonal[i] * x[i]
            + cx[i] * x[px[i]]
            + cy[i] * x[py[i]]
            + cz[i] * x[pz[i]]
            + cx[mx[i]] * x[mx[i]]
            + cy[my[i]] * x[my[i]]
            + cz[mz[i]] * x[mz[i]]
        )


@wp.func(inline=False)
def dot(a: wp.array[wp.float64], b: wp.array[wp.float64], n: int) -> wp.float64:
    total = wp.float64(0.0)
    for i in range(n):
        total += a[i] * b[i]
    return total


@wp.func(inline=False)
def largest(a: wp.array[wp.float64], n: int) -> wp.float64:
    most = wp.float64(0.0)
    for i in range(n):
        most = wp.max(most, wp.abs(a[i]))
    return most


@wp.func(inline=False)
def step_along(a: wp.array[wp.float64], b: wp.array[wp.float64], s: wp.float64, n: int) -> None:
    """a += s b."""
    for i in range(n):
        a[i] = a[i] + s * b[i]


@wp.func(inline=False)
def step_back(a: wp.array[wp.float64], b: wp.array[wp.float64], s: wp.float64, n: int) -> None:
    """a = b + s a."""
    for i in range(n):
        a[i] = b[i] + s * a[i]


def conjugate_gradients(kind: Any, misfit: Any, precondition: Any, multiply: Any) -> Any:
    """Return the Warp function that solves symmetric positive definite equations held in structs of a kind.

    misfit(equations, w, n): size of the residual r, compared with `enough`. precondition(equations, w, n): z from r.
    multiply(equations, w, n, s, y): y = A s. The function returned moves x and r along search directions s, with z and
    y as room to work in, and returns the number of iterations.
    """

    @wp.func
    def solve(
        equations: kind,
        w: int,
        n: int,
        x: wp.array[wp.float64],
        r: wp.array[wp.float64],
        z: wp.array[wp.float64],
        s: wp.array[wp.float64],
        y: wp.array[wp.float64],
        enough: wp.float64,
        most: int,
    ) -> int:
        iterations = wp.int32(0)
        rho = wp.float64(0.0)
        while misfit(equations, w, n) > enough and iterations < most:
            precondition(equations, w, n)
            new = dot(r, z, n)
            if iterations == 0:
                step_back(s, z, ZERO, n)
            else:
                step_back(s, z, new / rho, n)
            rho = new
            multiply(equations, w, n, s, y)
            alpha = rho / dot(s, y, n)
            step_along(x, s, alpha, n)
            step_along(r, y, -alpha, n)
            iterations += 1
        return iterations

    return solve
