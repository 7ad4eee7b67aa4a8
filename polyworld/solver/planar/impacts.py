"""Impacts: Newton's law of restitution in rounds, and its limit by energy."""

import warp as wp

from polyworld.solver.planar.contact_effects import apply_tangential_loss, with_contact_effects
from polyworld.solver.planar.records import Bodies, Contacts, Scene, Step
from polyworld.solver.planar.relaxation import relax
from polyworld.solver.planar.rows import GOOD, QUIET, SLOW, pushed_along, row_velocity, slow_approach

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
FAR = wp.float64(1.0e30)
IMPACT_ROUNDS = 40
IMPACT_SWEEPS = 32


@wp.func
def apply_restitution(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    contacts: wp.array[Contacts],
    step: Step,
    island: wp.int32,
    share: wp.float64,
    sticking: wp.int32,
    threshold: wp.vec2d,
) -> None:
    """Bring the rows of this round to `share` of the separation speed that restitution demands.

    sticking: 1 for rows with a stick fraction to stick, 0 for Coulomb friction in all.
    """
    slot = step.slot
    half = step.half
    for k in range(bodies[0].first_row[step.w, island], bodies[0].first_row[step.w, island + 1]):
        r = contacts[0].order[slot, k]
        contacts[0].rows[slot, half, r].solved = 0
        contacts[0].rows[slot, half, r].impulse = wp.vec3d()
        bounce = contacts[0].rows[slot, half, r].bounce
        if bounce < FAR:
            contacts[0].rows[slot, half, r].solved = 1
            contacts[0].rows[slot, half, r].target = bounce * share
            contacts[0].rows[slot, half, r].sticks = 0
            contacts[0].rows[slot, half, r].slip_target = ZERO
            if sticking == 1 and contacts[0].rows[slot, half, r].stick_fraction > ZERO:
                contacts[0].rows[slot, half, r].sticks = 1
                contacts[0].rows[slot, half, r].slip_target = contacts[0].rows[slot, half, r].target_velocity * share
    relax(
        scene,
        bodies,
        contacts,
        step.w,
        slot,
        half,
        island,
        IMPACT_SWEEPS,
        threshold[0],
        threshold[1],
        ZERO,
    )


@wp.func
def energy_gain(bodies: wp.array[Bodies], w: wp.int32, island: wp.int32) -> wp.float64:
    """Kinetic energy gained since `bodies[0].drag` was the rate, where it is more than rounding; else 0 [J]."""
    before = ZERO
    gain = ZERO
    for k in range(bodies[0].first_body[w, island], bodies[0].first_body[w, island + 1]):
        i = bodies[0].island[w, k]
        a = bodies[0].drag[w, i]
        b = bodies[0].next_rate[w, i]
        m = HALF * bodies[0].mass[w, i]
        j = HALF / bodies[0].inverse_inertia[w, i]
        before += m * (a[0] * a[0] + a[1] * a[1]) + j * a[2] * a[2]
        d = b - a
        s = b + a
        gain += m * (d[0] * s[0] + d[1] * s[1]) + j * d[2] * s[2]
    if gain <= wp.float64(1.0e-13) * before:
        return ZERO
    return gain


