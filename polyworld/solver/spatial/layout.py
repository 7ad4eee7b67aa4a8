"""Records of the kernels: bodies, shapes, contacts. SI units, world axes unless said otherwise.

Objects come first in every body array, statics after them; a static is a body of zero inverse mass.
"""

import warp as wp

from polyworld.solver.core.effect_table import Effects
from polyworld.solver.core.simulator import Outcome

# Small code is quick to compile, and a first rollout is a user's first impression: no unrolling, and LLVM's
# own inlining threshold in place of Warp's, which is twenty times higher.
OPTIONS: dict[str, object] = {"enable_backward": False, "max_unroll": 1, "cpu_compiler_flags": "-march=native"}

SPHERE = 0
BOX = 1
CYLINDER = 2
CAPSULE = 3
CONVEX = 4
TRIANGLE = 5
PLANE = 6
MESH = 7

MAX_FACE_POINTS = 16  # corners of one supporting face that are looked at
MAX_CLIPPED_POINTS = 48  # a convex polygon of 16 corners clipped by another has at most 32
MAX_MANIFOLD_POINTS = 8  # contact points kept of one pair


@wp.struct
class Shape:
    """Geometry in the shape's own axes, the same in all worlds.

    size: box half extents; (radius, radius, half height) of cylinder and capsule; radius of a sphere; normal of
    a plane, whose offset is `bound`; where a plane stands in one world, State.planes says. bound: radius of the
    bounding sphere about the shape's origin [m]. inset: how far the core lies inside the surface [m]. first_vertex,
    vertices, first_face, faces: rows of Geometry.vertices and of Geometry.face_normals; for a MESH faces counts
    triangles.
    """

    kind: int
    first_vertex: int
    vertices: int
    first_face: int
    faces: int
    inset: wp.float64
    bound: wp.float64
    size: wp.vec3d


@wp.struct
class Geometry:
    """Convex pieces of all bodies, and the vertices and faces they refer to; face f has corners
    face_corners[face_starts[f]:face_starts[f + 1]], rows of `vertices`.

    Body i has the shapes first_shape[i] to first_shape[i + 1], objects first. Where `placed` is 1, a shape lies
    at offset and rotation in body axes, else at the body's origin. bound: radius of the ball about a body's origin
    that holds all of it [m]. collides (n, n + s): 0 for pairs that pass through each other. tree: id of the
    bounding-volume hierarchy of a shape's triangles, 0 for none. edge_active: bit k set where edge k of a triangle
    may be touched from the side: it is a border or convex. lock: unit normal of the plane that all bodies move
    in, zero in space.
    """

    shapes: wp.array[Shape]
    first_shape: wp.array[wp.int32]
    placed: wp.array[wp.int32]
    offset: wp.array[wp.vec3d]
    rotation: wp.array[wp.mat33d]
    bound: wp.array[wp.float64]
    collides: wp.array2d[wp.int32]
    lock: wp.vec3d
    vertices: wp.array[wp.vec3d]
    face_normals: wp.array[wp.vec3d]
    face_starts: wp.array[wp.int32]
    face_corners: wp.array[wp.int32]
    edge_active: wp.array[wp.int32]
    tree: wp.array[wp.uint64]
    inertia: wp.array[wp.mat33d]  # (n,) for unit mass, body axes, and its inverse
    inverse_inertia: wp.array[wp.mat33d]
    radius: wp.array[wp.float64]  # (n,) of the ball of equal volume


@wp.struct
class Body:
    """State and parameters of one body in one world.

    x, q, v, w: position, orientation, velocity, angular velocity. rotation: matrix of q. v_free, w_free, dx,
    q_free: where the step ends without contact forces; for an isotropic one rotation_free, its rotation vector, and
    w_start, the angular velocity at the start of the step, give q_free. inertia_body and its inverse are for unit mass,
    about the centre of mass. isotropic: 1 where the inertia is the same about all axes. swept: how far a point of the
    body may move in one step [m]. push, push_torque: by deformable objects or control, over the step [N], [N m].
    """

    x: wp.vec3d
    q: wp.quatd
    v: wp.vec3d
    w: wp.vec3d
    rotation: wp.mat33d
    inverse_mass: wp.float64
    inertia: wp.mat33d
    inverse_inertia: wp.mat33d
    v_free: wp.vec3d
    w_free: wp.vec3d
    dx: wp.vec3d
    q_free: wp.quatd
    rotation_free: wp.vec3d
    w_start: wp.vec3d
    angular_momentum: wp.vec3d
    shift: wp.vec3d
    rotation_shift: wp.vec3d
    push: wp.vec3d
    push_torque: wp.vec3d
    radius: wp.float64
    mass: wp.float64
    friction: wp.float64
    restitution: wp.float64
    rolling: wp.float64
    torsion: wp.float64
    linear_damping: wp.float64
    angular_damping: wp.float64
    start: wp.float64
    swept: wp.float64
    active: int
    isotropic: int


@wp.struct
class Row:
    """One direction in which a contact acts: Jacobian (d, ja) on a, -(d, jb) on b, and its inverse effective mass.

    On a static jb is whatever, and wb zero.
    """

    d: wp.vec3d
    ja: wp.vec3d
    jb: wp.vec3d
    wa: wp.vec3d  # inverse inertia of a times ja
    wb: wp.vec3d
    k: wp.float64  # velocity per impulse
    inverse_k: wp.float64
    impulse: wp.float64


