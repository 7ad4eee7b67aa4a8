"""The contact search: every pair that may touch within the step, its manifold, and what it remembers."""

import warp as wp

from polyworld.solver.core.contact_coefficients import of_contact
from polyworld.solver.spatial.layout import (
    MAX_MANIFOLD_POINTS,
    MESH,
    PLANE,
    SPHERE,
    TRIANGLE,
    Geometry,
    Manifold,
    Shape,
    State,
)
from polyworld.solver.spatial.manifold import friction_anchor, tangent, touching_points
from polyworld.solver.spatial.neighbours import TOUCHING, near, placed_shape, update_neighbours
from polyworld.solver.spatial.separation import separating_direction, separation
from polyworld.solver.spatial.shapes import extent

FLAT = wp.float64(0.999999)  # cosine of an angle to a triangle's normal that is taken for none
SAME_POINT = wp.float64(0.05)  # how far a point may wander and still be the same, per radius


@wp.func
def remember(state: wp.array[State], w: int, new: int, first: int, count: int, reach: wp.float64) -> None:
    """Give a contact the forces of the last step's closest contact among [first, first + count), if close."""
    best = wp.int32(-1)
    nearest = reach * reach
    here = state[0].contacts[w, new].local
    for k in range(first, first + count):
        square = wp.length_sq(state[0].contacts[w, k].local - here)
        if square < nearest:
            nearest = square
            best = k
    if best >= 0:
        state[0].contacts[w, new].force_n = state[0].contacts[w, best].force_n
        state[0].contacts[w, new].force_t = state[0].contacts[w, best].force_t
        state[0].contacts[w, new].force_spin = state[0].contacts[w, best].force_spin
        state[0].contacts[w, new].force_roll = state[0].contacts[w, best].force_roll
    else:
        state[0].contacts[w, new].force_n = wp.float64(0.0)
        state[0].contacts[w, new].force_t = wp.vec3d()
        state[0].contacts[w, new].force_spin = wp.float64(0.0)
        state[0].contacts[w, new].force_roll = wp.vec3d()


@wp.func
def inactive_edge(geometry: wp.array[Geometry], face: int, n: wp.vec3d) -> bool:
    """Check whether n (body axes) leans over an edge of the triangle behind which the surface goes on."""
    normal = geometry[0].face_normals[face]
    lean = n - normal * wp.dot(n, normal)
    steepest = wp.float64(0.0)
    edge = wp.int32(-1)
    start = geometry[0].face_starts[face]
    for k in range(3):
        p = geometry[0].vertices[geometry[0].face_corners[start + k]]
        along = wp.normalize(geometry[0].vertices[geometry[0].face_corners[start + (k + 1) % 3]] - p)
        slope = wp.dot(wp.cross(along, normal), lean)
        if slope > steepest:
            steepest = slope
            edge = k
    if edge < 0:
        return False
    return (geometry[0].edge_active[face] >> edge) & 1 == 0


@wp.struct
class Pair:
    """Bodies i and j that may come within `reach` of each other [m], at their shapes p and q.

    half: which half of manifolds and contacts is this step's. old: the pair's first manifold of the last step, -1 for
    none; `remembered` contacts belong to it. carried: 1 where a manifold of this pair already carries the impacts that
    have not been reported.
    """

    half: int
    i: int
    j: int
    p: int
    q: int
    old: int
    remembered: int
    carried: int
    reach: wp.float64


