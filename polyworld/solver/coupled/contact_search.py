"""The search, once in a coupling step: every node, edge and corner that may touch before the next search."""

import warp as wp

from polyworld.solver.core.contact_coefficients import of_contact
from polyworld.solver.coupled.contact_bounds import OBJECT_SHARE, OWN_SHARE, nothing_near, part_position, swept
from polyworld.solver.coupled.contact_layout import (
    CORNER,
    CROSSING,
    ON_SHAPE,
    ON_TRIANGLE,
    Bounds,
    Contact,
    Found,
    Kept,
    Obstacles,
    Surface,
)
from polyworld.solver.coupled.contact_shapes import shape_distance, triangle_distance
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.spatial.layout import MESH, OPTIONS, PLANE, Body
from polyworld.solver.spatial.separation import triangle_weights

wp.set_module_options(OPTIONS)

LEAST_SAGITTA = wp.constant(wp.float64(2.0e-4))  # an edge touches between its nodes where it is this much closer
BISECTIONS = 16
BLOCK = 64  # elements that one thread looks at: starting one costs more than the look at what is far


@wp.func
def add(found: Found, w: int, c: Contact) -> None:
    slot = wp.atomic_add(found.count, w, 1)
    if slot >= found.contacts.shape[1]:
        found.overflowed[w] = 1
        found.count[w] = found.contacts.shape[1]
        return
    found.contacts[w, slot] = c


@wp.func
def against_body(surface: Surface, bodies: wp.array2d[Body], w: int, owner: int, body: int) -> Contact:
    """Add a contact of a deformable object with a body, its coefficients filled in."""
    c = Contact()
    c.body = body
    c.other = body
    c.owner = owner
    c.friction = of_contact(surface.friction[w % surface.friction.shape[0], owner], bodies[w, body].friction)
    c.restitution = of_contact(
        surface.restitution[w % surface.restitution.shape[0], owner], bodies[w, body].restitution
    )
    return c


@wp.func
def touch_node(
    clock: Clock, nodes: Nodes, obstacles: Obstacles, surface: Surface, bounds: Bounds, found: Found, w: int, i: int
) -> None:
    h = clock.h[w]
    if surface.exposed[i] == 0 or nodes.active[w, i] == 0 or h <= wp.float64(0.0):
        return
    d = nodes.owner[i]
    if nothing_near(bounds, w, d):
        return
    p = nodes.x[w, i]
    fall = wp.length(clock.gravity[w % clock.gravity.shape[0]]) * h * h
    slack = surface.radius[i] * wp.float64(1.05) + fall + wp.float64(1.0e-5)
    slack += (OWN_SHARE * wp.length(nodes.v[w, i]) + OBJECT_SHARE * bounds.speed[w, d]) * h
    for s in range(obstacles.parts.shape[0]):
        if bounds.near[w, d, s] == 0:
            continue
        part = obstacles.parts[s]
        b = part.body
        if surface.excluded[i, b] != 0:
            continue
        kind = obstacles.geometry[0].shapes[part.shape].kind
        reach = slack + swept(obstacles.bodies, w, part, h)
        if kind == PLANE:
            n = obstacles.geometry[0].shapes[part.shape].size
            if wp.dot(n, p) - obstacles.geometry[0].shapes[part.shape].bound <= reach:
                c = against_body(surface, obstacles.bodies, w, d, b)
                c.kind = ON_SHAPE
                c.n0 = i
                c.weight[0] = wp.float64(1.0)
                c.part = s
                c.reach = surface.radius[i]
                add(found, w, c)
            continue
        local = wp.transpose(obstacles.bodies[w, b].rotation) * (p - obstacles.bodies[w, b].x)
        if kind == MESH:
            half = wp.float32(reach)
            centre = wp.vec3(wp.float32(local[0]), wp.float32(local[1]), wp.float32(local[2]))
            box = wp.vec3(half, half, half) * wp.float32(1.0001)
            query = wp.bvh_query_aabb(obstacles.geometry[0].tree[part.shape], centre - box, centre + box)
            triangle = wp.int32(0)
            while wp.bvh_query_next(query, triangle):
                face = obstacles.geometry[0].shapes[part.shape].first_face + triangle
                first_vertex = obstacles.geometry[0].shapes[part.shape].first_vertex + 3 * triangle
                found_at = triangle_distance(obstacles.geometry, first_vertex, face, local)
                if wp.abs(found_at[3]) <= reach:
                    c = against_body(surface, obstacles.bodies, w, d, b)
                    c.kind = ON_TRIANGLE
                    c.n0 = i
                    c.weight[0] = wp.float64(1.0)
                    c.part = face
                    c.reach = surface.radius[i]
                    add(found, w, c)
            continue
        local = wp.transpose(part.rotation) * (local - part.position)
        far = part.bound + reach
        if wp.length_sq(local) > far * far:
            continue
        if shape_distance(obstacles.geometry, kind, obstacles.geometry[0].shapes[part.shape], local)[3] <= reach:
            c = against_body(surface, obstacles.bodies, w, d, b)
            c.kind = ON_SHAPE
            c.n0 = i
            c.weight[0] = wp.float64(1.0)
            c.part = s
            c.reach = surface.radius[i]
            add(found, w, c)


