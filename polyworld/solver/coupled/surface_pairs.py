"""Pairs of deformable surfaces that come near each other: nodes and triangles, edges and edges.

Near pairs are listed with a margin, and listed again only when something may have moved through half of it. From
the list, each coupling step takes those that may touch within it.
"""

import warp as wp

from polyworld.solver.coupled.contact_layout import Bounds, Found, Surface
from polyworld.solver.coupled.contact_points import closest_on_segments
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.coupled.surface_grid import Grid, bucket_at, sort_points, span_of, visited
from polyworld.solver.spatial.layout import OPTIONS
from polyworld.solver.spatial.separation import triangle_weights

wp.set_module_options(OPTIONS)

MARGIN = wp.constant(wp.float64(1.5))  # on the distance that things move in a step: they may get faster meanwhile
# Parts of one sheet do not meet where they are nearer than this in the unloaded sheet, in edges' lengths: a node and
# the corners of a triangle, the middles of two edges.
RING = wp.constant(wp.float64(1.2))
EDGE_RING = wp.constant(wp.float64(1.5))
PASSING = 3  # segments between two of a rope that a node's passage over a wheel can bring together
WIDEST = wp.constant(wp.float64(2.2))  # margin for what is quick, per least margin
DEEPEST = wp.constant(wp.float64(0.25))  # of a triangle's size: a node deeper in a solid than this is ignored


@wp.struct
class Pairs:
    """Nodes that may touch triangles and edges that may touch edges.

    node, edge: what the grids hold, as rows of the nodes and of Surface.edges. may, cross (D, D): 1 for objects whose
    nodes and faces, whose edges may touch. bonded (D, D): 1 for objects that are fastened to each other. rest (N,):
    positions in the unloaded shape. faces, crossings, sides (W, P): listed pairs (node, triangle), (edge, edge) and
    (node, side), their number (W,). listed_x (W, N): at the last listing, that had margin (W,); fastest (W,): of all,
    beside their mean motion. due (W,): 1 where the lists must be rebuilt. chain (E,): which rope an edge belongs to,
    or -1, and place_in_chain its number in it; segment (E,): its length. over_wheels (D,): 1 for ropes over pulleys.
    """

    node: wp.array[wp.int32]
    edge: wp.array[wp.int32]
    may: wp.array2d[wp.int32]
    cross: wp.array2d[wp.int32]
    bonded: wp.array2d[wp.int32]
    rest: wp.array[wp.vec3d]
    faces: wp.array2d[wp.vec2i]
    face_count: wp.array[wp.int32]
    crossings: wp.array2d[wp.vec2i]
    crossing_count: wp.array[wp.int32]
    sides: wp.array2d[wp.vec2i]
    side_count: wp.array[wp.int32]
    listed_x: wp.array2d[wp.vec3d]
    margin: wp.array[wp.float64]
    fastest: wp.array[wp.float64]
    due: wp.array[wp.int32]
    chain: wp.array[wp.int32]
    place_in_chain: wp.array[wp.int32]
    segment: wp.array[wp.float64]
    over_wheels: wp.array[wp.int32]
    longest: wp.float64  # edge among those that the grid holds
    skin: wp.float64  # least margin
    thickest: wp.float64  # radius


@wp.func
def boxes_near(bounds: Bounds, w: int, a: int, b: int, far: wp.float64) -> bool:
    """Check whether the boxes around two objects come within a distance."""
    for k in range(3):
        if bounds.low[w, a][k] - bounds.high[w, b][k] > far or bounds.low[w, b][k] - bounds.high[w, a][k] > far:
            return False
    return True


@wp.kernel
def sort_surfaces(clock: Clock, nodes: Nodes, surface: Surface, pairs: Pairs, node_grid: Grid, edge_grid: Grid) -> None:
    """Decide whether the lists are due, and sort nodes and edges into their grids where they are."""
    w = wp.tid()
    h = clock.h[w]
    pairs.due[w] = 0
    if h <= wp.float64(0.0):
        return
    # All that matters is how things move beside each other: what they do together is taken off.
    n = pairs.node.shape[0]
    drift = wp.vec3d()
    moved = wp.vec3d()
    for k in range(n):
        i = pairs.node[k]
        drift += nodes.v[w, i]
        moved += nodes.x[w, i] - pairs.listed_x[w, i]
    drift = drift / wp.float64(n)
    moved = moved / wp.float64(n)
    fastest = wp.float64(0.0)
    farthest = wp.float64(0.0)
    for k in range(n):
        i = pairs.node[k]
        fastest = wp.max(fastest, wp.length_sq(nodes.v[w, i] - drift))
        farthest = wp.max(farthest, wp.length_sq(nodes.x[w, i] - pairs.listed_x[w, i] - moved))
    fastest = wp.sqrt(fastest)
    pairs.fastest[w] = fastest
    step = MARGIN * fastest * h
    allowed = wp.float64(0.5) * pairs.margin[w] - step
    if allowed > wp.float64(0.0) and farthest < allowed * allowed:
        return
    pairs.due[w] = 1
    pairs.margin[w] = wp.max(wp.clamp(wp.float64(6.0) * step, pairs.skin, WIDEST * pairs.skin), wp.float64(2.2) * step)
    pairs.face_count[w] = 0
    pairs.crossing_count[w] = 0
    pairs.side_count[w] = 0
    for k in range(pairs.node.shape[0]):
        i = pairs.node[k]
        pairs.listed_x[w, i] = nodes.x[w, i]
        node_grid.point[w, k] = nodes.x[w, i]
    sort_points(node_grid, w)
    if pairs.edge.shape[0] > 0:
        for k in range(pairs.edge.shape[0]):
            e = pairs.edge[k]
            ends = nodes.x[w, surface.edges[e, 0]] + nodes.x[w, surface.edges[e, 1]]
            edge_grid.point[w, k] = ends * wp.float64(0.5)
        sort_points(edge_grid, w)


