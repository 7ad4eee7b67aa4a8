"""Contacts of nodes as points: where they are, how fast they part, and what an impulse at them does."""

import warp as wp

from polyworld.solver.core.friction import friction_impulse
from polyworld.solver.coupled.contact_bodies import Carried
from polyworld.solver.coupled.contact_layout import (
    CORNER,
    CROSSING,
    ON_SHAPE,
    ON_SIDE,
    ON_TRIANGLE,
    Contact,
    Obstacles,
)
from polyworld.solver.coupled.contact_shapes import FAR, shape_distance, triangle_distance
from polyworld.solver.coupled.mechanism import point_response, push_mechanism
from polyworld.solver.spatial.layout import OPTIONS, PLANE, Body
from polyworld.solver.spatial.manifold import tangent
from polyworld.solver.spatial.separation import triangle_weights
from polyworld.solver.spatial.shapes import unit

wp.set_module_options(OPTIONS)


@wp.func
def closest_on_segments(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, d: wp.vec3d) -> wp.vec2d:
    """Parameters of the closest points of segments ab and cd (Ericson 2005, 5.1.9); of parallel ones the middle of
    where they lie side by side.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    u = b - a
    v = d - c
    r = a - c
    uu = wp.dot(u, u)
    vv = wp.dot(v, v)
    uv = wp.dot(u, v)
    ur = wp.dot(u, r)
    vr = wp.dot(v, r)
    det = uu * vv - uv * uv
    s = wp.float64(0.5)
    if det > wp.float64(1.0e-9) * uu * vv:
        s = wp.clamp((uv * vr - ur * vv) / det, zero, one)
    else:
        s0 = wp.clamp(-ur / uu, zero, one)
        s1 = wp.clamp((uv - ur) / uu, zero, one)
        s = wp.float64(0.5) * (s0 + s1)
    t = (uv * s + vr) / vv
    if t < zero:
        t = zero
        s = wp.clamp(-ur / uu, zero, one)
    elif t > one:
        t = one
        s = wp.clamp((uv - ur) / uu, zero, one)
    return wp.vec2d(s, t)


@wp.func
def follow(c: Contact, obstacles: Obstacles, across: wp.vec3d, x: wp.array2d[wp.vec3d], w: int) -> Contact:
    """Return the contact's gap, normal, weights and arm where its sides are now; FAR where it cannot touch."""
    zero = wp.float64(0.0)
    p = x[w, c.n0]
    if c.kind == ON_SHAPE or c.kind == ON_TRIANGLE:
        if c.weight[1] > zero:
            p = p * c.weight[0] + x[w, c.n1] * c.weight[1]
        c.arm = p - obstacles.bodies[w, c.body].x
        at = wp.vec4d()
        rotation = obstacles.bodies[w, c.body].rotation
        if c.kind == ON_TRIANGLE:
            first = obstacles.geometry[0].face_corners[obstacles.geometry[0].face_starts[c.part]]
            at = triangle_distance(obstacles.geometry, first, c.part, wp.transpose(rotation) * c.arm)
        else:
            shape = obstacles.parts[c.part].shape
            kind = obstacles.geometry[0].shapes[shape].kind
            if kind == PLANE:
                c.normal = obstacles.geometry[0].shapes[shape].size
                c.gap = wp.dot(c.normal, p) - obstacles.geometry[0].shapes[shape].bound - c.reach
                return c
            local = wp.transpose(rotation) * c.arm - obstacles.parts[c.part].position
            local = wp.transpose(obstacles.parts[c.part].rotation) * local
            at = shape_distance(obstacles.geometry, kind, obstacles.geometry[0].shapes[shape], local)
            rotation = rotation * obstacles.parts[c.part].rotation
        c.normal = rotation * wp.vec3d(at[0], at[1], at[2])
        c.gap = at[3] - c.reach
        return c
    if c.kind == CROSSING:
        st = closest_on_segments(p, x[w, c.n1], x[w, c.n2], x[w, c.n3])
        c.weight = wp.vec4d(wp.float64(1.0) - st[0], st[0], st[1] - wp.float64(1.0), -st[1])
        away = p * c.weight[0] + x[w, c.n1] * c.weight[1] + x[w, c.n2] * c.weight[2] + x[w, c.n3] * c.weight[3]
        c.normal = unit(away, c.normal)
        c.gap = wp.length(away) - c.reach
        return c
    if c.kind == ON_SIDE:
        begin = x[w, c.n1]
        edge = x[w, c.n2] - begin
        at_side = wp.clamp(wp.dot(p - begin, edge) / wp.dot(edge, edge), zero, wp.float64(1.0))
        away = p - begin - edge * at_side
        outward = wp.normalize(wp.cross(edge, across))
        height = wp.dot(outward, away)
        c.weight = wp.vec4d(wp.float64(1.0), at_side - wp.float64(1.0), -at_side, zero)
        c.normal = outward
        c.gap = height - c.reach
        if at_side <= zero or at_side >= wp.float64(1.0):
            c.normal = unit(away, outward)
            c.gap = wp.where(height < zero, FAR, wp.length(away) - c.reach)
        return c
    a = p
    if c.kind == CORNER:
        p = obstacles.bodies[w, c.body].x + obstacles.bodies[w, c.body].rotation * obstacles.corners[c.part]
        b1 = x[w, c.n1]
        b2 = x[w, c.n2]
    else:
        a = x[w, c.n1]
        b1 = x[w, c.n2]
        b2 = x[w, c.n3]
    weights = triangle_weights(a - p, b1 - p, b2 - p)
    away = p - (a * weights[0] + b1 * weights[1] + b2 * weights[2])
    face = wp.normalize(wp.cross(b1 - a, b2 - a))
    inside = wp.min(weights[0], wp.min(weights[1], weights[2])) > zero
    if c.kind == CORNER:
        c.arm = p - away - obstacles.bodies[w, c.body].x
        c.weight = wp.vec4d(weights[0], weights[1], weights[2], zero)
        c.normal = face * c.side
        c.gap = FAR
        if inside:
            c.gap = -c.side * wp.dot(face, away) - c.reach
        return c
    c.weight = wp.vec4d(wp.float64(1.0), -weights[0], -weights[1], -weights[2])
    height = wp.dot(face, away)
    if inside:
        c.normal = face * c.side
        c.gap = c.side * height - c.reach
        return c
    # Beside the triangle nothing separates its two sides: the side is that which the node is on.
    distance = wp.length(away)
    c.normal = unit(away, face * c.side)
    c.gap = distance - c.reach
    if c.part == 1 and height < zero:  # inside a solid: a neighbour is closer
        c.gap = FAR
    if c.part == 0 and c.gap > zero:
        c.side = wp.where(height >= zero, wp.float64(1.0), wp.float64(-1.0))
    return c


