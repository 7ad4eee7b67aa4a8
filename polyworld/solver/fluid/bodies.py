"""Rigid bodies in the pressure equations: pressure pushes them, and what they do moves the liquid at once.

Batty, Bertails and Bridson, A fast variational framework for accurate solid-fluid coupling (2007): each body adds
B^T M^-1 B, with B the pressures' wrench on it, so that bodies of any lightness are stable.
"""

import warp as wp

from polyworld.solver.fluid.layout import Grid, Solids, System, Wetted
from polyworld.solver.spatial.layout import Body


@wp.func(inline=False)
def gather_wrench(grid: Grid, wetted: Wetted, system: System, w: int, count: int, p: wp.array[wp.float64]) -> None:
    """force and torque (per metre in a plane) of pressures p on every body."""
    for b in range(wetted.force.shape[1]):
        wetted.force[w, b] = wp.vec3d()
        wetted.torque[w, b] = wp.vec3d()
    for e in range(wetted.count[w]):
        push = grid.area * wetted.cover[w, e] * (p[wetted.lower[w, e]] - p[wetted.upper[w, e]])
        b = wetted.body[w, e]
        f = wetted.force[w, b]
        a = wetted.axis[w, e]
        f[a] = f[a] + push
        wetted.force[w, b] = f
        wetted.torque[w, b] = wetted.torque[w, b] + push * wetted.arm[w, e]


@wp.func(inline=False)
def respond(
    grid: Grid, solids: Solids, bodies: wp.array2d[Body], wetted: Wetted, w: int, dt: wp.float64
) -> None:
    """push and turn: changes of velocity and angular velocity by force and torque over dt."""
    for b in range(solids.bodies):
        share = solids.share[b]
        m = bodies[w, b].inverse_mass * share
        r = bodies[w, b].rotation
        wetted.push[w, b] = wetted.force[w, b] * (m * dt)
        turn = (r * (bodies[w, b].inverse_inertia * (wp.transpose(r) * wetted.torque[w, b]))) * (m * dt)
        if grid.thin >= 0:
            spin = turn[grid.thin]
            turn = wp.vec3d()
            turn[grid.thin] = spin
        wetted.turn[w, b] = turn


@wp.func(inline=False)
def add_outflow(grid: Grid, wetted: Wetted, w: int, y: wp.array[wp.float64], none: int) -> None:
    """Adds to y the divergence that push and turn make [1/s]."""
    for e in range(wetted.count[w]):
        b = wetted.body[w, e]
        speed = wetted.push[w, b][wetted.axis[w, e]] + wp.dot(wetted.turn[w, b], wetted.arm[w, e])
        flow = wetted.cover[w, e] * speed / grid.cell
        low = wetted.lower[w, e]
        high = wetted.upper[w, e]
        if low < none:
            y[low] = y[low] + flow
        if high < none:
            y[high] = y[high] - flow


@wp.func(inline=False)
def present_motion(bodies: wp.array2d[Body], wetted: Wetted, w: int, count: int) -> None:
    """push and turn: the velocities that the bodies have."""
    for b in range(count):
        wetted.push[w, b] = bodies[w, b].v
        wetted.turn[w, b] = bodies[w, b].w


@wp.func(inline=False)
def keep_touching(wetted: Wetted, fields_unknown: wp.array2d[wp.int32], stride: wp.vec3i, w: int, none: int) -> None:
    """Fill in the rows beside each covered face; faces with no unknown on either side are dropped."""
    kept = int(0)
    for e in range(wp.min(wetted.count[w], wetted.capacity)):
        c = wetted.face[w, e]
        high = fields_unknown[w, c]
        low = fields_unknown[w, c - stride[wetted.axis[w, e]]]
        if high < 0 and low < 0:
            continue
        if high < 0:
            high = none
        if low < 0:
            low = none
        wetted.lower[w, kept] = low
        wetted.upper[w, kept] = high
        wetted.body[w, kept] = wetted.body[w, e]
        wetted.axis[w, kept] = wetted.axis[w, e]
        wetted.face[w, kept] = c
        wetted.cover[w, kept] = wetted.cover[w, e]
        wetted.arm[w, kept] = wetted.arm[w, e]
        kept += 1
    wetted.count[w] = kept