@wp.struct
class Contact:
    """One point of a manifold; normal points from b to a. force holds the last step's impulses over its length."""

    point: wp.vec3d
    local: wp.vec3d  # the point in a's axes, by which it is recognised in the next step
    gap: wp.float64
    speed: wp.float64  # relative normal velocity at the start of the step, negative where the pair approaches
    target: wp.float64  # of the normal velocity
    target_velocity: wp.vec2d  # of the tangential velocity
    stick_impulse: wp.float64  # tangential impulse allowed whatever Coulomb's limit
    coupling_normal: wp.vec2d  # tangential velocities per normal impulse
    mass: wp.vec3d  # tangential impulses per velocity, xx, xy, yy
    relaxation: wp.float64  # impulse per velocity where it slips: 1 over the largest velocity per impulse
    coupling_rolling: wp.float64  # velocity along one direction of rolling per impulse along the other
    slip: wp.vec2d  # relative velocity along the tangents at the start of the step
    turning: wp.vec2d  # the same of the angular velocity
    force_n: wp.float64
    force_t: wp.vec3d
    force_spin: wp.float64
    force_roll: wp.vec3d


@wp.struct
class Manifold:
    """The contacts [first, first + count) of bodies a and b, and how the pair touches."""

    a: int
    b: int
    first: int
    count: int
    normal: wp.vec3d
    t1: wp.vec3d
    t2: wp.vec3d
    anchor: wp.float64  # friction acts at this fraction of the way from the patch's centre to its corners
    friction: wp.float64
    restitution: wp.float64
    torsion: wp.float64
    rolling: wp.float64
    close: wp.float64  # gap up to which the pair counts as touching [m]
    approach: wp.float64  # highest approach speed in this step's impacts [m/s]
    impact: wp.float64  # normal impulse of this step's impacts [N s]


@wp.struct
class State:
    """All that changes while a world runs, and room to work in: one row for each of K launches at a time.

    Contacts and manifolds are kept twice, in two halves of their arrays: those of this step and of the one before.
    """

    bodies: wp.array2d[Body]  # (K, n + s + 1), the last is the world, which joints may hold on to
    manifolds: wp.array2d[Manifold]  # (K, 2 M)
    contacts: wp.array2d[Contact]  # (K, 2 C)
    rows: wp.array2d[Row]  # (K, 3 C of contacts, 3 C of their spin and rolling, those of joints)
    mix_start: wp.array2d[wp.vec3d]  # (K, 2 C) impulses of contacts, then of their spin and rolling, see `acceleration`
    mix_end: wp.array2d[wp.vec3d]  # (K, 8 C)
    mix_change: wp.array2d[wp.vec3d]
    mix_v: wp.array2d[wp.vec3d]  # (K, 4 n)
    mix_w: wp.array2d[wp.vec3d]
    mixed: wp.array[wp.int32]  # (K,) sweeps that are kept
    resisting: wp.array[wp.int32]  # (K,) 1 where a contact resists spin or rolling
    scratch: wp.array2d[wp.vec3d]  # (K, corners of the two faces being clipped)
    manifold_count: wp.array2d[wp.int32]  # (K, 2)
    contact_count: wp.array2d[wp.int32]  # (K, 2)
    half: wp.array[wp.int32]  # (K,) the half of the last step's contacts, where a run ends
    slowest: wp.array[wp.float64]  # (K,) approach speed from which on contacts rebound [m/s]
    early: wp.array[wp.float64]  # (K,) time before they touch from which on bodies rebound [s]
    overflowed: wp.array[wp.int32]  # (K,) 1 where the contact buffer is full
    neighbours: wp.array2d[wp.int32]  # (K, max_neighbours) of each object, those after it, see `neighbours`
    first_neighbour: wp.array2d[wp.int32]  # (K, n + 1)
    listed_x: wp.array2d[wp.vec3d]  # (K, n) where objects were when these were listed
    skin: wp.array[wp.float64]  # (K,) within which of each other all pairs were listed [m], 0 where none were
    planes: wp.array2d[wp.vec4d]  # (K, s) outward normal and offset of the statics that are planes
    reaction: wp.array2d[wp.vec3d]  # (K, n) acceleration by contacts and joints in the last step, where effects act
    reaction_turning: wp.array2d[wp.vec3d]  # [rad/s^2]
    objects: int
    statics: int
    max_manifolds: int
    max_contacts: int
    max_neighbours: int
    turning_rows: int  # first row of spin and rolling


@wp.struct
class Parameters:
    """Parameters of the worlds: fields of (1 or W, ...), as in `polyworld.model.arrays.RigidArrays`."""

    mass: wp.array2d[wp.float64]
    friction: wp.array2d[wp.float64]
    restitution: wp.array2d[wp.float64]
    rolling_resistance: wp.array2d[wp.float64]
    torsional_radius: wp.array2d[wp.float64]
    linear_damping: wp.array2d[wp.float64]
    angular_damping: wp.array2d[wp.float64]
    position: wp.array2d[wp.vec3d]
    orientation: wp.array2d[wp.quatd]  # x, y, z, w
    velocity: wp.array2d[wp.vec3d]
    angular_velocity: wp.array2d[wp.vec3d]
    static_position: wp.array2d[wp.vec3d]  # of the shapes, see `statics.static_poses`
    static_orientation: wp.array2d[wp.quatd]
    static_plane: wp.array2d[wp.vec4d]
    static_friction: wp.array2d[wp.float64]
    static_restitution: wp.array2d[wp.float64]
    gravity: wp.array[wp.vec3d]
    time_scale: wp.array[wp.float64]
    time_origin: wp.array[wp.float64]
    effects: Effects
    contact_laws: int  # how many effects change what happens at contacts
    forces: int  # how many push bodies


@wp.struct
class Samples:
    """States at the sample times (W, T, n), and how each run ended."""

    position: wp.array3d[wp.vec3d]
    orientation: wp.array3d[wp.quatd]
    velocity: wp.array3d[wp.vec3d]
    angular_velocity: wp.array3d[wp.vec3d]
    outcome: Outcome