@wp.func
def list_pair(
    pairs: wp.array2d[wp.vec2i], count: wp.array[wp.int32], overflowed: wp.array[wp.int32], w: int, a: int, b: int
) -> None:
    slot = wp.atomic_add(count, w, 1)
    if slot >= pairs.shape[1]:
        overflowed[w] = 1
        count[w] = pairs.shape[1]
        return
    pairs[w, slot] = wp.vec2i(a, b)


@wp.kernel
def list_faces(nodes: Nodes, surface: Surface, bounds: Bounds, pairs: Pairs, grid: Grid, found: Found) -> None:
    """Nodes near each triangle, but for those that touch it in the unloaded shape."""
    w, t = wp.tid()
    if pairs.due[w] == 0:
        return
    n0 = surface.triangles[t, 0]
    n1 = surface.triangles[t, 1]
    n2 = surface.triangles[t, 2]
    d = nodes.owner[n0]
    if nodes.active[w, n0] == 0:
        return
    margin = pairs.margin[w]
    any_near = wp.int32(0)
    for o in range(pairs.may.shape[0]):
        if pairs.may[d, o] == 1 and (o == d or boxes_near(bounds, w, d, o, margin + wp.float64(2.0) * pairs.thickest)):
            any_near = 1
    if any_near == 0:
        return
    a = nodes.x[w, n0]
    b = nodes.x[w, n1]
    c = nodes.x[w, n2]
    reach = margin + wp.float64(2.0) * pairs.thickest
    ball = reach + wp.max(wp.length(b - a), wp.length(c - a))
    ra = pairs.rest[n0]
    rb = pairs.rest[n1]
    rc = pairs.rest[n2]
    longest = wp.max(wp.length(rb - ra), wp.max(wp.length(rc - ra), wp.length(rc - rb)))
    edge = wp.vec3d(reach, reach, reach)
    low = wp.min(wp.min(a, b), c) - edge
    high = wp.max(wp.max(a, b), c) + edge
    span = span_of(grid, w, low, high)
    for visit in range(span.visits):
        bucket = bucket_at(grid, span, visit)
        for s in range(grid.start[w, bucket], grid.start[w, bucket + 1]):
            item = grid.items[w, s]
            n = pairs.node[item]
            o = nodes.owner[n]
            own = (n - n0) * (n - n1) * (n - n2) == 0
            if own or pairs.may[d, o] == 0 or nodes.active[w, n] == 0:
                continue
            p = nodes.x[w, n]
            if wp.length_sq(p - a) > ball * ball or not visited(grid, w, item, span, visit):
                continue
            sum = surface.radius[n] + surface.radius[n0]
            if o == d or pairs.bonded[d, o] == 1:
                q = pairs.rest[n]
                nearest = wp.min(wp.length_sq(ra - q), wp.min(wp.length_sq(rb - q), wp.length_sq(rc - q)))
                ring = wp.max(RING * longest, sum + wp.float64(0.6) * longest)
                if nearest < ring * ring:
                    continue
            weights = triangle_weights(a - p, b - p, c - p)
            away = p - a * weights[0] - b * weights[1] - c * weights[2]
            far = sum + margin
            if wp.length_sq(away) > far * far:
                continue
            list_pair(pairs.faces, pairs.face_count, found.overflowed, w, n, t)


@wp.kernel
def list_sides(nodes: Nodes, surface: Surface, pairs: Pairs, grid: Grid, found: Found) -> None:
    """Nodes of other objects near each side of a slice."""
    w, t = wp.tid()
    if pairs.due[w] == 0:
        return
    n0 = surface.sides[t, 0]
    d = nodes.owner[n0]
    if nodes.active[w, n0] == 0:
        return
    a = nodes.x[w, n0]
    b = nodes.x[w, surface.sides[t, 1]]
    reach = pairs.margin[w] + wp.float64(2.0) * pairs.thickest
    room = wp.vec3d(reach, reach, reach)
    low = wp.min(a, b) - room
    high = wp.max(a, b) + room
    span = span_of(grid, w, low, high)
    for visit in range(span.visits):
        bucket = bucket_at(grid, span, visit)
        for s in range(grid.start[w, bucket], grid.start[w, bucket + 1]):
            item = grid.items[w, s]
            n = pairs.node[item]
            o = nodes.owner[n]
            if o == d or pairs.may[d, o] == 0 or nodes.active[w, n] == 0 or not visited(grid, w, item, span, visit):
                continue
            p = nodes.x[w, n]
            part = wp.clamp(wp.dot(p - a, b - a) / wp.length_sq(b - a), wp.float64(0.0), wp.float64(1.0))
            if wp.length(p - a - (b - a) * part) <= reach:
                list_pair(pairs.sides, pairs.side_count, found.overflowed, w, n, t)


