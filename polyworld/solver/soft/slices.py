"""Forces of quadratic triangles: slices in plane stress that stay in the motion plane.

The stretch across the plane is that at which no stress acts across it, but never below `THINNEST`: a triangle turned
inside out in its plane would otherwise gain by turning inside out across it too.
"""

import warp as wp

from polyworld.model.soft_elements import TRIANGLE_FAR, TRIANGLE_NEAR
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.soft.inlining import INLINED
from polyworld.solver.soft.material import (
    Law,
    cofactor,
    flow,
    flowed_strain,
    must_flow,
    shear_modulus,
    softened,
    viscous_stress,
)

wp.set_module_options(INLINED)

FAR = wp.constant(wp.float64(4.0 * TRIANGLE_FAR))
EXTRA = wp.constant(wp.float64(4.0 * (TRIANGLE_NEAR - TRIANGLE_FAR)))
THINNEST = wp.constant(wp.float64(0.3))


@wp.struct
class Slices:
    """Triangles of all slices. nodes (q, 6): rows of the node arrays; body (q,): column of the laws.

    slopes (q, 3): at each quadrature point the gradients of the barycentric coordinates 1 and 2, as rows [1/m], in
    axes whose third is the plane's normal. volume (q, 3): area times thickness of each point [m^3].
    """

    nodes: wp.array2d[wp.int32]
    body: wp.array[wp.int32]
    slopes: wp.array2d[wp.mat33d]
    volume: wp.array2d[wp.float64]
    normal: wp.vec3d


@wp.func
def gradient(values: wp.array2d[wp.vec3d], w: int, slices: Slices, t: int, point: int) -> wp.mat33d:
    """Compute the gradient of the nodes' values by rest position; its last column is zero."""
    a0 = values[w, slices.nodes[t, 0]]
    a1 = values[w, slices.nodes[t, 1]]
    a2 = values[w, slices.nodes[t, 2]]
    m01 = values[w, slices.nodes[t, 3]]
    m12 = values[w, slices.nodes[t, 4]]
    m20 = values[w, slices.nodes[t, 5]]
    s0 = FAR * (a0 + m01 + m20) - a0
    s1 = FAR * (m01 + a1 + m12) - a1
    s2 = FAR * (m20 + m12 + a2) - a2
    if point == 0:
        s0 = s0 + EXTRA * a0
        s1 = s1 + EXTRA * m01
        s2 = s2 + EXTRA * m20
    elif point == 1:
        s0 = s0 + EXTRA * m01
        s1 = s1 + EXTRA * a1
        s2 = s2 + EXTRA * m12
    else:
        s0 = s0 + EXTRA * m20
        s1 = s1 + EXTRA * m12
        s2 = s2 + EXTRA * a2
    return wp.transpose(wp.matrix_from_rows(s1 - s0, s2 - s0, wp.vec3d())) * slices.slopes[t, point]


@wp.func
def add_forces(w: int, slices: Slices, t: int, point: int, stress: wp.mat33d, f: wp.array2d[wp.vec3d]) -> None:
    """Add the forces of the stress at one point to the nodes: transpose of `gradient`."""
    b = slices.slopes[t, point] * wp.transpose(stress) * (-slices.volume[t, point])
    b1 = b[0]
    b2 = b[1]
    b0 = -b1 - b2
    c01 = FAR * (b0 + b1)
    c12 = FAR * (b1 + b2)
    c20 = FAR * (b2 + b0)
    own = FAR - wp.float64(1.0)
    c0 = own * b0
    c1 = own * b1
    c2 = own * b2
    if point == 0:
        c0 = c0 + EXTRA * b0
        c01 = c01 + EXTRA * b1
        c20 = c20 + EXTRA * b2
    elif point == 1:
        c01 = c01 + EXTRA * b0
        c1 = c1 + EXTRA * b1
        c12 = c12 + EXTRA * b2
    else:
        c20 = c20 + EXTRA * b0
        c12 = c12 + EXTRA * b1
        c2 = c2 + EXTRA * b2
    wp.atomic_add(f, w, slices.nodes[t, 0], c0)
    wp.atomic_add(f, w, slices.nodes[t, 1], c1)
    wp.atomic_add(f, w, slices.nodes[t, 2], c2)
    wp.atomic_add(f, w, slices.nodes[t, 3], c01)
    wp.atomic_add(f, w, slices.nodes[t, 4], c12)
    wp.atomic_add(f, w, slices.nodes[t, 5], c20)


