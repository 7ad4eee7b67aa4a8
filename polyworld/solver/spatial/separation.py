"""The direction that separates two convex shapes best, and by how much.

The signed distance of two convex shapes is the largest separation over all directions. Between the cores, which
lie a little inside the surfaces and so stay apart while the surfaces touch, the direction is that of the
shortest connection, found by the algorithm of Gilbert, Johnson & Keerthi (1988), IEEE J. Robotics Autom. 4, 193.
Faces and edges of a core are parallel to those of its shape, so the direction is exact for the shapes as well.
"""

import warp as wp

from polyworld.solver.spatial.layout import CAPSULE, CYLINDER, SPHERE, TRIANGLE, Geometry, Shape
from polyworld.solver.spatial.shapes import (
    candidate,
    candidate_count,
    extent,
    face_normal,
    has_closed_form,
    outward_at,
    rounding,
    support,
    unit,
)

MAX_ITERATIONS = 40
# Squared distance is known to this fraction when the search ends; the direction to its square root.
PRECISION = wp.float64(1.0e-13)
LOOSE_PRECISION = wp.float64(1.0e-8)  # what it must be known to for the direction to be trusted
FACE_PREFERENCE = wp.float64(1.0e-7)  # a face wins over an edge this close to it, per radius


class Simplex(wp.types.matrix(shape=(4, 3), dtype=wp.float64)):
    """Up to four points of the Minkowski difference, one a row."""


@wp.func
def row(s: Simplex, i: int) -> wp.vec3d:
    return wp.vec3d(s[i, 0], s[i, 1], s[i, 2])


@wp.func
def separation(
    vertices: wp.array[wp.vec3d], sa: Shape, ra: wp.mat33d, sb: Shape, rb: wp.mat33d, c: wp.vec3d, n: wp.vec3d
) -> wp.float64:
    """Gap between the shapes along the unit vector n from b to a; c is a's centre seen from b's [m]."""
    below = extent(vertices, sa, wp.transpose(ra) * (-n))
    above = extent(vertices, sb, wp.transpose(rb) * n)
    return wp.dot(c, n) - below - above


