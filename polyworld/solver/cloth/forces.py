"""Forces of every triangle on its corners: membrane, bending, air.

Membrane: the strain is that of the stretch tensor, E = U - 1 with U^2 = F^T F (Biot strain), and the stress conjugate
to it is linear in E, so that the force per width is exactly proportional to the extension at any stretch, nothing
weakens under compression, and no stiffness exceeds that at rest. With T this stress, the second Piola-Kirchhoff
stress S follows from U S + S U = 2 T, solved in closed form for 2 x 2 matrices.
"""

import warp as wp

from polyworld.solver.cloth.layout import BLOCK, FLATTEST, OPTIONS, Bending, Damping, Material, Surface, drift
from polyworld.solver.coupled.nodes import Clock, Nodes

wp.set_module_options(OPTIONS)


@wp.func
def air_drag(m: Material, n: wp.vec3d, ratio: wp.float64, u: wp.vec3d, ahead: wp.vec3d, h: wp.float64) -> wp.vec3d:
    """Force per rest area of air that passes a triangle, across and along it, each quadratic in its speed.

    u: the air's velocity past it now, ahead: what gravity makes of it in the step; ratio: area over rest area. Linearly
    implicit, -k |v| v' with v' = (v + g h) / (1 + k |v| h): no step overshoots, and terminal speeds are exact.
    """
    one = wp.float64(1.0)
    along = u - n * wp.dot(n, u)
    next_n = wp.dot(n, ahead)
    k_n = m.drag_normal * ratio * wp.abs(wp.dot(n, u))
    k_t = m.drag_tangential * ratio * wp.length(along)
    slow_n = one + k_n * h * m.inverse_density
    slow_t = one + k_t * h * m.inverse_density
    inverse = one / (slow_n * slow_t)
    return n * (next_n * k_n * slow_t * inverse) + (ahead - n * next_n) * (k_t * slow_n * inverse)


@wp.func
def add_force(
    h: wp.float64, gravity: wp.vec3d, nodes: Nodes, surface: Surface, bending: Bending, damping: Damping, w: int, t: int
) -> None:
    one = wp.float64(1.0)
    m = surface.materials[w, surface.cloth[t]]
    c = surface.corners[t]
    area = surface.area[t]
    x0 = nodes.x[w, c[0]]
    d1 = nodes.x[w, c[1]] - x0
    d2 = nodes.x[w, c[2]] - x0
    # Membrane.
    g = surface.inverse_rest[t]
    f1 = d1 * g[0, 0] + d2 * g[1, 0]
    f2 = d1 * g[0, 1] + d2 * g[1, 1]
    c11 = wp.dot(f1, f1)
    c12 = wp.dot(f1, f2)
    c22 = wp.dot(f2, f2)
    j = wp.max(wp.sqrt(wp.max(c11 * c22 - c12 * c12, wp.float64(0.0))), FLATTEST)
    trace = wp.sqrt(c11 + c22 + wp.float64(2.0) * j)
    scale = one / (trace * j)
    inverse = scale * j
    u11 = (c11 + j) * inverse
    u22 = (c22 + j) * inverse
    u12 = c12 * inverse
    if damping.stages[w] > 0:
        damping.first[w, t] = f1
        damping.second[w, t] = f2
        damping.stretch[w, t] = wp.vec3d(u11, u22, u12)
    e11 = u11 - one
    e22 = u22 - one
    t11 = m.stretch * e11 + m.cross * e22
    t22 = m.stretch * e22 + m.cross * e11
    t12 = m.shear * u12
    scale = scale * area
    s11 = scale * (j * t11 + u22 * u22 * t11 - wp.float64(2.0) * u22 * u12 * t12 + u12 * u12 * t22)
    s22 = scale * (j * t22 + u12 * u12 * t11 - wp.float64(2.0) * u11 * u12 * t12 + u11 * u11 * t22)
    s12 = scale * (j * t12 - u22 * u12 * t11 + (u11 * u22 + u12 * u12) * t12 - u11 * u12 * t22)
    p1 = f1 * s11 + f2 * s12
    p2 = f1 * s12 + f2 * s22
    k1 = -(p1 * g[0, 0] + p2 * g[0, 1])
    k2 = -(p1 * g[1, 0] + p2 * g[1, 1])
    # Bending: hinge torques about the edges turn the triangle by forces along its normal.
    n = bending.normal[w, t]
    spread = wp.abs(bending.spread[w, t])
    edges = surface.edges[t]
    axis = (
        (d2 - d1) * bending.torque[w, edges[0] >> 1]
        - d2 * bending.torque[w, edges[1] >> 1]
        + d1 * bending.torque[w, edges[2] >> 1]
    )
    k1 = k1 - n * (spread * wp.dot(d2, axis))
    k2 = k2 + n * (spread * wp.dot(d1, axis))
    k0 = -(k1 + k2)
    # Air.
    if m.drag_normal + m.drag_tangential > wp.float64(0.0):
        third = wp.float64(1.0 / 3.0)
        r = w % nodes.inverse_mass.shape[0]
        u0 = drift(nodes.v[w, c[0]], gravity, nodes.inverse_mass[r, c[0]], h)
        u1 = drift(nodes.v[w, c[1]], gravity, nodes.inverse_mass[r, c[1]], h)
        u2 = drift(nodes.v[w, c[2]], gravity, nodes.inverse_mass[r, c[2]], h)
        u = surface.wind - (u0 + u1 + u2) * third
        a0 = drift(nodes.v[w, c[0]], gravity, nodes.inverse_mass[r, c[0]], -h)
        a1 = drift(nodes.v[w, c[1]], gravity, nodes.inverse_mass[r, c[1]], -h)
        a2 = drift(nodes.v[w, c[2]], gravity, nodes.inverse_mass[r, c[2]], -h)
        ahead = surface.wind - (a0 + a1 + a2) * third
        drag = air_drag(m, n, j, u, ahead, h) * (third * area)
        k0 = k0 + drag
        k1 = k1 + drag
        k2 = k2 + drag
    wp.atomic_add(nodes.f, w, c[0], k0)
    wp.atomic_add(nodes.f, w, c[1], k1)
    wp.atomic_add(nodes.f, w, c[2], k2)


@wp.kernel
def add_forces(clock: Clock, nodes: Nodes, surface: Surface, bending: Bending, damping: Damping) -> None:
    w, k = wp.tid()
    h = clock.dt[w]
    if h <= wp.float64(0.0):
        return
    g = clock.gravity[w % clock.gravity.shape[0]]
    for t in range(k * BLOCK, wp.min((k + 1) * BLOCK, surface.corners.shape[0])):
        add_force(h, g, nodes, surface, bending, damping, w, t)
