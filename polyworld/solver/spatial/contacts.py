"""The contact search: every pair that may touch within the step, its manifold, and what it remembers."""

import warp as wp

from polyworld.solver.spatial.layout import (
    BOX,
    MAX_MANIFOLD_POINTS,
    MESH,
    PLANE,
    SPHERE,
    TRIANGLE,
    Body,
    Geometry,
    Manifold,
    Shape,
    State,
)
from polyworld.solver.spatial.manifold import friction_anchor, tangent, touching_points
from polyworld.solver.spatial.separation import separating_direction, separation
from polyworld.solver.spatial.shapes import extent

# Contacts are closed below this gap, as a fraction of the smaller body's bounding radius.
TOUCHING = wp.float64(1.0e-4)
FLAT = wp.float64(0.999999)  # cosine of an angle to a triangle's normal that is taken for none
SAME_POINT = wp.float64(0.05)  # how far a point may wander and still be the same, per radius


@wp.func
def paired(a: wp.float64, b: wp.float64) -> wp.float64:
    """Geometric mean of two coefficients; a's own where b leaves it to a (negative)."""
    if b < wp.float64(0.0):
        return a
    return wp.sqrt(a * b)


@wp.func
def near(sa: Shape, xa: wp.vec3d, sb: Shape, b: Body, reach: wp.float64) -> bool:
    """Whether a's bounding sphere comes within reach of b."""
    c = xa - b.x
    if sb.kind == PLANE:
        return wp.dot(sb.size, xa) - sb.bound - sa.bound <= reach
    if sb.kind == MESH:
        return True
    if sb.kind == BOX:
        p = wp.transpose(b.rotation) * c
        total = wp.float64(0.0)
        for k in range(3):
            beyond = wp.max(wp.abs(p[k]) - sb.size[k], wp.float64(0.0))
            total += beyond * beyond
        far = sa.bound + reach
        return total <= far * far
    far = sa.bound + sb.bound + reach
    return wp.dot(c, c) <= far * far


@wp.func
def remember(state: State, w: int, new: int, first: int, count: int, reach: wp.float64) -> None:
    """Give a contact the forces of the last step's closest contact among [first, first + count), if close."""
    best = wp.int32(-1)
    nearest = reach * reach
    here = state.contacts[w, new].local
    for k in range(first, first + count):
        square = wp.length_sq(state.contacts[w, k].local - here)
        if square < nearest:
            nearest = square
            best = k
    if best >= 0:
        state.contacts[w, new].force_n = state.contacts[w, best].force_n
        state.contacts[w, new].force_t = state.contacts[w, best].force_t
        state.contacts[w, new].force_spin = state.contacts[w, best].force_spin
        state.contacts[w, new].force_roll = state.contacts[w, best].force_roll
    else:
        state.contacts[w, new].force_n = wp.float64(0.0)
        state.contacts[w, new].force_t = wp.vec3d()
        state.contacts[w, new].force_spin = wp.float64(0.0)
        state.contacts[w, new].force_roll = wp.vec3d()


@wp.func
def inactive_edge(geometry: Geometry, face: int, n: wp.vec3d) -> bool:
    """Whether n (body axes) leans over an edge of the triangle behind which the surface goes on."""
    normal = geometry.face_normals[face]
    lean = n - normal * wp.dot(n, normal)
    steepest = wp.float64(0.0)
    edge = wp.int32(-1)
    start = geometry.face_starts[face]
    for k in range(3):
        p = geometry.vertices[geometry.face_corners[start + k]]
        along = wp.normalize(geometry.vertices[geometry.face_corners[start + (k + 1) % 3]] - p)
        slope = wp.dot(wp.cross(along, normal), lean)
        if slope > steepest:
            steepest = slope
            edge = k
    if edge < 0:
        return False
    return (geometry.edge_active[face] >> edge) & 1 == 0


@wp.func
def placed_shape(geometry: Geometry, state: State, w: int, j: int, q: int) -> Shape:
    """Shape q of body j; a plane where it stands in this world."""
    s = geometry.shapes[q]
    if s.kind == PLANE:
        plane = state.planes[w, j - state.objects]
        s.size = wp.vec3d(plane[0], plane[1], plane[2])
        s.bound = plane[3]
    return s


