"""Queries of convex shapes for the contact search: support points, extents, face normals and closest points."""

import warp as wp

from polyworld.solver.spatial.layout import (
    BOX,
    CAPSULE,
    CONVEX,
    CYLINDER,
    SPHERE,
    TRIANGLE,
    Geometry,
    Shape,
)

# A cylinder shows its cap rather than its side in directions within 45 degrees of its axis.
CAP_COSINE = wp.float64(0.7071)


@wp.func
def sign(x: wp.float64) -> wp.float64:
    if x < wp.float64(0.0):
        return wp.float64(-1.0)
    return wp.float64(1.0)


@wp.func
def unit(v: wp.vec3d, otherwise: wp.vec3d) -> wp.vec3d:
    """v over its length, or `otherwise` where v has none."""
    square = wp.dot(v, v)
    if square < wp.float64(1.0e-28):
        return otherwise
    return v / wp.sqrt(square)


@wp.func
def radial(d: wp.vec3d) -> wp.vec3d:
    """Unit vector of d's part across the body z axis; zero where d is along it."""
    return unit(wp.vec3d(d[0], d[1], wp.float64(0.0)), wp.vec3d())


@wp.func
def rounding(shape: Shape) -> wp.float64:
    """Radius by which the shape's core is swept: a ball is a swept point, a capsule a swept segment."""
    if shape.kind == SPHERE or shape.kind == CAPSULE:
        return shape.size[0]
    return wp.float64(0.0)


@wp.func(inline=False)
def support(vertices: wp.array[wp.vec3d], shape: Shape, d: wp.vec3d, inset: wp.float64) -> wp.vec3d:
    """Farthest point along d (body axes) of the core that lies `inset` inside the surface."""
    if shape.kind == BOX:
        return wp.vec3d(
            sign(d[0]) * (shape.size[0] - inset),
            sign(d[1]) * (shape.size[1] - inset),
            sign(d[2]) * (shape.size[2] - inset),
        )
    if shape.kind == CYLINDER:
        rim = radial(d) * (shape.size[0] - inset)
        return wp.vec3d(rim[0], rim[1], sign(d[2]) * (shape.size[2] - inset))
    if shape.kind == CAPSULE:
        return wp.vec3d(wp.float64(0.0), wp.float64(0.0), sign(d[2]) * shape.size[2])
    if shape.kind == SPHERE:
        return wp.vec3d()
    best = vertices[shape.first_vertex]
    highest = wp.dot(best, d)
    for i in range(shape.first_vertex + 1, shape.first_vertex + shape.vertices):
        height = wp.dot(vertices[i], d)
        if height > highest:
            highest = height
            best = vertices[i]
    if shape.kind == CONVEX:  # shrunk about the centre of mass, so that faces and edges keep their directions
        best = best * (wp.float64(1.0) - inset / shape.bound)
    return best


@wp.func
def extent(vertices: wp.array[wp.vec3d], shape: Shape, d: wp.vec3d) -> wp.float64:
    """Return the support of the shape along the unit vector d (body axes) from its origin [m]."""
    return wp.dot(support(vertices, shape, d, wp.float64(0.0)), d) + rounding(shape)


@wp.func
def face_towards(geometry: wp.array[Geometry], shape: Shape, d: wp.vec3d) -> int:
    """Row of the mesh face whose outward normal is closest to d (body axes)."""
    best = shape.first_face
    highest = wp.dot(geometry[0].face_normals[best], d)
    for f in range(shape.first_face + 1, shape.first_face + shape.faces):
        height = wp.dot(geometry[0].face_normals[f], d)
        if height > highest:
            highest = height
            best = f
    return best


@wp.func(inline=False)
def face_normal(geometry: wp.array[Geometry], shape: Shape, d: wp.vec3d) -> wp.vec3d:
    """Outward normal of the flat or developable face that looks most along d (body axes); zero for round shapes."""
    zero = wp.float64(0.0)
    if shape.kind == BOX:
        x = wp.abs(d[0])
        y = wp.abs(d[1])
        z = wp.abs(d[2])
        if x >= y and x >= z:
            return wp.vec3d(sign(d[0]), zero, zero)
        if y >= z:
            return wp.vec3d(zero, sign(d[1]), zero)
        return wp.vec3d(zero, zero, sign(d[2]))
    if shape.kind == CYLINDER:
        if wp.abs(d[2]) > CAP_COSINE:
            return wp.vec3d(zero, zero, sign(d[2]))
        return radial(d)
    if shape.kind == CONVEX:
        return geometry[0].face_normals[face_towards(geometry, shape, d)]
    if shape.kind == TRIANGLE:  # touched from its front side
        return geometry[0].face_normals[shape.first_face]
    return wp.vec3d()


@wp.func(inline=False)
def outward_at(shape: Shape, p: wp.vec3d) -> wp.vec3d:
    """Unit vector from the closest surface point to p, outwards, for the shapes with a closed form (body axes)."""
    zero = wp.float64(0.0)
    up = wp.vec3d(zero, zero, wp.float64(1.0))
    if shape.kind == BOX:
        c = wp.vec3d(
            wp.clamp(p[0], -shape.size[0], shape.size[0]),
            wp.clamp(p[1], -shape.size[1], shape.size[1]),
            wp.clamp(p[2], -shape.size[2], shape.size[2]),
        )
        away = p - c
        if wp.dot(away, away) > wp.float64(0.0):
            return unit(away, up)
        x = shape.size[0] - wp.abs(p[0])
        y = shape.size[1] - wp.abs(p[1])
        z = shape.size[2] - wp.abs(p[2])
        if x <= y and x <= z:
            return wp.vec3d(sign(p[0]), zero, zero)
        if y <= z:
            return wp.vec3d(zero, sign(p[1]), zero)
        return wp.vec3d(zero, zero, sign(p[2]))
    if shape.kind == CYLINDER:
        out = radial(p)
        beyond_side = wp.dot(out, p) - shape.size[0]
        beyond_cap = wp.abs(p[2]) - shape.size[2]
        if beyond_side > zero and beyond_cap > zero:
            return unit(out * beyond_side + up * (beyond_cap * sign(p[2])), up)
        if beyond_side > beyond_cap:
            return out
        return up * sign(p[2])
    if shape.kind == CAPSULE:
        return unit(p - up * wp.clamp(p[2], -shape.size[2], shape.size[2]), wp.vec3d(wp.float64(1.0), zero, zero))
    return unit(p, up)


@wp.func
def has_closed_form(shape: Shape) -> bool:
    """Check whether `outward_at` knows the shape."""
    return shape.kind == SPHERE or shape.kind == BOX or shape.kind == CYLINDER or shape.kind == CAPSULE


@wp.func
def candidate_count(shape: Shape) -> int:
    """Number of face normals to try when two cores overlap; see `candidate`."""
    if shape.kind == BOX:
        return 6
    if shape.kind == CYLINDER:
        return 2
    if shape.kind == CONVEX or shape.kind == TRIANGLE:
        return shape.faces
    return 0


@wp.func
def candidate(geometry: wp.array[Geometry], shape: Shape, i: int) -> wp.vec3d:
    """Return the i-th of a shape's face normals (body axes)."""
    zero = wp.float64(0.0)
    if shape.kind == CONVEX or shape.kind == TRIANGLE:
        return geometry[0].face_normals[shape.first_face + i]
    s = wp.float64(1 - 2 * (i % 2))
    if shape.kind == BOX:
        if i < 2:
            return wp.vec3d(s, zero, zero)
        if i < 4:
            return wp.vec3d(zero, s, zero)
    return wp.vec3d(zero, zero, s)
