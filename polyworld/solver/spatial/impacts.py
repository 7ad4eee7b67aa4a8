"""Impacts: Newton's law of restitution at the moment of touching, and when that will be."""

from typing import Any

import warp as wp

from polyworld.solver.core.effect_contacts import contact_friction, contact_restitution, contact_tangential
from polyworld.solver.spatial.constraints import NO_TARGET, ROWS, clear_impulses
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.layout import Body, Parameters, State
from polyworld.solver.spatial.rows import push, velocity_along

ITERATIONS = 200
CONVERGED = wp.float64(1.0e-11)  # [m/s]
AIM = wp.float64(0.1)  # an impact is looked for where the gap is this fraction of what counts as touching
TRIALS = 12
LESS = wp.float64(0.7)  # factor on the restitution from trial to trial
UNLIMITED = wp.float64(1.0e30)  # an impulse that none exceeds [N s]
ENERGY_ROUNDING = wp.float64(1.0 + 1.0e-9)


@wp.func
def kinetic_energy(b: Body) -> wp.float64:
    """Kinetic energy [J]; zero for statics, whose mass is not given."""
    w = wp.transpose(b.rotation) * b.w
    return wp.float64(0.5) * b.mass * (wp.dot(b.v, b.v) + wp.dot(w, b.inertia * w))


@wp.func
def time_to_impact(
    state: wp.array[State], w: int, half: int, h: wp.float64, threshold: wp.float64, gravity: wp.vec3d
) -> wp.float64:
    """Time until the first open contact closes faster than the threshold, at most h.

    Two convex bodies cannot meet before they meet along a direction that separates them now, so no impact is
    passed over; where the first guess falls short the next part of the step brings the rest.
    """
    zero = wp.float64(0.0)
    base = half * state[0].max_manifolds
    earliest = h
    for i in range(base, base + state[0].manifold_count[w, half]):
        b = state[0].manifolds[w, i].b
        close = state[0].manifolds[w, i].close
        pull = zero
        if b >= state[0].objects:
            pull = wp.dot(gravity, state[0].manifolds[w, i].normal)
        start = state[0].manifolds[w, i].first
        for c in range(start, start + state[0].manifolds[w, i].count):
            gap = state[0].contacts[w, c].gap
            if gap > close:
                speed = state[0].contacts[w, c].speed
                distance = gap - AIM * close
                # distance + speed t + pull t^2 / 2 = 0, in the form that does not cancel
                root = speed * speed - wp.float64(2.0) * pull * distance
                if root > threshold * threshold:
                    root = wp.sqrt(root)
                    if root > speed:
                        t = wp.float64(2.0) * distance / (root - speed)
                        earliest = wp.min(earliest, t)
    return earliest


@wp.func
def resists(state: wp.array[State], w: int, i: int) -> bool:
    """Check whether a pair resists spin or rolling."""
    return state[0].manifolds[w, i].torsion > wp.float64(0.0) or state[0].manifolds[w, i].rolling > wp.float64(0.0)


@wp.func
def meets(state: wp.array[State], w: int, c: int, close: wp.float64, fast: wp.float64) -> bool:
    """Check whether a contact touches, or does so soon that it rebounds already, at the approach speed `fast`."""
    return state[0].contacts[w, c].gap <= close + state[0].early[w] * wp.max(fast, wp.float64(0.0))


