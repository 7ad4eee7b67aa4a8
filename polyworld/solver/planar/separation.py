"""Gap and contact points of two outlines: convex polygons swept by discs, and half planes.

The separating-axis test gives the gap along face normals; where two corners are nearest, their distance.
Contact points by clipping the incident edge against the reference edge, as E. Catto describes for Box2D
("Contact Manifolds", GDC 2007), written here for outlines of any number of corners.
"""

import warp as wp

from polyworld.solver.planar.records import Bodies, Scene

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
FAR = wp.float64(1.0e30)


@wp.struct
class Manifold:
    """Up to two contact points; the normal points from a to b, points lie midway between the surfaces."""

    count: wp.int32
    normal: wp.vec2d
    point0: wp.vec2d
    point1: wp.vec2d
    gap0: wp.float64
    gap1: wp.float64


@wp.func
def rotate(v: wp.vec2d, c: wp.float64, s: wp.float64) -> wp.vec2d:
    return wp.vec2d(c * v[0] - s * v[1], s * v[0] + c * v[1])


@wp.func
def single(normal: wp.vec2d, point: wp.vec2d, gap: wp.float64) -> Manifold:
    m = Manifold()
    m.count = 1
    m.normal = normal
    m.point0 = point
    m.point1 = point
    m.gap0 = gap
    m.gap1 = FAR
    return m


@wp.func
def double(normal: wp.vec2d, p: wp.vec2d, gap_p: wp.float64, q: wp.vec2d, gap_q: wp.float64) -> Manifold:
    # Ordered along the tangent, so that the points of one step are those of the next.
    m = Manifold()
    m.count = 2
    m.normal = normal
    if (p[1] - q[1]) * normal[0] - (p[0] - q[0]) * normal[1] > ZERO:
        m.point0 = q
        m.gap0 = gap_q
        m.point1 = p
        m.gap1 = gap_p
    else:
        m.point0 = p
        m.gap0 = gap_p
        m.point1 = q
        m.gap1 = gap_q
    return m


@wp.func
def against_half_plane(scene: wp.array[Scene], a: wp.int32, pose: wp.vec3d, line: wp.vec3d) -> Manifold:
    outward = wp.vec2d(line[0], line[1])
    first = scene[0].first[a]
    count = scene[0].first[a + 1] - first
    radius = scene[0].sweep[a]
    c = wp.cos(pose[2])
    s = wp.sin(pose[2])
    centre = wp.vec2d(pose[0], pose[1])
    base = wp.dot(outward, centre) - line[2] - radius
    if count == 1:
        return single(-outward, centre - outward * (radius + HALF * base), base)
    lowest = wp.int32(0)
    lowest_gap = FAR
    for i in range(count):
        gap = base + wp.dot(outward, rotate(scene[0].vertices[first + i], c, s))
        if gap < lowest_gap:
            lowest_gap = gap
            lowest = i
    after = (lowest + 1) % count
    before = (lowest + count - 1) % count
    p = centre + rotate(scene[0].vertices[first + lowest], c, s)
    q = centre + rotate(scene[0].vertices[first + after], c, s)
    other_gap = wp.dot(outward, q) - line[2] - radius
    if count > 2:
        r = centre + rotate(scene[0].vertices[first + before], c, s)
        gap = wp.dot(outward, r) - line[2] - radius
        if gap < other_gap:
            other_gap = gap
            q = r
    return double(
        -outward,
        p - outward * (radius + HALF * lowest_gap),
        lowest_gap,
        q - outward * (radius + HALF * other_gap),
        other_gap,
    )


@wp.func
def disc_and_polygon(
    scene: wp.array[Scene], point: wp.vec2d, radius: wp.float64, b: wp.int32, pose: wp.vec3d
) -> Manifold:
    """Manifold whose normal points from the polygon b to the disc."""
    c = wp.cos(pose[2])
    s = wp.sin(pose[2])
    first = scene[0].first[b]
    count = scene[0].first[b + 1] - first
    local = rotate(wp.vec2d(point[0] - pose[0], point[1] - pose[1]), c, -s)
    best = -FAR
    edge = wp.int32(0)
    for i in range(count):
        distance = wp.dot(scene[0].normals[first + i], local - scene[0].vertices[first + i])
        if distance > best:
            best = distance
            edge = i
    start = scene[0].vertices[first + edge]
    end = scene[0].vertices[first + (edge + 1) % count]
    normal = scene[0].normals[first + edge]
    if best > ZERO:
        corner = start
        beyond = wp.dot(local - start, end - start) < ZERO
        if wp.dot(local - end, end - start) > ZERO:
            corner = end
            beyond = True
        if beyond:
            distance = wp.length(local - corner)
            if distance > ZERO:
                normal = (local - corner) / distance
                best = distance
    gap = best - radius - scene[0].sweep[b]
    outward = rotate(normal, c, s)
    return single(outward, point - outward * (radius + HALF * gap), gap)


