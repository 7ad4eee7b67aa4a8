"""Impacts: Newton's law of restitution in rounds, and its limit by energy."""

import warp as wp

from polyworld.solver.planar.constraints import separation_speed, solve_row
from polyworld.solver.planar.contact_effects import apply_tangential_loss, with_contact_effects
from polyworld.solver.planar.joints import project_hinge_rate
from polyworld.solver.planar.records import Bodies, Contacts, Joints, References, Scene, Step

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
FAR = wp.float64(1.0e30)
SLOW = wp.float64(1.0e-5)  # approach speeds below this do not bounce [m/s]
QUIET = wp.float64(1.0e-8)  # approach speeds below this are left to the force solve [m/s]
IMPACT_ROUNDS = 40
IMPACT_SWEEPS = 100


@wp.func
def apply_restitution(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    joints: Joints,
    step: Step,
    share: wp.float64,
    sticking: wp.float64,
    threshold: wp.float64,
) -> None:
    """Bring the rows of this round to `share` of the separation speed that restitution demands; hinges hold.

    sticking: 1 for rows with a stick fraction to stick, 0 for Coulomb friction in all.
    """
    w = step.w
    half = step.half
    rows = step.rows
    for sweep in range(IMPACT_SWEEPS):
        residual = ZERO
        for k in range(rows):
            row = contacts.rows[w, half, k]
            if row.bounce < FAR:
                # Impulses of this round alone; those of the force solve wait in the row meanwhile.
                visit = row
                visit.bounce = row.bounce * share
                visit.stick_fraction = row.stick_fraction * sticking
                visit.target_velocity = row.target_velocity * (share * sticking)
                visit.impulse = wp.where(sweep == 0, ZERO, row.round_impulse)
                visit.impulse_tangent = wp.where(sweep == 0, ZERO, row.round_tangent)
                visit.impulse_roll = wp.where(sweep == 0, ZERO, row.round_roll)
                visit = solve_row(scene, bodies, w, visit)
                residual = wp.max(residual, visit.gap)
                row.round_impulse = visit.impulse
                row.round_tangent = visit.impulse_tangent
                row.round_roll = visit.impulse_roll
                contacts.rows[w, half, k] = row
        for j in range(joints.count):
            residual = wp.max(residual, project_hinge_rate(bodies, joints, w, j))
        if residual <= threshold:
            break


@wp.func
def energy_gain(scene: Scene, bodies: Bodies, w: wp.int32) -> wp.float64:
    """Kinetic energy gained since `bodies.drag` was the rate, where it is more than rounding; else 0 [J]."""
    before = ZERO
    gain = ZERO
    for i in range(scene.bodies):
        a = bodies.drag[w, i]
        b = bodies.next_rate[w, i]
        m = HALF * bodies.mass[w, i]
        j = HALF / bodies.inverse_inertia[w, i]
        before += m * (a[0] * a[0] + a[1] * a[1]) + j * a[2] * a[2]
        d = b - a
        s = b + a
        gain += m * (d[0] * s[0] + d[1] * s[1]) + j * d[2] * s[2]
    if gain <= wp.float64(1.0e-13) * before:
        return ZERO
    return gain


@wp.func
def limit_restitution_energy(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    joints: Joints,
    step: Step,
    gain: wp.float64,
    sticking: wp.float64,
    threshold: wp.float64,
) -> None:
    """Limit the restitution of a round in which friction would create energy (Kane 1984) to where it gains none.

    Between the plastic solution, which never gains, and Newton's, impulses and rates are mixed: the mixture
    keeps within Coulomb's cone and admissible, and its energy is quadratic in the share of Newton's.
    """
    w = step.w
    half = step.half
    rows = step.rows
    for i in range(scene.bodies):
        bodies.shift[w, i] = bodies.next_rate[w, i]
        bodies.next_rate[w, i] = bodies.drag[w, i]
    for k in range(rows):
        row = contacts.rows[w, half, k]
        row.newton_impulse = row.round_impulse
        contacts.rows[w, half, k] = row
    apply_restitution(scene, bodies, contacts, joints, step, ZERO, sticking, threshold)
    # Energy change at share s: plastic + linear s + bend s^2; it is `gain` at s = 1.
    plastic = ZERO
    bend = ZERO
    for i in range(scene.bodies):
        m = HALF * bodies.mass[w, i]
        j = HALF / bodies.inverse_inertia[w, i]
        a = bodies.drag[w, i]
        b = bodies.next_rate[w, i]
        d = b - a
        s = b + a
        plastic += m * (d[0] * s[0] + d[1] * s[1]) + j * d[2] * s[2]
        d = bodies.shift[w, i] - b
        bend += m * (d[0] * d[0] + d[1] * d[1]) + j * d[2] * d[2]
    linear = gain - plastic - bend
    share = ZERO
    if plastic < ZERO:
        share = -wp.float64(2.0) * plastic / (linear + wp.sqrt(linear * linear - wp.float64(4.0) * bend * plastic))
    for i in range(scene.bodies):
        bodies.next_rate[w, i] = wp.lerp(bodies.next_rate[w, i], bodies.shift[w, i], share)
    for k in range(rows):
        row = contacts.rows[w, half, k]
        row.round_impulse = wp.lerp(row.round_impulse, row.newton_impulse, share)
        contacts.rows[w, half, k] = row


