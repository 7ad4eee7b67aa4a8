"""Contacts of the pairs of surface elements that were found near each other."""

import warp as wp

from polyworld.solver.coupled.contact_layout import CROSSING, ON_FACE, ON_SIDE, Contact, Found, Surface
from polyworld.solver.coupled.contact_points import closest_on_segments
from polyworld.solver.coupled.contact_search import add
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.coupled.surface_pairs import DEEPEST, MARGIN, Pairs, run_together
from polyworld.solver.spatial.layout import OPTIONS
from polyworld.solver.spatial.separation import triangle_weights

wp.set_module_options(OPTIONS)


@wp.func
def mixed(values: wp.array2d[wp.float64], w: int, a: int, b: int) -> wp.float64:
    """Geometric mean of two objects' coefficients."""
    r = w % values.shape[0]
    return wp.sqrt(values[r, a] * values[r, b])


@wp.kernel
def take_pairs(clock: Clock, nodes: Nodes, surface: Surface, pairs: Pairs, bodies: int, found: Found) -> None:
    """Add the listed pairs that may touch within the coupling step; bodies: their number, for events."""
    w = wp.tid()
    h = clock.h[w]
    x = nodes.x
    v = nodes.v
    radius = surface.radius
    owner = nodes.owner
    if h <= wp.float64(0.0):
        return
    fastest = pairs.fastest[w]
    for k in range(pairs.face_count[w]):
        n = pairs.faces[w, k][0]
        t = pairs.faces[w, k][1]
        n0 = surface.triangles[t, 0]
        n1 = surface.triangles[t, 1]
        n2 = surface.triangles[t, 2]
        p = x[w, n]
        a = x[w, n0]
        b = x[w, n1]
        c = x[w, n2]
        weights = triangle_weights(a - p, b - p, c - p)
        away = p - a * weights[0] - b * weights[1] - c * weights[2]
        u = v[w, n] - v[w, n0] * weights[0] - v[w, n1] * weights[1] - v[w, n2] * weights[2]
        sum = radius[n] + radius[n0]
        far = wp.float64(1.05) * sum + (MARGIN * wp.length(u) + wp.float64(0.3) * fastest) * h
        face = wp.cross(b - a, c - a)
        size = wp.length(face)
        height = wp.dot(face, away) / wp.max(size, wp.float64(1.0e-300))
        one_sided = surface.one_sided[owner[n0]]
        deepest = DEEPEST * wp.sqrt(size)
        if one_sided == 1 and height < wp.float64(0.0):
            far = deepest
        if wp.length_sq(away) > far * far:
            continue
        z = Contact()
        z.kind = ON_FACE
        z.n0 = n
        z.n1 = n0
        z.n2 = n1
        z.n3 = n2
        z.body = -1
        z.part = one_sided
        z.owner = wp.min(owner[n], owner[n0])
        z.other = bodies + wp.max(owner[n], owner[n0])
        z.weight = wp.vec4d(wp.float64(1.0), -weights[0], -weights[1], -weights[2])
        z.reach = sum
        z.side = wp.float64(1.0)
        if one_sided == 0 and height < wp.float64(0.0):
            z.side = wp.float64(-1.0)
        z.friction = mixed(surface.friction, w, owner[n], owner[n0])
        z.restitution = mixed(surface.restitution, w, owner[n], owner[n0])
        add(found, w, z)
    for k in range(pairs.side_count[w]):
        n = pairs.sides[w, k][0]
        n0 = surface.sides[pairs.sides[w, k][1], 0]
        n1 = surface.sides[pairs.sides[w, k][1], 1]
        edge = x[w, n1] - x[w, n0]
        t_side = wp.clamp(wp.dot(x[w, n] - x[w, n0], edge) / wp.dot(edge, edge), wp.float64(0.0), wp.float64(1.0))
        away = x[w, n] - x[w, n0] - edge * t_side
        u = v[w, n] - v[w, n0] - (v[w, n1] - v[w, n0]) * t_side
        sum = radius[n] + radius[n0]
        far = wp.float64(1.05) * sum + (MARGIN * wp.length(u) + wp.float64(0.3) * fastest) * h
        if wp.dot(wp.cross(edge, surface.across), away) < wp.float64(0.0):
            far = DEEPEST * wp.length(edge)
        if wp.length_sq(away) > far * far:
            continue
        z = Contact()
        z.kind = ON_SIDE
        z.n0 = n
        z.n1 = n0
        z.n2 = n1
        z.body = -1
        z.owner = wp.min(owner[n], owner[n0])
        z.other = bodies + wp.max(owner[n], owner[n0])
        z.weight = wp.vec4d(wp.float64(1.0), t_side - wp.float64(1.0), -t_side, wp.float64(0.0))
        z.reach = sum
        z.friction = mixed(surface.friction, w, owner[n], owner[n0])
        z.restitution = mixed(surface.restitution, w, owner[n], owner[n0])
        add(found, w, z)
    for k in range(pairs.crossing_count[w]):
        e = pairs.crossings[w, k][0]
        f = pairs.crossings[w, k][1]
        n0 = surface.edges[e, 0]
        n1 = surface.edges[e, 1]
        m0 = surface.edges[f, 0]
        m1 = surface.edges[f, 1]
        if run_together(x, surface, pairs, w, e, f):
            continue
        st = closest_on_segments(x[w, n0], x[w, n1], x[w, m0], x[w, m1])
        away = x[w, n0] + (x[w, n1] - x[w, n0]) * st[0] - x[w, m0] - (x[w, m1] - x[w, m0]) * st[1]
        u = v[w, n0] + (v[w, n1] - v[w, n0]) * st[0] - v[w, m0] - (v[w, m1] - v[w, m0]) * st[1]
        sum = radius[n0] + radius[m0]
        far = wp.float64(1.05) * sum + (MARGIN * wp.length(u) + wp.float64(0.3) * fastest) * h
        if wp.length_sq(away) > far * far:
            continue
        z = Contact()
        z.kind = CROSSING
        z.n0 = n0
        z.n1 = n1
        z.n2 = m0
        z.n3 = m1
        z.body = -1
        z.owner = wp.min(owner[n0], owner[m0])
        z.other = bodies + wp.max(owner[n0], owner[m0])
        z.reach = sum
        z.normal = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
        z.friction = mixed(surface.friction, w, owner[n0], owner[m0])
        z.restitution = mixed(surface.restitution, w, owner[n0], owner[m0])
        add(found, w, z)
