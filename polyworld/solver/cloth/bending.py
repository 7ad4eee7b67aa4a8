"""Bending of a triangle mesh as a thin plate that may move far: Morley's triangle on the turning surface.

Curvature is constant in a triangle and follows from the angles between its normal and the directors at its edges
(Grinspun, Gingold, Reisman & Zorin 2006, "Computing discrete shape operators on general meshes", midedge operator):
K = sum over edges of bend / (area * length) * t t^T, with t across the edge and as long as it. With directors free to
turn about their edges, small deflections are those of Morley's plate triangle (Morley 1968), which converges on every
mesh. To fix the directors halfway between the normals instead saves their motion, but does not converge unless
all pairs of triangles are parallelograms: measured, a simply supported plate is 40% too stiff with alternating
diagonals and 20% with irregular triangles.

The directors follow the nodes like fast light flywheels; see `stability.py` for how fast.
"""

import warp as wp

from polyworld.solver.cloth.layout import BLOCK, OPTIONS, Bending, Surface, drift
from polyworld.solver.coupled.nodes import Clock, Nodes

wp.set_module_options(OPTIONS)


@wp.func
def find_normal(
    h: wp.float64, gravity: wp.vec3d, nodes: Nodes, surface: Surface, bending: Bending, w: int, t: int
) -> None:
    """Normal of every triangle, and the rate at which it turns where that is damped."""
    c = surface.corners[t]
    x0 = nodes.x[w, c[0]]
    x1 = nodes.x[w, c[1]]
    x2 = nodes.x[w, c[2]]
    n = wp.cross(x1 - x0, x2 - x0)
    spread = wp.float64(1.0) / wp.max(wp.length(n), wp.float64(1.0e-30))
    n = n * spread
    bending.normal[w, t] = n
    r = w % nodes.inverse_mass.shape[0]
    i0 = nodes.inverse_mass[r, c[0]]
    i1 = nodes.inverse_mass[r, c[1]]
    i2 = nodes.inverse_mass[r, c[2]]
    if surface.materials[w, surface.cloth[t]].bend_delay > wp.float64(0.0):
        turning = (x2 - x1) * wp.dot(n, drift(nodes.v[w, c[0]], gravity, i0, h))
        turning = turning + (x0 - x2) * wp.dot(n, drift(nodes.v[w, c[1]], gravity, i1, h))
        turning = turning + (x1 - x0) * wp.dot(n, drift(nodes.v[w, c[2]], gravity, i2, h))
        bending.turning[w, t] = turning * spread
    if i0 + i1 + i2 == wp.float64(0.0) or surface.fixed[t] == 1:
        spread = -spread
    bending.spread[w, t] = spread


@wp.kernel
def find_normals(clock: Clock, nodes: Nodes, surface: Surface, bending: Bending) -> None:
    w, k = wp.tid()
    h = clock.dt[w]
    if h <= wp.float64(0.0):
        return
    g = clock.gravity[w % clock.gravity.shape[0]]
    for t in range(k * BLOCK, wp.min((k + 1) * BLOCK, surface.corners.shape[0])):
        find_normal(h, g, nodes, surface, bending, w, t)


@wp.func
def angle_between(sine: wp.float64, cosine: wp.float64) -> wp.float64:
    """Angle of a unit vector (cosine, sine): twice the arc tangent of its half's tangent, by a Chebyshev series good to
    1e-12 up to 45 degrees, which takes half the time of the general function.
    """
    if cosine < wp.float64(0.71):
        return wp.atan2(sine, cosine)
    t = sine / (wp.float64(1.0) + cosine)
    z = t * t
    zz = z * z
    low = wp.float64(1.9999999999983118) - wp.float64(0.6666666654185051) * z
    low = low + zz * (wp.float64(0.3999998482849173) - wp.float64(0.2857072292450921) * z)
    high = wp.float64(0.22205989106281127) - wp.float64(0.1797645667027343) * z
    high = high + zz * (wp.float64(0.13908645868699915) - wp.float64(0.07459797133420526) * z)
    return t * (low + zz * zz * high)


