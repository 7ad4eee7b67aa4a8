"""Signed distance of a point to a shape, and its direction."""

import warp as wp

from polyworld.solver.spatial.contacts import inactive_edge
from polyworld.solver.spatial.layout import BOX, CAPSULE, CONVEX, CYLINDER, Geometry, Shape
from polyworld.solver.spatial.separation import triangle_weights
from polyworld.solver.spatial.shapes import outward_at, unit

FAR = wp.float64(1.0e30)


@wp.func(inline=False)
def shape_distance(geometry: wp.array[Geometry], kind: int, shape: Shape, p: wp.vec3d) -> wp.vec4d:
    """Outward normal and, as fourth value, signed distance of p from the surface (body axes).

    Beside an edge or a corner of a convex mesh the distance is that to the farther face's plane, which is less than
    the true one by a fraction of the radius that touches it.
    """
    zero = wp.float64(0.0)
    if kind == CONVEX:
        best = wp.vec3d()
        highest = -FAR
        for f in range(shape.first_face, shape.first_face + shape.faces):
            n = geometry[0].face_normals[f]
            height = wp.dot(n, p - geometry[0].vertices[geometry[0].face_corners[geometry[0].face_starts[f]]])
            if height > highest:
                highest = height
                best = n
        return wp.vec4d(best[0], best[1], best[2], highest)
    n = outward_at(shape, p)
    reach = shape.size[0]  # of a sphere
    if kind == BOX:
        reach = wp.abs(n[0]) * shape.size[0] + wp.abs(n[1]) * shape.size[1] + wp.abs(n[2]) * shape.size[2]
    elif kind == CYLINDER:
        reach = wp.sqrt(n[0] * n[0] + n[1] * n[1]) * shape.size[0] + wp.abs(n[2]) * shape.size[2]
    elif kind == CAPSULE:
        reach = shape.size[0] + wp.abs(n[2]) * shape.size[2]
    return wp.vec4d(n[0], n[1], n[2], wp.max(wp.dot(p, n) - reach, -FAR) + zero)


@wp.func(inline=False)
def triangle_distance(geometry: wp.array[Geometry], first_vertex: int, face: int, p: wp.vec3d) -> wp.vec4d:
    """Return the same for a triangle of a mesh that is touched from its front; FAR where a neighbour is closer."""
    a = geometry[0].vertices[first_vertex]
    b = geometry[0].vertices[first_vertex + 1]
    c = geometry[0].vertices[first_vertex + 2]
    n = geometry[0].face_normals[face]
    weights = triangle_weights(a - p, b - p, c - p)
    away = p - (a * weights[0] + b * weights[1] + c * weights[2])
    height = wp.dot(n, away)
    distance = wp.length(away)
    if wp.abs(height) > wp.float64(0.999999) * distance:
        return wp.vec4d(n[0], n[1], n[2], height)
    direction = unit(away, n)
    if height < wp.float64(0.0) or inactive_edge(geometry, face, direction):
        return wp.vec4d(n[0], n[1], n[2], FAR)
    return wp.vec4d(direction[0], direction[1], direction[2], distance)