@wp.func(inline=False)
def touch(geometry: wp.array[Geometry], state: wp.array[State], w: int, pair: Pair, sb: Shape) -> int:
    """Add the manifold of a pair at two of its shapes, if they come within reach of each other.

    sb is shape q, or one of its triangles. Returns the new `carried`.
    """
    half = pair.half
    i = pair.i
    j = pair.j
    p = pair.p
    q = pair.q
    reach = pair.reach
    old = pair.old
    carried = pair.carried
    sa = geometry[0].shapes[p]
    xa = state[0].bodies[w, i].x
    ra = state[0].bodies[w, i].rotation
    xb = state[0].bodies[w, j].x
    rb = state[0].bodies[w, j].rotation
    if geometry[0].placed[p] == 1:
        xa += ra * geometry[0].offset[p]
        ra = ra * geometry[0].rotation[p]
    if geometry[0].placed[q] == 1:
        xb += rb * geometry[0].offset[q]
        rb = rb * geometry[0].rotation[q]
    c = xa - xb
    n = sb.size
    gap = wp.float64(0.0)
    if sb.kind == PLANE:
        c = n * (wp.dot(n, xa) - sb.bound)  # seen from the foot of the perpendicular on the plane
        gap = wp.dot(n, c) - extent(geometry[0].vertices, sa, wp.transpose(ra) * (-n))
    else:
        n = separating_direction(geometry, sa, ra, sb, rb, c)
        if sb.kind == TRIANGLE:
            face = rb * geometry[0].face_normals[sb.first_face]
            if wp.dot(face, n) > FLAT:
                n = face
            elif inactive_edge(geometry, sb.first_face, wp.transpose(rb) * n):
                return carried  # the surface goes on behind this edge: the neighbour is closer
        gap = separation(geometry[0].vertices, sa, ra, sb, rb, c, n)
    if gap > reach:
        return carried
    index = state[0].manifold_count[w, half]
    first = state[0].contact_count[w, half]
    if index >= state[0].max_manifolds or first + MAX_MANIFOLD_POINTS > state[0].max_contacts:
        state[0].overflowed[w] = 1
        return carried
    t1 = tangent(n)
    across = wp.cross(geometry[0].lock, n)
    if wp.length_sq(across) > wp.float64(0.25):  # friction acts in the plane of motion
        t1 = wp.normalize(across)
    t2 = wp.cross(n, t1)
    frame = wp.mat33d(t1[0], t1[1], t1[2], t2[0], t2[1], t2[2], n[0], n[1], n[2])
    scratch = state[0].scratch[w]
    count = touching_points(geometry, sa, ra, sb, rb, c, frame, gap, reach, scratch)
    if count == 0:
        return carried
    base = half * state[0].max_contacts
    for k in range(count):
        at = scratch[k]
        point = xa + t1 * at[0] + t2 * at[1] + n * at[2]
        state[0].contacts[w, base + first + k].point = point
        state[0].contacts[w, base + first + k].local = wp.transpose(state[0].bodies[w, i].rotation) * (
            point - state[0].bodies[w, i].x
        )
        state[0].contacts[w, base + first + k].gap = scratch[MAX_MANIFOLD_POINTS + k][0]
        state[0].contacts[w, base + first + k].target_velocity = wp.vec2d()
        state[0].contacts[w, base + first + k].stick_impulse = wp.float64(0.0)
        before = wp.int32(0)
        if old >= 0:
            before = state[0].manifolds[w, old].first
        remember(state, w, base + first + k, before, pair.remembered, SAME_POINT * sa.bound)
    m = Manifold()
    m.a = i
    m.b = j
    m.first = base + first
    m.count = count
    m.normal = n
    m.t1 = t1
    m.t2 = t2
    m.anchor = friction_anchor(sa, sb, n, ra, rb, count)
    m.friction = of_contact(state[0].bodies[w, i].friction, state[0].bodies[w, j].friction)
    m.restitution = of_contact(state[0].bodies[w, i].restitution, state[0].bodies[w, j].restitution)
    m.rolling = wp.max(state[0].bodies[w, i].rolling, state[0].bodies[w, j].rolling)
    m.close = TOUCHING * sa.bound
    if j < state[0].objects:
        m.close = TOUCHING * wp.min(sa.bound, sb.bound)
    m.torsion = wp.max(state[0].bodies[w, i].torsion, state[0].bodies[w, j].torsion)
    if old >= 0 and carried == 0:  # impacts of this step, until they have been reported
        m.approach = state[0].manifolds[w, old].approach
        m.impact = state[0].manifolds[w, old].impact
    state[0].manifolds[w, half * state[0].max_manifolds + index] = m
    state[0].manifold_count[w, half] = index + 1
    state[0].contact_count[w, half] = first + count
    return 1


@wp.func(inline=False)
def touch_mesh(geometry: wp.array[Geometry], state: wp.array[State], w: int, pair: Pair) -> int:
    """As `touch`, for all triangles of the mesh q that come near shape p."""
    i = pair.i
    j = pair.j
    p = pair.p
    q = pair.q
    sa = geometry[0].shapes[p]
    sb = geometry[0].shapes[q]
    xa = state[0].bodies[w, i].x
    if geometry[0].placed[p] == 1:
        xa += state[0].bodies[w, i].rotation * geometry[0].offset[p]
    x = wp.transpose(state[0].bodies[w, j].rotation) * (xa - state[0].bodies[w, j].x)
    far = wp.float32(sa.bound + pair.reach)
    centre = wp.vec3(wp.float32(x[0]), wp.float32(x[1]), wp.float32(x[2]))
    box = wp.vec3(far, far, far) * wp.float32(1.00001)
    query = wp.bvh_query_aabb(geometry[0].tree[q], centre - box, centre + box)
    triangle = wp.int32(0)
    piece = Shape()
    piece.kind = TRIANGLE
    piece.vertices = 3
    piece.faces = 1
    while wp.bvh_query_next(query, triangle):
        piece.first_face = sb.first_face + triangle
        piece.first_vertex = sb.first_vertex + 3 * triangle
        piece.bound = sa.bound
        pair.carried = touch(geometry, state, w, pair, piece)
    return pair.carried


