"""The records of attachments. SI units, world axes unless said otherwise."""

import warp as wp


@wp.struct
class Fastenings:
    """Attachments (A,) in W worlds.

    released (W, A): 1 after its release, at `when` [s]. impulse (W, A): given to the deformable object in this
    coupling step; force: mean of the last one. release (A,): NaN for never; strength: negative for unbreakable.
    last_h (W,): length of the coupling step before [s].
    """

    released: wp.array2d[wp.int32]
    when: wp.array2d[wp.float64]
    impulse: wp.array2d[wp.vec3d]
    force: wp.array2d[wp.vec3d]
    release: wp.array[wp.float64]
    strength: wp.array[wp.float64]
    last_h: wp.array[wp.float64]


@wp.struct
class Motion:
    """Rows (time, displacement) of all motions: those of attachment a are first[a] to first[a + 1]."""

    first: wp.array[wp.int32]
    time: wp.array[wp.float64]
    displacement: wp.array[wp.vec3d]


@wp.struct
class OnWorld:
    """Nodes (m,) held to the world. node: their rows; attachment: of which; position (W, m): where they began."""

    node: wp.array[wp.int32]
    attachment: wp.array[wp.int32]
    position: wp.array2d[wp.vec3d]


@wp.struct
class OnBodies:
    """Nodes (m,) held to rigid bodies: those of body[g] are first[g] to first[g + 1].

    node: their rows; attachment: of which; position (W, m): in the body's axes; last (W, m): impulse on the node in
    the inner step before [N s].
    """

    body: wp.array[wp.int32]
    first: wp.array[wp.int32]
    node: wp.array[wp.int32]
    attachment: wp.array[wp.int32]
    position: wp.array2d[wp.vec3d]
    last: wp.array2d[wp.vec3d]


@wp.struct
class OnNodes:
    """Nodes (m,) held to points of other deformable objects.

    node: their rows; attachment: of which; target, weight: the point, between three nodes, the third -1 on a segment;
    offset from it, in the axes of the triangle. last (W, m): impulse on the node in the inner step before [N s];
    wanted (W, m): relative velocity.
    """

    node: wp.array[wp.int32]
    attachment: wp.array[wp.int32]
    target: wp.array[wp.vec3i]
    weight: wp.array[wp.vec3d]
    offset: wp.array[wp.vec3d]
    last: wp.array2d[wp.vec3d]
    wanted: wp.array2d[wp.vec3d]
