"""One direction in which an impulse acts between two bodies."""

import warp as wp

from polyworld.solver.spatial.layout import Body, Row, State

IMMOBILE = wp.float64(1.0e-9)  # least velocity per impulse of a row, in those of a free point


@wp.func
def world_inverse_inertia(bodies: wp.array2d[Body], w: int, i: int) -> wp.mat33d:
    """Inverse inertia about the centre of mass, world axes [1/(kg m^2)]."""
    own = bodies[w, i].inverse_inertia * bodies[w, i].inverse_mass
    if bodies[w, i].isotropic == 1:
        return own
    return bodies[w, i].rotation * own * wp.transpose(bodies[w, i].rotation)


@wp.func
def make_row(
    d: wp.vec3d, ja: wp.vec3d, jb: wp.vec3d, ia: wp.mat33d, ib: wp.mat33d, masses: wp.float64, lock: wp.vec3d
) -> Row:
    """Build a row; where bodies move in a plane only (unit normal `lock`), what would lead out of it is left out."""
    row = Row()
    row.d = d
    row.ja = ja
    row.jb = jb
    locked = wp.dot(lock, lock) > wp.float64(0.5)
    if locked:  # the bodies' inverse inertia sees to the rotation
        row.d = d - lock * wp.dot(lock, d)
    row.wa = ia * ja
    row.wb = ib * jb
    row.k = masses * wp.dot(row.d, row.d) + wp.dot(ja, row.wa) + wp.dot(jb, row.wb)
    if locked:  # a row without freedom moves nothing, whatever its impulse: keep it divisible
        row.k = wp.max(row.k, IMMOBILE * masses)
    row.inverse_k = wp.float64(1.0) / row.k
    return row


@wp.func
def along(
    state: wp.array[State], w: int, r: int, apart: wp.vec3d, rotation_a: wp.vec3d, rotation_b: wp.vec3d
) -> wp.float64:
    """Project velocities or small displacements on row r: a's centre less b's, and both rotations."""
    return (
        wp.dot(state[0].rows[w, r].d, apart)
        + wp.dot(state[0].rows[w, r].ja, rotation_a)
        - wp.dot(state[0].rows[w, r].jb, rotation_b)
    )


@wp.func
def velocity_along(state: wp.array[State], w: int, a: int, b: int, r: int) -> wp.float64:
    """Relative velocity along row r, positive where a moves away from b."""
    apart = state[0].bodies[w, a].v - state[0].bodies[w, b].v
    return along(state, w, r, apart, state[0].bodies[w, a].w, state[0].bodies[w, b].w)


@wp.func
def push(state: wp.array[State], w: int, a: int, b: int, r: int, impulse: wp.float64) -> None:
    """Apply an impulse along row r and add it to the row's sum."""
    d = state[0].rows[w, r].d
    state[0].bodies[w, a].v += d * (impulse * state[0].bodies[w, a].inverse_mass)
    state[0].bodies[w, a].w += state[0].rows[w, r].wa * impulse
    state[0].bodies[w, b].v -= d * (impulse * state[0].bodies[w, b].inverse_mass)
    state[0].bodies[w, b].w -= state[0].rows[w, r].wb * impulse
    state[0].rows[w, r].impulse += impulse