@wp.func(inline=False)
def touch_pieces(geometry: wp.array[Geometry], state: wp.array[State], w: int, pair: Pair) -> None:
    """As `touch`, for all pieces of two bodies of which at least one has several."""
    i = pair.i
    j = pair.j
    for p in range(geometry[0].first_shape[i], geometry[0].first_shape[i + 1]):
        sa = geometry[0].shapes[p]
        xa = state[0].bodies[w, i].x
        if geometry[0].placed[p] == 1:
            xa += state[0].bodies[w, i].rotation * geometry[0].offset[p]
        for q in range(geometry[0].first_shape[j], geometry[0].first_shape[j + 1]):
            pair.p = p
            pair.q = q
            sb = placed_shape(geometry, state, w, j, q)
            if sb.kind == MESH:
                pair.carried = touch_mesh(geometry, state, w, pair)
            elif geometry[0].placed[q] == 1:
                xb = state[0].bodies[w, j].x + state[0].bodies[w, j].rotation * geometry[0].offset[q]
                far = sa.bound + sb.bound + pair.reach
                if wp.length_sq(xa - xb) <= far * far:
                    pair.carried = touch(geometry, state, w, pair, sb)
            elif near(state, w, j, sa, xa, sb, pair.reach):
                pair.carried = touch(geometry, state, w, pair, sb)


@wp.func
def find_contacts(geometry: wp.array[Geometry], state: wp.array[State], w: int, half: int, h: wp.float64) -> None:
    """Fill the given half of manifolds and contacts with all pairs that may touch before the step ends.

    h: time over which bodies also move with their velocities, where `swept` is without these; else 0.

    Pairs come in ascending order, so the last step's list is walked once beside this one's.
    """
    state[0].manifold_count[w, half] = 0
    state[0].contact_count[w, half] = 0
    update_neighbours(geometry, state, w, h)
    previous = (1 - half) * state[0].max_manifolds
    previous_end = previous + state[0].manifold_count[w, 1 - half]
    for i in range(state[0].objects):
        if state[0].bodies[w, i].active == 0:
            continue
        p = geometry[0].first_shape[i]
        single = geometry[0].first_shape[i + 1] - p == 1
        sa = geometry[0].shapes[p]
        sa.bound = geometry[0].bound[i]
        xa = state[0].bodies[w, i].x
        swept = state[0].bodies[w, i].swept + TOUCHING * wp.float64(2.0) * sa.bound
        for listed in range(state[0].first_neighbour[w, i], state[0].first_neighbour[w, i + 1]):
            j = state[0].neighbours[w, listed]
            if state[0].bodies[w, j].active == 0:
                continue
            q = geometry[0].first_shape[j]
            alone = single and geometry[0].first_shape[j + 1] - q == 1
            sb = placed_shape(geometry, state, w, j, q)
            if geometry[0].placed[q] == 1:
                sb.kind = SPHERE
                sb.bound = geometry[0].bound[j]
            reach = swept + state[0].bodies[w, j].swept
            if h > wp.float64(0.0):
                reach += h * wp.length(state[0].bodies[w, i].v - state[0].bodies[w, j].v)
            if not near(state, w, j, sa, xa, sb, reach):
                continue
            while previous < previous_end and (
                state[0].manifolds[w, previous].a < i
                or (state[0].manifolds[w, previous].a == i and state[0].manifolds[w, previous].b < j)
            ):
                previous += 1
            old = wp.int32(-1)
            remembered = wp.int32(0)
            k = previous
            while k < previous_end and state[0].manifolds[w, k].a == i and state[0].manifolds[w, k].b == j:
                if old < 0:
                    old = previous  # pieces and triangles have a manifold each, their contacts in one run
                else:  # what impacts there were is kept with the first
                    impact = state[0].manifolds[w, k].impact
                    state[0].manifolds[w, old].impact += impact
                    approach = state[0].manifolds[w, k].approach
                    state[0].manifolds[w, old].approach = wp.max(state[0].manifolds[w, old].approach, approach)
                remembered += state[0].manifolds[w, k].count
                k += 1
            pair = Pair()
            pair.half = half
            pair.i = i
            pair.j = j
            pair.p = p
            pair.q = q
            pair.old = old
            pair.remembered = remembered
            pair.reach = reach
            if not alone:
                touch_pieces(geometry, state, w, pair)
            elif sb.kind == MESH:
                touch_mesh(geometry, state, w, pair)
            else:
                sb = placed_shape(geometry, state, w, j, q)
                touch(geometry, state, w, pair, sb)