@wp.func
def run_together(x: wp.array2d[wp.vec3d], surface: Surface, pairs: Pairs, w: int, e: int, f: int) -> bool:
    """Check whether two edges of a rope over pulleys are too near each other along it to touch.

    Its segments give rope to the wheels and take it from them: the rope between is as long as it is now. Nodes that
    pass a wheel bring two segments with them, and the rope on the wheel runs elsewhere than the segment across it.
    """
    d = pairs.chain[e]
    if d < 0 or pairs.chain[f] != d or pairs.over_wheels[d] == 0:
        return False
    low = wp.min(e, f) + 1
    high = wp.max(e, f)
    if high - low < PASSING:
        return True
    thick = wp.float64(1.6) * (surface.radius[surface.edges[e, 0]] + surface.radius[surface.edges[f, 0]])
    length = wp.float64(0.0)
    for k in range(low, high):
        length += wp.length(x[w, surface.edges[k, 1]] - x[w, surface.edges[k, 0]])
        if length > thick:
            return False
    return True


@wp.kernel
def list_crossings(nodes: Nodes, surface: Surface, bounds: Bounds, pairs: Pairs, grid: Grid, found: Found) -> None:
    """Edges near each edge. Those of one rope count where the rope between them is longer than thick."""
    w, e = wp.tid()
    if pairs.due[w] == 0:
        return
    n0 = surface.edges[e, 0]
    n1 = surface.edges[e, 1]
    d = nodes.owner[n0]
    if nodes.active[w, n0] == 0:
        return
    margin = pairs.margin[w]
    any_near = wp.int32(0)
    for o in range(pairs.may.shape[0]):
        if pairs.cross[d, o] == 1 and (
            o == d or boxes_near(bounds, w, d, o, margin + wp.float64(2.0) * pairs.thickest)
        ):
            any_near = 1
    if any_near == 0:
        return
    a = nodes.x[w, n0]
    b = nodes.x[w, n1]
    reach = margin + wp.float64(2.0) * pairs.thickest + pairs.longest * wp.float64(0.5)
    centre = (a + b) * wp.float64(0.5)
    rest = (pairs.rest[n0] + pairs.rest[n1]) * wp.float64(0.5)
    ball = reach + wp.length(b - a) * wp.float64(0.5)
    room = wp.vec3d(reach, reach, reach)
    low = wp.min(a, b) - room
    high = wp.max(a, b) + room
    span = span_of(grid, w, low, high)
    for visit in range(span.visits):
        bucket = bucket_at(grid, span, visit)
        for s in range(grid.start[w, bucket], grid.start[w, bucket + 1]):
            item = grid.items[w, s]
            f = pairs.edge[item]
            if f <= e:
                continue
            m0 = surface.edges[f, 0]
            o = nodes.owner[m0]
            if pairs.cross[d, o] == 0 or nodes.active[w, m0] == 0:
                continue
            m1 = surface.edges[f, 1]
            if wp.length_sq(grid.point[w, item] - centre) > ball * ball:
                continue
            if (n0 - m0) * (n0 - m1) * (n1 - m0) * (n1 - m1) == 0 or not visited(grid, w, item, span, visit):
                continue
            sum = surface.radius[n0] + surface.radius[m0]
            if (o == d and pairs.chain[e] < 0) or pairs.bonded[d, o] == 1:
                longest = wp.max(pairs.segment[e], pairs.segment[f])
                ring = wp.max(EDGE_RING * longest, sum + longest)
                middle = (pairs.rest[m0] + pairs.rest[m1]) * wp.float64(0.5)
                if wp.length_sq(middle - rest) < ring * ring:
                    continue
            if pairs.chain[e] >= 0 and pairs.chain[e] == pairs.chain[f]:
                between = wp.float64(wp.abs(pairs.place_in_chain[e] - pairs.place_in_chain[f]) - 1)
                if between * pairs.segment[e] < wp.float64(1.6) * sum or between < wp.float64(1.0):
                    continue
            st = closest_on_segments(a, b, nodes.x[w, m0], nodes.x[w, m1])
            apart = a + (b - a) * st[0] - nodes.x[w, m0] - (nodes.x[w, m1] - nodes.x[w, m0]) * st[1]
            far = sum + margin
            if wp.length_sq(apart) > far * far:
                continue
            list_pair(pairs.crossings, pairs.crossing_count, found.overflowed, w, e, f)
