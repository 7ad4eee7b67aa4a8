"""Kernels that hold nodes to rigid bodies on joints."""

import warp as wp

from polyworld.effects.law import wrench
from polyworld.solver.coupled.attachment_kernels import DRIFT_SHARE, inertia_of
from polyworld.solver.coupled.attachment_layout import Fastenings, OnBodies
from polyworld.solver.coupled.mechanism import Mechanisms, own_response, push_mechanism
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.spatial.layout import OPTIONS, Body

wp.set_module_options(OPTIONS)

SWEEPS = 10  # over the bodies of a world, where joints hold together some that hold nodes
CONVERGED = wp.constant(wp.float64(1.0e-9))  # largest velocity change in a sweep that counts as none [m/s or rad/s]


@wp.func(inline=False)
def solve_six(matrix: wp.spatial_matrixd, right: wp.spatial_vectord) -> wp.spatial_vectord:
    """Solve six linear equations: Gaussian elimination with partial pivoting."""
    a = matrix
    b = right
    for c in range(6):
        best = c
        for r in range(c + 1, 6):
            if wp.abs(a[r, c]) > wp.abs(a[best, c]):
                best = r
        for k in range(6):
            kept = a[c, k]
            a[c, k] = a[best, k]
            a[best, k] = kept
        kept = b[c]
        b[c] = b[best]
        b[best] = kept
        for r in range(c + 1, 6):
            share = a[r, c] / a[c, c]
            for k in range(c, 6):
                a[r, k] = a[r, k] - share * a[c, k]
            b[r] = b[r] - share * b[c]
    for back in range(6):
        r = 5 - back
        value = b[r]
        for k in range(r + 1, 6):
            value -= a[r, k] * b[k]
        b[r] = value / a[r, r]
    return b


@wp.func
def holds(nodes: Nodes, held: OnBodies, f: Fastenings, w: int, k: int) -> bool:
    """Check whether the k-th node is held at this moment, and moves."""
    i = held.node[k]
    if f.released[w, held.attachment[k]] == 1 or nodes.active[w, i] == 0:
        return False
    return nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i] > wp.float64(0.0)


@wp.kernel
def push_on_jointed(
    clock: Clock, nodes: Nodes, bodies: wp.array2d[Body], m: Mechanisms, held: OnBodies, f: Fastenings
) -> None:
    """Nodes and jointed bodies push each other as in the inner step before."""
    w = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    for g in range(held.body.shape[0]):
        b = held.body[g]
        if m.first[b] < 0 or bodies[w, b].active == 0:
            continue
        for k in range(held.first[g], held.first[g + 1]):
            i = held.node[k]
            if not holds(nodes, held, f, w, k):
                held.last[w, k] = wp.vec3d()
                continue
            impulse = held.last[w, k]
            nodes.v[w, i] += impulse * nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i]
            push_mechanism(m, bodies, w, b, -impulse, wp.cross(impulse, nodes.x[w, i] - bodies[w, b].x))


@wp.func(inline=False)
def hold_group(
    nodes: Nodes, bodies: wp.array2d[Body], m: Mechanisms, held: OnBodies, f: Fastenings, w: int, g: int, t: wp.float64
) -> wp.float64:
    """Give a body and the nodes held to it one rigid motion. Returns the largest change of the body's velocities.

    With the response A of the body, and of the nodes, in the body's motion, inertia N and momentum h, an impulse P
    passes from them to it: V' = V + A P and N V' = h - P, so that (1 + A N) V' = V + A h.
    """
    b = held.body[g]
    centre = bodies[w, b].x
    rotation = bodies[w, b].rotation
    momentum = wp.vec3d()
    spin = wp.vec3d()
    total = wp.float64(0.0)
    first_moment = wp.vec3d()
    about = wp.mat33d()
    for k in range(held.first[g], held.first[g + 1]):
        if holds(nodes, held, f, w, k):
            i = held.node[k]
            mass = nodes.mass[w % nodes.mass.shape[0], i]
            arm = nodes.x[w, i] - centre
            drift = (rotation * held.position[w, k] - arm) * (DRIFT_SHARE / t)
            p = (nodes.v[w, i] - drift) * mass
            momentum += p
            spin += wp.cross(arm, p)
            total += mass
            first_moment += arm * mass
            about += inertia_of(arm, mass)
    if total == wp.float64(0.0):
        return wp.float64(0.0)
    skew = wp.skew(first_moment)
    inertia = wp.spatial_matrixd()
    for r in range(3):
        inertia[r, r] = total
        for c in range(3):
            inertia[r, c + 3] = -skew[r, c]
            inertia[r + 3, c] = skew[r, c]
            inertia[r + 3, c + 3] = about[r, c]
    response = own_response(m, w, b)
    matrix = response * inertia
    for r in range(6):
        matrix[r, r] = matrix[r, r] + wp.float64(1.0)
    own = wrench(momentum, spin)
    before = wrench(bodies[w, b].v, bodies[w, b].w)
    after = solve_six(matrix, before + response * own)
    passed = own - inertia * after
    push_mechanism(m, bodies, w, b, wp.spatial_top(passed), wp.spatial_bottom(passed))
    bodies[w, b].v = wp.spatial_top(after)
    bodies[w, b].w = wp.spatial_bottom(after)
    for k in range(held.first[g], held.first[g + 1]):
        if holds(nodes, held, f, w, k):
            i = held.node[k]
            arm = nodes.x[w, i] - centre
            u = bodies[w, b].v + wp.cross(bodies[w, b].w, arm)
            u += (rotation * held.position[w, k] - arm) * (DRIFT_SHARE / t)
            held.last[w, k] += (u - nodes.v[w, i]) * nodes.mass[w % nodes.mass.shape[0], i]
            nodes.v[w, i] = u
    return wp.length(after - before)


@wp.kernel
def hold_to_jointed(
    clock: Clock, nodes: Nodes, bodies: wp.array2d[Body], m: Mechanisms, held: OnBodies, f: Fastenings
) -> None:
    """Move jointed bodies and the nodes held to them as one: Gauss-Seidel over these bodies."""
    w = wp.tid()
    t = clock.dt[w]
    if t <= wp.float64(0.0):
        return
    for _sweep in range(SWEEPS):
        worst = wp.float64(0.0)
        for g in range(held.body.shape[0]):
            if m.first[held.body[g]] >= 0 and bodies[w, held.body[g]].active == 1:
                worst = wp.max(worst, hold_group(nodes, bodies, m, held, f, w, g, t))
        if worst < CONVERGED:
            break
    for g in range(held.body.shape[0]):
        if m.first[held.body[g]] >= 0 and bodies[w, held.body[g]].active == 1:
            for k in range(held.first[g], held.first[g + 1]):
                if holds(nodes, held, f, w, k):
                    f.impulse[w, held.attachment[k]] += held.last[w, k]
