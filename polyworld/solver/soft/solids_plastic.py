"""Forces of quadratic tetrahedra that flow."""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.soft.inlining import INLINED
from polyworld.solver.soft.material import Law, Response, flow, flowed_strain, must_flow, response, softened, stress
from polyworld.solver.soft.solids import Elements, common_slopes, gathered, gradient, scatter, spread

wp.set_module_options(INLINED)


@wp.func
def plastic_response(f: wp.mat33d, undo: wp.mat33d, m: Law) -> Response:
    """Response by the whole deformation gradient f, where the plastic deformation has the inverse `undo`."""
    r = response(f * undo, m)
    r.shear = r.shear * wp.transpose(undo)
    r.slope = r.slope * wp.transpose(undo)
    return r


@wp.func
def flowing(
    w: int,
    t: int,
    point: int,
    f: wp.mat33d,
    m: Law,
    undo: wp.array3d[wp.mat33d],
    strain: wp.array3d[wp.float64],
) -> wp.mat33d:
    """Let one point flow if it must; returns the inverse of its plastic deformation."""
    before = undo[w, t, point]
    elastic = f * before
    if not must_flow(elastic, m):
        return before
    after = flow(elastic, before, m)
    strain[w, t, point] = strain[w, t, point] + flowed_strain(before, after)
    undo[w, t, point] = after
    return after


@wp.kernel
def plastic_forces(
    clock: Clock,
    nodes: Nodes,
    elements: Elements,
    laws: wp.array2d[Law],
    undo: wp.array3d[wp.mat33d],
    strain: wp.array3d[wp.float64],
) -> None:
    """Apply plastic flow to tetrahedra that must, and add their forces.

    undo, strain (W, q, 4): inverse of the plastic deformation, and equivalent plastic strain, at each point.
    """
    w, t = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    m = laws[w % laws.shape[0], elements.body[t]]
    if m.yield_stress < wp.float64(0.0):
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
    f0 = gradient(common, c.a0, c.m01, c.m02, c.m03, g0)
    f1 = gradient(common, c.m01, c.a1, c.m12, c.m13, g1)
    f2 = gradient(common, c.m02, c.m12, c.a2, c.m23, g2)
    f3 = gradient(common, c.m03, c.m13, c.m23, c.a3, g3)
    m0 = softened(undo[w, t, 0], m)
    m1 = softened(undo[w, t, 1], m)
    m2 = softened(undo[w, t, 2], m)
    m3 = softened(undo[w, t, 3], m)
    r0 = plastic_response(f0, flowing(w, t, 0, f0, m0, undo, strain), m0)
    r1 = plastic_response(f1, flowing(w, t, 1, f1, m1, undo, strain), m1)
    r2 = plastic_response(f2, flowing(w, t, 2, f2, m2, undo, strain), m2)
    r3 = plastic_response(f3, flowing(w, t, 3, f3, m3, undo, strain), m3)
    mean = (w0 * r0.j + w1 * r1.j + w2 * r2.j + w3 * r3.j) / (w0 + w1 + w2 + w3)
    b0 = spread(stress(r0, mean, m0), g0, w0)
    b1 = spread(stress(r1, mean, m1), g1, w1)
    b2 = spread(stress(r2, mean, m2), g2, w2)
    b3 = spread(stress(r3, mean, m3), g3, w3)
    scatter(w, elements.nodes, t, b0, b1, b2, b3, nodes.f)
