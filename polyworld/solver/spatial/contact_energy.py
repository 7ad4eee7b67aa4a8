"""Contacts give a step no energy: friction is lowered where they would.

A slender body that slides on its end may be driven into the ground by its own friction, so that no solution of
Coulomb's law without an impact exists, or several do (Painleve 1895, C. R. Acad. Sci. 121, 112): none that gains energy
is taken.
"""

import warp as wp

from polyworld.solver.spatial.constraints import ROWS
from polyworld.solver.spatial.layout import State

LESS = wp.float64(0.7)  # factor on the friction from trial to trial
ROUNDING = wp.float64(1.0e-6)  # share of the kinetic energy that is not yet a gain


@wp.func
def energy_at(state: wp.array[State], w: int, i: int, v: wp.vec3d, spin: wp.vec3d) -> wp.float64:
    """Return the kinetic energy of body i at a velocity and an angular velocity [J]."""
    turned = wp.transpose(state[0].bodies[w, i].rotation) * spin
    return (
        wp.float64(0.5)
        * state[0].bodies[w, i].mass
        * (wp.dot(v, v) + wp.dot(turned, state[0].bodies[w, i].inertia * turned))
    )


@wp.func(inline=False)
def gains_energy(state: wp.array[State], w: int) -> bool:
    """Check whether all bodies together have more kinetic energy than without their contacts."""
    before = wp.float64(0.0)
    after = wp.float64(0.0)
    for i in range(state[0].objects):
        if state[0].bodies[w, i].active == 1:
            before += energy_at(state, w, i, state[0].bodies[w, i].v_free, state[0].bodies[w, i].w_free)
            after += energy_at(state, w, i, state[0].bodies[w, i].v, state[0].bodies[w, i].w)
    return after > before * (wp.float64(1.0) + ROUNDING)


@wp.func(inline=False)
def lower_friction(state: wp.array[State], w: int, first: int, last: int, offset: int) -> None:
    """Lower the friction of those manifolds [first, last) whose impulses do work."""
    bodies = state[0].bodies[w]
    rows = state[0].rows[w]
    for i in range(first, last):
        a = state[0].manifolds[w, i].a
        b = state[0].manifolds[w, i].b
        apart = bodies[a].v + bodies[a].v_free - bodies[b].v - bodies[b].v_free
        turning_a = bodies[a].w + bodies[a].w_free
        turning_b = bodies[b].w + bodies[b].w_free
        start = state[0].manifolds[w, i].first
        work = wp.float64(0.0)
        for r in range(ROWS * (start - offset), ROWS * (start + state[0].manifolds[w, i].count - offset)):
            speed = wp.dot(rows[r].d, apart) + wp.dot(rows[r].ja, turning_a) - wp.dot(rows[r].jb, turning_b)
            work += rows[r].impulse * speed
        if work > wp.float64(0.0):
            state[0].manifolds[w, i].friction = LESS * state[0].manifolds[w, i].friction