@wp.func
def find_bend(x: wp.array2d[wp.vec3d], surface: Surface, bending: Bending, w: int, e: int) -> None:
    """Bend angles at every edge. A triangle held at all corners is rigid, so that the director is its normal."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    ends = surface.ends[e]
    along = x[w, ends[1]] - x[w, ends[0]]
    inverse = one / wp.max(wp.length(along), wp.float64(1.0e-30))
    bending.inverse_length[w, e] = inverse
    slots = surface.slots[e]
    angle = bending.angle[w, e]
    if slots[1] < 0:
        bending.bend[w, e] = wp.vec2d(angle, zero)
        bending.bend_rate[w, e] = wp.vec2d(bending.rate[w, e], zero)
        return
    a = slots[0] >> 2
    b = slots[1] >> 2
    n_a = bending.normal[w, a]
    n_b = bending.normal[w, b]
    hinge = angle_between(wp.dot(wp.cross(n_a, n_b), along) * inverse, wp.dot(n_a, n_b))
    share = wp.float64(0.5)
    if bending.spread[w, a] * bending.spread[w, b] < zero:
        share = wp.where(bending.spread[w, a] < zero, zero, one)
        angle = zero
        bending.angle[w, e] = zero
        bending.rate[w, e] = zero
    bending.share[w, e] = share
    bending.bend[w, e] = wp.vec2d(share * hinge + angle, (one - share) * hinge - angle)
    if surface.materials[w, surface.cloth[a]].bend_delay > zero:
        rotation = wp.dot(bending.turning[w, b] - bending.turning[w, a], along) * inverse
        rate = bending.rate[w, e]
        bending.bend_rate[w, e] = wp.vec2d(share * rotation + rate, (one - share) * rotation - rate)


@wp.kernel
def find_bends(clock: Clock, nodes: Nodes, surface: Surface, bending: Bending) -> None:
    w, k = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    for e in range(k * BLOCK, wp.min((k + 1) * BLOCK, surface.ends.shape[0])):
        find_bend(nodes.x, surface, bending, w, e)


@wp.func
def of_side(values: wp.array2d[wp.vec2d], w: int, edges: wp.vec3i) -> wp.vec3d:
    """Return a triangle's own of the two values at each of its edges."""
    return wp.vec3d(
        values[w, edges[0] >> 1][edges[0] & 1],
        values[w, edges[1] >> 1][edges[1] & 1],
        values[w, edges[2] >> 1][edges[2] & 1],
    )


@wp.func
def find_moment(surface: Surface, bending: Bending, w: int, t: int) -> None:
    """Energy per bend angle: A D ((1 - nu) K : dK + nu tr K tr dK), with damping in the rate of K."""
    m = surface.materials[w, surface.cloth[t]]
    edges = surface.edges[t]
    b = surface.curvature[t]
    k = b * of_side(bending.bend, w, edges) - surface.rest_curvature[t]
    if m.bend_delay > wp.float64(0.0):
        k = k + (b * of_side(bending.bend_rate, w, edges)) * m.bend_delay
    stress = wp.vec3d(
        k[0] + m.poisson * k[1],
        k[1] + m.poisson * k[0],
        wp.float64(2.0) * (wp.float64(1.0) - m.poisson) * k[2],
    )
    bending.moment[w, t] = (stress * b) * (m.plate * surface.area[t])


@wp.kernel
def find_moments(clock: Clock, surface: Surface, bending: Bending) -> None:
    w, k = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    for t in range(k * BLOCK, wp.min((k + 1) * BLOCK, surface.corners.shape[0])):
        find_moment(surface, bending, w, t)


@wp.func
def turn_director(
    h: wp.float64, active: wp.array2d[wp.int32], surface: Surface, bending: Bending, w: int, e: int
) -> None:
    """Torque of every hinge, and one step of the motion of its director."""
    slots = surface.slots[e]
    a = slots[0] >> 2
    moment_a = bending.moment[w, a][slots[0] & 3]
    moment_b = wp.float64(0.0)
    if slots[1] >= 0:
        moment_b = bending.moment[w, slots[1] >> 2][slots[1] & 3]
        share = bending.share[w, e]
        torque = share * moment_a + (wp.float64(1.0) - share) * moment_b
        bending.torque[w, e] = torque * bending.inverse_length[w, e]
    if active[w, surface.ends[e][0]] == 0:
        return
    director = surface.materials[w, surface.cloth[a]].director
    rate = bending.rate[w, e] - (h * director * surface.softness[e]) * (moment_a - moment_b)
    bending.rate[w, e] = rate
    bending.angle[w, e] = bending.angle[w, e] + h * rate


@wp.kernel
def turn_directors(clock: Clock, nodes: Nodes, surface: Surface, bending: Bending) -> None:
    w, k = wp.tid()
    h = clock.dt[w]
    if h <= wp.float64(0.0):
        return
    for e in range(k * BLOCK, wp.min((k + 1) * BLOCK, surface.ends.shape[0])):
        turn_director(h, nodes.active, surface, bending, w, e)
