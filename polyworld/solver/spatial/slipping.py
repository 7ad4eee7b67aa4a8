"""Correction of positions where a body stops slipping within a step.

The contact solver has one friction for a whole step, which is right for the velocities at its end. But friction that is
at its limit until the slip is over, and holds the body after that, moves it elsewhere than the same impulse spread over
the step: by up to an eighth of its deceleration times the step squared.
"""

import warp as wp

from polyworld.solver.spatial.constraints import ROWS
from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.rows import along, velocity_along

STILL = wp.float64(1.0e-6)  # slip that counts as none [m/s]
SWEEPS = 50
LEVEL = wp.float64(1.0e-12)  # distance from the surface that counts as none [m]


@wp.func
def end_slips(state: wp.array[State], w: int, half: int, h: wp.float64) -> None:
    """Move bodies of which all contacts with another slip at the start of a step of length h and stick at its end.

    With the limit b [N s] of friction in the step, the impulse j that it had, and the part p of the step that the slip
    took, constant forces before and after that differ from constant ones by p (b - j) h / 2 of impulse times time.
    """
    base = half * state[0].max_manifolds
    offset = half * state[0].max_contacts
    for i in range(base, base + state[0].manifold_count[w, half]):
        part = slipping_part(state, w, i, offset)
        if part > wp.float64(0.0):
            start = state[0].manifolds[w, i].first
            for c in range(start, start + state[0].manifolds[w, i].count):
                slip = state[0].contacts[w, c].slip
                r = ROWS * (c - offset)
                most = state[0].manifolds[w, i].friction * state[0].rows[w, r].impulse
                if most > wp.float64(0.0):
                    against = -most * wp.normalize(slip)
                    for k in range(2):
                        lacks = against[k] - state[0].rows[w, r + 1 + k].impulse
                        shift(state, w, i, r + 1 + k, lacks * part * h * wp.float64(0.5))
            keep_touching(state, w, i, offset)


@wp.func
def slipping_part(state: wp.array[State], w: int, i: int, offset: int) -> wp.float64:
    """Return the part of a step in which a manifold's contacts slipped, where they stick at its end; else 0.

    The slip changes from what it was to nothing by the impulse of friction, and what it would be without friction is
    known: so is what friction at its limit would have done.
    """
    a = state[0].manifolds[w, i].a
    b = state[0].manifolds[w, i].b
    slipped = wp.float64(0.0)
    stuck = wp.float64(0.0)
    start = state[0].manifolds[w, i].first
    for c in range(start, start + state[0].manifolds[w, i].count):
        r = ROWS * (c - offset)
        most = state[0].manifolds[w, i].friction * state[0].rows[w, r].impulse
        if most > wp.float64(0.0):
            slip = state[0].contacts[w, c].slip
            speed = wp.length(slip)
            if speed <= STILL or wp.abs(velocity_along(state, w, a, b, r + 1)) > STILL:
                return wp.float64(0.0)
            if wp.abs(velocity_along(state, w, a, b, r + 2)) > STILL:
                return wp.float64(0.0)
            x = slip[0] / speed
            y = slip[1] / speed
            used = -x * state[0].rows[w, r + 1].impulse - y * state[0].rows[w, r + 2].impulse
            free = x * free_velocity_along(state, w, a, b, r + 1) + y * free_velocity_along(state, w, a, b, r + 2)
            slipped += speed * used
            stuck += free * (most - used)
    if slipped <= wp.float64(0.0) or stuck <= wp.float64(0.0):
        return wp.float64(0.0)
    return slipped / (slipped + stuck)


@wp.func
def free_velocity_along(state: wp.array[State], w: int, a: int, b: int, r: int) -> wp.float64:
    """Relative velocity along row r at the end of the step, had nothing touched."""
    apart = state[0].bodies[w, a].v_free - state[0].bodies[w, b].v_free
    return along(state, w, r, apart, state[0].bodies[w, a].w_free, state[0].bodies[w, b].w_free)


@wp.func
def shift(state: wp.array[State], w: int, i: int, r: int, amount: wp.float64) -> None:
    """Move the bodies of a manifold as an impulse of so much times time [N s^2] along row r does."""
    a = state[0].manifolds[w, i].a
    b = state[0].manifolds[w, i].b
    d = state[0].rows[w, r].d
    state[0].bodies[w, a].shift += d * (amount * state[0].bodies[w, a].inverse_mass)
    state[0].bodies[w, a].rotation_shift += state[0].rows[w, r].wa * amount
    state[0].bodies[w, b].shift -= d * (amount * state[0].bodies[w, b].inverse_mass)
    state[0].bodies[w, b].rotation_shift -= state[0].rows[w, r].wb * amount


@wp.func
def keep_touching(state: wp.array[State], w: int, i: int, offset: int) -> None:
    """Let the normal forces of a manifold follow, so that what touches goes on touching."""
    a = state[0].manifolds[w, i].a
    b = state[0].manifolds[w, i].b
    start = state[0].manifolds[w, i].first
    for _sweep in range(SWEEPS):
        furthest = wp.float64(0.0)
        for c in range(start, start + state[0].manifolds[w, i].count):
            r = ROWS * (c - offset)
            if state[0].rows[w, r].impulse > wp.float64(0.0):
                apart = state[0].bodies[w, a].shift - state[0].bodies[w, b].shift
                away = along(
                    state, w, r, apart, state[0].bodies[w, a].rotation_shift, state[0].bodies[w, b].rotation_shift
                )
                shift(state, w, i, r, -away / state[0].rows[w, r].k)
                furthest = wp.max(furthest, wp.abs(away))
        if furthest <= LEVEL:
            return