@wp.kernel
def search_nodes(
    clock: Clock, nodes: Nodes, obstacles: Obstacles, surface: Surface, bounds: Bounds, found: Found
) -> None:
    """Nodes against the pieces of bodies, planes and meshes."""
    w, block = wp.tid()
    for i in range(block * BLOCK, wp.min((block + 1) * BLOCK, nodes.x.shape[1])):
        touch_node(clock, nodes, obstacles, surface, bounds, found, w, i)


@wp.func
def touch_edge(
    clock: Clock, nodes: Nodes, obstacles: Obstacles, surface: Surface, bounds: Bounds, found: Found, w: int, e: int
) -> None:
    h = clock.h[w]
    i = surface.edges[e, 0]
    j = surface.edges[e, 1]
    if nodes.active[w, i] == 0 or h <= wp.float64(0.0):
        return
    zero = wp.float64(0.0)
    d = nodes.owner[i]
    if nothing_near(bounds, w, d):
        return
    fall = wp.length(clock.gravity[w % clock.gravity.shape[0]]) * h * h
    slack = surface.radius[i] * wp.float64(1.05) + fall + wp.float64(1.0e-5)
    fastest = wp.max(wp.length(nodes.v[w, i]), wp.length(nodes.v[w, j]))
    slack += (OWN_SHARE * fastest + OBJECT_SHARE * bounds.speed[w, d]) * h
    half = wp.length(nodes.x[w, j] - nodes.x[w, i]) * wp.float64(0.5)
    for s in range(obstacles.parts.shape[0]):
        if bounds.near[w, d, s] == 0:
            continue
        part = obstacles.parts[s]
        b = part.body
        kind = obstacles.geometry[0].shapes[part.shape].kind
        if kind == PLANE:
            continue
        if kind == MESH or surface.excluded[i, b] != 0 or surface.excluded[j, b] != 0:
            continue
        reach = slack + swept(obstacles.bodies, w, part, h)
        to_part = wp.transpose(obstacles.bodies[w, b].rotation * part.rotation)
        origin = part_position(obstacles.bodies, w, part)
        begin = to_part * (nodes.x[w, i] - origin)
        displacement = to_part * (nodes.x[w, j] - nodes.x[w, i])
        far = part.bound + reach + half
        if wp.length_sq(begin + displacement * wp.float64(0.5)) > far * far:
            continue
        shape = obstacles.geometry[0].shapes[part.shape]
        at_begin = shape_distance(obstacles.geometry, kind, shape, begin)
        at_end = shape_distance(obstacles.geometry, kind, shape, begin + displacement)
        if (at_begin[3] + at_end[3]) * wp.float64(0.5) - half > reach:
            continue
        if wp.dot(wp.vec3d(at_begin[0], at_begin[1], at_begin[2]), displacement) >= zero:
            continue
        if wp.dot(wp.vec3d(at_end[0], at_end[1], at_end[2]), displacement) <= zero:
            continue
        low = wp.float64(0.0)
        high = wp.float64(1.0)
        t = wp.float64(0.5)
        for _step in range(BISECTIONS):
            t = wp.float64(0.5) * (low + high)
            here = shape_distance(obstacles.geometry, kind, shape, begin + displacement * t)
            if wp.dot(wp.vec3d(here[0], here[1], here[2]), displacement) > zero:
                high = t
            else:
                low = t
        nearest = shape_distance(obstacles.geometry, kind, shape, begin + displacement * t)[3]
        sagitta = wp.min(at_begin[3], at_end[3]) - nearest
        least = wp.max(LEAST_SAGITTA * wp.float64(2.0) * half, surface.yielding[d] * surface.radius[i])
        if nearest > reach or sagitta < least:
            continue
        c = against_body(surface, obstacles.bodies, w, d, b)
        c.kind = ON_SHAPE
        c.n0 = i
        c.n1 = j
        c.weight[0] = wp.float64(1.0) - t
        c.weight[1] = t
        c.part = s
        c.reach = surface.radius[i] * (wp.float64(1.0) - surface.yielding[d])
        add(found, w, c)


