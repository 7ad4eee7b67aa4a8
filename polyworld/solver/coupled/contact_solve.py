"""Contact impulses of one inner step: non-penetration, restitution and Coulomb friction.

Gauss-Seidel over the contacts that act, warm started. Impulses are equal and opposite on the two sides, so linear
momentum is conserved to rounding; against a body they act at the same point, so angular momentum is too.
"""

import warp as wp

from polyworld.solver.coupled.contact_bodies import Carried
from polyworld.solver.coupled.contact_layout import (
    Contact,
    Found,
    Obstacles,
    Tally,
)
from polyworld.solver.coupled.contact_points import (
    follow,
    node_mobility,
    node_of,
    push,
    relative_velocity,
    tangential_impulse,
    weigh,
)
from polyworld.solver.coupled.contact_shapes import FAR
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.spatial.layout import OPTIONS, Body

wp.set_module_options(OPTIONS)

SWEEPS = 10
CONVERGED = wp.constant(wp.float64(1.0e-6))  # largest velocity change in a sweep that counts as none [m/s]
SLOWEST_IMPACT = wp.constant(wp.float64(1.0e-4))  # on top of the speed that gravity gives in two inner steps [m/s]
RECOVERY = wp.constant(wp.float64(0.01))  # time in which an overlap is removed [s]
OVERLAP_SPEED = wp.constant(wp.float64(0.5))  # at most [m/s]
WAIT = wp.constant(wp.float64(0.4))  # of the time to a touch at the speed of now, for which a contact is not looked at
LEAST_SPEED = wp.constant(wp.float64(0.1))  # that it may have got by then [m/s]


@wp.func(inline=False)
def solve(
    found: Found,
    count: int,
    sweeps: int,
    inverse_mass: wp.array2d[wp.float64],
    carried: Carried,
    bodies: wp.array2d[Body],
    v: wp.array2d[wp.vec3d],
    w: int,
) -> None:
    """Sweep over the acting contacts until no velocity changes any more."""
    for _sweep in range(sweeps):
        worst = wp.float64(0.0)
        for a in range(count):
            c = found.contacts[w, found.acting[w, a]]
            u = relative_velocity(c, bodies, v, w)
            before = c.impulse
            normal = wp.max(before + (c.target - wp.dot(c.normal, u)) / c.k, wp.float64(0.0))
            change = c.normal * (normal - before)
            worst = wp.max(worst, wp.abs(normal - before) * c.k)
            if c.step_friction > wp.float64(0.0) and (normal > wp.float64(0.0) or before > wp.float64(0.0)):
                if c.body >= 0:
                    push(c, change, inverse_mass, carried, bodies, v, w)
                    u = relative_velocity(c, bodies, v, w)
                    change = wp.vec3d()
                tangential = tangential_impulse(c, u, c.step_friction * normal)
                slip = tangential - c.tangential
                worst = wp.max(worst, wp.length(slip) * c.k11)
                found.contacts[w, found.acting[w, a]].tangential = tangential
                change += slip
            found.contacts[w, found.acting[w, a]].impulse = normal
            push(c, change, inverse_mass, carried, bodies, v, w)
        if worst < CONVERGED:
            break


@wp.func
def correct_overlap(
    c: Contact,
    pull: wp.vec3d,
    dt: wp.float64,
    nodes: Nodes,
    bodies: wp.array2d[Body],
    carried: Carried,
    found: Found,
    w: int,
) -> None:
    """Project nodes out of an overlap without changing velocities, and keep those that rest from falling.

    The move of the nodes takes half a step of gravity off their path, which is right for what flies; here it is put
    back. The impulses of held nodes are stored.
    """
    zero = wp.float64(0.0)
    lift = wp.vec3d()
    if c.impulse > zero and c.rebound == zero:
        rest = pull
        if c.body >= 0:
            rest = pull - (bodies[w, c.body].v - carried.before[w, c.body]) / dt
            if carried.flying[w, c.body] == 1:
                rest = pull - carried.acceleration[w, c.body]
        lift = rest * (wp.float64(0.5) * dt * dt)
    deeper = -c.gap - wp.max(wp.dot(c.normal, relative_velocity(c, bodies, nodes.v, w)), zero) * dt
    mobility = node_mobility(c, nodes.inverse_mass, w)
    shift = wp.vec3d()
    if c.impulse > zero and c.rebound != zero:
        shift = c.normal * (c.rebound / c.k)  # the nodes' share
    elif deeper > zero and mobility > zero:
        correction = wp.min(deeper * wp.min(dt / RECOVERY, wp.float64(1.0)), OVERLAP_SPEED * dt)
        shift = c.normal * (correction / mobility)
    for m in range(4):
        if c.weight[m] != zero:
            node = node_of(c, m)
            im = nodes.inverse_mass[w % nodes.inverse_mass.shape[0], node]
            if im > zero:
                nodes.x[w, node] += shift * (c.weight[m] * im) + lift * found.falling[w, node]
                if c.impulse > zero:
                    found.falling[w, node] = zero
            else:
                found.reaction[w, node] += (c.normal * c.impulse + c.tangential) * c.weight[m]


@wp.func
def note(c: Contact, tally: Tally, p: wp.vec3d, now: wp.float64, dt: wp.float64, w: int) -> None:
    """Add a contact's impulse to what its pair went through."""
    a = c.owner
    b = c.other
    if tally.impulse[w, a, b] == wp.float64(0.0):
        tally.begin[w, a, b] = now
        tally.first_impulse[w, a, b] = wp.float64(0.0)
        tally.speed[w, a, b] = wp.float64(0.0)
        tally.position[w, a, b] = p
    tally.impulse[w, a, b] += c.impulse
    if tally.begin[w, a, b] == now:
        tally.first_impulse[w, a, b] += c.impulse
        tally.speed[w, a, b] = wp.max(tally.speed[w, a, b], c.approach)
    tally.last[w, a, b] = now + dt


