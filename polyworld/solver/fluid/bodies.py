"""Rigid bodies in the pressure equations: pressure pushes them, and what they do moves the liquid at once.

Batty, Bertails and Bridson, A fast variational framework for accurate solid-fluid coupling (2007): each body adds
B^T M^-1 B, with B the pressures' wrench on it, so that bodies of any lightness are stable.
"""

import warp as wp

from polyworld.solver.fluid.layout import OPTIONS, Grid, Pace, Solids, Wetted
from polyworld.solver.fluid.stencil import ONE, ZERO
from polyworld.solver.spatial.layout import Body

wp.set_module_options(OPTIONS)


@wp.func(inline=False)
def clear_wrench(wetted: Wetted, w: int) -> None:
    for b in range(wetted.force.shape[1]):
        wetted.force[w, b] = wp.vec3d()
        wetted.torque[w, b] = wp.vec3d()


@wp.func(inline=False)
def add_wrench(grid: Grid, wetted: Wetted, w: int, p: wp.array[wp.float64]) -> None:
    """Add force and torque (per metre in a plane) of pressures p on the faces of every body."""
    for m in range(wetted.count[w]):
        e = wetted.touching[w, m]
        push = wetted.cover[w, e] * (p[wetted.lower[w, e]] - p[wetted.upper[w, e]])
        push = grid.area * (push + wetted.through[w, e] * p[wetted.beside[w, e]])
        b = wetted.body[w, e]
        force = wp.vec3d()
        force[wetted.axis[w, e]] = push
        wp.atomic_add(wetted.force, w, b, force)
        wp.atomic_add(wetted.torque, w, b, push * wetted.arm[w, e])


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
    """Add to y the divergence of push and spin at the faces [1/s]."""
    for m in range(wetted.count[w]):
        e = wetted.touching[w, m]
        b = wetted.body[w, e]
        speed = wetted.push[w, b][wetted.axis[w, e]] + wp.dot(wetted.spin[w, b], wetted.arm[w, e])
        speed /= grid.cell
        flow = wetted.cover[w, e] * speed
        beside = wetted.beside[w, e]
        if beside < none:
            wp.atomic_add(y, beside, wetted.through[w, e] * speed)
        low = wetted.lower[w, e]
        high = wetted.upper[w, e]
        if low < none:
            wp.atomic_add(y, low, flow)
        if high < none:
            wp.atomic_add(y, high, -flow)


@wp.func(inline=False)
def present_motion(bodies: wp.array2d[Body], wetted: Wetted, w: int, count: int) -> None:
    """Set push and spin to the velocities of the bodies."""
    for b in range(count):
        wetted.push[w, b] = bodies[w, b].v
        wetted.spin[w, b] = bodies[w, b].w


@wp.kernel
def reset_wrench(wetted: Wetted) -> None:
    w = wp.tid()
    clear_wrench(wetted, w)


@wp.kernel
def gather_wrench(grid: Grid, pressures: wp.array2d[wp.float64], wetted: Wetted, pace: Pace) -> None:
    """Add force and torque (per metre in a plane) of pressures on every body to what they are."""
    w = wp.tid()
    if pace.dt[w] > ZERO:
        add_wrench(grid, wetted, w, pressures[w])


@wp.kernel
def push_bodies(
    grid: Grid,
    solids: Solids,
    wetted: Wetted,
    bodies: wp.array2d[Body],
    h: wp.array[wp.float64],
    pace: Pace,
) -> None:
    """Velocity change of the bodies by the pressure's force and torque, kept as the next coupling step's forecast."""
    w = wp.tid()
    dt = pace.dt[w]
    if dt <= ZERO:
        return
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


@wp.func
def _lasting(now: wp.vec3d, before: wp.vec3d) -> wp.vec3d:
    """Return what two coupling steps have in common of a force or torque, along the later one.

    Where a body in a liquid collides, the liquid answers by a blow of its own. That is over by the next step: if it
    were predicted, the contact would return it as if the body had struck once more, and the body would rebound too far.
    """
    square = wp.dot(now, now)
    if square <= ZERO:
        return wp.vec3d()
    return now * wp.clamp(wp.dot(now, before) / square, ZERO, ONE)


@wp.kernel
def apply_prediction(
    grid: Grid, solids: Solids, wetted: Wetted, bodies: wp.array2d[Body], h: wp.array[wp.float64]
) -> None:
    """Apply the fluid's lasting push to bodies, so that joints and contacts can resist it."""
    w = wp.tid()
    for b in range(solids.bodies):
        wetted.force[w, b] = _lasting(wetted.forecast[w, b], wetted.before[w, b])
        wetted.torque[w, b] = _lasting(wetted.forecast_torque[w, b], wetted.torque_before[w, b])
        wetted.before[w, b] = wetted.forecast[w, b]
        wetted.torque_before[w, b] = wetted.forecast_torque[w, b]
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