def impact_solver(solve_manifolds: Any, energy: Any, undo_joints: Any) -> Any:
    """Return the function `resolve_impacts`, for functions that do the joints' part.

    energy(joints, state, w, a, b) is the kinetic energy of all that an impact of a and b can change; and
    undo_joints(joints, state, w) removes the joints' impulses of an impact whose contact impulses were removed.
    """

    @wp.func(inline=False)
    def undo(joints: wp.array[Joints], state: wp.array[State], w: int, i: int, last: int, offset: int) -> None:
        """Remove the impulses of an impact whose manifolds are [i, last)."""
        a = state[0].manifolds[w, i].a
        b = state[0].manifolds[w, i].b
        start = state[0].manifolds[w, i].first
        end = state[0].manifolds[w, last - 1].first + state[0].manifolds[w, last - 1].count
        for r in range(ROWS * (start - offset), ROWS * (end - offset)):
            push(state, w, a, b, r, -state[0].rows[w, r].impulse)
            if resists(state, w, i):
                s = state[0].turning_rows + r
                push(state, w, a, b, s, -state[0].rows[w, s].impulse)
        undo_joints(joints, state, w)

    @wp.func(inline=False)
    def rebound(
        joints: wp.array[Joints],
        state: wp.array[State],
        w: int,
        i: int,
        last: int,
        offset: int,
        e: wp.float64,
        tangential: wp.float64,
    ) -> wp.float64:
        """Resolve the impact of one pair, whose manifolds are [i, last); returns its normal impulse [N s].

        All points rebound with the restitution e times their own approach speed (Moreau's form of Newton's law, which
        for frictionless bodies keeps the energy where it is 1). With friction Newton's law can create energy in
        oblique impacts of slender bodies (Kane 1984; Stronge 1990, Proc. R. Soc. A 431, 169): the restitution is
        then lowered until it does not. tangential: restitution along the contact, -1 for Coulomb friction.
        """
        a = state[0].manifolds[w, i].a
        b = state[0].manifolds[w, i].b
        start = state[0].manifolds[w, i].first
        end = state[0].manifolds[w, last - 1].first + state[0].manifolds[w, last - 1].count
        restitution = e
        returned = tangential
        allowed = energy(joints, state, w, a, b) * ENERGY_ROUNDING
        for trial in range(TRIALS):
            for m in range(i, last):
                close = state[0].manifolds[w, m].close
                first = state[0].manifolds[w, m].first
                for c in range(first, first + state[0].manifolds[w, m].count):
                    r = ROWS * (c - offset)
                    clear_impulses(state, w, r)
                    if resists(state, w, i):
                        clear_impulses(state, w, state[0].turning_rows + r)
                    state[0].contacts[w, c].target = -restitution * velocity_along(state, w, a, b, r)
                    if not meets(state, w, c, close, -velocity_along(state, w, a, b, r)):
                        state[0].contacts[w, c].target = NO_TARGET
                    elif tangential > wp.float64(-1.0):
                        x = velocity_along(state, w, a, b, r + 1)
                        y = velocity_along(state, w, a, b, r + 2)
                        state[0].contacts[w, c].target_velocity = wp.vec2d(-returned * x, -returned * y)
                        state[0].contacts[w, c].stick_impulse = UNLIMITED
            solve_manifolds(joints, state, w, i, last, offset, ITERATIONS, CONVERGED, wp.float64(0.0))
            if energy(joints, state, w, a, b) <= allowed or trial == TRIALS - 1:
                break
            restitution = restitution * LESS
            returned = returned * LESS
            undo(joints, state, w, i, last, offset)
        impulse = wp.float64(0.0)
        for c in range(start, end):
            impulse += state[0].rows[w, ROWS * (c - offset)].impulse
            state[0].contacts[w, c].target_velocity = wp.vec2d()
            state[0].contacts[w, c].stick_impulse = wp.float64(0.0)
        return impulse

    @wp.func(inline=False)
    def rebound_with_effects(
        parameters: wp.array[Parameters],
        joints: wp.array[Joints],
        state: wp.array[State],
        world: int,
        w: int,
        i: int,
        last: int,
        offset: int,
        fastest: wp.float64,
        normal: wp.vec3d,
    ) -> wp.float64:
        """As `rebound`, for an approach at the speed `fastest` along `normal`, with the effects' contact laws.

        A stick fraction below 1 mixes the sticking solution and that of Coulomb friction. Both separate the bodies and
        gain no energy, and so does any mixture, for the energy is convex in the velocities.
        """
        zero = wp.float64(0.0)
        one = wp.float64(1.0)
        a = state[0].manifolds[w, i].a
        b = state[0].manifolds[w, i].b
        effects = parameters[0].effects
        e = contact_restitution(effects, world, a, b, state[0].manifolds[w, i].restitution, fastest)
        law = contact_tangential(effects, world, a, b)
        stick_fraction = law[2]
        impulse = zero
        if stick_fraction < one:
            impulse = rebound(joints, state, w, i, last, offset, e, -one)
        if stick_fraction > zero:
            if stick_fraction < one:
                for k in range(state[0].objects):
                    state[0].bodies[w, k].v_free = state[0].bodies[w, k].v  # free for use until the step is predicted
                    state[0].bodies[w, k].w_free = state[0].bodies[w, k].w
                undo(joints, state, w, i, last, offset)
            stuck = rebound(joints, state, w, i, last, offset, e, law[1])
            impulse = wp.lerp(impulse, stuck, stick_fraction)
            if stick_fraction < one:
                for k in range(state[0].objects):
                    v = wp.lerp(state[0].bodies[w, k].v_free, state[0].bodies[w, k].v, stick_fraction)
                    spin = wp.lerp(state[0].bodies[w, k].w_free, state[0].bodies[w, k].w, stick_fraction)
                    state[0].bodies[w, k].v = v
                    state[0].bodies[w, k].w = spin
        if law[0] > zero:
            ma = state[0].bodies[w, a].inverse_mass
            mb = state[0].bodies[w, b].inverse_mass
            u = state[0].bodies[w, a].v - state[0].bodies[w, b].v
            tangential_loss = (u - normal * wp.dot(normal, u)) * (law[0] / (ma + mb))
            state[0].bodies[w, a].v -= tangential_loss * ma
            state[0].bodies[w, b].v += tangential_loss * mb
        return impulse

    @wp.func
    def resolve_impacts(
        parameters: wp.array[Parameters],
        joints: wp.array[Joints],
        state: wp.array[State],
        world: int,
        w: int,
        half: int,
        threshold: wp.float64,
    ) -> int:
        """Apply Newton's impact law to touching pairs that approach faster than the threshold; return their number.

        Pairs are resolved one after another until none approaches, as a shock runs through touching bodies; the points
        of one pair are resolved together, each rebounding with the pair's restitution times its own approach speed.
        """
        base = half * state[0].max_manifolds
        offset = half * state[0].max_contacts
        count = state[0].manifold_count[w, half]
        resolved = wp.int32(0)
        sweep = wp.int32(0)
        active = wp.int32(0)
        for i in range(base, base + count):
            start = state[0].manifolds[w, i].first
            for c in range(start, start + state[0].manifolds[w, i].count):
                fast = -state[0].contacts[w, c].speed
                if meets(state, w, c, state[0].manifolds[w, i].close, fast):
                    state[0].manifolds[w, i].approach = wp.max(state[0].manifolds[w, i].approach, fast)
                    if fast > threshold:
                        active = 1
        while active == 1 and sweep < 8 + 4 * count:
            active = wp.int32(0)
            sweep += 1
            last = wp.int32(base)
            while last < base + count:
                i = last  # the pair's manifolds, one of each piece or triangle, are [i, last)
                a = state[0].manifolds[w, i].a
                b = state[0].manifolds[w, i].b
                fastest = wp.float64(0.0)
                hardest = wp.int32(i)  # the manifold that approaches fastest
                while last < base + count and state[0].manifolds[w, last].a == a and state[0].manifolds[w, last].b == b:
                    close = state[0].manifolds[w, last].close
                    start = state[0].manifolds[w, last].first
                    for c in range(start, start + state[0].manifolds[w, last].count):
                        fast = -velocity_along(state, w, a, b, ROWS * (c - offset))
                        if fast > fastest and meets(state, w, c, close, fast):
                            fastest = fast
                            hardest = last
                    last += 1
                if fastest <= threshold:
                    continue
                state[0].manifolds[w, i].approach = wp.max(state[0].manifolds[w, i].approach, fastest)
                active = wp.int32(1)
                resolved += 1
                impulse = wp.float64(0.0)
                if parameters[0].contact_laws > 0:
                    normal = state[0].manifolds[w, hardest].normal
                    impulse = rebound_with_effects(
                        parameters, joints, state, world, w, i, last, offset, fastest, normal
                    )
                else:
                    e = state[0].manifolds[w, i].restitution
                    impulse = rebound(joints, state, w, i, last, offset, e, wp.float64(-1.0))
                state[0].manifolds[w, i].impact += impulse
        return resolved

    return resolve_impacts


