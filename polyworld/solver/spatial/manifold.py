"""Contact points of two shapes: their supporting faces, clipped against each other in the plane of contact.

A face is written as corners (u, v, height): coordinates along the two tangents, and height along the contact
normal, all seen from one origin. Heights of a flat face are linear in (u, v), so the gap at any common (u, v) is
the difference of two linear functions, also where the faces are tilted against each other.
"""

import warp as wp

from polyworld.solver.spatial.layout import (
    BOX,
    CAPSULE,
    CYLINDER,
    MAX_CLIPPED_POINTS,
    MAX_FACE_POINTS,
    MAX_MANIFOLD_POINTS,
    PLANE,
    SPHERE,
    TRIANGLE,
    Geometry,
    Shape,
)
from polyworld.solver.spatial.shapes import CAP_COSINE, face_towards, radial, rounding, sign, support

HALF_TURN = wp.float64(3.141592653589793)
MISSED = wp.float64(1.0e-4)  # a gap this much above the separation, per radius, means that a corner is missing
RIM_POINTS = 8  # corners of a cylinder's cap against another face
PARALLEL_SINE = wp.float64(0.02)  # two edges closer to parallel than this touch along a line

# Where friction acts, as a fraction of the way from the patch's centre to its corners: the mean distance from
# the centre under uniform pressure over that of the corners, so that a spinning body feels the right moment.
ANCHOR_DISC = wp.float64(0.6667)  # 2/3 of the radius
ANCHOR_FACE = wp.float64(0.5411)  # of a square: (sqrt 2 + asinh 1) / 3 half edges, over sqrt 2
ANCHOR_LINE = wp.float64(0.5)


