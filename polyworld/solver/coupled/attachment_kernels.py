"""Kernels that hold nodes to the world, to rigid bodies and to other deformable objects."""

import warp as wp

from polyworld.solver.spatial.layout import OPTIONS, Body

wp.set_module_options(OPTIONS)

DRIFT_SHARE = wp.constant(wp.float64(0.1))  # of a node's distance from its target, removed in an inner step
SWEEPS = 20
CONVERGED = wp.constant(wp.float64(1.0e-9))  # largest velocity change in a sweep that counts as none [m/s]


@wp.struct
class Fastenings:
    """Attachments (A,) and what they hold, element arrays (W, m) or (m,).

    released (W, A): 1 after its release, at `when` [s]. impulse (W, A): given to the deformable object in this
    coupling step; force: mean of the last one. release (A,): NaN for never; strength: negative for unbreakable.
    """

    released: wp.array2d[wp.int32]
    when: wp.array2d[wp.float64]
    impulse: wp.array2d[wp.vec3d]
    force: wp.array2d[wp.vec3d]
    release: wp.array[wp.float64]
    strength: wp.array[wp.float64]


@wp.struct
class Motion:
    """Rows (time, displacement) of all motions: those of attachment a are first[a] to first[a + 1]."""

    first: wp.array[wp.int32]
    time: wp.array[wp.float64]
    displacement: wp.array[wp.vec3d]


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
def begin_step(
    time: wp.array[wp.float64], h: wp.array[wp.float64], last_h: wp.array[wp.float64], f: Fastenings
) -> None:
    """Compute mean forces of the last coupling step; release attachments at their time or beyond their strength."""
    w, a = wp.tid()
    if h[w] <= wp.float64(0.0):
        return
    if last_h[w] > wp.float64(0.0):
        f.force[w, a] = f.impulse[w, a] / last_h[w]
    f.impulse[w, a] = wp.vec3d()
    if f.released[w, a] == 1:
        f.force[w, a] = wp.vec3d()
        return
    broken = f.strength[a] >= wp.float64(0.0) and wp.length(f.force[w, a]) > f.strength[a]
    if broken or time[w] >= f.release[a] - wp.float64(1.0e-9):
        f.released[w, a] = 1
        f.when[w, a] = time[w]


@wp.kernel
def note_length(h: wp.array[wp.float64], last_h: wp.array[wp.float64]) -> None:
    w = wp.tid()
    if h[w] > wp.float64(0.0):
        last_h[w] = h[w]


@wp.kernel
def free_nodes(
    h: wp.array[wp.float64],
    node: wp.array[wp.int32],
    attachment: wp.array[wp.int32],
    mass: wp.array2d[wp.float64],
    inverse_mass: wp.array2d[wp.float64],
    f: Fastenings,
) -> None:
    """Nodes get their mass back where no attachment holds them any more."""
    w = wp.tid()
    if h[w] <= wp.float64(0.0):
        return
    for k in range(node.shape[0]):
        if f.released[w, attachment[k]] == 1 and f.when[w, attachment[k]] >= wp.float64(0.0):
            inverse_mass[w, node[k]] = wp.float64(1.0) / mass[w % mass.shape[0], node[k]]
    for k in range(node.shape[0]):
        if f.released[w, attachment[k]] == 0:
            inverse_mass[w, node[k]] = wp.float64(0.0)


@wp.kernel
def resist_forces(
    dt: wp.array[wp.float64],
    node: wp.array[wp.int32],
    attachment: wp.array[wp.int32],
    active: wp.array2d[wp.int32],
    force: wp.array2d[wp.vec3d],
    f: Fastenings,
) -> None:
    """Held nodes do not follow the forces on them: the attachment takes these."""
    w = wp.tid()
    if dt[w] <= wp.float64(0.0):
        return
    for k in range(node.shape[0]):
        a = attachment[k]
        if f.released[w, a] == 0 and active[w, node[k]] == 1:
            f.impulse[w, a] -= force[w, node[k]] * dt[w]


@wp.kernel
def hold_to_world(
    time: wp.array[wp.float64],
    dt: wp.array[wp.float64],
    inner: wp.array[wp.int32],
    node: wp.array[wp.int32],
    attachment: wp.array[wp.int32],
    position: wp.array2d[wp.vec3d],
    motion: Motion,
    mass: wp.array2d[wp.float64],
    active: wp.array2d[wp.int32],
    x: wp.array2d[wp.vec3d],
    v: wp.array2d[wp.vec3d],
    reaction: wp.array2d[wp.vec3d],
    f: Fastenings,
) -> None:
    """Velocities that take held nodes to where they are led; what that costs is the attachment's impulse."""
    w = wp.tid()
    t = dt[w]
    if t <= wp.float64(0.0):
        return
    now = time[w] + wp.float64(inner[0] + 1) * t
    for k in range(node.shape[0]):
        i = node[k]
        a = attachment[k]
        if f.released[w, a] == 1 or active[w, i] == 0:
            continue
        u = (position[w, k] + displaced(motion, a, now) - x[w, i]) / t
        m = mass[w % mass.shape[0], i]
        f.impulse[w, a] += (u - v[w, i]) * m - reaction[w, i]
        reaction[w, i] = wp.vec3d()
        v[w, i] = u


