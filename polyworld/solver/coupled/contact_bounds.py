"""Bounds of deformable objects, and which parts of bodies and obstacles may reach them in a step."""

import warp as wp

from polyworld.solver.coupled.contact_layout import (
    Bounds,
    Obstacles,
    Part,
    Surface,
)
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.spatial.layout import MESH, OPTIONS, PLANE, Body

wp.set_module_options(OPTIONS)

OWN_SHARE = wp.constant(wp.float64(1.2))  # of a node's own path in the step; it may get faster meanwhile,
OBJECT_SHARE = wp.constant(wp.float64(0.3))  # by this share of its object's highest speed


@wp.kernel
def bound_objects(nodes: Nodes, surface: Surface, bounds: Bounds) -> None:
    """Boxes around the deformable objects and their highest speeds."""
    w, d = wp.tid()
    low = wp.vec3d(wp.float64(1.0e30), wp.float64(1.0e30), wp.float64(1.0e30))
    high = -low
    fastest = wp.float64(0.0)
    for i in range(surface.first[d], surface.first[d] + surface.count[d]):
        p = nodes.x[w, i]
        low = wp.min(low, p)
        high = wp.max(high, p)
        fastest = wp.max(fastest, wp.length_sq(nodes.v[w, i]))
    bounds.low[w, d] = low
    bounds.high[w, d] = high
    bounds.speed[w, d] = wp.sqrt(fastest)


@wp.func
def part_position(bodies: wp.array2d[Body], w: int, part: Part) -> wp.vec3d:
    """Origin of a piece in world axes."""
    return bodies[w, part.body].x + bodies[w, part.body].rotation * part.position


@wp.func
def swept(bodies: wp.array2d[Body], w: int, part: Part, h: wp.float64) -> wp.float64:
    """Compute how far a point of a piece may move in the step."""
    return h * (
        wp.length(bodies[w, part.body].v) + wp.length(bodies[w, part.body].w) * (part.bound + wp.length(part.position))
    )


@wp.kernel
def near_parts(clock: Clock, obstacles: Obstacles, surface: Surface, bounds: Bounds) -> None:
    """Find which pieces come near the box around each deformable object."""
    w, d, s = wp.tid()
    h = clock.h[w]
    bounds.near[w, d, s] = 0
    part = obstacles.parts[s]
    if h <= wp.float64(0.0) or obstacles.bodies[w, part.body].active == 0 or surface.count[d] == 0:
        return
    thickness = surface.radius[surface.first[d]]
    fall = wp.length(clock.gravity[w % clock.gravity.shape[0]]) * h * h
    reach = thickness * wp.float64(1.1) + swept(obstacles.bodies, w, part, h) + fall
    reach += (OWN_SHARE + OBJECT_SHARE) * bounds.speed[w, d] * h + wp.float64(1.0e-5)
    low = bounds.low[w, d]
    high = bounds.high[w, d]
    kind = obstacles.geometry[0].shapes[part.shape].kind
    if kind == PLANE:
        n = obstacles.geometry[0].shapes[part.shape].size
        lowest = -obstacles.geometry[0].shapes[part.shape].bound
        for k in range(3):
            lowest += wp.min(n[k] * low[k], n[k] * high[k])
        if lowest <= reach:
            bounds.near[w, d, s] = 1
        return
    if kind == MESH:
        bounds.near[w, d, s] = 1
        return
    p = part_position(obstacles.bodies, w, part)
    away = p - wp.min(wp.max(p, low), high)
    far = part.bound + reach
    if wp.length_sq(away) <= far * far:
        bounds.near[w, d, s] = 1


@wp.func
def nothing_near(bounds: Bounds, w: int, d: int) -> bool:
    near = wp.int32(0)
    for s in range(bounds.near.shape[2]):
        near += bounds.near[w, d, s]
    return near == 0
