"""Distance and outward direction of a point from a solid, and the part of a cell's surroundings a solid covers."""

import warp as wp

from polyworld.solver.fluid.layout import Solid, Solids
from polyworld.solver.fluid.stencil import HALF, ONE, ZERO
from polyworld.solver.spatial.layout import BOX, CAPSULE, CONVEX, CYLINDER, MESH, PLANE, SPHERE

OPEN_MESH = 1  # `faces` of a mesh that does not enclose a volume: what lies behind its nearest face is solid
THIN = wp.float64(1.0e-3)  # of an edge
FAR = wp.float64(1.0e3)  # farther than this from a mesh counts as outside [m]


@wp.func
def _out(v: wp.vec3d, otherwise: wp.vec3d) -> wp.vec3d:
    length = wp.length(v)
    if length < wp.float64(1.0e-14):
        return otherwise
    return v / length


@wp.func(inline=False)
def nearest(solids: Solids, s: int, p: wp.vec3d) -> wp.vec4d:
    """Outward normal and signed distance (negative inside) of solid s at p, both in the solid's own axes."""
    solid = solids.solids[s]
    kind = solid.kind
    size = solid.size
    up = wp.vec3d(ZERO, ZERO, ONE)
    n = up
    d = FAR
    if kind == SPHERE:
        n = _out(p, up)
        d = wp.length(p) - size[0]
    elif kind == CAPSULE:
        away = p - up * wp.clamp(p[2], -size[2], size[2])
        n = _out(away, wp.vec3d(ONE, ZERO, ZERO))
        d = wp.length(away) - size[0]
    elif kind == BOX:
        q = wp.vec3d(wp.abs(p[0]) - size[0], wp.abs(p[1]) - size[1], wp.abs(p[2]) - size[2])
        away = wp.vec3d()
        a = wp.int32(0)
        for i in range(3):
            if q[i] > ZERO:
                away[i] = q[i] * wp.sign(p[i])
            if q[i] > q[a]:
                a = i
        d = q[a]
        if d > ZERO:
            d = wp.length(away)
            n = away / d
        else:
            away = wp.vec3d()
            away[a] = ONE
            if p[a] < ZERO:
                away[a] = -ONE
            n = away
    elif kind == CYLINDER:
        rim = wp.sqrt(p[0] * p[0] + p[1] * p[1])
        side = _out(wp.vec3d(p[0], p[1], ZERO), wp.vec3d(ONE, ZERO, ZERO))
        beyond = rim - size[0]
        cap = wp.abs(p[2]) - size[2]
        top = up
        if p[2] < ZERO:
            top = -up
        if beyond > ZERO and cap > ZERO:
            away = side * beyond + top * cap
            d = wp.length(away)
            n = away / d
        elif beyond > cap:
            n = side
            d = beyond
        else:
            n = top
            d = cap
    elif kind == CONVEX:
        d = -FAR
        for f in range(solid.first_face, solid.first_face + solid.faces):
            height = wp.dot(solids.normals[f], p) - solids.offsets[f]
            if height > d:
                d = height
                n = solids.normals[f]
    elif kind == PLANE:
        n = size
        d = wp.dot(size, p) - solid.offset
    elif kind == MESH:
        point = wp.vec3(wp.float32(p[0]), wp.float32(p[1]), wp.float32(p[2]))
        hit = wp.mesh_query_point_sign_winding_number(solids.meshes[s], point, wp.float32(FAR))
        if solid.faces == OPEN_MESH:
            hit = wp.mesh_query_point_sign_normal(solids.meshes[s], point, wp.float32(FAR))
        if hit.result:
            on = wp.mesh_eval_position(solids.meshes[s], hit.face, hit.u, hit.v)
            face = wp.mesh_eval_face_normal(solids.meshes[s], hit.face)
            gap = point - on
            d = wp.float64(wp.length(gap)) * wp.float64(hit.sign)
            n = wp.vec3d(wp.float64(face[0]), wp.float64(face[1]), wp.float64(face[2]))
            if wp.abs(d) > wp.float64(1.0e-5):
                n = wp.vec3d(wp.float64(gap[0]), wp.float64(gap[1]), wp.float64(gap[2])) / d
    return wp.vec4d(n[0], n[1], n[2], d)


@wp.func
def ramp(d: wp.float64, width: wp.float64) -> wp.float64:
    return wp.clamp(HALF - d / width, ZERO, ONE)


@wp.func
def _slab(x: wp.float64, half: wp.float64, h: wp.float64) -> wp.float64:
    """Part of [x - h/2, x + h/2] inside a slab. One thinner than two edges keeps one face of any grid closed."""
    inside = wp.max(half, HALF * h)
    width = wp.min(wp.float64(2.0) * inside - h, h)
    if width > THIN * h:
        return ramp(wp.abs(x) - inside, width)
    # Where both its sides lie on faces, one of them is the wall.
    if wp.abs(x + THIN * h) < inside:
        return ONE
    return ZERO


@wp.func(inline=False)
def cover(solids: Solids, s: int, p: wp.vec3d, h: wp.float64, flat: int) -> wp.float64:
    """Part of the surroundings (an edge h wide) of p, in the solid's axes, that the solid takes up, 0 to 1.

    The solid smeared over h: its faces move through the grid without steps, its volume stays, and flow along a
    plane face at any angle to the grid meets no resistance. flat: 1 in a plane.
    """
    solid = solids.solids[s]
    size = solid.size
    # Smearing a curved surface adds volume, h^2/12 times the mean curvature; a smaller radius takes it away.
    # Sheets end half an edge later, so that those that meet at an edge leave no gap between them.
    if solid.kind == BOX:
        if wp.min(size[0], wp.min(size[1], size[2])) < h:
            for a in range(3):
                if size[a] >= h:
                    size[a] = size[a] + HALF * h
        return _slab(p[0], size[0], h) * _slab(p[1], size[1], h) * _slab(p[2], size[2], h)
    if solid.kind == CYLINDER:
        radius = size[0] - h * h / (wp.float64(24.0) * size[0])
        if size[2] < h:
            radius = size[0] + HALF * h
        rim = wp.sqrt(p[0] * p[0] + p[1] * p[1])
        return ramp(rim - radius, h) * _slab(p[2], size[2], h)
    d = nearest(solids, s, p)[3]
    if solid.kind == SPHERE or solid.kind == CAPSULE:
        curved = wp.float64(12.0)
        if flat == 1 or solid.kind == CAPSULE:
            curved = wp.float64(24.0)
        d += h * h / (curved * size[0])
    return ramp(d, h)


@wp.func
def to_solid(solid: Solid, x: wp.vec3d, rotation: wp.mat33d, p: wp.vec3d) -> wp.vec3d:
    """Return a world point in the axes of a solid whose body is at x with the given rotation."""
    local = wp.transpose(rotation) * (p - x)
    return wp.transpose(solid.rotation) * (local - solid.position)