@wp.func
def inertia_of(arm: wp.vec3d, mass: wp.float64) -> wp.mat33d:
    """Inertia of a point mass about the origin."""
    return (wp.identity(n=3, dtype=wp.float64) * wp.dot(arm, arm) - wp.outer(arm, arm)) * mass


@wp.kernel
def push_on_bodies(
    dt: wp.array[wp.float64],
    body: wp.array[wp.int32],
    first: wp.array[wp.int32],
    node: wp.array[wp.int32],
    attachment: wp.array[wp.int32],
    inverse_mass: wp.array2d[wp.float64],
    active: wp.array2d[wp.int32],
    bodies: wp.array2d[Body],
    x: wp.array2d[wp.vec3d],
    v: wp.array2d[wp.vec3d],
    last: wp.array2d[wp.vec3d],
    f: Fastenings,
) -> None:
    """Nodes and bodies push each other as in the inner step before, so that damping sees what is held at rest."""
    w, g = wp.tid()
    b = body[g]
    if dt[w] <= wp.float64(0.0) or bodies[w, b].active == 0:
        return
    rotation = bodies[w, b].rotation
    ease = rotation * bodies[w, b].inverse_inertia * wp.transpose(rotation) * bodies[w, b].inverse_mass
    for k in range(first[g], first[g + 1]):
        i = node[k]
        if f.released[w, attachment[k]] == 1 or active[w, i] == 0:
            last[w, k] = wp.vec3d()
            continue
        impulse = last[w, k]
        v[w, i] += impulse * inverse_mass[w % inverse_mass.shape[0], i]
        bodies[w, b].v -= impulse * bodies[w, b].inverse_mass
        bodies[w, b].w -= ease * wp.cross(x[w, i] - bodies[w, b].x, impulse)


@wp.kernel
def push_on_nodes(
    dt: wp.array[wp.float64],
    node: wp.array[wp.int32],
    attachment: wp.array[wp.int32],
    target: wp.array[wp.vec3i],
    weight: wp.array[wp.vec3d],
    inverse_mass: wp.array2d[wp.float64],
    active: wp.array2d[wp.int32],
    v: wp.array2d[wp.vec3d],
    last: wp.array2d[wp.vec3d],
    f: Fastenings,
) -> None:
    """Add the same for nodes held to other nodes."""
    w = wp.tid()
    if dt[w] <= wp.float64(0.0):
        return
    r = w % inverse_mass.shape[0]
    for k in range(node.shape[0]):
        i = node[k]
        n = target[k]
        if f.released[w, attachment[k]] == 1 or active[w, i] == 0 or active[w, n[0]] == 0:
            last[w, k] = wp.vec3d()
            continue
        third = wp.max(n[2], 0)
        v[w, i] += last[w, k] * inverse_mass[r, i]
        v[w, n[0]] -= last[w, k] * (weight[k][0] * inverse_mass[r, n[0]])
        v[w, n[1]] -= last[w, k] * (weight[k][1] * inverse_mass[r, n[1]])
        v[w, third] -= last[w, k] * (weight[k][2] * inverse_mass[r, third])


