"""Effects at contacts and on the supporting plane of a planar world."""

import warp as wp

from polyworld.solver.core.effect_contacts import contact_friction, contact_restitution, contact_tangential
from polyworld.solver.planar.records import Bodies, Contacts, Row, Scene

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)


@wp.func
def friction_at(
    scene: wp.array[Scene], w: wp.int32, a: wp.int32, b: wp.int32, mu: wp.float64, x: wp.vec3d, path: wp.vec3d
) -> wp.float64:
    """Return the Coulomb coefficient, mu without effects, of body a on b (the supporting plane: -1).

    It is the mean over the path travelled in a step, with its middle at x; plane coordinates.
    """
    to_world = wp.transpose(scene[0].axes)
    return contact_friction(scene[0].effects, w, a, b, mu, to_world * x, to_world * path)


# Functions of their own, not inlined: worlds without such effects then run as fast as if there were none. They take
# the records as arrays of one, for a call would copy them.
@wp.func(inline=False)
def set_plane_friction(
    scene: wp.array[Scene], bodies: wp.array[Bodies], w: wp.int32, members: wp.int32, h: wp.float64
) -> None:
    """Set what the supporting plane can hold over the path of each member in a step of length h."""
    load = -bodies[0].gravity[w][2]
    if scene[0].supports == 0 or load <= ZERO:
        return
    for m in range(members):
        i = bodies[0].members[w, m]
        ahead = bodies[0].rate[w, i] * h
        x = bodies[0].pose[w, i] + ahead * HALF
        position = wp.vec3d(x[0], x[1], scene[0].level)
        path = wp.vec3d(ahead[0], ahead[1], ZERO)
        mu = friction_at(scene, w, i, -1, bodies[0].support[w, i], position, path)
        bodies[0].hold[w, i] = load * mu


@wp.func(inline=False)
def set_row_friction(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    contacts: wp.array[Contacts],
    w: wp.int32,
    slot: wp.int32,
    half: wp.int32,
    active: wp.int32,
) -> None:
    """Set the friction of the active rows by the effects where they touch."""
    for k in range(active):
        r = contacts[0].active[slot, k]
        a = contacts[0].rows[slot, half, r].a
        b = contacts[0].rows[slot, half, r].b
        arm = contacts[0].rows[slot, half, r].arm_a
        pose = bodies[0].pose[w, a]
        position = wp.vec3d(pose[0] + arm[0], pose[1] + arm[1], bodies[0].height[w, a])
        mu = contacts[0].rows[slot, half, r].friction
        contacts[0].rows[slot, half, r].friction = friction_at(scene, w, a, b, mu, position, wp.vec3d())


@wp.func(inline=False)
def with_contact_effects(scene: wp.array[Scene], w: wp.int32, row: Row, v: wp.vec2d) -> Row:
    """Return the row of an impact at the separation speed v (normal, tangent) with the effects' contact laws."""
    e = contact_restitution(scene[0].effects, w, row.a, row.b, row.restitution, -v[0])
    law = contact_tangential(scene[0].effects, w, row.a, row.b)
    row.bounce = -e * v[0]
    row.tangential_loss = law[0]
    row.target_velocity = -law[1] * v[1]
    row.stick_fraction = law[2]
    return row


@wp.func(inline=False)
def apply_tangential_loss(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    contacts: wp.array[Contacts],
    w: wp.int32,
    slot: wp.int32,
    half: wp.int32,
    begin: wp.int32,
    end: wp.int32,
) -> None:
    """Remove each pair's loss from its centres' relative tangential velocity, once a pair."""
    last = wp.int32(-1)
    for k in range(begin, end):
        row = contacts[0].rows[slot, half, contacts[0].order[slot, k]]
        if row.tangential_loss > ZERO and row.slot != last:
            last = row.slot
            ma = bodies[0].inverse_mass[w, row.a]
            mb = ZERO
            v = -bodies[0].next_rate[w, row.a]
            if row.b < scene[0].bodies:
                mb = bodies[0].inverse_mass[w, row.b]
                v = v + bodies[0].next_rate[w, row.b]
            across = row.normal[0] * v[1] - row.normal[1] * v[0]
            p = wp.vec3d(-row.normal[1], row.normal[0], ZERO) * (row.tangential_loss * across / (ma + mb))
            bodies[0].next_rate[w, row.a] = bodies[0].next_rate[w, row.a] + p * ma
            if row.b < scene[0].bodies:
                bodies[0].next_rate[w, row.b] = bodies[0].next_rate[w, row.b] - p * mb
