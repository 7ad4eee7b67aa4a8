"""Kernels that hold nodes to the world, to rigid bodies and to other deformable objects."""

import warp as wp

from polyworld.solver.coupled.attachment_layout import Fastenings, Motion, OnBodies, OnNodes, OnWorld
from polyworld.solver.coupled.mechanism import Mechanisms
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.spatial.layout import OPTIONS, Body

wp.set_module_options(OPTIONS)

DRIFT_SHARE = wp.constant(wp.float64(0.1))  # of a node's distance from its target, removed in an inner step
SWEEPS = 20
CONVERGED = wp.constant(wp.float64(1.0e-9))  # largest velocity change in a sweep that counts as none [m/s]


@wp.func
def displaced(motion: Motion, a: int, time: wp.float64) -> wp.vec3d:
    """Displacement of attachment a at a time: linear between rows, the first before and the last after them."""
    low = motion.first[a]
    high = motion.first[a + 1] - 1
    if high < low:
        return wp.vec3d()
    if time <= motion.time[low]:
        return motion.displacement[low]
    if time >= motion.time[high]:
        return motion.displacement[high]
    while high - low > 1:
        middle = (low + high) / 2
        if motion.time[middle] <= time:
            low = middle
        else:
            high = middle
    part = (time - motion.time[low]) / (motion.time[high] - motion.time[low])
    return motion.displacement[low] * (wp.float64(1.0) - part) + motion.displacement[high] * part


@wp.kernel
def begin_step(clock: Clock, f: Fastenings) -> None:
    """Compute mean forces of the last coupling step; release attachments at their time or beyond their strength."""
    w, a = wp.tid()
    if clock.h[w] <= wp.float64(0.0):
        return
    if f.last_h[w] > wp.float64(0.0):
        f.force[w, a] = f.impulse[w, a] / f.last_h[w]
    f.impulse[w, a] = wp.vec3d()
    if f.released[w, a] == 1:
        f.force[w, a] = wp.vec3d()
        return
    broken = f.strength[a] >= wp.float64(0.0) and wp.length(f.force[w, a]) > f.strength[a]
    if broken or clock.time[w] >= f.release[a] - wp.float64(1.0e-9):
        f.released[w, a] = 1
        f.when[w, a] = clock.time[w]


@wp.kernel
def note_length(clock: Clock, f: Fastenings) -> None:
    w = wp.tid()
    if clock.h[w] > wp.float64(0.0):
        f.last_h[w] = clock.h[w]


@wp.kernel
def free_nodes(clock: Clock, nodes: Nodes, held: OnWorld, f: Fastenings) -> None:
    """Nodes get their mass back where no attachment holds them any more."""
    w = wp.tid()
    if clock.h[w] <= wp.float64(0.0):
        return
    for k in range(held.node.shape[0]):
        if f.released[w, held.attachment[k]] == 1 and f.when[w, held.attachment[k]] >= wp.float64(0.0):
            nodes.inverse_mass[w, held.node[k]] = wp.float64(1.0) / nodes.mass[w % nodes.mass.shape[0], held.node[k]]
    for k in range(held.node.shape[0]):
        if f.released[w, held.attachment[k]] == 0:
            nodes.inverse_mass[w, held.node[k]] = wp.float64(0.0)


@wp.kernel
def resist_forces(clock: Clock, nodes: Nodes, held: OnWorld, f: Fastenings) -> None:
    """Held nodes do not follow the forces on them: the attachment takes these."""
    w = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    for k in range(held.node.shape[0]):
        a = held.attachment[k]
        if f.released[w, a] == 0 and nodes.active[w, held.node[k]] == 1:
            f.impulse[w, a] -= nodes.f[w, held.node[k]] * clock.dt[w]


@wp.kernel
def hold_to_world(
    clock: Clock, nodes: Nodes, held: OnWorld, motion: Motion, reaction: wp.array2d[wp.vec3d], f: Fastenings
) -> None:
    """Velocities that take held nodes to where they are led; what that costs is the attachment's impulse."""
    w = wp.tid()
    t = clock.dt[w]
    if t <= wp.float64(0.0):
        return
    now = clock.time[w] + wp.float64(clock.inner[0] + 1) * t
    for k in range(held.node.shape[0]):
        i = held.node[k]
        a = held.attachment[k]
        if f.released[w, a] == 1 or nodes.active[w, i] == 0:
            continue
        u = (held.position[w, k] + displaced(motion, a, now) - nodes.x[w, i]) / t
        m = nodes.mass[w % nodes.mass.shape[0], i]
        f.impulse[w, a] += (u - nodes.v[w, i]) * m - reaction[w, i]
        reaction[w, i] = wp.vec3d()
        nodes.v[w, i] = u


