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

from polyworld.solver.cloth.layout import OPTIONS, Bending, Material, Surface

wp.set_module_options(OPTIONS)


@wp.kernel
def find_normals(
    surface: Surface,
    materials: wp.array2d[Material],
    dt: wp.array[wp.float64],
    x: wp.array2d[wp.vec3d],
    v: wp.array2d[wp.vec3d],
    inverse_mass: wp.array2d[wp.float64],
    bending: Bending,
) -> None:
    """Normal of every triangle, and the rate at which it turns where that is damped."""
    w, t = wp.tid()
    if dt[w] <= wp.float64(0.0):
        return
    c = surface.corners[t]
    x0 = x[w, c[0]]
    x1 = x[w, c[1]]
    x2 = x[w, c[2]]
    n = wp.cross(x1 - x0, x2 - x0)
    spread = wp.float64(1.0) / wp.max(wp.length(n), wp.float64(1.0e-30))
    n = n * spread
    bending.normal[w, t] = n
    if materials[w % materials.shape[0], surface.cloth[t]].bend_delay > wp.float64(0.0):
        turning = (
            (x2 - x1) * wp.dot(n, v[w, c[0]]) + (x0 - x2) * wp.dot(n, v[w, c[1]]) + (x1 - x0) * wp.dot(n, v[w, c[2]])
        )
        bending.turning[w, t] = turning * spread
    r = w % inverse_mass.shape[0]
    if inverse_mass[r, c[0]] + inverse_mass[r, c[1]] + inverse_mass[r, c[2]] == wp.float64(0.0):
        spread = -spread
    bending.spread[w, t] = spread


@wp.kernel
def find_bends(
    surface: Surface,
    materials: wp.array2d[Material],
    dt: wp.array[wp.float64],
    x: wp.array2d[wp.vec3d],
    bending: Bending,
) -> None:
    """Bend angles at every edge. A triangle held at all corners is rigid, so that the director is its normal."""
    w, e = wp.tid()
    if dt[w] <= wp.float64(0.0):
        return
    zero = wp.float64(0.0)
    angle = bending.angle[w, e]
    rate = bending.rate[w, e]
    sides = surface.sides[e]
    a = sides[0]
    b = sides[1]
    if b < 0:
        bending.bend[w, e] = wp.vec2d(angle, zero)
        bending.bend_rate[w, e] = wp.vec2d(rate, zero)
        return
    share = wp.float64(0.5)
    held_a = bending.spread[w, a] < zero
    held_b = bending.spread[w, b] < zero
    if held_a != held_b:
        share = wp.where(held_a, zero, wp.float64(1.0))
        angle = zero
        rate = zero
        bending.angle[w, e] = zero
        bending.rate[w, e] = zero
    bending.share[w, e] = share
    ends = surface.ends[e]
    along = wp.normalize(x[w, ends[1]] - x[w, ends[0]])
    n_a = bending.normal[w, a]
    n_b = bending.normal[w, b]
    hinge = wp.atan2(wp.dot(wp.cross(n_a, n_b), along), wp.dot(n_a, n_b))
    bending.bend[w, e] = wp.vec2d(share * hinge + angle, (wp.float64(1.0) - share) * hinge - angle)
    if materials[w % materials.shape[0], surface.cloth[a]].bend_delay > zero:
        turn = wp.dot(bending.turning[w, b] - bending.turning[w, a], along)
        bending.bend_rate[w, e] = wp.vec2d(share * turn + rate, (wp.float64(1.0) - share) * turn - rate)


@wp.func
def of_side(values: wp.array2d[wp.vec2d], w: int, edges: wp.vec3i) -> wp.vec3d:
    """A triangle's own of the two values at each of its edges."""
    return wp.vec3d(
        values[w, edges[0] >> 1][edges[0] & 1],
        values[w, edges[1] >> 1][edges[1] & 1],
        values[w, edges[2] >> 1][edges[2] & 1],
    )


@wp.kernel
def find_moments(
    surface: Surface,
    materials: wp.array2d[Material],
    dt: wp.array[wp.float64],
    bending: Bending,
) -> None:
    """Energy per bend angle: A D ((1 - nu) K : dK + nu tr K tr dK), with damping in the rate of K."""
    w, t = wp.tid()
    if dt[w] <= wp.float64(0.0):
        return
    m = materials[w % materials.shape[0], surface.cloth[t]]
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
def turn_directors(
    surface: Surface,
    materials: wp.array2d[Material],
    dt: wp.array[wp.float64],
    active: wp.array2d[wp.int32],
    bending: Bending,
) -> None:
    """Torque of every hinge, and one step of the motion of its director."""
    w, e = wp.tid()
    h = dt[w]
    if h <= wp.float64(0.0):
        return
    sides = surface.sides[e]
    a = sides[0]
    b = sides[1]
    ends = surface.ends[e]
    edges = surface.edges[a]
    k = wp.where(edges[0] == 2 * e, 0, wp.where(edges[1] == 2 * e, 1, 2))
    moment_a = bending.moment[w, a][k]
    moment_b = wp.float64(0.0)
    if b >= 0:
        edges = surface.edges[b]
        k = wp.where(edges[0] == 2 * e + 1, 0, wp.where(edges[1] == 2 * e + 1, 1, 2))
        moment_b = bending.moment[w, b][k]
        share = bending.share[w, e]
        bending.torque[w, e] = share * moment_a + (wp.float64(1.0) - share) * moment_b
    if active[w, ends[0]] == 0:
        return
    m = materials[w % materials.shape[0], surface.cloth[a]]
    rate = bending.rate[w, e] - (h * m.director * surface.softness[e]) * (moment_a - moment_b)
    bending.rate[w, e] = rate
    bending.angle[w, e] = bending.angle[w, e] + h * rate