@wp.func
def limit_restitution_energy(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    contacts: wp.array[Contacts],
    step: Step,
    island: wp.int32,
    gain: wp.float64,
    sticking: wp.int32,
    threshold: wp.vec2d,
) -> None:
    """Limit the restitution of a round in which friction would create energy (Kane 1984) to where it gains none.

    Between the plastic solution, which never gains, and Newton's, impulses and rates are mixed: the mixture
    keeps within Coulomb's cone and admissible, and its energy is quadratic in the share of Newton's.
    """
    w = step.w
    slot = step.slot
    half = step.half
    first_body = bodies[0].first_body[w, island]
    last_body = bodies[0].first_body[w, island + 1]
    for k in range(first_body, last_body):
        i = bodies[0].island[w, k]
        bodies[0].shift[w, i] = bodies[0].next_rate[w, i]
        bodies[0].next_rate[w, i] = bodies[0].drag[w, i]
    for k in range(bodies[0].first_row[w, island], bodies[0].first_row[w, island + 1]):
        r = contacts[0].order[slot, k]
        contacts[0].rows[slot, half, r].newton_impulse = contacts[0].rows[slot, half, r].impulse[0]
    apply_restitution(scene, bodies, contacts, step, island, ZERO, sticking, threshold)
    # Energy change at share s: plastic + linear s + bend s^2; it is `gain` at s = 1.
    plastic = ZERO
    bend = ZERO
    for k in range(first_body, last_body):
        i = bodies[0].island[w, k]
        m = HALF * bodies[0].mass[w, i]
        j = HALF / bodies[0].inverse_inertia[w, i]
        a = bodies[0].drag[w, i]
        b = bodies[0].next_rate[w, i]
        d = b - a
        s = b + a
        plastic += m * (d[0] * s[0] + d[1] * s[1]) + j * d[2] * s[2]
        d = bodies[0].shift[w, i] - b
        bend += m * (d[0] * d[0] + d[1] * d[1]) + j * d[2] * d[2]
    linear = gain - plastic - bend
    share = ZERO
    if plastic < ZERO:
        share = -wp.float64(2.0) * plastic / (linear + wp.sqrt(linear * linear - wp.float64(4.0) * bend * plastic))
    for k in range(first_body, last_body):
        i = bodies[0].island[w, k]
        bodies[0].next_rate[w, i] = wp.lerp(bodies[0].next_rate[w, i], bodies[0].shift[w, i], share)
    for k in range(bodies[0].first_row[w, island], bodies[0].first_row[w, island + 1]):
        r = contacts[0].order[slot, k]
        along = wp.lerp(
            contacts[0].rows[slot, half, r].impulse[0], contacts[0].rows[slot, half, r].newton_impulse, share
        )
        contacts[0].rows[slot, half, r].impulse = wp.vec3d(along, ZERO, ZERO)


@wp.func
def begin_round(
    scene: wp.array[Scene],
    bodies: wp.array[Bodies],
    contacts: wp.array[Contacts],
    step: Step,
    island: wp.int32,
    round_number: wp.int32,
) -> wp.vec2d:
    """Set what the rows of an island do in this round; return how many approach, and the largest stick fraction."""
    w = step.w
    slot = step.slot
    half = step.half
    approaching = ZERO
    mix = ZERO
    bouncing = wp.int32(0)
    fastest = wp.int32(0)
    for k in range(bodies[0].first_row[w, island], bodies[0].first_row[w, island + 1]):
        r = contacts[0].order[slot, k]
        contacts[0].rows[slot, half, r].bounce = FAR
        contacts[0].rows[slot, half, r].stick_fraction = ZERO
        contacts[0].rows[slot, half, r].target_velocity = ZERO
        contacts[0].rows[slot, half, r].tangential_loss = ZERO
        if contacts[0].rows[slot, half, r].touching == 1:
            v = row_velocity(scene, contacts, bodies[0].next_rate, w, slot, half, r)
            slow = slow_approach(step, pushed_along(scene, bodies, contacts, step, r))
            if v[0] < -QUIET * slow:
                if -v[0] > slow:
                    approaching += ONE
                if -v[0] > slow and round_number < IMPACT_ROUNDS:
                    fastest = wp.int32(1)
                    contacts[0].rows[slot, half, r].bounce = -contacts[0].rows[slot, half, r].restitution * v[0]
                    if scene[0].contact_laws > 0:
                        row = with_contact_effects(scene, w, contacts[0].rows[slot, half, r], v)
                        mix = wp.max(mix, row.stick_fraction)
                        contacts[0].rows[slot, half, r] = row
                    if contacts[0].rows[slot, half, r].bounce == ZERO:
                        contacts[0].rows[slot, half, r].plastic = 1
                    else:
                        bouncing = wp.int32(1)
                else:
                    contacts[0].rows[slot, half, r].plastic = 1
            if contacts[0].rows[slot, half, r].plastic == 1:
                contacts[0].rows[slot, half, r].bounce = ZERO
            if round_number == IMPACT_ROUNDS:  # still not apart: the last round is plastic for all
                contacts[0].rows[slot, half, r].bounce = ZERO
    if approaching > ZERO and bouncing == 0 and scene[0].contact_laws == 0:
        # Nothing rebounds: rows that an inelastic impact reaches next are solved with it, not in rounds of their own.
        for k in range(bodies[0].first_row[w, island], bodies[0].first_row[w, island + 1]):
            r = contacts[0].order[slot, k]
            dead = fastest == 0 or contacts[0].rows[slot, half, r].restitution == ZERO
            if dead and contacts[0].rows[slot, half, r].touching == 1:
                contacts[0].rows[slot, half, r].bounce = ZERO
    return wp.vec2d(approaching, mix)