@wp.func
def act(
    c: Contact,
    dt: wp.float64,
    threshold: wp.float64,
    pull: wp.vec3d,
    nodes: Nodes,
    bodies: wp.array2d[Body],
    carried: Carried,
    w: int,
) -> Contact:
    """Check whether the contact acts in this inner step; return its target velocity, and FAR where it does not."""
    zero = wp.float64(0.0)
    u = relative_velocity(c, bodies, nodes.v, w)
    speed = wp.dot(c.normal, u)
    c.approach = -speed
    end = c.gap + speed * dt
    if end > zero and c.impulse == zero:
        c.wait = wp.int32(WAIT * c.gap / ((wp.length(u) + LEAST_SPEED) * dt))
        c.gap = FAR
        return c
    c = weigh(c, nodes.inverse_mass, carried, bodies, w)
    if c.k <= zero:
        c.gap = FAR
        return c
    fall = wp.float64(0.0)
    if c.body >= 0:
        fall = wp.dot(c.normal, carried.acceleration[w, c.body] - pull)
    c.step_friction = c.friction
    if c.body < 0 and c.gap > wp.float64(0.1) * c.reach:
        c.step_friction = zero  # impulses along two nodes that are apart would turn them
    c.target = -wp.max(c.gap, zero) / dt
    c.rebound = zero
    if c.impulse == zero and c.approach > threshold and end < zero and c.restitution > zero:
        # It hits after a part of the step, at the speed of then, and flies back for the rest.
        before = wp.clamp(c.gap / c.approach, zero, dt)
        after = dt - before
        back = c.restitution * c.approach - (wp.float64(1.0) + c.restitution) * fall * after
        if back > zero:
            c.target = back
            c.rebound = -wp.max(c.gap, zero) - back * before - wp.float64(0.5) * fall * before * (dt + after)
    c.tangential = c.tangential - c.normal * wp.dot(c.normal, c.tangential)
    return c


@wp.kernel
def push_on(clock: Clock, nodes: Nodes, bodies: wp.array2d[Body], carried: Carried, found: Found) -> None:
    """Contacts push as in the inner step before, so that implicit parts of a material see what rests at rest."""
    w = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    for k in range(found.count[w]):
        if found.contacts[w, k].impulse > wp.float64(0.0):
            c = found.contacts[w, k]
            c.given = c.normal * c.impulse + c.tangential
            found.contacts[w, k].given = c.given
            push(c, c.given, nodes.inverse_mass, carried, bodies, nodes.v, w)


@wp.kernel
def solve_contacts(
    clock: Clock, nodes: Nodes, obstacles: Obstacles, carried: Carried, across: wp.vec3d, found: Found, tally: Tally
) -> None:
    """Change the nodes' and bodies' velocities so that nothing overlaps at the end of the inner step."""
    w = wp.tid()
    dt = clock.dt[w]
    if dt <= wp.float64(0.0) or found.count[w] == 0:
        return
    zero = wp.float64(0.0)
    pull = clock.gravity[w % clock.gravity.shape[0]]
    threshold = wp.float64(2.0) * wp.length(pull) * dt + SLOWEST_IMPACT
    count = wp.int32(0)
    sweeps = wp.int32(1)
    last = wp.int32(-1)
    for k in range(found.count[w]):
        if found.contacts[w, k].wait > 0:
            found.contacts[w, k].wait -= 1
            continue
        c = follow(found.contacts[w, k], obstacles, across, nodes.x, w)
        if c.gap < FAR:
            c = act(c, dt, threshold, pull, nodes, obstacles.bodies, carried, w)
        if c.gap < FAR:
            found.acting[w, count] = k
            count += 1
            if c.n0 == last or c.weight[1] != zero:
                sweeps = SWEEPS
            if c.body >= 0 and obstacles.bodies[w, c.body].inverse_mass > zero:
                sweeps = SWEEPS
            last = c.n0
        else:
            if c.impulse > zero:
                push(c, -c.given, nodes.inverse_mass, carried, obstacles.bodies, nodes.v, w)
            c.impulse = zero
            c.tangential = wp.vec3d()
        found.contacts[w, k] = c
    if count == 0:
        return
    for a in range(count):
        if found.contacts[w, found.acting[w, a]].impulse > zero:
            c = found.contacts[w, found.acting[w, a]]
            lack = c.normal * c.impulse + c.tangential - c.given
            push(c, lack, nodes.inverse_mass, carried, obstacles.bodies, nodes.v, w)
    solve(found, count, sweeps, nodes.inverse_mass, carried, obstacles.bodies, nodes.v, w)
    now = clock.time[w] + wp.float64(clock.inner[0]) * dt
    for a in range(count):
        k = found.acting[w, a]
        if found.contacts[w, k].impulse == zero and found.contacts[w, k].gap >= zero:
            continue
        c = found.contacts[w, k]
        correct_overlap(c, pull, dt, nodes, obstacles.bodies, carried, found, w)
        if tally.record == 1 and c.impulse > zero:
            note(c, tally, nodes.x[w, c.n0], now, dt, w)
    for a in range(count):
        if found.contacts[w, found.acting[w, a]].impulse == zero:
            continue
        c = found.contacts[w, found.acting[w, a]]
        for m in range(4):
            if c.weight[m] != zero:
                found.falling[w, node_of(c, m)] = wp.float64(1.0)