@wp.func
def tangent(n: wp.vec3d) -> wp.vec3d:
    """Return a unit vector across n that changes little when n does."""
    x = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
    if wp.abs(n[0]) > wp.float64(0.8):
        x = wp.vec3d(wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
    return wp.normalize(x - n * wp.dot(n, x))


@wp.func(inline=False)
def write_face(
    geometry: wp.array[Geometry],
    shape: Shape,
    rotation: wp.mat33d,
    centre: wp.vec3d,
    outward: wp.vec3d,
    rim: int,
    frame: wp.mat33d,
    out: wp.array[wp.vec3d],
    at: int,
) -> wp.vec3d:
    """Write the face that looks along `outward` to out[at:] and return (corner count, dheight/du, dheight/dv).

    centre is the shape's origin seen from the frame's; rim is the number of corners that stand for a disc.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    d = wp.transpose(rotation) * outward
    normal = wp.vec3d()
    count = wp.int32(1)
    if shape.kind == BOX:
        x = wp.abs(d[0])
        y = wp.abs(d[1])
        z = wp.abs(d[2])
        axis = wp.int32(2)
        if x >= y and x >= z:
            axis = 0
        elif y >= z:
            axis = 1
        i = (axis + 1) % 3
        j = (axis + 2) % 3
        corner = shape.size
        corner[axis] = sign(d[axis]) * shape.size[axis]
        normal[axis] = sign(d[axis])
        for k in range(4):
            corner[i] = shape.size[i]
            corner[j] = shape.size[j]
            if k == 1 or k == 2:
                corner[i] = -shape.size[i]
            if k >= 2:
                corner[j] = -shape.size[j]
            out[at + k] = corner
        count = 4
    elif shape.kind == CYLINDER and wp.abs(d[2]) > CAP_COSINE:
        # The rim's extreme point comes first, so that a tilted cylinder stands on its true lowest point.
        first = radial(d)
        if d[0] * d[0] + d[1] * d[1] < wp.float64(1.0e-14):
            first = wp.vec3d(one, zero, zero)
        for k in range(rim):
            angle = wp.float64(2 * k) * HALF_TURN / wp.float64(rim)
            cosine = wp.cos(angle) * shape.size[0]
            sine = wp.sin(angle) * shape.size[0]
            out[at + k] = wp.vec3d(
                first[0] * cosine - first[1] * sine,
                first[1] * cosine + first[0] * sine,
                sign(d[2]) * shape.size[2],
            )
        normal = wp.vec3d(zero, zero, sign(d[2]))
        count = rim
    elif shape.kind == CYLINDER or (shape.kind == CAPSULE and wp.abs(d[2]) < wp.float64(0.5)):
        side = radial(d) * shape.size[0]
        if shape.kind == CAPSULE:
            side = d * shape.size[0]
        lift = wp.vec3d(zero, zero, shape.size[2])
        out[at] = side - lift
        out[at + 1] = side + lift
        count = 2
    elif shape.kind == SPHERE or shape.kind == CAPSULE:
        out[at] = support(geometry[0].vertices, shape, d, zero) + d * shape.size[0]
    elif shape.kind == TRIANGLE:
        for k in range(3):
            out[at + k] = geometry[0].vertices[shape.first_vertex + k]
        normal = geometry[0].face_normals[shape.first_face]
        count = 3
    else:
        f = face_towards(geometry, shape, d)
        start = geometry[0].face_starts[f]
        corners = geometry[0].face_starts[f + 1] - start
        count = wp.min(corners, MAX_FACE_POINTS)
        for k in range(count):
            out[at + k] = geometry[0].vertices[geometry[0].face_corners[start + k * corners / count]]
        normal = geometry[0].face_normals[f]
    for k in range(count):
        out[at + k] = frame * (rotation * out[at + k] + centre)
    if count == 1:
        return wp.vec3d(one, zero, zero)
    if count == 2:
        along = out[at + 1] - out[at]
        square = along[0] * along[0] + along[1] * along[1]
        if square > wp.float64(1.0e-4) * (square + along[2] * along[2]):
            slope = along[2] / square
            return wp.vec3d(wp.float64(2.0), along[0] * slope, along[1] * slope)
    if count > 2:
        up = frame * (rotation * normal)
        if wp.abs(up[2]) > wp.float64(0.05):
            return wp.vec3d(wp.float64(count), -up[0] / up[2], -up[1] / up[2])
    out[at] = frame * (rotation * support(geometry[0].vertices, shape, d, zero) + centre)
    return wp.vec3d(one, zero, zero)


@wp.func
def height(face: wp.vec3d, corner: wp.vec3d, p: wp.vec3d) -> wp.float64:
    """Height of a face (count, slopes) through `corner` above (u, v) of p."""
    return corner[2] + face[1] * (p[0] - corner[0]) + face[2] * (p[1] - corner[1])


@wp.func(inline=False)
def clip(out: wp.array[wp.vec3d], at: int, count: int, q: int, q_count: int, spare: int) -> int:
    """Clip the polygon (or the edge, where count is 2) out[at:] to the polygon out[q:]; returns the new count.

    Sutherland & Hodgman (1974), Comm. ACM 17, 32, in (u, v). An edge as q clips only at its two ends.
    """
    zero = wp.float64(0.0)
    winding = wp.float64(0.0)
    for k in range(q_count):
        a = out[q + k]
        b = out[q + (k + 1) % q_count]
        winding += a[0] * b[1] - a[1] * b[0]
    winding = sign(winding)
    n = count
    for k in range(q_count):
        a = out[q + k]
        edge = out[q + (k + 1) % q_count] - a
        inner = wp.vec3d(-edge[1] * winding, edge[0] * winding, zero)
        if q_count == 2:
            inner = wp.vec3d(edge[0], edge[1], zero)
        made = wp.int32(0)
        for i in range(n):
            p = out[at + i]
            following = out[at + (i + 1) % n]
            inside = inner[0] * (p[0] - a[0]) + inner[1] * (p[1] - a[1])
            next_inside = inner[0] * (following[0] - a[0]) + inner[1] * (following[1] - a[1])
            if inside >= zero and made < MAX_CLIPPED_POINTS:
                out[spare + made] = p
                made += 1
            crosses = (inside >= zero) != (next_inside >= zero)
            if crosses and (n > 2 or i == 0) and made < MAX_CLIPPED_POINTS:
                out[spare + made] = p + (following - p) * (inside / (inside - next_inside))
                made += 1
        n = made
        for i in range(n):
            out[at + i] = out[spare + i]
    return n


@wp.func
def crossing(p: wp.vec3d, p2: wp.vec3d, q: wp.vec3d, q2: wp.vec3d) -> wp.vec3d:
    """(u, v) where the lines through two edges cross, kept on the first; (0, 0, 1) added where they are parallel."""
    r = p2 - p
    s = q2 - q
    cross = r[0] * s[1] - r[1] * s[0]
    lengths = wp.sqrt((r[0] * r[0] + r[1] * r[1]) * (s[0] * s[0] + s[1] * s[1]))
    if wp.abs(cross) < PARALLEL_SINE * lengths:
        return wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    w = q - p
    t = wp.clamp((w[0] * s[1] - w[1] * s[0]) / cross, wp.float64(0.0), wp.float64(1.0))
    return wp.vec3d(p[0] + r[0] * t, p[1] + r[1] * t, wp.float64(0.0))


@wp.func
def touching_points(
    geometry: wp.array[Geometry],
    sa: Shape,
    ra: wp.mat33d,
    sb: Shape,
    rb: wp.mat33d,
    c: wp.vec3d,
    frame: wp.mat33d,
    gap: wp.float64,
    margin: wp.float64,
    out: wp.array[wp.vec3d],
) -> int:
    """Write the contact points of a pair to out[0:] and return their number, at most MAX_MANIFOLD_POINTS.

    Corners are (u, v, height) seen from a's centre, c is a's centre seen from b's; a point is written as
    (u, v, height of the middle), its gap as the first entry of out[MAX_MANIFOLD_POINTS + i]. gap is the separation
    along the normal; points with a gap above margin are left out.
    """
    normal = wp.vec3d(frame[2, 0], frame[2, 1], frame[2, 2])
    at = 2 * MAX_MANIFOLD_POINTS
    q = at + MAX_CLIPPED_POINTS
    spare = q + MAX_CLIPPED_POINTS
    rim = RIM_POINTS
    if sb.kind == PLANE:
        rim = 4
    fa = write_face(geometry, sa, ra, wp.vec3d(), -normal, rim, frame, out, at)
    corner_a = out[at]
    n = int(fa[0])
    single = n == 1
    fb = wp.vec3d()
    corner_b = frame * (-c)
    if sb.kind != PLANE:
        fb = write_face(geometry, sb, rb, -c, normal, rim, frame, out, q)
        m = int(fb[0])
        corner_b = out[q]
        if m == 1:
            out[at] = wp.vec3d(corner_b[0], corner_b[1], corner_b[2] + gap)
            single = True
        elif n == 2 and m == 2:
            meet = crossing(out[at], out[at + 1], out[q], out[q + 1])
            if meet[2] < wp.float64(0.5):
                out[at] = wp.vec3d(meet[0], meet[1], height(fa, corner_a, meet))
                single = True
            else:
                n = clip(out, at, n, q, m, spare)
        elif n >= 3 and m == 2:
            n = clip(out, q, m, at, n, spare)
            for k in range(n):
                p = out[q + k]
                out[at + k] = wp.vec3d(p[0], p[1], height(fa, corner_a, p))
        elif n >= 2:
            n = clip(out, at, n, q, m, spare)
    if single:
        p = out[at]
        out[0] = wp.vec3d(p[0], p[1], p[2] - wp.float64(0.5) * gap)
        out[MAX_MANIFOLD_POINTS] = wp.vec3d(gap, wp.float64(0.0), wp.float64(0.0))
        return 1
    # Keep at most MAX_MANIFOLD_POINTS, evenly round the outline, the deepest among them.
    deepest = wp.int32(0)
    least = wp.float64(1.0e30)
    for k in range(n):
        p = out[at + k]
        g = p[2] - height(fb, corner_b, p)
        if g < least:
            least = g
            deepest = k
    kept = wp.int32(0)
    slack = MISSED * sa.bound
    if least > gap + slack:  # the face that looks along the normal best need not hold the corner that touches
        p = frame * (ra * support(geometry[0].vertices, sa, wp.transpose(ra) * (-normal), wp.float64(0.0)))
        p[2] = p[2] - rounding(sa)
        if sb.kind != PLANE and wp.abs(p[2] - height(fb, corner_b, p) - gap) > slack:
            v = frame * (rb * support(geometry[0].vertices, sb, wp.transpose(rb) * normal, wp.float64(0.0)) - c)
            v[2] = v[2] + rounding(sb)
            if wp.abs(height(fa, corner_a, v) - v[2] - gap) <= slack:
                p = wp.vec3d(v[0], v[1], v[2] + gap)
        out[0] = wp.vec3d(p[0], p[1], p[2] - wp.float64(0.5) * gap)
        out[MAX_MANIFOLD_POINTS] = wp.vec3d(gap, wp.float64(0.0), wp.float64(0.0))
        kept = 1
    total = wp.min(n, MAX_MANIFOLD_POINTS - kept)
    for k in range(total):
        p = out[at + (deepest + k * n / total) % n]
        g = p[2] - height(fb, corner_b, p)
        if g < margin:
            out[kept] = wp.vec3d(p[0], p[1], p[2] - wp.float64(0.5) * g)
            out[MAX_MANIFOLD_POINTS + kept] = wp.vec3d(g, wp.float64(0.0), wp.float64(0.0))
            kept += 1
    return kept


@wp.func
def friction_anchor(sa: Shape, sb: Shape, normal: wp.vec3d, ra: wp.mat33d, rb: wp.mat33d, count: int) -> wp.float64:
    """Return where friction acts between the patch's centre (0) and its corners (1)."""
    if count == 1:
        return wp.float64(1.0)
    if count == 2:
        return ANCHOR_LINE
    axis = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    if sa.kind == CYLINDER and wp.abs(wp.dot(ra * axis, normal)) > CAP_COSINE:
        return ANCHOR_DISC
    if sb.kind == CYLINDER and wp.abs(wp.dot(rb * axis, normal)) > CAP_COSINE:
        return ANCHOR_DISC
    return ANCHOR_FACE
