"""The records of bodies that hang on joints as a tree: their links, and how these move in one world.

Motions are spatial vectors (velocity of the point of the body that is at the tree's origin, angular velocity), forces
(force, torque about that origin), world axes (Featherstone, Rigid Body Dynamics Algorithms, 2008, ch. 2).
"""

import warp as wp

FREE = 5  # a link that nothing holds, beside the kinds of joints
ROOT = -1  # the parent of a link that hangs on the world, or on nothing


@wp.struct
class LinkKind:
    """A body and what it hangs on, the same in all worlds; parents come before their children.

    parent: index of the parent's link, or ROOT. joint: index of the joint that holds it, -1 for none. sign: 1 where the
    body is the joint's `a`, else -1. first: its first freedom.
    """

    body: int
    parent: int
    joint: int
    kind: int
    sign: wp.float64
    first: int
    freedoms: int


@wp.struct
class Link:
    """A link in one world: where it was when a step began, and where it is and how it moves at a stage of the step.

    origin: of its tree, fixed over the step [m]. arm: the joint's point in the body's axes, other_arm in the parent's
    (of the world: in space), axis in the parent's. relative_q: orientation at the start, seen from the parent. travel:
    of a slider at the start [m]. bend: acceleration that took it off a straight path in the last step [m/s^2].
    """

    origin: wp.vec3d
    start_x: wp.vec3d
    arm: wp.vec3d
    other_arm: wp.vec3d
    axis: wp.vec3d
    relative_q: wp.quatd
    travel: wp.float64
    bend: wp.float64
    x: wp.vec3d
    q: wp.quatd
    rotation: wp.mat33d
    motion: wp.spatial_vectord
    bias: wp.spatial_vectord  # acceleration that it has relative to its parent's without one of its freedoms
    force: wp.spatial_vectord  # that it takes to hold the link at rest acceleration, from here on to the leaves
    acceleration: wp.spatial_vectord
    free: wp.vec3d  # acceleration that gravity, damping and effects alone would give it [m/s^2]
    free_turning: wp.vec3d  # [rad/s^2]


@wp.struct
class Inertia:
    """Inertia about the tree's origin of a link and all that hangs on it, which yields on its joints.

    Its force is mass a + moment alpha, its torque moment^T a + about alpha.
    """

    mass: wp.mat33d
    moment: wp.mat33d
    about: wp.mat33d


@wp.struct
class Freedom:
    """One degree of freedom of a link on its joint.

    along: motion for a unit of speed. inertial: force for a unit of acceleration along it, what hangs on it yielding;
    light: one over its part along the freedom. push: along it, less what it takes to hold the rest.
    position: since the step began [rad or m]; speed; start_speed: when the step began. direction: 1 or -1 of its slip
    with dry friction; 0 where there is none.
    """

    along: wp.spatial_vectord
    inertial: wp.spatial_vectord
    light: wp.float64
    push: wp.float64
    position: wp.float64
    speed: wp.float64
    start_speed: wp.float64
    direction: wp.float64


@wp.struct
class Tree:
    """All links of K worlds. count: 0 where the joints make no tree. slopes, rates: derivatives of positions and speeds
    at the stages of a step, those of stage s from s * freedoms on. known: 1 where the speeds' at the first are known.
    wanted: length of the next step by the error of the last [s], 0 where there is none. clear: time in which nothing
    would come near when that was last looked for [s].
    """

    count: int
    freedoms: int
    kinds: wp.array[LinkKind]
    link_of: wp.array[wp.int32]  # (n,) the link of each body
    links: wp.array2d[Link]
    inertia: wp.array2d[Inertia]
    coordinates: wp.array2d[Freedom]
    slopes: wp.array2d[wp.float64]
    rates: wp.array2d[wp.float64]
    known: wp.array[wp.int32]
    wanted: wp.array[wp.float64]
    clear: wp.array[wp.float64]
    method: wp.array2d[wp.float64]  # (16, 13): see `tree_scene`


@wp.func
def linear(motion: wp.spatial_vectord) -> wp.vec3d:
    return wp.vec3d(motion[0], motion[1], motion[2])


@wp.func
def angular(motion: wp.spatial_vectord) -> wp.vec3d:
    return wp.vec3d(motion[3], motion[4], motion[5])