@wp.kernel
def search_edges(
    clock: Clock, nodes: Nodes, obstacles: Obstacles, surface: Surface, bounds: Bounds, found: Found
) -> None:
    """Edges that come closest to a convex piece between their nodes.

    The distance to a convex shape is a convex function along the edge, so bisection on its slope finds the point.
    """
    w, block = wp.tid()
    for e in range(block * BLOCK, wp.min((block + 1) * BLOCK, surface.edges.shape[0])):
        touch_edge(clock, nodes, obstacles, surface, bounds, found, w, e)


@wp.func
def touch_triangle(
    clock: Clock, nodes: Nodes, obstacles: Obstacles, surface: Surface, bounds: Bounds, found: Found, w: int, k: int
) -> None:
    h = clock.h[w]
    i = surface.triangles[k, 0]
    if nodes.active[w, i] == 0 or h <= wp.float64(0.0):
        return
    d = nodes.owner[i]
    if nothing_near(bounds, w, d):
        return
    p0 = nodes.x[w, i]
    p1 = nodes.x[w, surface.triangles[k, 1]]
    p2 = nodes.x[w, surface.triangles[k, 2]]
    fall = wp.length(clock.gravity[w % clock.gravity.shape[0]]) * h * h
    slack = surface.radius[i] * wp.float64(1.05) + fall + wp.float64(1.0e-5)
    slack += (OWN_SHARE + OBJECT_SHARE) * bounds.speed[w, d] * h
    size = wp.max(wp.length(p1 - p0), wp.length(p2 - p0))
    normal = wp.normalize(wp.cross(p1 - p0, p2 - p0))
    for s in range(obstacles.parts.shape[0]):
        part = obstacles.parts[s]
        b = part.body
        if part.corners == 0 or bounds.near[w, d, s] == 0 or surface.excluded[i, b] != 0:
            continue
        if surface.excluded[surface.triangles[k, 1], b] + surface.excluded[surface.triangles[k, 2], b] > 0:
            continue
        reach = slack + swept(obstacles.bodies, w, part, h)
        centre = part_position(obstacles.bodies, w, part)
        far = part.bound + reach + size
        if wp.length_sq(p0 - centre) > far * far:
            continue
        for m in range(part.first_corner, part.first_corner + part.corners):
            point = obstacles.bodies[w, b].x + obstacles.bodies[w, b].rotation * obstacles.corners[m]
            weights = triangle_weights(p0 - point, p1 - point, p2 - point)
            away = p0 * weights[0] + p1 * weights[1] + p2 * weights[2] - point
            if wp.length(away) - obstacles.corner_radius[m] > reach:
                continue
            c = against_body(surface, obstacles.bodies, w, d, b)
            c.kind = CORNER
            c.n0 = i
            c.n1 = surface.triangles[k, 1]
            c.n2 = surface.triangles[k, 2]
            c.part = m
            c.reach = surface.radius[i] + obstacles.corner_radius[m]
            c.side = wp.float64(-1.0)  # a surface with an inside is pushed inwards
            if surface.one_sided[d] == 0 and wp.dot(normal, p0 - centre) > wp.float64(0.0):
                c.side = wp.float64(1.0)
            add(found, w, c)