@wp.func
def inertia_of(arm: wp.vec3d, mass: wp.float64) -> wp.mat33d:
    """Inertia of a point mass about the origin."""
    return (wp.identity(n=3, dtype=wp.float64) * wp.dot(arm, arm) - wp.outer(arm, arm)) * mass


@wp.kernel
def push_on_bodies(
    clock: Clock, nodes: Nodes, bodies: wp.array2d[Body], m: Mechanisms, held: OnBodies, f: Fastenings
) -> None:
    """Nodes and bodies push each other as in the inner step before, so that damping sees what is held at rest.

    Bodies on joints are left to `attachment_jointed`.
    """
    w, g = wp.tid()
    b = held.body[g]
    if clock.dt[w] <= wp.float64(0.0) or bodies[w, b].active == 0 or m.first[b] >= 0:
        return
    rotation = bodies[w, b].rotation
    ease = rotation * bodies[w, b].inverse_inertia * wp.transpose(rotation) * bodies[w, b].inverse_mass
    for k in range(held.first[g], held.first[g + 1]):
        i = held.node[k]
        if f.released[w, held.attachment[k]] == 1 or nodes.active[w, i] == 0:
            held.last[w, k] = wp.vec3d()
            continue
        impulse = held.last[w, k]
        nodes.v[w, i] += impulse * nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i]
        bodies[w, b].v -= impulse * bodies[w, b].inverse_mass
        bodies[w, b].w -= ease * wp.cross(nodes.x[w, i] - bodies[w, b].x, impulse)


@wp.kernel
def push_on_nodes(clock: Clock, nodes: Nodes, held: OnNodes, f: Fastenings) -> None:
    """Add the same for nodes held to other nodes."""
    w = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    r = w % nodes.inverse_mass.shape[0]
    for k in range(held.node.shape[0]):
        i = held.node[k]
        n = held.target[k]
        if f.released[w, held.attachment[k]] == 1 or nodes.active[w, i] == 0 or nodes.active[w, n[0]] == 0:
            held.last[w, k] = wp.vec3d()
            continue
        third = wp.max(n[2], 0)
        nodes.v[w, i] += held.last[w, k] * nodes.inverse_mass[r, i]
        nodes.v[w, n[0]] -= held.last[w, k] * (held.weight[k][0] * nodes.inverse_mass[r, n[0]])
        nodes.v[w, n[1]] -= held.last[w, k] * (held.weight[k][1] * nodes.inverse_mass[r, n[1]])
        nodes.v[w, third] -= held.last[w, k] * (held.weight[k][2] * nodes.inverse_mass[r, third])