@wp.func(inline=False)
def resolve_impacts(scene: wp.array[Scene], bodies: wp.array[Bodies], contacts: wp.array[Contacts], step: Step) -> None:
    """Apply Newton's law of restitution at every touching row that approaches, in rounds of those that do.

    In each round the rows that approach get restitution together, those that do not are left alone: a row of
    balls then passes the impact on (generalised reflections, Smith, Kaufman, Vouga, Tamstorf & Grinspun 2012,
    ACM TOG 31, 106). Approach speeds below what gravity changes in half a step do not bounce: from then on the
    row only keeps its bodies from approaching. Effects may give rows a stick fraction: the solutions with sticking and
    with Coulomb friction are then mixed. Neither gains energy, and so no mixture does, for the energy is convex in
    the rates. Rows of one round with different stick fractions, in impacts at one instant, all take the largest.
    """
    w = step.w
    slot = step.slot
    half = step.half
    for island in range(step.islands):
        first = bodies[0].first_row[w, island]
        last = bodies[0].first_row[w, island + 1]
        fastest = ZERO
        heaviest = ZERO
        for k in range(first, last):
            r = contacts[0].order[slot, k]
            if contacts[0].rows[slot, half, r].touching == 1:
                v = row_velocity(scene, contacts, bodies[0].next_rate, w, slot, half, r)
                contacts[0].rows[slot, half, r].approach = wp.max(ZERO, -v[0])
                fastest = wp.max(fastest, -v[0])
                heaviest = wp.max(heaviest, wp.length(bodies[0].push[w, contacts[0].rows[slot, half, r].a]))
        threshold = wp.vec2d(
            wp.float64(1.0e-12) * fastest + wp.float64(1.0e-9) * step.whole * heaviest,
            GOOD * slow_approach(step, heaviest),
        )
        round_number = wp.int32(0)
        while fastest > SLOW and round_number <= IMPACT_ROUNDS:
            counts = begin_round(scene, bodies, contacts, step, island, round_number)
            round_number += 1
            mix = counts[1]
            if counts[0] == ZERO:
                break
            for k in range(bodies[0].first_body[w, island], bodies[0].first_body[w, island + 1]):
                i = bodies[0].island[w, k]
                bodies[0].drag[w, i] = bodies[0].next_rate[w, i]
            laws = wp.where(mix > ZERO, 2, 1)
            for law in range(laws):  # Coulomb friction, then sticking
                part = wp.where(law == 0, ONE - mix, mix)
                if part > ZERO:
                    if law == 1:
                        for k in range(bodies[0].first_body[w, island], bodies[0].first_body[w, island + 1]):
                            i = bodies[0].island[w, k]
                            bodies[0].mixed[w, i] = bodies[0].next_rate[w, i]
                            bodies[0].next_rate[w, i] = bodies[0].drag[w, i]
                    apply_restitution(scene, bodies, contacts, step, island, ONE, law, threshold)
                    gain = energy_gain(bodies, w, island)
                    if gain > ZERO:
                        limit_restitution_energy(scene, bodies, contacts, step, island, gain, law, threshold)
                    for k in range(first, last):
                        r = contacts[0].order[slot, k]
                        if contacts[0].rows[slot, half, r].bounce < FAR:
                            contacts[0].rows[slot, half, r].impact_impulse = (
                                contacts[0].rows[slot, half, r].impact_impulse
                                + contacts[0].rows[slot, half, r].impulse[0] * part
                            )
            if scene[0].contact_laws > 0:
                if mix > ZERO:
                    for k in range(bodies[0].first_body[w, island], bodies[0].first_body[w, island + 1]):
                        i = bodies[0].island[w, k]
                        bodies[0].next_rate[w, i] = wp.lerp(bodies[0].mixed[w, i], bodies[0].next_rate[w, i], mix)
                apply_tangential_loss(scene, bodies, contacts, w, slot, half, first, last)