@wp.kernel
def search_corners(
    clock: Clock, nodes: Nodes, obstacles: Obstacles, surface: Surface, bounds: Bounds, found: Found
) -> None:
    """Triangles that a corner of a body, or the centre of its round end, may press into."""
    w, block = wp.tid()
    for k in range(block * BLOCK, wp.min((block + 1) * BLOCK, surface.triangles.shape[0])):
        touch_triangle(clock, nodes, obstacles, surface, bounds, found, w, k)


@wp.kernel
def mark_overlaps(
    positions: wp.array[wp.vec3d],
    linked: wp.array2d[wp.int32],
    nodes: Nodes,
    surface: Surface,
    obstacles: Obstacles,
    excluded: wp.array2d[wp.int32],
) -> None:
    """Mark nodes that lie in a body which their object is fastened to; linked (D, B)."""
    i, s = wp.tid()
    part = obstacles.parts[s]
    if linked[nodes.owner[i], part.body] == 0:
        return
    local = (
        wp.transpose(obstacles.bodies[0, part.body].rotation) * (positions[i] - obstacles.bodies[0, part.body].x)
        - part.position
    )
    local = wp.transpose(part.rotation) * local
    kind = obstacles.geometry[0].shapes[part.shape].kind
    if shape_distance(obstacles.geometry, kind, obstacles.geometry[0].shapes[part.shape], local)[3] < surface.radius[i]:
        excluded[i, part.body] = 1


@wp.kernel
def keep_acting(clock: Clock, found: Found) -> None:
    """Set aside the contacts that act, for the search that follows, and empty the list."""
    w = wp.tid()
    if clock.h[w] <= wp.float64(0.0):
        return
    for k in range(found.kept_count[w]):
        found.latest[w, found.kept_node[w, k]] = -1
    count = wp.int32(0)
    for k in range(found.count[w]):
        if found.contacts[w, k].impulse > wp.float64(0.0):
            c = found.contacts[w, k]
            old = Kept()
            old.kind = c.kind
            old.n1 = c.n1
            old.n2 = c.n2
            old.n3 = c.n3
            old.part = c.part
            old.impulse = c.impulse
            old.tangential = c.tangential
            old.normal = c.normal
            old.weight = c.weight
            old.arm = c.arm
            old.next = found.latest[w, c.n0]
            found.kept[w, count] = old
            found.kept_node[w, count] = c.n0
            found.latest[w, c.n0] = count
            count += 1
    found.kept_count[w] = count
    found.count[w] = 0


@wp.kernel
def recall_acting(clock: Clock, found: Found) -> None:
    """Contacts found again push on as they did."""
    w = wp.tid()
    if clock.h[w] <= wp.float64(0.0) or found.kept_count[w] == 0:
        return
    for k in range(found.count[w]):
        m = found.latest[w, found.contacts[w, k].n0]
        while m >= 0:
            old = found.kept[w, m]
            same = old.kind == found.contacts[w, k].kind and old.part == found.contacts[w, k].part
            same = same and old.n1 == found.contacts[w, k].n1 and old.n2 == found.contacts[w, k].n2
            if same and old.n3 == found.contacts[w, k].n3:
                found.contacts[w, k].impulse = old.impulse
                found.contacts[w, k].tangential = old.tangential
                found.contacts[w, k].normal = old.normal
                found.contacts[w, k].arm = old.arm
                if old.kind == CORNER or old.kind == CROSSING:
                    found.contacts[w, k].weight = old.weight
            m = old.next