@wp.func(inline=False)
def touch(
    geometry: Geometry,
    state: State,
    w: int,
    half: int,
    i: int,
    j: int,
    p: int,
    q: int,
    sb: Shape,
    reach: wp.float64,
    old: int,
    remembered: int,
    told: int,
) -> int:
    """Add the manifold of bodies i and j at their shapes p and q, if they come within reach of each other.

    sb is shape q, or one of its triangles. old is the pair's first manifold of the last step, -1 for none;
    `remembered` contacts belong to it. told: 1 where a manifold of this pair already carries the impacts that have
    not been reported. Returns `told` from now on.
    """
    sa = geometry.shapes[p]
    xa = state.bodies[w, i].x
    ra = state.bodies[w, i].rotation
    xb = state.bodies[w, j].x
    rb = state.bodies[w, j].rotation
    if geometry.placed[p] == 1:
        xa += ra * geometry.offset[p]
        ra = ra * geometry.turn[p]
    if geometry.placed[q] == 1:
        xb += rb * geometry.offset[q]
        rb = rb * geometry.turn[q]
    c = xa - xb
    n = sb.size
    gap = wp.float64(0.0)
    if sb.kind == PLANE:
        c = n * (wp.dot(n, xa) - sb.bound)  # seen from the foot of the perpendicular on the plane
        gap = wp.dot(n, c) - extent(geometry.vertices, sa, wp.transpose(ra) * (-n))
    else:
        n = separating_direction(geometry, sa, ra, sb, rb, c)
        if sb.kind == TRIANGLE:
            face = rb * geometry.face_normals[sb.first_face]
            if wp.dot(face, n) > FLAT:
                n = face
            elif inactive_edge(geometry, sb.first_face, wp.transpose(rb) * n):
                return told  # the surface goes on behind this edge: the neighbour is closer
        gap = separation(geometry.vertices, sa, ra, sb, rb, c, n)
    if gap > reach:
        return told
    index = state.manifold_count[w, half]
    first = state.contact_count[w, half]
    if index >= state.max_manifolds or first + MAX_MANIFOLD_POINTS > state.max_contacts:
        state.crowded[w] = 1
        return told
    t1 = tangent(n)
    across = wp.cross(geometry.lock, n)
    if wp.length_sq(across) > wp.float64(0.25):  # friction acts in the plane of motion
        t1 = wp.normalize(across)
    t2 = wp.cross(n, t1)
    frame = wp.mat33d(t1[0], t1[1], t1[2], t2[0], t2[1], t2[2], n[0], n[1], n[2])
    scratch = state.scratch[w]
    count = touching_points(geometry, sa, ra, sb, rb, c, frame, gap, reach, scratch)
    if count == 0:
        return told
    base = half * state.max_contacts
    for k in range(count):
        at = scratch[k]
        point = xa + t1 * at[0] + t2 * at[1] + n * at[2]
        state.contacts[w, base + first + k].point = point
        state.contacts[w, base + first + k].local = wp.transpose(state.bodies[w, i].rotation) * (
            point - state.bodies[w, i].x
        )
        state.contacts[w, base + first + k].gap = scratch[MAX_MANIFOLD_POINTS + k][0]
        state.contacts[w, base + first + k].aim = wp.vec2d()
        state.contacts[w, base + first + k].grip = wp.float64(0.0)
        before = wp.int32(0)
        if old >= 0:
            before = state.manifolds[w, old].first
        remember(state, w, base + first + k, before, remembered, SAME_POINT * sa.bound)
    m = Manifold()
    m.a = i
    m.b = j
    m.first = base + first
    m.count = count
    m.normal = n
    m.t1 = t1
    m.t2 = t2
    m.anchor = friction_anchor(sa, sb, n, ra, rb, count)
    m.friction = paired(state.bodies[w, i].friction, state.bodies[w, j].friction)
    m.restitution = paired(state.bodies[w, i].restitution, state.bodies[w, j].restitution)
    m.rolling = wp.max(state.bodies[w, i].rolling, state.bodies[w, j].rolling)
    m.close = TOUCHING * sa.bound
    if j < state.objects:
        m.close = TOUCHING * wp.min(sa.bound, sb.bound)
    m.torsion = wp.max(state.bodies[w, i].torsion, state.bodies[w, j].torsion)
    if old >= 0 and told == 0:  # impacts of this step, until they have been reported
        m.approach = state.manifolds[w, old].approach
        m.impact = state.manifolds[w, old].impact
    state.manifolds[w, half * state.max_manifolds + index] = m
    state.manifold_count[w, half] = index + 1
    state.contact_count[w, half] = first + count
    return 1


