"""Impacts: Newton's law of restitution at the moment of touching, and when that will be."""

from typing import Any

import warp as wp

from polyworld.solver.spatial.constraints import NO_TARGET, ROWS, clear_impulses
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.layout import Body, State
from polyworld.solver.spatial.rows import push, velocity_along

ITERATIONS = 200
CONVERGED = wp.float64(1.0e-11)  # [m/s]
AIM = wp.float64(0.1)  # an impact is looked for where the gap is this fraction of what counts as touching
TRIALS = 12
LESS = wp.float64(0.7)  # factor on the restitution from trial to trial
ENERGY_ROUNDING = wp.float64(1.0 + 1.0e-9)


@wp.func
def kinetic_energy(b: Body) -> wp.float64:
    """Kinetic energy [J]; zero for statics, whose mass is not given."""
    w = wp.transpose(b.rotation) * b.w
    return wp.float64(0.5) * b.mass * (wp.dot(b.v, b.v) + wp.dot(w, b.inertia * w))


@wp.func
def time_to_impact(
    state: State, w: int, half: int, h: wp.float64, threshold: wp.float64, gravity: wp.vec3d
) -> wp.float64:
    """Time until the first open contact closes faster than the threshold, at most h.

    Two convex bodies cannot meet before they meet along a direction that separates them now, so no impact is
    passed over; where the first guess falls short the next part of the step brings the rest.
    """
    zero = wp.float64(0.0)
    base = half * state.max_manifolds
    earliest = h
    for i in range(base, base + state.manifold_count[w, half]):
        b = state.manifolds[w, i].b
        close = state.manifolds[w, i].close
        pull = zero
        if b >= state.objects:
            pull = wp.dot(gravity, state.manifolds[w, i].normal)
        start = state.manifolds[w, i].first
        for c in range(start, start + state.manifolds[w, i].count):
            gap = state.contacts[w, c].gap
            if gap > close:
                speed = state.contacts[w, c].speed
                distance = gap - AIM * close
                # distance + speed t + pull t^2 / 2 = 0, in the form that does not cancel
                root = speed * speed - wp.float64(2.0) * pull * distance
                if root > threshold * threshold:
                    root = wp.sqrt(root)
                    if root > speed:
                        t = wp.float64(2.0) * distance / (root - speed)
                        earliest = wp.min(earliest, t)
    return earliest


def impact_solver(solve_manifolds: Any, energy: Any, take_back: Any) -> Any:
    """The function `resolve_impacts`, for functions that do the joints' part.

    energy(joints, state, w, a, b) is the kinetic energy of all that an impact of a and b can change; and
    take_back(joints, state, w) takes back what the joints did in an impact whose contact impulses were taken back.
    """

    @wp.func(inline=False)
    def rebound(joints: Joints, state: State, w: int, i: int, last: int, offset: int) -> wp.float64:
        """Resolve the impact of one pair, whose manifolds are [i, last); returns its normal impulse [N s].

        All points rebound with the restitution times their own approach speed (Moreau's form of Newton's law, which
        for frictionless bodies keeps the energy where it is 1). With friction Newton's law can create energy in
        oblique impacts of slender bodies (Kane 1984; Stronge 1990, Proc. R. Soc. A 431, 169): the restitution is
        then lowered until it does not.
        """
        a = state.manifolds[w, i].a
        b = state.manifolds[w, i].b
        start = state.manifolds[w, i].first
        end = state.manifolds[w, last - 1].first + state.manifolds[w, last - 1].count
        restitution = state.manifolds[w, i].restitution
        allowed = energy(joints, state, w, a, b) * ENERGY_ROUNDING
        for trial in range(TRIALS):
            for m in range(i, last):
                close = state.manifolds[w, m].close
                first = state.manifolds[w, m].first
                for c in range(first, first + state.manifolds[w, m].count):
                    r = ROWS * (c - offset)
                    clear_impulses(state, w, r)
                    state.contacts[w, c].target = -restitution * velocity_along(state, w, a, b, r)
                    if state.contacts[w, c].gap > close:
                        state.contacts[w, c].target = NO_TARGET
            solve_manifolds(joints, state, w, i, last, offset, ITERATIONS, CONVERGED, wp.float64(0.0))
            if energy(joints, state, w, a, b) <= allowed or trial == TRIALS - 1:
                break
            restitution = restitution * LESS
            for r in range(ROWS * (start - offset), ROWS * (end - offset)):
                if state.rows[w, r].impulse != wp.float64(0.0):  # rows that are not in use hold no directions either
                    push(state, w, a, b, r, -state.rows[w, r].impulse)
            take_back(joints, state, w)
        impulse = wp.float64(0.0)
        for c in range(start, end):
            impulse += state.rows[w, ROWS * (c - offset)].impulse
        return impulse

    @wp.func
    def resolve_impacts(joints: Joints, state: State, w: int, half: int, threshold: wp.float64) -> int:
        """Newton's impact law for all touching pairs that approach faster than the threshold; returns their number.

        Pairs are resolved one after another until none approaches, as a shock runs through touching bodies; the points
        of one pair are resolved together, each rebounding with the pair's restitution times its own approach speed.
        """
        base = half * state.max_manifolds
        offset = half * state.max_contacts
        count = state.manifold_count[w, half]
        resolved = wp.int32(0)
        sweep = wp.int32(0)
        active = wp.int32(0)
        for i in range(base, base + count):
            start = state.manifolds[w, i].first
            for c in range(start, start + state.manifolds[w, i].count):
                if state.contacts[w, c].gap <= state.manifolds[w, i].close:
                    fast = -state.contacts[w, c].speed
                    state.manifolds[w, i].approach = wp.max(state.manifolds[w, i].approach, fast)
                    if fast > threshold:
                        active = 1
        while active == 1 and sweep < 8 + 4 * count:
            active = wp.int32(0)
            sweep += 1
            last = wp.int32(base)
            while last < base + count:
                i = last  # the pair's manifolds, one of each piece or triangle, are [i, last)
                a = state.manifolds[w, i].a
                b = state.manifolds[w, i].b
                fastest = wp.float64(0.0)
                while last < base + count and state.manifolds[w, last].a == a and state.manifolds[w, last].b == b:
                    close = state.manifolds[w, last].close
                    start = state.manifolds[w, last].first
                    for c in range(start, start + state.manifolds[w, last].count):
                        if state.contacts[w, c].gap <= close:
                            fastest = wp.max(fastest, -velocity_along(state, w, a, b, ROWS * (c - offset)))
                    last += 1
                if fastest <= threshold:
                    continue
                state.manifolds[w, i].approach = wp.max(state.manifolds[w, i].approach, fastest)
                active = wp.int32(1)
                resolved += 1
                state.manifolds[w, i].impact += rebound(joints, state, w, i, last, offset)
        return resolved

    return resolve_impacts
