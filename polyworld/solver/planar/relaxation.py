"""Projected Gauss-Seidel sweeps over contact rows, accelerated as conjugate gradients.

A sweep's change of the impulses serves as the gradient of a nonlinear conjugate-gradient method (Silcowitz, Niebe &
Erleben 2010, "A nonsmooth nonlinear conjugate gradient method for interactive contact force problems", Vis. Comput. 26,
893): a stack of L bodies takes of the order of L sweeps, not L^2. The last sweep is a plain one, so that its impulses
keep within their limits.
"""

import warp as wp

from polyworld.solver.planar.motion import slide
from polyworld.solver.planar.records import Bodies, Contacts, Row, Scene

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
FAR = wp.float64(1.0e30)
PATIENCE = 32  # sweeps


@wp.func
def sweep_rows(
    n: wp.int32,
    rates: wp.array[wp.vec3d],
    inverse_mass: wp.array[wp.float64],
    inverse_inertia: wp.array[wp.float64],
    rows: wp.array[Row],
    order: wp.array[wp.int32],
    first: wp.int32,
    last: wp.int32,
) -> wp.vec2d:
    """Solve the rows one after another: normal, Coulomb friction, rolling resistance, each within its limit.

    Returns the largest change of speed, and the energy norm of the change of the impulses, squared.
    """
    residual = ZERO
    norm = ZERO
    for k in range(first, last):
        r = order[k]
        if rows[r].solved == 1:
            a = rows[r].a
            b = rows[r].b
            normal = rows[r].normal
            levers = rows[r].levers
            mass = rows[r].mass
            stiff = rows[r].compliance
            was = rows[r].impulse
            ma = inverse_mass[a]
            ia = inverse_inertia[a]
            va = rates[a]
            mb = ZERO
            ib = ZERO
            vb = wp.vec3d()
            if b < n:
                mb = inverse_mass[b]
                ib = inverse_inertia[b]
                vb = rates[b]
            # The tangent is the normal turned left.
            x = vb[0] - va[0]
            y = vb[1] - va[1]
            speed = (normal[0] * x + normal[1] * y) + (levers[1] * vb[2] - levers[0] * va[2])
            slip = (normal[0] * y - normal[1] * x) + (levers[3] * vb[2] - levers[2] * va[2])
            along = wp.max(ZERO, was[0] + (rows[r].target - speed) * mass[0])
            change = along - was[0]
            slip = slip + change * rows[r].coupling
            limit = rows[r].friction * along
            if rows[r].sticks == 1:
                limit = FAR
                slip = slip - rows[r].slip_target
            across = wp.clamp(was[1] - slip * mass[1], -limit, limit)
            change_across = across - was[1]
            turn_a = ia * (levers[0] * change + levers[2] * change_across)
            turn_b = ib * (levers[1] * change + levers[3] * change_across)
            roll = was[2]
            change_roll = ZERO
            rolling = rows[r].rolling
            if rolling > ZERO:
                most = rolling * along
                roll = wp.clamp(roll - (vb[2] + turn_b - va[2] + turn_a) * mass[2], -most, most)
                change_roll = roll - was[2]
                turn_a += ia * change_roll
                turn_b += ib * change_roll
            rows[r].impulse = wp.vec3d(along, across, roll)
            px = normal[0] * change - normal[1] * change_across
            py = normal[1] * change + normal[0] * change_across
            rates[a] = wp.vec3d(va[0] - ma * px, va[1] - ma * py, va[2] - turn_a)
            if b < n:
                rates[b] = wp.vec3d(vb[0] + mb * px, vb[1] + mb * py, vb[2] + turn_b)
            along_speed = wp.abs(change) * stiff[0]
            across_speed = wp.abs(change_across) * stiff[1]
            residual = wp.max(residual, wp.max(along_speed, across_speed))
            norm += along_speed * wp.abs(change) + across_speed * wp.abs(change_across)
            norm += change_roll * change_roll * stiff[2]
    return wp.vec2d(residual, norm)


@wp.func
def hold_bodies(bodies: wp.array[Bodies], w: wp.int32, first: wp.int32, last: wp.int32, h: wp.float64) -> wp.float64:
    """Solve the friction of bodies on the supporting plane; return the largest change of a rate."""
    residual = ZERO
    for m in range(first, last):
        i = bodies[0].island[w, m]
        hold = bodies[0].hold[w, i]
        if hold > ZERO:
            without = bodies[0].next_rate[w, i] - bodies[0].drag[w, i]
            patch = bodies[0].patch[w, i]
            held = slide(without, hold * h * bodies[0].linear_decay[w, i][1], patch[0], patch[1])
            residual = wp.max(residual, wp.length(held - bodies[0].next_rate[w, i]))
            bodies[0].next_rate[w, i] = held
            bodies[0].drag[w, i] = held - without
    return residual