@wp.func(inline=False)
def set_effect_friction(
    parameters: wp.array[Parameters],
    state: wp.array[State],
    world: int,
    w: int,
    half: int,
    threshold: wp.float64,
    h: wp.float64,
) -> None:
    """Set the friction of all touching pairs by the effects at the middle of where they touch.

    Pairs that approach faster than the threshold collide now; the others slide over a step of length h, in which
    the position moves with the first of them. (Where an impact elsewhere cuts the step, its path was taken as whole.)
    """
    base = half * state[0].max_manifolds
    for i in range(base, base + state[0].manifold_count[w, half]):
        centre = wp.vec3d()
        touching = wp.float64(0.0)
        time = h
        start = state[0].manifolds[w, i].first
        for c in range(start, start + state[0].manifolds[w, i].count):
            if state[0].contacts[w, c].gap <= state[0].manifolds[w, i].close:
                centre += state[0].contacts[w, c].point
                touching += wp.float64(1.0)
                if state[0].contacts[w, c].speed < -threshold:
                    time = wp.float64(0.0)
        if touching > wp.float64(0.0):
            ahead = state[0].bodies[w, state[0].manifolds[w, i].a].v * time
            friction = contact_friction(
                parameters[0].effects,
                world,
                state[0].manifolds[w, i].a,
                state[0].manifolds[w, i].b,
                state[0].manifolds[w, i].friction,
                centre / touching + ahead * wp.float64(0.5),
                ahead,
            )
            state[0].manifolds[w, i].friction = friction
            if friction <= wp.float64(0.0):  # nothing to begin with from the last step
                for c in range(start, start + state[0].manifolds[w, i].count):
                    state[0].contacts[w, c].force_t = wp.vec3d()
                    state[0].contacts[w, c].force_spin = wp.float64(0.0)