@wp.func(inline=False)
def touch_mesh(
    geometry: Geometry,
    state: State,
    w: int,
    half: int,
    i: int,
    j: int,
    p: int,
    q: int,
    reach: wp.float64,
    old: int,
    remembered: int,
    told: int,
) -> int:
    """As `touch`, for all triangles of the mesh q that come near shape p."""
    sa = geometry.shapes[p]
    sb = geometry.shapes[q]
    xa = state.bodies[w, i].x
    if geometry.placed[p] == 1:
        xa += state.bodies[w, i].rotation * geometry.offset[p]
    x = wp.transpose(state.bodies[w, j].rotation) * (xa - state.bodies[w, j].x)
    far = wp.float32(sa.bound + reach)
    centre = wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))
    box = wp.vec3(far, far, far) * wp.float32(1.00001)
    query = wp.bvh_query_aabb(geometry.tree[q], centre - box, centre + box)
    triangle = wp.int32(0)
    piece = Shape()
    piece.kind = TRIANGLE
    piece.vertices = 3
    piece.faces = 1
    while wp.bvh_query_next(query, triangle):
        piece.first_face = sb.first_face + triangle
        piece.first_vertex = sb.first_vertex + 3 * triangle
        piece.bound = sa.bound
        told = touch(geometry, state, w, half, i, j, p, q, piece, reach, old, remembered, told)
    return told


@wp.func(inline=False)
def touch_pieces(
    geometry: Geometry, state: State, w: int, half: int, i: int, j: int, reach: wp.float64, old: int, remembered: int
) -> None:
    """As `touch`, for all pieces of two bodies of which at least one has several."""
    told = wp.int32(0)
    for p in range(geometry.first_shape[i], geometry.first_shape[i + 1]):
        sa = geometry.shapes[p]
        xa = state.bodies[w, i].x
        if geometry.placed[p] == 1:
            xa += state.bodies[w, i].rotation * geometry.offset[p]
        for q in range(geometry.first_shape[j], geometry.first_shape[j + 1]):
            sb = placed_shape(geometry, state, w, j, q)
            if sb.kind == MESH:
                told = touch_mesh(geometry, state, w, half, i, j, p, q, reach, old, remembered, told)
            elif geometry.placed[q] == 1:
                xb = state.bodies[w, j].x + state.bodies[w, j].rotation * geometry.offset[q]
                far = sa.bound + sb.bound + reach
                if wp.length_sq(xa - xb) <= far * far:
                    told = touch(geometry, state, w, half, i, j, p, q, sb, reach, old, remembered, told)
            elif near(sa, xa, sb, state.bodies[w, j], reach):
                told = touch(geometry, state, w, half, i, j, p, q, sb, reach, old, remembered, told)


@wp.func
def find_contacts(geometry: Geometry, state: State, w: int, half: int) -> None:
    """Fill the given half of manifolds and contacts with all pairs that may touch before the step ends.

    Pairs come in ascending order, so the last step's list is walked once beside this one's.
    """
    state.manifold_count[w, half] = 0
    state.contact_count[w, half] = 0
    previous = (1 - half) * state.max_manifolds
    previous_end = previous + state.manifold_count[w, 1 - half]
    for i in range(state.objects):
        if state.bodies[w, i].active == 0:
            continue
        p = geometry.first_shape[i]
        single = geometry.first_shape[i + 1] - p == 1
        sa = geometry.shapes[p]
        sa.bound = geometry.bound[i]
        xa = state.bodies[w, i].x
        swept = state.bodies[w, i].swept + TOUCHING * wp.float64(2.0) * sa.bound
        for j in range(i + 1, state.objects + state.statics):
            if state.bodies[w, j].active == 0:
                continue
            q = geometry.first_shape[j]
            alone = single and geometry.first_shape[j + 1] - q == 1
            sb = placed_shape(geometry, state, w, j, q)
            if geometry.placed[q] == 1:
                sb.kind = SPHERE
                sb.bound = geometry.bound[j]
            reach = swept + state.bodies[w, j].swept
            if not near(sa, xa, sb, state.bodies[w, j], reach) or geometry.collides[i, j] == 0:
                continue
            while previous < previous_end and (
                state.manifolds[w, previous].a < i
                or (state.manifolds[w, previous].a == i and state.manifolds[w, previous].b < j)
            ):
                previous += 1
            old = wp.int32(-1)
            remembered = wp.int32(0)
            k = previous
            while k < previous_end and state.manifolds[w, k].a == i and state.manifolds[w, k].b == j:
                if old < 0:
                    old = previous  # pieces and triangles have a manifold each, their contacts in one run
                else:  # what impacts there were is kept with the first
                    impact = state.manifolds[w, k].impact
                    state.manifolds[w, old].impact += impact
                    approach = state.manifolds[w, k].approach
                    state.manifolds[w, old].approach = wp.max(state.manifolds[w, old].approach, approach)
                remembered += state.manifolds[w, k].count
                k += 1
            if not alone:
                touch_pieces(geometry, state, w, half, i, j, reach, old, remembered)
            elif sb.kind == MESH:
                touch_mesh(geometry, state, w, half, i, j, p, q, reach, old, remembered, 0)
            else:
                sb = placed_shape(geometry, state, w, j, q)
                touch(geometry, state, w, half, i, j, p, q, sb, reach, old, remembered, 0)