@wp.func
def keep_iterate(
    rates: wp.array[wp.vec3d],
    last_rate: wp.array[wp.vec3d],
    direction: wp.array[wp.vec3d],
    island: wp.array[wp.int32],
    first: wp.int32,
    last: wp.int32,
) -> None:
    """Let the directions of the members' rates, or of their drag, begin here."""
    for m in range(first, last):
        i = island[m]
        last_rate[i] = rates[i]
        direction[i] = wp.vec3d()


@wp.func
def extrapolate(
    rates: wp.array[wp.vec3d],
    last_rate: wp.array[wp.vec3d],
    direction: wp.array[wp.vec3d],
    island: wp.array[wp.int32],
    first: wp.int32,
    last: wp.int32,
    beta: wp.float64,
) -> None:
    """Go on from a sweep by beta times the last direction; the rates are linear in the impulses, and follow."""
    for m in range(first, last):
        i = island[m]
        was = last_rate[i]
        turn = rates[i] - was + direction[i] * beta
        direction[i] = turn
        rates[i] = was + turn
        last_rate[i] = was + turn


@wp.func
def extrapolate_rows(
    rows: wp.array[Row], order: wp.array[wp.int32], first: wp.int32, last: wp.int32, beta: wp.float64
) -> None:
    for k in range(first, last):
        r = order[k]
        if rows[r].solved == 1:
            before = rows[r].last_impulse
            direction = rows[r].impulse - before + rows[r].direction * beta
            rows[r].direction = direction
            rows[r].impulse = before + direction
            rows[r].last_impulse = before + direction


@wp.func(inline=False)  # called in several places; by reference, for a call would copy the records
def relax(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    contacts: wp.array[Contacts],
    w: wp.int32,
    slot: wp.int32,
    half: wp.int32,
    island: wp.int32,
    sweeps: wp.int32,
    threshold: wp.float64,
    good: wp.float64,
    h: wp.float64,
) -> None:
    """Bring the solved rows of one island to their targets, in at most so many sweeps.

    Ends where no speed changes by more than `threshold` [m/s] in a sweep; of bodies so many that they need more than
    PATIENCE sweeps, by more than `good` [m/s]: at rest, the next steps converge further. h: length of the step over
    which the supporting plane acts [s]; 0 for an impact.
    """
    first = bodies[0].first_row[w, island]
    last = bodies[0].first_row[w, island + 1]
    first_body = bodies[0].first_body[w, island]
    last_body = bodies[0].first_body[w, island + 1]
    forces = wp.where(h > ZERO, 1, 0)
    # Views: what is reached through the records would be looked up again at every access.
    n = scene[0].bodies
    rates = bodies[0].next_rate[w]
    inverse_mass = bodies[0].inverse_mass[w]
    inverse_inertia = bodies[0].inverse_inertia[w]
    members = bodies[0].island[w]
    rows = contacts[0].rows[slot, half]
    order = contacts[0].order[slot]
    before = ZERO
    for sweep in range(sweeps):
        if sweep == 1:
            for k in range(first, last):
                rows[order[k]].last_impulse = rows[order[k]].impulse
                rows[order[k]].direction = wp.vec3d()
            keep_iterate(rates, bodies[0].last_rate[w], bodies[0].rate_direction[w], members, first_body, last_body)
            if forces == 1:
                keep_iterate(
                    bodies[0].drag[w],
                    bodies[0].last_drag[w],
                    bodies[0].drag_direction[w],
                    members,
                    first_body,
                    last_body,
                )
        found = sweep_rows(n, rates, inverse_mass, inverse_inertia, rows, order, first, last)
        residual = found[0]
        if forces == 1:
            residual = wp.max(residual, hold_bodies(bodies, w, first_body, last_body, h))
        if residual <= wp.where(sweep < PATIENCE, threshold, wp.max(threshold, good)):
            break
        if sweep > 0 and sweep + 1 < sweeps:
            beta = ZERO
            if before > ZERO and found[1] < before:
                beta = found[1] / before
            extrapolate_rows(rows, order, first, last, beta)
            extrapolate(
                rates, bodies[0].last_rate[w], bodies[0].rate_direction[w], members, first_body, last_body, beta
            )
            if forces == 1:
                extrapolate(
                    bodies[0].drag[w],
                    bodies[0].last_drag[w],
                    bodies[0].drag_direction[w],
                    members,
                    first_body,
                    last_body,
                    beta,
                )
            before = found[1]