@wp.kernel
def hold_to_bodies(
    clock: Clock, nodes: Nodes, bodies: wp.array2d[Body], mechanisms: Mechanisms, held: OnBodies, f: Fastenings
) -> None:
    """Move a body and the nodes held to it as one rigid body, with their total linear and angular momentum.

    That is the exact solution of all the fastenings at once. Nodes off their targets approach them meanwhile, and
    the momentum of that is taken from the others. Bodies on joints are left to `attachment_jointed`.
    """
    w, g = wp.tid()
    t = clock.dt[w]
    b = held.body[g]
    if t <= wp.float64(0.0) or bodies[w, b].active == 0 or mechanisms.first[b] >= 0:
        return
    centre = bodies[w, b].x
    rotation = bodies[w, b].rotation
    m = bodies[w, b].mass
    total = m
    inertia = rotation * bodies[w, b].inertia * wp.transpose(rotation) * m
    momentum = bodies[w, b].v * m
    spin = inertia * bodies[w, b].w
    first_moment = wp.vec3d()
    count = wp.int32(0)
    for k in range(held.first[g], held.first[g + 1]):
        i = held.node[k]
        if f.released[w, held.attachment[k]] == 1 or nodes.active[w, i] == 0:
            continue
        if nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i] == wp.float64(0.0):
            continue
        m = nodes.mass[w % nodes.mass.shape[0], i]
        arm = nodes.x[w, i] - centre
        drift = (rotation * held.position[w, k] - arm) * (DRIFT_SHARE / t)
        p = (nodes.v[w, i] - drift) * m
        momentum += p
        spin += wp.cross(arm, p)
        total += m
        first_moment += arm * m
        inertia += inertia_of(arm, m)
        count += 1
    if count == 0:
        return
    inertia -= inertia_of(first_moment, wp.float64(1.0) / total)
    turning = wp.inverse(inertia) * (spin - wp.cross(first_moment, momentum) / total)
    velocity = (momentum - wp.cross(turning, first_moment)) / total
    bodies[w, b].v = velocity
    bodies[w, b].w = turning
    for k in range(held.first[g], held.first[g + 1]):
        i = held.node[k]
        if f.released[w, held.attachment[k]] == 1 or nodes.active[w, i] == 0:
            continue
        if nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i] == wp.float64(0.0):
            continue
        arm = nodes.x[w, i] - centre
        u = velocity + wp.cross(turning, arm) + (rotation * held.position[w, k] - arm) * (DRIFT_SHARE / t)
        held.last[w, k] += (u - nodes.v[w, i]) * nodes.mass[w % nodes.mass.shape[0], i]
        f.impulse[w, held.attachment[k]] += held.last[w, k]
        nodes.v[w, i] = u


@wp.func
def offset_of(x: wp.array2d[wp.vec3d], w: int, n: wp.vec3i, local: wp.vec3d) -> wp.vec3d:
    """Return in world axes an offset kept in a triangle's, or for a segment (third node negative) in the world's."""
    if n[2] < 0:
        return local
    along = wp.normalize(x[w, n[1]] - x[w, n[0]])
    normal = wp.normalize(wp.cross(along, x[w, n[2]] - x[w, n[0]]))
    return along * local[0] + wp.cross(normal, along) * local[1] + normal * local[2]


@wp.kernel
def hold_to_nodes(clock: Clock, nodes: Nodes, held: OnNodes, f: Fastenings) -> None:
    """Gauss-Seidel over nodes held to a point of another deformable object, warm started with the last impulses."""
    w = wp.tid()
    t = clock.dt[w]
    if t <= wp.float64(0.0):
        return
    zero = wp.float64(0.0)
    x = nodes.x
    v = nodes.v
    mobility = nodes.inverse_mass
    r = w % mobility.shape[0]
    for sweep in range(SWEEPS):
        worst = wp.float64(0.0)
        for k in range(held.node.shape[0]):
            i = held.node[k]
            n = held.target[k]
            if f.released[w, held.attachment[k]] == 1 or nodes.active[w, i] == 0 or nodes.active[w, n[0]] == 0:
                continue
            b = held.weight[k]
            third = wp.max(n[2], 0)
            ease = mobility[r, i] + b[0] * b[0] * mobility[r, n[0]] + b[1] * b[1] * mobility[r, n[1]]
            ease += b[2] * b[2] * mobility[r, third]
            if ease <= zero:
                continue
            if sweep == 0:
                point = x[w, n[0]] * b[0] + x[w, n[1]] * b[1] + x[w, third] * b[2] + offset_of(x, w, n, held.offset[k])
                held.wanted[w, k] = (point - x[w, i]) * (DRIFT_SHARE / t)
            u = v[w, i] - v[w, n[0]] * b[0] - v[w, n[1]] * b[1] - v[w, third] * b[2]
            change = (held.wanted[w, k] - u) / ease
            held.last[w, k] += change
            worst = wp.max(worst, wp.length(change) * ease)
            v[w, i] += change * mobility[r, i]
            v[w, n[0]] -= change * (b[0] * mobility[r, n[0]])
            v[w, n[1]] -= change * (b[1] * mobility[r, n[1]])
            v[w, third] -= change * (b[2] * mobility[r, third])
        if worst < CONVERGED:
            break
    for k in range(held.node.shape[0]):
        f.impulse[w, held.attachment[k]] += held.last[w, k]
