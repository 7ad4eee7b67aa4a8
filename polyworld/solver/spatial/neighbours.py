"""Pairs of bodies that may touch soon, listed until one can have come near (Verlet 1967, Phys. Rev. 159, 98)."""

import warp as wp

from polyworld.solver.spatial.layout import BOX, MESH, PLANE, Geometry, Shape, State

# Contacts are closed below this gap, as a fraction of the smaller body's bounding radius.
TOUCHING = wp.float64(1.0e-4)
SKIN = wp.float64(8.0)  # steps for which a list lasts, at the speed of the fastest


@wp.func
def placed_shape(geometry: wp.array[Geometry], state: wp.array[State], w: int, j: int, q: int) -> Shape:
    """Shape q of body j; a plane where it stands in this world."""
    s = geometry[0].shapes[q]
    if s.kind == PLANE:
        plane = state[0].planes[w, j - state[0].objects]
        s.size = wp.vec3d(plane[0], plane[1], plane[2])
        s.bound = plane[3]
    return s


@wp.func
def near(state: wp.array[State], w: int, j: int, sa: Shape, xa: wp.vec3d, sb: Shape, reach: wp.float64) -> bool:
    """Check whether a's bounding sphere comes within reach of body j, or one of its shapes."""
    c = xa - state[0].bodies[w, j].x
    if sb.kind == PLANE:
        return wp.dot(sb.size, xa) - sb.bound - sa.bound <= reach
    if sb.kind == MESH:
        return True
    if sb.kind == BOX:
        p = wp.transpose(state[0].bodies[w, j].rotation) * c
        total = wp.float64(0.0)
        for k in range(3):
            beyond = wp.max(wp.abs(p[k]) - sb.size[k], wp.float64(0.0))
            total += beyond * beyond
        far = sa.bound + reach
        return total <= far * far
    far = sa.bound + sb.bound + reach
    return wp.dot(c, c) <= far * far


@wp.func(inline=False)
def list_neighbours(geometry: wp.array[Geometry], state: wp.array[State], w: int, skin: wp.float64) -> None:
    """List the pairs, in ascending order, whose bounding spheres come within `skin` of each other; all with statics."""
    count = wp.int32(0)
    neighbours = state[0].neighbours[w]
    bound = geometry[0].bound
    for i in range(state[0].objects):
        state[0].first_neighbour[w, i] = count
        xa = state[0].bodies[w, i].x
        state[0].listed_x[w, i] = xa
        for j in range(i + 1, state[0].objects + state[0].statics):
            if geometry[0].collides[i, j] == 0:
                continue
            far = bound[i] + bound[j] + skin
            if j >= state[0].objects or wp.length_sq(xa - state[0].bodies[w, j].x) <= far * far:
                if count == state[0].max_neighbours:
                    state[0].overflowed[w] = 1
                    count = wp.int32(0)
                neighbours[count] = j
                count += 1
    state[0].first_neighbour[w, state[0].objects] = count
    state[0].skin[w] = skin


@wp.func(inline=False)
def update_neighbours(geometry: wp.array[Geometry], state: wp.array[State], w: int, h: wp.float64) -> None:
    """List all pairs again if one that is not listed may come within reach, as `find_contacts` says."""
    moved = wp.float64(0.0)
    swept = wp.float64(0.0)
    fastest = wp.float64(0.0)
    largest = wp.float64(0.0)
    for i in range(state[0].objects):
        moved = wp.max(moved, wp.length_sq(state[0].bodies[w, i].x - state[0].listed_x[w, i]))
        swept = wp.max(swept, state[0].bodies[w, i].swept)
        fastest = wp.max(fastest, wp.length_sq(state[0].bodies[w, i].v))
        largest = wp.max(largest, geometry[0].bound[i])
    reach = wp.float64(2.0) * (swept + h * wp.sqrt(fastest) + TOUCHING * largest)
    # Also where a number is none.
    if not (reach + wp.float64(2.0) * wp.sqrt(moved) <= state[0].skin[w]):
        list_neighbours(geometry, state, w, reach * (wp.float64(1.0) + SKIN))