@wp.func(inline=False)
def triangle_weights(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.vec3d:
    """Barycentric weights of the triangle's point closest to the origin (Ericson 2005, 5.1.5)."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    ab = b - a
    ac = c - a
    d1 = -wp.dot(ab, a)
    d2 = -wp.dot(ac, a)
    if d1 <= zero and d2 <= zero:
        return wp.vec3d(one, zero, zero)
    d3 = -wp.dot(ab, b)
    d4 = -wp.dot(ac, b)
    if d3 >= zero and d4 <= d3:
        return wp.vec3d(zero, one, zero)
    vc = d1 * d4 - d3 * d2
    if vc <= zero and d1 >= zero and d3 <= zero:
        t = d1 / (d1 - d3)
        return wp.vec3d(one - t, t, zero)
    d5 = -wp.dot(ab, c)
    d6 = -wp.dot(ac, c)
    if d6 >= zero and d5 <= d6:
        return wp.vec3d(zero, zero, one)
    vb = d5 * d2 - d1 * d6
    if vb <= zero and d2 >= zero and d6 <= zero:
        t = d2 / (d2 - d6)
        return wp.vec3d(one - t, zero, t)
    va = d3 * d6 - d5 * d4
    if va <= zero and d4 - d3 >= zero and d5 - d6 >= zero:
        t = (d4 - d3) / ((d4 - d3) + (d5 - d6))
        return wp.vec3d(zero, one - t, t)
    total = va + vb + vc
    if total <= zero:
        return wp.vec3d(one, zero, zero)
    return wp.vec3d(va, vb, vc) / total


@wp.func(inline=False)
def core_direction(
    vertices: wp.array[wp.vec3d], sa: Shape, ra: wp.mat33d, sb: Shape, rb: wp.mat33d, c: wp.vec3d
) -> tuple[wp.vec3d, bool]:
    """Unit vector along the shortest connection from b's core to a's, and whether it is that exactly.

    Zero where the cores overlap; inexact where rounding errors end the search early.
    """
    zero = wp.float64(0.0)
    points = Simplex()
    count = wp.int32(0)
    v = c
    square = wp.dot(v, v)
    slack = square
    scale = (sa.bound + sb.bound) * (sa.bound + sb.bound)
    inset_a = sa.inset
    inset_b = sb.inset
    if rounding(sa) + rounding(sb) > zero:  # a swept core keeps its distance: the other body needs no inset
        inset_a = zero
        inset_b = zero
    for iteration in range(MAX_ITERATIONS):
        d = -v
        p = (
            c
            + ra * support(vertices, sa, wp.transpose(ra) * d, inset_a)
            - rb * support(vertices, sb, wp.transpose(rb) * v, inset_b)
        )
        slack = square - wp.dot(v, p)
        if iteration > 0 and slack <= PRECISION * square:
            break
        repeated = wp.int32(0)
        for i in range(count):
            if wp.length_sq(row(points, i) - p) <= wp.float64(1.0e-30) * scale:
                repeated = 1
        if repeated == 1:
            break
        points[count, 0] = p[0]
        points[count, 1] = p[1]
        points[count, 2] = p[2]
        count += 1
        # Closest point of the simplex: for a tetrahedron, of those faces that the origin lies outside of.
        weights = wp.vec3d(wp.float64(1.0), zero, zero)
        i0 = wp.int32(0)
        i1 = wp.int32(0)
        i2 = wp.int32(0)
        if count == 2:
            edge = row(points, 1) - row(points, 0)
            t = wp.clamp(-wp.dot(row(points, 0), edge) / wp.dot(edge, edge), zero, wp.float64(1.0))
            weights = wp.vec3d(wp.float64(1.0) - t, t, zero)
            i1 = 1
        if count == 3:
            i1 = 1
            i2 = 2
            weights = triangle_weights(row(points, 0), row(points, 1), row(points, 2))
        if count == 4:
            nearest = wp.float64(-1.0)
            for opposite in range(4):
                j0 = (opposite + 1) % 4
                j1 = (opposite + 2) % 4
                j2 = (opposite + 3) % 4
                a = row(points, j0)
                normal = wp.cross(row(points, j1) - a, row(points, j2) - a)
                inner = wp.dot(row(points, opposite) - a, normal)
                outer = -wp.dot(a, normal)
                if inner * outer <= zero:  # outside, or the tetrahedron is flat
                    candidate_weights = triangle_weights(a, row(points, j1), row(points, j2))
                    near = (
                        a * candidate_weights[0]
                        + row(points, j1) * candidate_weights[1]
                        + row(points, j2) * candidate_weights[2]
                    )
                    if nearest < zero or wp.dot(near, near) < nearest:
                        nearest = wp.dot(near, near)
                        weights = candidate_weights
                        i0 = j0
                        i1 = j1
                        i2 = j2
            if nearest < zero:
                return wp.vec3d(), False
        # Keep the points that carry weight.
        kept = Simplex()
        closest = wp.vec3d()
        count = wp.int32(0)
        for k in range(3):
            source = i0
            if k == 1:
                source = i1
            if k == 2:
                source = i2
            if weights[k] > zero:
                q = row(points, source)
                closest += q * weights[k]
                kept[count, 0] = q[0]
                kept[count, 1] = q[1]
                kept[count, 2] = q[2]
                count += 1
        points = kept
        nearer = wp.dot(closest, closest)
        if nearer <= wp.float64(1.0e-24) * scale:
            return wp.vec3d(), False
        if iteration > 0 and nearer >= square:  # rounding errors: the best direction so far stays
            break
        v = closest
        square = nearer
    return unit(v, wp.vec3d()), slack <= LOOSE_PRECISION * square


@wp.func(inline=False)
def best_candidate(
    geometry: wp.array[Geometry], sa: Shape, ra: wp.mat33d, sb: Shape, rb: wp.mat33d, c: wp.vec3d, guess: wp.vec3d
) -> wp.vec3d:
    """Best of a guess, both shapes' face normals, their radial directions and the centre line."""
    best = unit(guess, unit(c, wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))))
    if sb.kind == TRIANGLE and wp.dot(guess, guess) < wp.float64(0.5):
        best = rb * geometry[0].face_normals[sb.first_face]
    highest = separation(geometry[0].vertices, sa, ra, sb, rb, c, best)
    first = candidate_count(sa)
    second = candidate_count(sb)
    if sb.kind == TRIANGLE:  # any other way out would lead through the surface
        first = 0
    for i in range(first + second + 2):
        n = best
        if i < first:
            n = ra * candidate(geometry, sa, i)
        elif i < first + second:
            n = rb * candidate(geometry, sb, i - first)
        elif i == first + second and (sa.kind == CYLINDER or sa.kind == CAPSULE):
            axis = ra * wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
            n = unit(c - axis * wp.dot(axis, c), best)
        elif sb.kind == CYLINDER or sb.kind == CAPSULE:
            axis = rb * wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
            n = unit(c - axis * wp.dot(axis, c), best)
        s = separation(geometry[0].vertices, sa, ra, sb, rb, c, n)
        if s > highest:
            highest = s
            best = n
    return best


@wp.func(inline=False)
def separating_direction(
    geometry: wp.array[Geometry], sa: Shape, ra: wp.mat33d, sb: Shape, rb: wp.mat33d, c: wp.vec3d
) -> wp.vec3d:
    """Unit vector from b to a along which the two shapes are farthest apart, or overlap least."""
    if sa.kind == SPHERE and has_closed_form(sb):
        return rb * outward_at(sb, wp.transpose(rb) * c)
    if sb.kind == SPHERE and has_closed_form(sa):
        return -(ra * outward_at(sa, wp.transpose(ra) * (-c)))
    n, exact = core_direction(geometry[0].vertices, sa, ra, sb, rb, c)
    if not exact:
        return best_candidate(geometry, sa, ra, sb, rb, c, n)
    # A face in contact gives its normal exactly, also where the other body hangs over the face's edge.
    best = n
    margin = FACE_PREFERENCE * wp.min(sa.bound, sb.bound)
    highest = separation(geometry[0].vertices, sa, ra, sb, rb, c, n) - margin
    for side in range(2):
        m = wp.vec3d()
        if side == 0:
            m = -(ra * face_normal(geometry, sa, wp.transpose(ra) * (-n)))
        else:
            m = rb * face_normal(geometry, sb, wp.transpose(rb) * n)
        if wp.dot(m, m) > wp.float64(0.5):
            s = separation(geometry[0].vertices, sa, ra, sb, rb, c, m)
            if s > highest:
                highest = s
                best = m
    return best
