"""The records of contacts of deformable objects. SI units, world axes unless said otherwise."""

import warp as wp

from polyworld.solver.spatial.layout import Body, Geometry

# What touches what. A weighted point of up to three nodes is pushed along the normal; a body or other nodes are
# pushed back.
ON_SHAPE = 0  # a node, or a point inside an edge, on a convex shape or a plane
ON_TRIANGLE = 1  # a node on a triangle of a static mesh
CORNER = 2  # a body's corner, or the centre of its round end, on a triangle of cloth or of a soft surface
ON_FACE = 3  # a node on a triangle of cloth or of a soft surface
CROSSING = 4  # an edge on an edge
ON_SIDE = 5  # in a plane: a node on the outline of a soft slice


@wp.struct
class Contact:
    """One possible contact, found by the search and followed until the next one.

    weight: of the nodes n0 to n3 in the relative velocity, of opposite signs on the two sides; the sum is 1
    where a body is on the other side, else 0. body: row of the bodies, -1 for none. part: row of the parts, of the
    corners, or of a mesh's faces. owner, other: whose contact it is, for events; other counts bodies first, then
    deformables. reach: sum of the radii [m]. side: 1 or -1, the side of a face that is touched. last: time at which
    it last carried an impulse.
    """

    kind: int
    n0: int
    n1: int
    n2: int
    n3: int
    body: int
    part: int
    owner: int
    other: int
    weight: wp.vec4d
    reach: wp.float64
    side: wp.float64
    friction: wp.float64
    restitution: wp.float64
    step_friction: wp.float64  # friction coefficient in this inner step
    normal: wp.vec3d
    arm: wp.vec3d  # from the body's centre of mass to the point
    t1: wp.vec3d
    wait: int  # inner steps for which it cannot touch
    gap: wp.float64
    approach: wp.float64
    rebound: wp.float64  # distance from where the step would end to where a rebound within it ends [m]
    target: wp.float64
    k: wp.float64  # velocity per impulse, along the normal
    k11: wp.float64
    k12: wp.float64
    k22: wp.float64
    impulse: wp.float64
    tangential: wp.vec3d
    given: wp.vec3d  # impulse that the sides already have at the start of the inner step


@wp.struct
class Part:
    """A convex piece of a body: rows of Geometry.shapes, of the bodies, of the corners; its position in body axes."""

    shape: int
    body: int
    first_corner: int
    corners: int
    position: wp.vec3d
    rotation: wp.mat33d
    bound: wp.float64  # radius about the piece's origin [m]


@wp.struct
class Obstacles:
    """All pieces of all bodies, and the points of them that may press into a triangle (body axes, radius [m]).

    bodies (W, B): the rigid solver's. geometry (1,): of their shapes.
    """

    bodies: wp.array2d[Body]
    geometry: wp.array[Geometry]

    parts: wp.array[Part]
    corners: wp.array[wp.vec3d]
    corner_body: wp.array[wp.int32]
    corner_radius: wp.array[wp.float64]


@wp.struct
class Surface:
    """Nodes and faces that may touch: edges (E, 2), triangles (T, 3) as node rows; sides (S, 2): outlines of slices in
    a plane, their inside on the left seen against the plane's unit normal `across`.

    radius (N,) [m]. friction, restitution (R, D), R is 1 or W. exposed (N,): 1 for nodes that may touch. one_sided
    (D,): 1 for a deformable object with an inside. yielding (D,): share of its radius by which an edge may be pressed
    in between its nodes. excluded (N, B): 1 where a node must not touch a body. first, count (D,): nodes of each
    deformable object.
    """

    edges: wp.array2d[wp.int32]
    triangles: wp.array2d[wp.int32]
    sides: wp.array2d[wp.int32]
    across: wp.vec3d
    radius: wp.array[wp.float64]
    friction: wp.array2d[wp.float64]
    restitution: wp.array2d[wp.float64]
    exposed: wp.array[wp.int32]
    one_sided: wp.array[wp.int32]
    yielding: wp.array[wp.float64]
    excluded: wp.array2d[wp.int32]
    first: wp.array[wp.int32]
    count: wp.array[wp.int32]


@wp.struct
class Bounds:
    """Boxes (W, D) around the deformable objects, their highest speeds, and which parts are near (W, D, P)."""

    low: wp.array2d[wp.vec3d]
    high: wp.array2d[wp.vec3d]
    speed: wp.array2d[wp.float64]
    near: wp.array3d[wp.int32]


@wp.struct
class Kept:
    """A contact that acted, until the next search has found it again; next: another one of the same node, or -1."""

    kind: int
    n1: int
    n2: int
    n3: int
    part: int
    next: int
    impulse: wp.float64
    tangential: wp.vec3d
    normal: wp.vec3d
    weight: wp.vec4d
    arm: wp.vec3d


@wp.struct
class Found:
    """Contacts (W, C) of each world, how many there are (W,), those that act in this inner step (W, C).

    overflowed (W,): 1 where the buffer is full. falling (W, N): 1, and 0 while a node that rests on something is being
    looked at. reaction (W, N): impulses on nodes that are held, since they were last read [N s]. kept (W, K): what
    acted before the search, of which nodes, kept_count (W,), latest (W, N): the last one of a node, or -1.
    """

    contacts: wp.array2d[Contact]
    count: wp.array[wp.int32]
    acting: wp.array2d[wp.int32]
    overflowed: wp.array[wp.int32]
    falling: wp.array2d[wp.float64]
    reaction: wp.array2d[wp.vec3d]
    kept: wp.array2d[Kept]
    kept_node: wp.array2d[wp.int32]
    kept_count: wp.array[wp.int32]
    latest: wp.array2d[wp.int32]


@wp.struct
class Tally:
    """Contacts of pairs of a deformable object and another (W, D, B + D) in this coupling step."""

    impulse: wp.array3d[wp.float64]
    first_impulse: wp.array3d[wp.float64]
    speed: wp.array3d[wp.float64]
    begin: wp.array3d[wp.float64]
    last: wp.array3d[wp.float64]
    position: wp.array3d[wp.vec3d]
    record: int
