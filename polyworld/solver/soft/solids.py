"""Forces of quadratic tetrahedra."""

import warp as wp

from polyworld.model.soft_elements import TETRAHEDRON_FAR, TETRAHEDRON_NEAR
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.soft.inlining import INLINED
from polyworld.solver.soft.material import Law, response, stress

wp.set_module_options(INLINED)

FAR = wp.constant(wp.float64(4.0 * TETRAHEDRON_FAR))
EXTRA = wp.constant(wp.float64(4.0 * (TETRAHEDRON_NEAR - TETRAHEDRON_FAR)))


@wp.struct
class Elements:
    """Tetrahedra of all bodies. nodes (q, 10): rows of the node arrays; body (q,): column of the parameters.

    slopes (q, 4): at each quadrature point the gradients of the barycentric coordinates 1, 2, 3, as rows [1/m].
    volume (q, 4): volume at rest of each quadrature point [m^3].
    """

    nodes: wp.array2d[wp.int32]
    body: wp.array[wp.int32]
    slopes: wp.array2d[wp.mat33d]
    volume: wp.array2d[wp.float64]


@wp.struct
class Corners:
    """One vector for each node of a tetrahedron: corners, then middles of edges 01, 02, 03, 12, 13, 23."""

    a0: wp.vec3d
    a1: wp.vec3d
    a2: wp.vec3d
    a3: wp.vec3d
    m01: wp.vec3d
    m02: wp.vec3d
    m03: wp.vec3d
    m12: wp.vec3d
    m13: wp.vec3d
    m23: wp.vec3d


@wp.func
def gathered(values: wp.array2d[wp.vec3d], w: int, nodes: wp.array2d[wp.int32], t: int) -> Corners:
    """Return the values at a tetrahedron's nodes."""
    c = Corners()
    c.a0 = values[w, nodes[t, 0]]
    c.a1 = values[w, nodes[t, 1]]
    c.a2 = values[w, nodes[t, 2]]
    c.a3 = values[w, nodes[t, 3]]
    c.m01 = values[w, nodes[t, 4]]
    c.m02 = values[w, nodes[t, 5]]
    c.m03 = values[w, nodes[t, 6]]
    c.m12 = values[w, nodes[t, 7]]
    c.m13 = values[w, nodes[t, 8]]
    c.m23 = values[w, nodes[t, 9]]
    return c


@wp.func
def common_slopes(c: Corners) -> wp.mat33d:
    """Rows 1, 2, 3: what the derivatives by coordinates 1, 2, 3, less that by 0, have in common at all points."""
    s0 = FAR * (c.a0 + c.m01 + c.m02 + c.m03) - c.a0
    s1 = FAR * (c.m01 + c.a1 + c.m12 + c.m13) - c.a1
    s2 = FAR * (c.m02 + c.m12 + c.a2 + c.m23) - c.a2
    s3 = FAR * (c.m03 + c.m13 + c.m23 + c.a3) - c.a3
    return wp.matrix_from_rows(s1 - s0, s2 - s0, s3 - s0)


@wp.func
def gradient(common: wp.mat33d, n0: wp.vec3d, n1: wp.vec3d, n2: wp.vec3d, n3: wp.vec3d, slopes: wp.mat33d) -> wp.mat33d:
    """Gradient by rest position, at the point whose near nodes have the values n0 to n3."""
    extra = wp.matrix_from_rows(EXTRA * (n1 - n0), EXTRA * (n2 - n0), EXTRA * (n3 - n0))
    return wp.transpose(common + extra) * slopes


@wp.func
def scatter(
    w: int,
    nodes: wp.array2d[wp.int32],
    t: int,
    b0: wp.mat33d,
    b1: wp.mat33d,
    b2: wp.mat33d,
    b3: wp.mat33d,
    total: wp.array2d[wp.vec3d],
) -> None:
    """Add the forces that belong to stresses at the four points: transpose of `gathered` and `gradient`.

    Row i - 1 of b_q is volume times stress times the gradient of coordinate i at point q; the row of coordinate 0 is
    minus their sum.
    """
    z0 = b0[0] + b0[1] + b0[2]
    z1 = b1[0] + b1[1] + b1[2]
    z2 = b2[0] + b2[1] + b2[2]
    z3 = b3[0] + b3[1] + b3[2]
    all = b0 + b1 + b2 + b3
    s0 = (z0 + z1 + z2 + z3) * FAR
    s1 = all[0] * FAR
    s2 = all[1] * FAR
    s3 = all[2] * FAR
    back = wp.float64(1.0) / FAR
    wp.atomic_add(total, w, nodes[t, 0], EXTRA * z0 + s0 - s0 * back)
    wp.atomic_add(total, w, nodes[t, 1], s1 * back - s1 - EXTRA * b1[0])
    wp.atomic_add(total, w, nodes[t, 2], s2 * back - s2 - EXTRA * b2[1])
    wp.atomic_add(total, w, nodes[t, 3], s3 * back - s3 - EXTRA * b3[2])
    wp.atomic_add(total, w, nodes[t, 4], EXTRA * (z1 - b0[0]) + s0 - s1)
    wp.atomic_add(total, w, nodes[t, 5], EXTRA * (z2 - b0[1]) + s0 - s2)
    wp.atomic_add(total, w, nodes[t, 6], EXTRA * (z3 - b0[2]) + s0 - s3)
    wp.atomic_add(total, w, nodes[t, 7], -EXTRA * (b2[0] + b1[1]) - s1 - s2)
    wp.atomic_add(total, w, nodes[t, 8], -EXTRA * (b3[0] + b1[2]) - s1 - s3)
    wp.atomic_add(total, w, nodes[t, 9], -EXTRA * (b3[1] + b2[2]) - s2 - s3)


@wp.func
def spread(stress: wp.mat33d, slopes: wp.mat33d, volume: wp.float64) -> wp.mat33d:
    """Rows: volume times stress times the gradients of coordinates 1, 2, 3."""
    return slopes * wp.transpose(stress) * volume


@wp.kernel
def elastic_forces(clock: Clock, nodes: Nodes, elements: Elements, laws: wp.array2d[Law]) -> None:
    """Add the forces of tetrahedra that never flow."""
    w, t = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    m = laws[w % laws.shape[0], elements.body[t]]
    if m.yield_stress >= wp.float64(0.0):
        return
    c = gathered(nodes.x, w, elements.nodes, t)
    common = common_slopes(c)
    g0 = elements.slopes[t, 0]
    g1 = elements.slopes[t, 1]
    g2 = elements.slopes[t, 2]
    g3 = elements.slopes[t, 3]
    w0 = elements.volume[t, 0]
    w1 = elements.volume[t, 1]
    w2 = elements.volume[t, 2]
    w3 = elements.volume[t, 3]
    r0 = response(gradient(common, c.a0, c.m01, c.m02, c.m03, g0), m)
    r1 = response(gradient(common, c.m01, c.a1, c.m12, c.m13, g1), m)
    r2 = response(gradient(common, c.m02, c.m12, c.a2, c.m23, g2), m)
    r3 = response(gradient(common, c.m03, c.m13, c.m23, c.a3, g3), m)
    mean = (w0 * r0.j + w1 * r1.j + w2 * r2.j + w3 * r3.j) / (w0 + w1 + w2 + w3)
    b0 = spread(stress(r0, mean, m), g0, w0)
    b1 = spread(stress(r1, mean, m), g1, w1)
    b2 = spread(stress(r2, mean, m), g2, w2)
    b3 = spread(stress(r3, mean, m), g3, w3)
    scatter(w, elements.nodes, t, b0, b1, b2, b3, nodes.f)