@wp.func
def relative_velocity(c: Contact, bodies: wp.array2d[Body], v: wp.array2d[wp.vec3d], w: int) -> wp.vec3d:
    u = v[w, c.n0] * c.weight[0]
    if c.weight[1] != wp.float64(0.0):
        u += v[w, c.n1] * c.weight[1]
    if c.weight[2] != wp.float64(0.0):
        u += v[w, c.n2] * c.weight[2]
    if c.weight[3] != wp.float64(0.0):
        u += v[w, c.n3] * c.weight[3]
    if c.body >= 0:
        u -= bodies[w, c.body].v + wp.cross(bodies[w, c.body].w, c.arm)
    return u


@wp.func
def push(
    c: Contact,
    impulse: wp.vec3d,
    inverse_mass: wp.array2d[wp.float64],
    carried: Carried,
    bodies: wp.array2d[Body],
    v: wp.array2d[wp.vec3d],
    w: int,
) -> None:
    r = w % inverse_mass.shape[0]
    v[w, c.n0] += impulse * (c.weight[0] * inverse_mass[r, c.n0])
    if c.weight[1] != wp.float64(0.0):
        v[w, c.n1] += impulse * (c.weight[1] * inverse_mass[r, c.n1])
    if c.weight[2] != wp.float64(0.0):
        v[w, c.n2] += impulse * (c.weight[2] * inverse_mass[r, c.n2])
    if c.weight[3] != wp.float64(0.0):
        v[w, c.n3] += impulse * (c.weight[3] * inverse_mass[r, c.n3])
    if c.body >= 0 and bodies[w, c.body].inverse_mass > wp.float64(0.0):
        if carried.mechanisms.first[c.body] >= 0:
            push_mechanism(carried.mechanisms, bodies, w, c.body, -impulse, wp.cross(impulse, c.arm))
            return
        bodies[w, c.body].v -= impulse * bodies[w, c.body].inverse_mass
        bodies[w, c.body].w -= carried.inverse_inertia[w, c.body] * wp.cross(c.arm, impulse)


