"""The records the cloth kernels work on. SI units.

Triangle corners are counter-clockwise; its edge k lies opposite its corner k. Bend angles: an edge carries a director,
a normal of its own, and each triangle at the edge has the angle between its normal and that director as bend angle.
A slot 4 t + k is edge k of triangle t.
"""

import warp as wp

OPTIONS: dict[str, object] = {"enable_backward": False, "max_unroll": 1, "cpu_compiler_flags": "-march=native"}

# Triangles or edges that one thread goes through: on a CPU a loop costs half of what as many threads do.
BLOCK = wp.constant(256)
FLATTEST = wp.constant(wp.float64(1.0e-9))  # area ratio below which a triangle counts as this flat


@wp.struct
class Material:
    """Parameters of one cloth in one world.

    stretch, cross: Q_11 = Q_22 and Q_12 of the membrane [N/m]. shear: 2 G t [N/m]. stretch_delay, bend_delay: damping
    times [s]. plate: D [N m]. poisson [1]. director: of an edge's director, 1 / (inertia * softness) [1/(N m s^2)].
    inverse_density: area per mass [m^2/kg]. drag_normal, drag_tangential: half the air's density times the coefficient
    [kg/m^3].
    """

    stretch: wp.float64
    cross: wp.float64
    shear: wp.float64
    stretch_delay: wp.float64
    bend_delay: wp.float64
    plate: wp.float64
    poisson: wp.float64
    director: wp.float64
    inverse_density: wp.float64
    drag_normal: wp.float64
    drag_tangential: wp.float64


@wp.struct
class Surface:
    """Constants and parameters: T triangles and E edges of all cloths, in W worlds.

    corners (T,): nodes. edges (T,): 2 e + s of each of its edges, s = 0 for the first triangle at edge e. cloth (T,):
    index of its object. area (T,): rest area [m^2]. inverse_rest (T,): inverse of the matrix of its rest edges 0-1
    and 0-2 in material axes [1/m]. curvature (T,): of the bend angles, to (k_11, k_22, k_12) in material axes [1/m].
    rest_curvature (T,): that without moment [1/m]. fixed (T,): 1 where all corners are held to one rigid body for good.
    ends (E,): nodes, in the order of the first triangle. slots (E,): in its two triangles, -1 for none. softness
    (E,): inverse stiffness of its director for D = 1 [1]. materials (W, cloths). wind: velocity of the air [m/s].
    """

    corners: wp.array[wp.vec3i]
    edges: wp.array[wp.vec3i]
    cloth: wp.array[wp.int32]
    area: wp.array[wp.float64]
    inverse_rest: wp.array[wp.mat22d]
    curvature: wp.array[wp.mat33d]
    rest_curvature: wp.array[wp.vec3d]
    fixed: wp.array[wp.int32]
    ends: wp.array[wp.vec2i]
    slots: wp.array[wp.vec2i]
    softness: wp.array[wp.float64]
    materials: wp.array2d[Material]
    wind: wp.vec3d


@wp.struct
class Bending:
    """State and scratch of bending, W worlds.

    angle, rate (W, E): of the director against the mean of the two normals [rad], [rad/s]: state. moment (W, T):
    energy per bend angle of each edge [N m]: state too, the directors' next step needs it. normal (W, T): unit
    normal. spread (W, T): 1 / (2 current area) [1/m^2]; negative for a triangle that is held at all corners.
    turning (W, T): rate at which the normal turns, as a vector along edges [rad/s]. bend, bend_rate (W, E): bend angle
    of the first and of the second triangle, and its rate. share (W, E): of the first triangle in the hinge angle.
    inverse_length (W, E) [1/m]. torque (W, E): energy per hinge angle, over the edge's length [N].
    """

    angle: wp.array2d[wp.float64]
    rate: wp.array2d[wp.float64]
    moment: wp.array2d[wp.vec3d]
    normal: wp.array2d[wp.vec3d]
    spread: wp.array2d[wp.float64]
    turning: wp.array2d[wp.vec3d]
    bend: wp.array2d[wp.vec2d]
    bend_rate: wp.array2d[wp.vec2d]
    share: wp.array2d[wp.float64]
    inverse_length: wp.array2d[wp.float64]
    torque: wp.array2d[wp.float64]


@wp.struct
class Damping:
    """Scratch of the damping of stretch, for the n nodes of all cloths, in order.

    nodes (n,): the node; corners (T,): of the triangles, counted among these. stages (W,): number of stages. first,
    second (W, T): rest axes as they lie now, F; stretch (W, T): u_11, u_22, u_12 of U. start, push, rate (W, n):
    velocity before, acceleration by other forces, change by a part of the step there. last, other (W, n): velocities
    of the stages, alternating. force (W, n) [N].
    """

    nodes: wp.array[wp.int32]
    corners: wp.array[wp.vec3i]
    stages: wp.array[wp.int32]
    first: wp.array2d[wp.vec3d]
    second: wp.array2d[wp.vec3d]
    stretch: wp.array2d[wp.vec3d]
    start: wp.array2d[wp.vec3d]
    push: wp.array2d[wp.vec3d]
    rate: wp.array2d[wp.vec3d]
    last: wp.array2d[wp.vec3d]
    other: wp.array2d[wp.vec3d]
    force: wp.array2d[wp.vec3d]


@wp.func
def drift(v: wp.vec3d, gravity: wp.vec3d, inverse_mass: wp.float64, h: wp.float64) -> wp.vec3d:
    """Velocity with which the position changes: of a free node the one at the step's end lacks half a step of gravity,
    see `coupled.motion.move`. Between held and free nodes the difference would damp what does not move.
    """
    if inverse_mass > wp.float64(0.0):
        return v - gravity * (wp.float64(0.5) * h)
    return v