@wp.func
def widest_separation(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    w: wp.int32,
    a: wp.int32,
    angle: wp.float64,
    at_a: wp.int32,
    b: wp.int32,
    at_b: wp.int32,
) -> wp.vec2d:
    """Largest separation over the edge normals of a, and the edge's index."""
    c = wp.cos(angle)
    s = wp.sin(angle)
    first = scene[0].first[a]
    count = scene[0].first[a + 1] - first
    count_b = scene[0].first[b + 1] - scene[0].first[b]
    best = -FAR
    edge = wp.int32(0)
    for i in range(count):
        normal = rotate(scene[0].normals[first + i], c, s)
        least = FAR
        for j in range(count_b):
            least = wp.min(least, wp.dot(normal, bodies[0].corners[w, at_b + j]))
        least -= wp.dot(normal, bodies[0].corners[w, at_a + i])
        if least > best:
            best = least
            edge = i
    return wp.vec2d(best, wp.float64(edge))


@wp.func
def nearest_on_segment(p: wp.vec2d, a: wp.vec2d, b: wp.vec2d) -> wp.vec2d:
    along = b - a
    u = wp.clamp(wp.dot(p - a, along) / wp.dot(along, along), ZERO, ONE)
    return a + along * u


@wp.func
def polygons(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    w: wp.int32,
    a: wp.int32,
    pose_a: wp.vec3d,
    b: wp.int32,
    pose_b: wp.vec3d,
) -> Manifold:
    count_a = scene[0].first[a + 1] - scene[0].first[a]
    count_b = scene[0].first[b + 1] - scene[0].first[b]
    c = wp.cos(pose_a[2])
    s = wp.sin(pose_a[2])
    for i in range(count_a):
        bodies[0].corners[w, i] = wp.vec2d(pose_a[0], pose_a[1]) + rotate(
            scene[0].vertices[scene[0].first[a] + i], c, s
        )
    c = wp.cos(pose_b[2])
    s = wp.sin(pose_b[2])
    for i in range(count_b):
        bodies[0].corners[w, count_a + i] = wp.vec2d(pose_b[0], pose_b[1]) + rotate(
            scene[0].vertices[scene[0].first[b] + i], c, s
        )
    by_a = widest_separation(scene, bodies, w, a, pose_a[2], 0, b, count_a)
    by_b = widest_separation(scene, bodies, w, b, pose_b[2], count_a, a, 0)

    # Reference: the polygon with the widest separation; a for ties, so that rounding does not alternate.
    reference = a
    other = b
    at_reference = wp.int32(0)
    at_other = count_a
    count = count_a
    count_other = count_b
    angle = pose_a[2]
    angle_other = pose_b[2]
    separation = by_a[0]
    edge = wp.int32(by_a[1])
    if by_b[0] > by_a[0] + HALF * scene[0].touch:
        reference = b
        other = a
        at_reference = count_a
        at_other = wp.int32(0)
        count = count_b
        count_other = count_a
        angle = pose_b[2]
        angle_other = pose_a[2]
        separation = by_b[0]
        edge = wp.int32(by_b[1])
    normal = rotate(scene[0].normals[scene[0].first[reference] + edge], wp.cos(angle), wp.sin(angle))
    r1 = bodies[0].corners[w, at_reference + edge]
    r2 = bodies[0].corners[w, at_reference + (edge + 1) % count]
    local = rotate(normal, wp.cos(angle_other), -wp.sin(angle_other))
    incident = wp.int32(0)
    least = FAR
    for i in range(count_other):
        facing = wp.dot(local, scene[0].normals[scene[0].first[other] + i])
        if facing < least:
            least = facing
            incident = i
    i1 = bodies[0].corners[w, at_other + incident]
    i2 = bodies[0].corners[w, at_other + (incident + 1) % count_other]

    sweep = scene[0].sweep[reference] + scene[0].sweep[other]
    towards_b = ONE
    if reference == b:
        towards_b = -ONE
    if separation > -scene[0].touch and (separation > scene[0].touch or sweep > ZERO):
        # Apart: nearest points of the two edges; where they are two corners, the face normal is not the direction.
        best_r = r1
        best_i = nearest_on_segment(r1, i1, i2)
        p = nearest_on_segment(r2, i1, i2)
        if wp.length(p - r2) < wp.length(best_i - best_r):
            best_i = p
            best_r = r2
        p = nearest_on_segment(i1, r1, r2)
        if wp.length(p - i1) < wp.length(best_i - best_r):
            best_i = i1
            best_r = p
        p = nearest_on_segment(i2, r1, r2)
        if wp.length(p - i2) < wp.length(best_i - best_r):
            best_i = i2
            best_r = p
        distance = wp.length(best_i - best_r)
        if distance > separation + scene[0].touch * HALF * HALF and distance > ZERO:
            direction = (best_i - best_r) / distance
            gap = distance - sweep
            middle = best_r + direction * (scene[0].sweep[reference] + HALF * gap)
            return single(direction * towards_b, middle, gap)

    length = wp.length(r2 - r1)
    tangent = (r2 - r1) / length
    s1 = wp.dot(i1 - r1, tangent)
    s2 = wp.dot(i2 - r1, tangent)
    gap1 = wp.dot(i1 - r1, normal) - sweep
    gap2 = wp.dot(i2 - r1, normal) - sweep
    back = scene[0].sweep[other]
    span = s2 - s1
    if wp.abs(span) < wp.float64(1.0e-9) * length or wp.max(s1, s2) <= ZERO or wp.min(s1, s2) >= length:
        # The incident edge is upright on the face, or overhangs it: only its nearer end touches.
        if gap1 < gap2:
            return single(normal * towards_b, i1 - normal * (back + HALF * gap1), gap1)
        return single(normal * towards_b, i2 - normal * (back + HALF * gap2), gap2)
    u1 = (wp.clamp(s1, ZERO, length) - s1) / span
    u2 = (wp.clamp(s2, ZERO, length) - s1) / span
    p1 = i1 + (i2 - i1) * u1
    p2 = i1 + (i2 - i1) * u2
    g1 = gap1 + (gap2 - gap1) * u1
    g2 = gap1 + (gap2 - gap1) * u2
    return double(normal * towards_b, p1 - normal * (back + HALF * g1), g1, p2 - normal * (back + HALF * g2), g2)