@wp.func
def node_mobility(c: Contact, inverse_mass: wp.array2d[wp.float64], w: int) -> wp.float64:
    """Velocity of the weighted point per impulse on it."""
    r = w % inverse_mass.shape[0]
    return (
        c.weight[0] * c.weight[0] * inverse_mass[r, c.n0]
        + c.weight[1] * c.weight[1] * inverse_mass[r, c.n1]
        + c.weight[2] * c.weight[2] * inverse_mass[r, c.n2]
        + c.weight[3] * c.weight[3] * inverse_mass[r, c.n3]
    )


@wp.func
def weigh(
    c: Contact,
    inverse_mass: wp.array2d[wp.float64],
    carried: Carried,
    bodies: wp.array2d[Body],
    w: int,
) -> Contact:
    """Effective inverse masses of the contact along its normal and its two tangents."""
    k = node_mobility(c, inverse_mass, w)
    c.k = k
    c.t1 = tangent(c.normal)
    c.k12 = wp.float64(0.0)
    c.k11 = k
    c.k22 = k
    if c.body >= 0 and bodies[w, c.body].inverse_mass > wp.float64(0.0):
        t2 = wp.cross(c.normal, c.t1)
        if carried.mechanisms.first[c.body] >= 0:
            yielding = point_response(carried.mechanisms, w, c.body, c.arm)
            c.k = k + wp.dot(c.normal, yielding * c.normal)
            along = yielding * c.t1
            c.k11 = k + wp.dot(c.t1, along)
            c.k12 = wp.dot(t2, along)
            c.k22 = k + wp.dot(t2, yielding * t2)
            return c
        k += bodies[w, c.body].inverse_mass
        jn = wp.cross(c.arm, c.normal)
        j1 = wp.cross(c.arm, c.t1)
        j2 = wp.cross(c.arm, t2)
        inertia = carried.inverse_inertia[w, c.body]
        c.k = k + wp.dot(jn, inertia * jn)
        turned = inertia * j1
        c.k11 = k + wp.dot(j1, turned)
        c.k12 = wp.dot(j2, turned)
        c.k22 = k + wp.dot(j2, inertia * j2)
    return c


@wp.func
def tangential_impulse(c: Contact, u: wp.vec3d, bound: wp.float64) -> wp.vec3d:
    """Return the tangential impulse that stops the sliding velocity u, or as much of it as friction can."""
    t2 = wp.cross(c.normal, c.t1)
    before = wp.vec2d(wp.dot(c.tangential, c.t1), wp.dot(c.tangential, t2))
    slip = wp.vec2d(wp.dot(u, c.t1), wp.dot(u, t2))
    impulse = friction_impulse(before, slip, wp.vec3d(c.k11, c.k12, c.k22), bound)
    return c.t1 * impulse[0] + t2 * impulse[1]


@wp.func
def node_of(c: Contact, m: int) -> int:
    if m == 1:
        return c.n1
    if m == 2:
        return c.n2
    if m == 3:
        return c.n3
    return c.n0
