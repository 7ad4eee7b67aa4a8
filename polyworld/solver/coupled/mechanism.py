"""Bodies held by joints, pushed by ropes, cloths and soft bodies: what moves with a pushed body, and how much.

In the inner steps a jointed body yields to a push as its joints let it (Featherstone, Rigid Body Dynamics Algorithms,
2008, ch. 7: the inverse inertia of an articulated body), not as if it were free: with the free body's, a node held far
from the centre of a welded body is taken to yield readily, and the push that it gets back grows from step to step.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.effects.law import wrench
from polyworld.solver.spatial.layout import Body
from polyworld.world import World


@wp.struct
class Mechanisms:
    """Groups of bodies that joints hold to each other or to the world; B bodies in W worlds, E pairs of a group.

    first (B,): of the pairs of a pushed body, -1 where it has no joints; count (B,): bodies of its group, place (B,):
    its own among them. member (E,): the body that moves; response (W, E): its velocities (v, w) per impulse
    (linear, angular) on the pushed body, about their centres of mass. impulse, angular_impulse (W, B): on each body in
    this coupling step, without those of the joints.
    """

    first: wp.array[wp.int32]
    count: wp.array[wp.int32]
    place: wp.array[wp.int32]
    member: wp.array[wp.int32]
    response: wp.array2d[wp.spatial_matrixd]
    impulse: wp.array2d[wp.vec3d]
    angular_impulse: wp.array2d[wp.vec3d]


def groups(world: World) -> NDArray[np.int32]:
    """Return for each object (n,) the first of those that joints, other than springs, hold together with it."""
    index = {o.name: i for i, o in enumerate(world.objects)}
    group = np.arange(len(index), dtype=np.int32)
    for joint in world.joints:
        if joint.kind != "spring" and joint.other is not None:
            pair = group[[index[joint.object], index[joint.other]]]
            group[np.isin(group, pair)] = pair.min()
    return group


def build_mechanisms(world: World, bodies: int, n_worlds: int) -> Mechanisms:
    """Return the mechanisms of `n_worlds` variants of a world with a number of bodies, objects first."""
    index = {o.name: i for i, o in enumerate(world.objects)}
    group = groups(world)
    held = [index[j.object] for j in world.joints if j.kind != "spring"]
    first = np.full(bodies, -1, dtype=np.int32)
    count, place = np.zeros(bodies, dtype=np.int32), np.zeros(bodies, dtype=np.int32)
    member: list[int] = []
    for own in sorted({int(group[i]) for i in held}):
        together = np.flatnonzero(group == own)
        for number, body in enumerate(together):
            first[body], count[body], place[body] = len(member), len(together), number
            member.extend(int(b) for b in together)
    m = Mechanisms()
    m.first, m.count, m.place = buffers.ints(first), buffers.ints(count), buffers.ints(place)
    m.member = buffers.ints(member)
    m.response = buffers.zeros((n_worlds, len(member)), wp.spatial_matrixd)
    m.impulse = buffers.zeros((n_worlds, bodies), wp.vec3d)
    m.angular_impulse = buffers.zeros((n_worlds, bodies), wp.vec3d)
    return m


@wp.func
def own_response(m: Mechanisms, w: int, b: int) -> wp.spatial_matrixd:
    """Velocities (v, w) of jointed body b per impulse (linear, angular) on it."""
    return m.response[w, m.first[b] + m.place[b]]


@wp.func
def point_response(m: Mechanisms, w: int, b: int, arm: wp.vec3d) -> wp.mat33d:
    """Velocity per impulse of jointed body b's point at `arm` from its centre of mass [1/kg]."""
    full = own_response(m, w, b)
    linear = wp.mat33d()
    mixed = wp.mat33d()
    angular = wp.mat33d()
    for r in range(3):
        for c in range(3):
            linear[r, c] = full[r, c]
            mixed[r, c] = full[r, c + 3]
            angular[r, c] = full[r + 3, c + 3]
    cross = wp.skew(arm)
    mixed = mixed * cross
    return linear + mixed + wp.transpose(mixed) - cross * angular * cross


@wp.func
def push_mechanism(
    m: Mechanisms, bodies: wp.array2d[Body], w: int, b: int, impulse: wp.vec3d, angular_impulse: wp.vec3d
) -> None:
    """Apply an impulse at the centre of jointed body b, and an angular one: all of its group move."""
    m.impulse[w, b] = m.impulse[w, b] + impulse
    m.angular_impulse[w, b] = m.angular_impulse[w, b] + angular_impulse
    given = wrench(impulse, angular_impulse)
    for e in range(m.first[b], m.first[b] + m.count[b]):
        gained = m.response[w, e] * given
        i = m.member[e]
        bodies[w, i].v = bodies[w, i].v + wp.spatial_top(gained)
        bodies[w, i].w = bodies[w, i].w + wp.spatial_bottom(gained)


def reset_mechanisms(m: Any) -> None:
    """Forget the responses and impulses of the last run."""
    for values in (m.response, m.impulse, m.angular_impulse):
        buffers.clear(values)