@wp.func(inline=False)  # called in several places; by reference, for a call would copy the records
def find_manifold(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    w: wp.int32,
    a: wp.int32,
    pose_a: wp.vec3d,
    b: wp.int32,
    pose_b: wp.vec3d,
) -> Manifold:
    """Contact points of body a and body or static b in the given poses."""
    count_a = scene[0].first[a + 1] - scene[0].first[a]
    count_b = scene[0].first[b + 1] - scene[0].first[b]
    centre_a = wp.vec2d(pose_a[0], pose_a[1])
    centre_b = wp.vec2d(pose_b[0], pose_b[1])
    if count_b == 0:
        return against_half_plane(scene, a, pose_a, pose_b)
    if count_a == 1 and count_b == 1:
        distance = wp.length(centre_b - centre_a)
        normal = wp.vec2d(ONE, ZERO)
        if distance > ZERO:
            normal = (centre_b - centre_a) / distance
        gap = distance - scene[0].sweep[a] - scene[0].sweep[b]
        return single(normal, centre_a + normal * (scene[0].sweep[a] + HALF * gap), gap)
    if count_a == 1:
        m = disc_and_polygon(scene, centre_a, scene[0].sweep[a], b, pose_b)
        m.normal = -m.normal
        return m
    if count_b == 1:
        return disc_and_polygon(scene, centre_b, scene[0].sweep[b], a, pose_a)
    return polygons(scene, bodies, w, a, pose_a, b, pose_b)
