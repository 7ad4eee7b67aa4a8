"""Rigid bodies in the pressure equations: pressure pushes them, and what they do moves the liquid at once.

Batty, Bertails and Bridson, A fast variational framework for accurate solid-fluid coupling (2007): each body adds
B^T M^-1 B, with B the pressures' wrench on it, so that bodies of any lightness are stable.
"""

import warp as wp

from polyworld.solver.fluid.layout import OPTIONS, Grid, Pace, Solids, System, Wetted
from polyworld.solver.fluid.stencil import ZERO
from polyworld.solver.spatial.layout import Body

wp.set_module_options(OPTIONS)


@wp.func(inline=False)
def gather_wrench(grid: Grid, wetted: Wetted, w: int, p: wp.array[wp.float64]) -> None:
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
def respond(grid: Grid, solids: Solids, bodies: wp.array2d[Body], wetted: Wetted, w: int, dt: wp.float64) -> None:
    """Compute push and spin: changes of velocity and angular velocity by force and torque over dt."""
    for b in range(solids.bodies):
        share = solids.share[b]
        m = bodies[w, b].inverse_mass * share
        r = bodies[w, b].rotation
        wetted.push[w, b] = wetted.force[w, b] * (m * dt)
        change = (r * (bodies[w, b].inverse_inertia * (wp.transpose(r) * wetted.torque[w, b]))) * (m * dt)
        if grid.thin >= 0:
            spin = change[grid.thin]
            change = wp.vec3d()
            change[grid.thin] = spin
        wetted.spin[w, b] = change


@wp.func(inline=False)
def add_outflow(grid: Grid, wetted: Wetted, w: int, y: wp.array[wp.float64], none: int) -> None:
    """Add to y the divergence of push and spin [1/s]."""
    for e in range(wetted.count[w]):
        b = wetted.body[w, e]
        speed = wetted.push[w, b][wetted.axis[w, e]] + wp.dot(wetted.spin[w, b], wetted.arm[w, e])
        flow = wetted.cover[w, e] * speed / grid.cell
        low = wetted.lower[w, e]
        high = wetted.upper[w, e]
        if low < none:
            y[low] = y[low] + flow
        if high < none:
            y[high] = y[high] - flow


@wp.func(inline=False)
def present_motion(bodies: wp.array2d[Body], wetted: Wetted, w: int, count: int) -> None:
    """Set push and spin to the velocities of the bodies."""
    for b in range(count):
        wetted.push[w, b] = bodies[w, b].v
        wetted.spin[w, b] = bodies[w, b].w


@wp.func(inline=False)
def keep_touching(wetted: Wetted, fields_unknown: wp.array2d[wp.int32], stride: wp.vec3i, w: int, none: int) -> None:
    """Fill in the rows beside each covered face; faces with no unknown on either side are dropped."""
    kept = wp.int32(0)
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


@wp.kernel
def push_bodies(
    grid: Grid,
    solids: Solids,
    system: System,
    wetted: Wetted,
    bodies: wp.array2d[Body],
    h: wp.array[wp.float64],
    pace: Pace,
) -> None:
    """Velocity change of the bodies by the pressure on them, kept as the forecast of the next coupling step's."""
    w = wp.tid()
    dt = pace.dt[w]
    if dt <= ZERO:
        return
    gather_wrench(grid, wetted, w, system.x[w])
    respond(grid, solids, bodies, wetted, w, dt)
    for b in range(solids.bodies):
        if bodies[w, b].active == 1:
            bodies[w, b].v = bodies[w, b].v + wetted.push[w, b]
            bodies[w, b].w = bodies[w, b].w + wetted.spin[w, b]
            pace.given[w] = pace.given[w] + wetted.force[w, b] * dt
            wetted.forecast[w, b] = wetted.forecast[w, b] + wetted.force[w, b] * (dt / h[w])
            wetted.forecast_torque[w, b] = wetted.forecast_torque[w, b] + wetted.torque[w, b] * (dt / h[w])


@wp.kernel
def bump_bodies(grid: Grid, solids: Solids, wetted: Wetted, bodies: wp.array2d[Body], pace: Pace) -> None:
    """Velocity change of the bodies by the impulses in force and torque."""
    w = wp.tid()
    if pace.dt[w] <= ZERO:
        return
    respond(grid, solids, bodies, wetted, w, wp.float64(1.0))
    for b in range(solids.bodies):
        if bodies[w, b].active == 1:
            bodies[w, b].v = bodies[w, b].v + wetted.push[w, b]
            bodies[w, b].w = bodies[w, b].w + wetted.spin[w, b]


@wp.kernel
def apply_prediction(
    grid: Grid, solids: Solids, wetted: Wetted, bodies: wp.array2d[Body], h: wp.array[wp.float64]
) -> None:
    """Apply the fluid's impulse of the last coupling step to bodies, so that joints and contacts can resist it."""
    w = wp.tid()
    for b in range(solids.bodies):
        wetted.force[w, b] = wetted.forecast[w, b]
        wetted.torque[w, b] = wetted.forecast_torque[w, b]
    respond(grid, solids, bodies, wetted, w, h[w])
    for b in range(solids.bodies):
        if bodies[w, b].active == 1:
            wetted.predicted_push[w, b] = wetted.push[w, b]
            wetted.predicted_spin[w, b] = wetted.spin[w, b]
            bodies[w, b].v = bodies[w, b].v + wetted.push[w, b]
            bodies[w, b].w = bodies[w, b].w + wetted.spin[w, b]


@wp.kernel
def remove_prediction(solids: Solids, wetted: Wetted, bodies: wp.array2d[Body]) -> None:
    """Remove the predicted velocity change, and reset the forecast."""
    w = wp.tid()
    for b in range(solids.bodies):
        bodies[w, b].v = bodies[w, b].v - wetted.predicted_push[w, b]
        bodies[w, b].w = bodies[w, b].w - wetted.predicted_spin[w, b]
        wetted.predicted_push[w, b] = wp.vec3d()
        wetted.predicted_spin[w, b] = wp.vec3d()
        wetted.forecast[w, b] = wp.vec3d()
        wetted.forecast_torque[w, b] = wp.vec3d()