@wp.func
def resolve_impacts(
    scene: Scene, bodies: Bodies, contacts: Contacts, joints: Joints, references: References, step: Step
) -> None:
    """Apply Newton's law of restitution at every touching row that approaches, in rounds of those that do.

    In each round the rows that approach get restitution together, those that do not are left alone: a row of
    balls then passes the impact on (generalised reflections, Smith, Kaufman, Vouga, Tamstorf & Grinspun 2012,
    ACM TOG 31, 106). Approach speeds below what gravity changes in half a step do not bounce: from then on the
    row only keeps its bodies from approaching. Effects may give rows a stick fraction: the solutions with sticking and
    with Coulomb friction are then mixed. Neither gains energy, and so no mixture does, for the energy is convex in
    the rates. Rows of one round with different stick fractions, in impacts at one instant, all take the largest.
    """
    w = step.w
    half = step.half
    rows = step.rows
    fastest = ZERO
    heaviest = ZERO
    for k in range(rows):
        row = contacts.rows[w, half, k]
        row.approach = ZERO
        row.plastic = 0
        if row.touching == 1:
            v = separation_speed(scene, bodies, w, row)
            row.approach = wp.max(ZERO, -v[0])
            fastest = wp.max(fastest, row.approach)
            heaviest = wp.max(heaviest, wp.length(bodies.push[w, row.a]))
        contacts.rows[w, half, k] = row
    threshold = wp.float64(1.0e-12) * fastest + wp.float64(1.0e-9) * step.whole * heaviest
    if fastest <= QUIET:
        return
    for round_number in range(IMPACT_ROUNDS + 1):
        approaching = wp.int32(0)
        mix = ZERO
        for k in range(rows):
            row = contacts.rows[w, half, k]
            row.bounce = FAR
            row.stick_fraction = ZERO
            row.target_velocity = ZERO
            row.tangential_loss = ZERO
            if row.touching == 1:
                v = separation_speed(scene, bodies, w, row)
                if v[0] < -QUIET:
                    approaching += 1
                    pushed = wp.abs(wp.dot(row.normal, wp.vec2d(bodies.push[w, row.a][0], bodies.push[w, row.a][1])))
                    if row.b < scene.bodies:
                        pushed = wp.max(
                            pushed,
                            wp.abs(wp.dot(row.normal, wp.vec2d(bodies.push[w, row.b][0], bodies.push[w, row.b][1]))),
                        )
                    if -v[0] > HALF * step.whole * pushed + SLOW and round_number < IMPACT_ROUNDS:
                        row.bounce = -row.restitution * v[0]
                        if scene.contact_laws > 0:
                            row = with_contact_effects(references.scene, w, row, v)
                            mix = wp.max(mix, row.stick_fraction)
                        if row.bounce == ZERO:
                            row.plastic = 1
                    else:
                        row.plastic = 1
                if row.plastic == 1:
                    row.bounce = ZERO
                if round_number == IMPACT_ROUNDS:  # still not apart: the last round is plastic for all
                    row.bounce = ZERO
            contacts.rows[w, half, k] = row
        if approaching == 0:
            return
        for i in range(scene.bodies):
            bodies.drag[w, i] = bodies.next_rate[w, i]
        laws = wp.where(mix > ZERO, 2, 1)
        for law in range(laws):  # Coulomb friction, then sticking
            part = wp.where(law == 0, ONE - mix, mix)
            if part > ZERO:
                sticking = wp.float64(law)
                if law == 1:
                    for i in range(scene.bodies):
                        bodies.mixed[w, i] = bodies.next_rate[w, i]
                        bodies.next_rate[w, i] = bodies.drag[w, i]
                apply_restitution(scene, bodies, contacts, joints, step, ONE, sticking, threshold)
                gain = energy_gain(scene, bodies, w)
                if gain > ZERO:
                    limit_restitution_energy(scene, bodies, contacts, joints, step, gain, sticking, threshold)
                for k in range(rows):
                    row = contacts.rows[w, half, k]
                    if row.bounce < FAR:
                        row.impact_impulse = row.impact_impulse + row.round_impulse * part
                        contacts.rows[w, half, k] = row
        if scene.contact_laws > 0:
            if mix > ZERO:
                for i in range(scene.bodies):
                    bodies.next_rate[w, i] = wp.lerp(bodies.mixed[w, i], bodies.next_rate[w, i], mix)
            apply_tangential_loss(references.scene, references.bodies, references.contacts, w, half, rows)