@wp.func
def across(f: wp.mat33d, normal: wp.vec3d, m: Law) -> wp.mat33d:
    """Return the deformation gradient with the stretch across the plane at which no stress acts there."""
    u = wp.vec3d(f[0, 0], f[1, 0], f[2, 0])
    v = wp.vec3d(f[0, 1], f[1, 1], f[2, 1])
    flat = wp.dot(normal, wp.cross(u, v))
    square = wp.dot(u, u) + wp.dot(v, v)
    lam = m.lam_mean + m.lam_point
    t = wp.float64(1.0)
    for _ in range(6):
        whole = square + t * t + wp.float64(1.0)
        mu = m.mu * (wp.float64(1.0) - wp.float64(1.0) / whole)
        value = mu * t + lam * (flat * t - m.alpha) * flat
        slope = mu + lam * flat * flat + wp.float64(2.0) * m.mu * t * t / (whole * whole)
        t = wp.max(t - value / slope, THINNEST)
    return wp.matrix_from_cols(u, v, normal * t)


@wp.func
def plane_stress(f: wp.mat33d, m: Law) -> wp.mat33d:
    """First Piola-Kirchhoff stress [Pa] of the whole deformation gradient f."""
    c = cofactor(f)
    j = (f[0, 0] * c[0, 0] + f[0, 1] * c[0, 1]) + f[0, 2] * c[0, 2]
    lam = m.lam_mean + m.lam_point
    return f * shear_modulus(wp.ddot(f, f), m) + c * (lam * (j - m.alpha))


@wp.kernel
def elastic_forces(clock: Clock, nodes: Nodes, slices: Slices, laws: wp.array2d[Law]) -> None:
    """Add the forces of triangles that never flow."""
    w, t = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    m = laws[w % laws.shape[0], slices.body[t]]
    if m.yield_stress >= wp.float64(0.0):
        return
    for point in range(3):
        whole = across(gradient(nodes.x, w, slices, t, point), slices.normal, m)
        add_forces(w, slices, t, point, plane_stress(whole, m), nodes.f)


@wp.kernel
def viscous_forces(stage: int, clock: Clock, nodes: Nodes, slices: Slices, laws: wp.array2d[Law]) -> None:
    """Add viscous forces, as `solids_viscous.viscous_forces` does."""
    w, t = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    m = laws[w % laws.shape[0], slices.body[t]]
    if m.viscous_shear <= wp.float64(0.0) or m.stages < stage or wp.min(m.stages, 1) != wp.min(stage, 1):
        return
    for point in range(3):
        stress = viscous_stress(gradient(nodes.x, w, slices, t, point), gradient(nodes.v, w, slices, t, point), m)
        add_forces(w, slices, t, point, stress, nodes.f)


@wp.kernel
def plastic_forces(
    clock: Clock,
    nodes: Nodes,
    slices: Slices,
    laws: wp.array2d[Law],
    undo: wp.array3d[wp.mat33d],
    strain: wp.array3d[wp.float64],
) -> None:
    """Let triangles flow that must, and add their forces, as `solids_plastic.plastic_forces` does."""
    w, t = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    m = laws[w % laws.shape[0], slices.body[t]]
    if m.yield_stress < wp.float64(0.0):
        return
    for point in range(3):
        before = undo[w, t, point]
        own = softened(before, m)
        flat = gradient(nodes.x, w, slices, t, point)
        after = before
        elastic = across(flat * before, slices.normal, own)
        if must_flow(elastic, own):
            after = flow(elastic, before, own)
            strain[w, t, point] = strain[w, t, point] + flowed_strain(before, after)
            undo[w, t, point] = after
            elastic = across(flat * after, slices.normal, own)
        add_forces(w, slices, t, point, plane_stress(elastic, own) * wp.transpose(after), nodes.f)