@wp.kernel
def hold_to_bodies(
    dt: wp.array[wp.float64],
    body: wp.array[wp.int32],
    first: wp.array[wp.int32],
    node: wp.array[wp.int32],
    attachment: wp.array[wp.int32],
    position: wp.array2d[wp.vec3d],
    mass: wp.array2d[wp.float64],
    inverse_mass: wp.array2d[wp.float64],
    active: wp.array2d[wp.int32],
    bodies: wp.array2d[Body],
    x: wp.array2d[wp.vec3d],
    v: wp.array2d[wp.vec3d],
    last: wp.array2d[wp.vec3d],
    f: Fastenings,
) -> None:
    """Move a body and the nodes held to it as one rigid body, with their total linear and angular momentum.

    That is the exact solution of all the fastenings at once. Nodes off their targets approach them meanwhile, and
    the momentum of that is taken from the others.
    """
    w, g = wp.tid()
    t = dt[w]
    b = body[g]
    if t <= wp.float64(0.0) or bodies[w, b].active == 0:
        return
    centre = bodies[w, b].x
    rotation = bodies[w, b].rotation
    m = bodies[w, b].mass
    total = m
    inertia = rotation * bodies[w, b].inertia * wp.transpose(rotation) * m
    momentum = bodies[w, b].v * m
    spin = inertia * bodies[w, b].w
    first_moment = wp.vec3d()
    held = wp.int32(0)
    for k in range(first[g], first[g + 1]):
        i = node[k]
        if f.released[w, attachment[k]] == 1 or active[w, i] == 0:
            continue
        if inverse_mass[w % inverse_mass.shape[0], i] == wp.float64(0.0):
            continue
        m = mass[w % mass.shape[0], i]
        arm = x[w, i] - centre
        drift = (rotation * position[w, k] - arm) * (DRIFT_SHARE / t)
        p = (v[w, i] - drift) * m
        momentum += p
        spin += wp.cross(arm, p)
        total += m
        first_moment += arm * m
        inertia += inertia_of(arm, m)
        held += 1
    if held == 0:
        return
    inertia -= inertia_of(first_moment, wp.float64(1.0) / total)
    turning = wp.inverse(inertia) * (spin - wp.cross(first_moment, momentum) / total)
    velocity = (momentum - wp.cross(turning, first_moment)) / total
    bodies[w, b].v = velocity
    bodies[w, b].w = turning
    for k in range(first[g], first[g + 1]):
        i = node[k]
        if f.released[w, attachment[k]] == 1 or active[w, i] == 0:
            continue
        if inverse_mass[w % inverse_mass.shape[0], i] == wp.float64(0.0):
            continue
        arm = x[w, i] - centre
        u = velocity + wp.cross(turning, arm) + (rotation * position[w, k] - arm) * (DRIFT_SHARE / t)
        last[w, k] += (u - v[w, i]) * mass[w % mass.shape[0], i]
        f.impulse[w, attachment[k]] += last[w, k]
        v[w, i] = u


@wp.func
def offset_of(x: wp.array2d[wp.vec3d], w: int, n: wp.vec3i, local: wp.vec3d) -> wp.vec3d:
    """Return in world axes an offset kept in a triangle's, or for a segment (third node negative) in the world's."""
    if n[2] < 0:
        return local
    along = wp.normalize(x[w, n[1]] - x[w, n[0]])
    normal = wp.normalize(wp.cross(along, x[w, n[2]] - x[w, n[0]]))
    return along * local[0] + wp.cross(normal, along) * local[1] + normal * local[2]


@wp.kernel
def hold_to_nodes(
    dt: wp.array[wp.float64],
    node: wp.array[wp.int32],
    attachment: wp.array[wp.int32],
    target: wp.array[wp.vec3i],
    weight: wp.array[wp.vec3d],
    offset: wp.array[wp.vec3d],
    inverse_mass: wp.array2d[wp.float64],
    active: wp.array2d[wp.int32],
    x: wp.array2d[wp.vec3d],
    v: wp.array2d[wp.vec3d],
    last: wp.array2d[wp.vec3d],
    wanted: wp.array2d[wp.vec3d],
    f: Fastenings,
) -> None:
    """Gauss-Seidel over nodes held to a point of another deformable object, warm started with the last impulses."""
    w = wp.tid()
    t = dt[w]
    if t <= wp.float64(0.0):
        return
    zero = wp.float64(0.0)
    r = w % inverse_mass.shape[0]
    for sweep in range(SWEEPS):
        worst = wp.float64(0.0)
        for k in range(node.shape[0]):
            i = node[k]
            n = target[k]
            if f.released[w, attachment[k]] == 1 or active[w, i] == 0 or active[w, n[0]] == 0:
                continue
            b = weight[k]
            third = wp.max(n[2], 0)
            ease = inverse_mass[r, i] + b[0] * b[0] * inverse_mass[r, n[0]] + b[1] * b[1] * inverse_mass[r, n[1]]
            ease += b[2] * b[2] * inverse_mass[r, third]
            if ease <= zero:
                continue
            if sweep == 0:
                position = x[w, n[0]] * b[0] + x[w, n[1]] * b[1] + x[w, third] * b[2] + offset_of(x, w, n, offset[k])
                wanted[w, k] = (position - x[w, i]) * (DRIFT_SHARE / t)
            u = v[w, i] - v[w, n[0]] * b[0] - v[w, n[1]] * b[1] - v[w, third] * b[2]
            change = (wanted[w, k] - u) / ease
            last[w, k] += change
            worst = wp.max(worst, wp.length(change) * ease)
            v[w, i] += change * inverse_mass[r, i]
            v[w, n[0]] -= change * (b[0] * inverse_mass[r, n[0]])
            v[w, n[1]] -= change * (b[1] * inverse_mass[r, n[1]])
            v[w, third] -= change * (b[2] * inverse_mass[r, third])
        if worst < CONVERGED:
            break
    for k in range(node.shape[0]):
        f.impulse[w, attachment[k]] += last[w, k]
