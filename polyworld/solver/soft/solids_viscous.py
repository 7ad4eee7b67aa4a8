"""Viscous forces of quadratic tetrahedra."""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.soft.inlining import INLINED
from polyworld.solver.soft.material import Law, viscous_stress
from polyworld.solver.soft.solids import Elements, common_slopes, gathered, gradient, scatter, spread

wp.set_module_options(INLINED)


@wp.kernel
def viscous_forces(stage: int, clock: Clock, nodes: Nodes, elements: Elements, laws: wp.array2d[Law]) -> None:
    """Add the viscous forces of tetrahedra.

    Stage 0 is for bodies whose law has no stages, stage k > 0 for those that have at least k.
    """
    w, t = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    m = laws[w % laws.shape[0], elements.body[t]]
    if m.viscous_shear <= wp.float64(0.0) or m.stages < stage or wp.min(m.stages, 1) != wp.min(stage, 1):
        return
    c = gathered(nodes.x, w, elements.nodes, t)
    u = gathered(nodes.v, w, elements.nodes, t)
    common = common_slopes(c)
    rates = common_slopes(u)
    g0 = elements.slopes[t, 0]
    g1 = elements.slopes[t, 1]
    g2 = elements.slopes[t, 2]
    g3 = elements.slopes[t, 3]
    f0 = gradient(common, c.a0, c.m01, c.m02, c.m03, g0)
    f1 = gradient(common, c.m01, c.a1, c.m12, c.m13, g1)
    f2 = gradient(common, c.m02, c.m12, c.a2, c.m23, g2)
    f3 = gradient(common, c.m03, c.m13, c.m23, c.a3, g3)
    d0 = gradient(rates, u.a0, u.m01, u.m02, u.m03, g0)
    d1 = gradient(rates, u.m01, u.a1, u.m12, u.m13, g1)
    d2 = gradient(rates, u.m02, u.m12, u.a2, u.m23, g2)
    d3 = gradient(rates, u.m03, u.m13, u.m23, u.a3, g3)
    b0 = spread(viscous_stress(f0, d0, m), g0, elements.volume[t, 0])
    b1 = spread(viscous_stress(f1, d1, m), g1, elements.volume[t, 1])
    b2 = spread(viscous_stress(f2, d2, m), g2, elements.volume[t, 2])
    b3 = spread(viscous_stress(f3, d3, m), g3, elements.volume[t, 3])
    scatter(w, elements.nodes, t, b0, b1, b2, b3, nodes.f)
