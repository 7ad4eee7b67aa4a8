"""Contacts: near pairs, contact rows, impacts, and the forces that hold touching bodies apart."""

import warp as wp

from polyworld.solver.core.contact_coefficients import of_contact
from polyworld.solver.planar.contact_effects import apply_tangential_loss, with_contact_effects
from polyworld.solver.planar.joints import project_hinge_rate, solve_hinge, warm_start_hinges
from polyworld.solver.planar.motion import pose_at, slide, stiffness_of
from polyworld.solver.planar.records import Bodies, Contacts, Joints, References, Row, Samples, Scene
from polyworld.solver.planar.separation import find_manifold

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
FAR = wp.float64(1.0e30)
SLOW = wp.float64(1.0e-5)  # approach speeds below this do not bounce [m/s]
QUIET = wp.float64(1.0e-8)  # approach speeds below this are left to the force solve [m/s]
IMPACT_ROUNDS = 40
IMPACT_SWEEPS = 100
FORCE_SWEEPS = 300


@wp.func
def find_near(
    scene: Scene, bodies: Bodies, contacts: Contacts, w: wp.int32, segment: wp.int32, reach: wp.float64
) -> wp.int32:
    """List the pairs whose bounding circles are nearer than `reach`; returns how many."""
    n = scene.bodies
    count = wp.int32(0)
    for a in range(n):
        if scene.schedule.joins[a] <= segment:
            pa = bodies.pose[w, a]
            for b in range(a + 1, n + scene.statics):
                if scene.collides[a, b] != 0:
                    gap = -FAR
                    if b < n:
                        if scene.schedule.joins[b] <= segment:
                            pb = bodies.pose[w, b]
                            gap = wp.length(wp.vec2d(pb[0] - pa[0], pb[1] - pa[1])) - scene.bound[a] - scene.bound[b]
                        else:
                            gap = FAR
                    else:
                        pb = bodies.static_pose[w, b - n]
                        if scene.first[b + 1] == scene.first[b]:
                            gap = pb[0] * pa[0] + pb[1] * pa[1] - pb[2] - scene.bound[a]
                        else:
                            gap = wp.length(wp.vec2d(pb[0] - pa[0], pb[1] - pa[1])) - scene.bound[a] - scene.bound[b]
                    if gap < reach:
                        contacts.near[w, count] = wp.vec2i(a, b)
                        contacts.near_gap[w, count] = gap
                        count += 1
    return count


@wp.func
def rate_of(scene: Scene, bodies: Bodies, w: wp.int32, i: wp.int32) -> wp.vec3d:
    if i >= scene.bodies:
        return wp.vec3d(ZERO, ZERO, ZERO)
    return bodies.next_rate[w, i]


@wp.func
def point_velocity(rate: wp.vec3d, arm: wp.vec2d) -> wp.vec2d:
    return wp.vec2d(rate[0] - rate[2] * arm[1], rate[1] + rate[2] * arm[0])


@wp.func
def separation_speed(scene: Scene, bodies: Bodies, w: wp.int32, row: Row) -> wp.vec2d:
    """Relative velocity of b against a at the contact: along the normal (positive: parting) and the tangent."""
    va = point_velocity(rate_of(scene, bodies, w, row.a), row.arm_a)
    vb = point_velocity(rate_of(scene, bodies, w, row.b), row.arm_b)
    v = vb - va
    return wp.vec2d(wp.dot(row.normal, v), row.normal[0] * v[1] - row.normal[1] * v[0])


@wp.func
def apply_impulse(
    scene: Scene, bodies: Bodies, w: wp.int32, row: Row, along: wp.float64, across: wp.float64, roll: wp.float64
) -> None:
    """Add impulses (normal, tangent, moment) to the rates of b, and the opposite to those of a."""
    p = wp.vec2d(along * row.normal[0] - across * row.normal[1], along * row.normal[1] + across * row.normal[0])
    a = row.a
    ma = bodies.inverse_mass[w, a]
    ia = bodies.inverse_inertia[w, a]
    moment_a = row.arm_a[0] * p[1] - row.arm_a[1] * p[0] + roll
    bodies.next_rate[w, a] = bodies.next_rate[w, a] - wp.vec3d(ma * p[0], ma * p[1], ia * moment_a)
    b = row.b
    if b < scene.bodies:
        mb = bodies.inverse_mass[w, b]
        ib = bodies.inverse_inertia[w, b]
        moment_b = row.arm_b[0] * p[1] - row.arm_b[1] * p[0] + roll
        bodies.next_rate[w, b] = bodies.next_rate[w, b] + wp.vec3d(mb * p[0], mb * p[1], ib * moment_b)


@wp.func
def make_row(
    scene: Scene,
    bodies: Bodies,
    w: wp.int32,
    a: wp.int32,
    b: wp.int32,
    slot: wp.int32,
    normal: wp.vec2d,
    point: wp.vec2d,
    gap: wp.float64,
) -> Row:
    row = Row()
    row.a = a
    row.b = b
    row.slot = slot
    row.normal = normal
    row.gap = gap
    row.touching = wp.where(gap <= scene.touch, 1, 0)
    pa = bodies.pose[w, a]
    row.arm_a = wp.vec2d(point[0] - pa[0], point[1] - pa[1])
    ta = row.arm_a[0] * normal[0] + row.arm_a[1] * normal[1]
    na = row.arm_a[0] * normal[1] - row.arm_a[1] * normal[0]
    ia = bodies.inverse_inertia[w, a]
    k_normal = bodies.inverse_mass[w, a] + ia * na * na
    k_tangent = bodies.inverse_mass[w, a] + ia * ta * ta
    k_roll = ia
    rolling = bodies.rolling[w, a]
    if b < scene.bodies:
        pb = bodies.pose[w, b]
        row.arm_b = wp.vec2d(point[0] - pb[0], point[1] - pb[1])
        tb = row.arm_b[0] * normal[0] + row.arm_b[1] * normal[1]
        nb = row.arm_b[0] * normal[1] - row.arm_b[1] * normal[0]
        ib = bodies.inverse_inertia[w, b]
        k_normal += bodies.inverse_mass[w, b] + ib * nb * nb
        k_tangent += bodies.inverse_mass[w, b] + ib * tb * tb
        k_roll += ib
        rolling = wp.max(rolling, bodies.rolling[w, b])
    row.mass_normal = ONE / k_normal
    row.mass_tangent = ONE / k_tangent
    row.mass_roll = ONE / k_roll
    row.friction = of_contact(bodies.friction[w, a], bodies.friction[w, b])
    row.restitution = of_contact(bodies.restitution[w, a], bodies.restitution[w, b])
    row.rolling = rolling
    return row


@wp.func
def find_rows(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    samples: Samples,
    w: wp.int32,
    half: wp.int32,
    near_count: wp.int32,
    old_count: wp.int32,
    ratio: wp.float64,
) -> wp.int32:
    """Contact rows of all touching pairs, started from the last step's impulses times `ratio`; returns how many."""
    capacity = contacts.rows.shape[2]
    count = wp.int32(0)
    old = wp.int32(0)
    for k in range(near_count):
        if contacts.near_gap[w, k] <= scene.touch:
            pair = contacts.near[w, k]
            a = pair[0]
            b = pair[1]
            pose_a = bodies.pose[w, a]
            pose_b = pose_at(scene, bodies, w, b, ZERO, ONE)
            m = find_manifold(scene, bodies, w, a, pose_a, b, pose_b)
            gap = wp.min(m.gap0, m.gap1)
            contacts.near_gap[w, k] = gap
            if gap <= scene.touch:
                start = count
                for j in range(m.count):
                    if count < capacity:
                        point = m.point0
                        point_gap = m.gap0
                        if j == 1:
                            point = m.point1
                            point_gap = m.gap1
                        row = make_row(scene, bodies, w, a, b, k, m.normal, point, point_gap)
                        contacts.rows[w, half, count] = row
                        count += 1
                    else:
                        samples.outcome.overflowed[w] = samples.outcome.overflowed[w] + 1
                # Both lists are in the order of the pairs, and a pair's points in the order of the tangent.
                searching = wp.int32(1)
                while searching == 1 and old < old_count:
                    was = contacts.rows[w, 1 - half, old]
                    if was.a > a or (was.a == a and was.b > b):
                        searching = wp.int32(0)
                    else:
                        if was.a == a and was.b == b:
                            target = start
                            if count - start == 2:
                                first = contacts.rows[w, half, start].arm_a
                                second = contacts.rows[w, half, start + 1].arm_a
                                if wp.length(was.arm_a - second) < wp.length(was.arm_a - first):
                                    target = start + 1
                            if target < count:
                                fresh = contacts.rows[w, half, target]
                                if fresh.touching == 1:
                                    fresh.impulse = fresh.impulse + was.impulse * ratio
                                    fresh.impulse_tangent = fresh.impulse_tangent + was.impulse_tangent * ratio
                                    fresh.impulse_roll = fresh.impulse_roll + was.impulse_roll * ratio
                                    contacts.rows[w, half, target] = fresh
                        old += 1
    return count


@wp.func
def solve_row(scene: Scene, bodies: Bodies, w: wp.int32, row: Row) -> Row:
    """Solve one row (Gauss-Seidel): normal, Coulomb friction, rolling resistance, each within its limit."""
    v = separation_speed(scene, bodies, w, row)
    new = wp.max(ZERO, row.impulse + (row.bounce - v[0]) * row.mass_normal)
    change = new - row.impulse
    row.impulse = new
    if change != ZERO:
        apply_impulse(scene, bodies, w, row, change, ZERO, ZERO)
        v = separation_speed(scene, bodies, w, row)
    limit = row.friction * row.impulse
    if row.stick_fraction > ZERO:
        limit = FAR
    across = wp.clamp(row.impulse_tangent - (v[1] - row.target_velocity) * row.mass_tangent, -limit, limit)
    change_across = across - row.impulse_tangent
    row.impulse_tangent = across
    change_roll = ZERO
    if row.rolling > ZERO:
        spin = -rate_of(scene, bodies, w, row.a)[2] + rate_of(scene, bodies, w, row.b)[2]
        roll_limit = row.rolling * row.impulse
        roll = wp.clamp(row.impulse_roll - spin * row.mass_roll, -roll_limit, roll_limit)
        change_roll = roll - row.impulse_roll
        row.impulse_roll = roll
    if change_across != ZERO or change_roll != ZERO:
        apply_impulse(scene, bodies, w, row, ZERO, change_across, change_roll)
    # Left in `gap` is the residual: the largest change of speed this visit made.
    row.gap = wp.max(wp.abs(change) / row.mass_normal, wp.abs(change_across) / row.mass_tangent)
    return row


@wp.func
def apply_restitution(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    joints: Joints,
    w: wp.int32,
    half: wp.int32,
    rows: wp.int32,
    share: wp.float64,
    sticking: wp.float64,
    threshold: wp.float64,
) -> None:
    """Bring the rows of this round to `share` of the separation speed that restitution demands; hinges hold.

    sticking: 1 for rows with a stick fraction to stick, 0 for Coulomb friction in all.
    """
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
    w: wp.int32,
    half: wp.int32,
    rows: wp.int32,
    gain: wp.float64,
    sticking: wp.float64,
    threshold: wp.float64,
) -> None:
    """Limit the restitution of a round in which friction would create energy (Kane 1984) to where it gains none.

    Between the plastic solution, which never gains, and Newton's, impulses and rates are mixed: the mixture
    keeps within Coulomb's cone and admissible, and its energy is quadratic in the share of Newton's.
    """
    for i in range(scene.bodies):
        bodies.shift[w, i] = bodies.next_rate[w, i]
        bodies.next_rate[w, i] = bodies.drag[w, i]
    for k in range(rows):
        row = contacts.rows[w, half, k]
        row.newton_impulse = row.round_impulse
        contacts.rows[w, half, k] = row
    apply_restitution(scene, bodies, contacts, joints, w, half, rows, ZERO, sticking, threshold)
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
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    joints: Joints,
    references: References,
    w: wp.int32,
    half: wp.int32,
    rows: wp.int32,
    step: wp.float64,
) -> None:
    """Apply Newton's law of restitution at every touching row that approaches, in rounds of those that do.

    In each round the rows that approach get restitution together, those that do not are left alone: a row of
    balls then passes the impact on (generalised reflections, Smith, Kaufman, Vouga, Tamstorf & Grinspun 2012,
    ACM TOG 31, 106). Approach speeds below what gravity changes in half a step do not bounce: from then on the
    row only keeps its bodies from approaching. Effects may give rows a stick fraction: the solutions with sticking and
    with Coulomb friction are then mixed. Neither gains energy, and so no mixture does, for the energy is convex in
    the rates. Rows of one round with different stick fractions, in impacts at one instant, all take the largest.
    """
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
    threshold = wp.float64(1.0e-12) * fastest + wp.float64(1.0e-9) * step * heaviest
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
                    if -v[0] > HALF * step * pushed + SLOW and round_number < IMPACT_ROUNDS:
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
                apply_restitution(scene, bodies, contacts, joints, w, half, rows, ONE, sticking, threshold)
                gain = energy_gain(scene, bodies, w)
                if gain > ZERO:
                    limit_restitution_energy(scene, bodies, contacts, joints, w, half, rows, gain, sticking, threshold)
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


@wp.func
def solve_contact_velocities(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    joints: Joints,
    w: wp.int32,
    half: wp.int32,
    rows: wp.int32,
    ratio: wp.float64,
    h: wp.float64,
) -> None:
    """Solve the impulses over h at touching rows and hinges, with friction on the supporting plane.

    No row approaches at the end of the step; no hinge opens over it. ratio: h over the last step's.
    """
    pushed = warm_start_hinges(bodies, joints, w, ratio, h)
    for k in range(rows):
        row = contacts.rows[w, half, k]
        if row.touching == 1:
            # A body that has just bounced may come back as fast as it left, within the step.
            va = point_velocity(bodies.rate[w, row.a], row.arm_a)
            vb = wp.vec2d(ZERO, ZERO)
            if row.b < scene.bodies:
                vb = point_velocity(bodies.rate[w, row.b], row.arm_b)
            row.bounce = -wp.max(ZERO, wp.dot(row.normal, vb - va))
            limit = row.friction * row.impulse
            row.impulse_tangent = wp.clamp(row.impulse_tangent, -limit, limit)
            contacts.rows[w, half, k] = row
            apply_impulse(scene, bodies, w, row, row.impulse, row.impulse_tangent, row.impulse_roll)
            pushed = wp.max(pushed, wp.length(bodies.push[w, row.a]) * h)
            pushed = wp.max(pushed, wp.length(bodies.rate[w, row.a]))
            if row.b < scene.bodies:
                pushed = wp.max(pushed, wp.length(bodies.push[w, row.b]) * h)
                pushed = wp.max(pushed, wp.length(bodies.rate[w, row.b]))
    for _ in range(FORCE_SWEEPS):
        residual = ZERO
        for k in range(rows):
            row = contacts.rows[w, half, k]
            if row.touching == 1:
                gap = row.gap
                row = solve_row(scene, bodies, w, row)
                residual = wp.max(residual, row.gap)
                row.gap = gap
                contacts.rows[w, half, k] = row
        for j in range(joints.count):
            residual = wp.max(residual, solve_hinge(bodies, joints, w, j, h))
        for i in range(scene.bodies):
            if bodies.coupled[w, i] == 1 and bodies.hold[w, i] > ZERO:
                without = bodies.next_rate[w, i] - bodies.drag[w, i]
                limit = bodies.hold[w, i] * h * bodies.linear_decay[w, i][1]
                held = slide(without, limit, bodies.patch[w, i], stiffness_of(bodies, w, i))
                residual = wp.max(residual, wp.length(held - bodies.next_rate[w, i]))
                bodies.next_rate[w, i] = held
                bodies.drag[w, i] = held - without
        if residual <= wp.float64(1.0e-11) * pushed:
            break


@wp.func
def part_overlaps(
    scene: Scene, bodies: Bodies, contacts: Contacts, w: wp.int32, half: wp.int32, rows: wp.int32, share: wp.float64
) -> None:
    """Move overlapping bodies apart by `share` of the overlap, without giving them speed."""
    for k in range(rows):
        row = contacts.rows[w, half, k]
        depth = -row.gap - wp.float64(4.0) * scene.touch
        if row.touching == 1 and depth > ZERO:
            p = row.normal * (depth * share * row.mass_normal)
            a = row.a
            ma = bodies.inverse_mass[w, a]
            moment_a = bodies.inverse_inertia[w, a] * (row.arm_a[0] * p[1] - row.arm_a[1] * p[0])
            bodies.shift[w, a] = bodies.shift[w, a] - wp.vec3d(ma * p[0], ma * p[1], moment_a)
            b = row.b
            if b < scene.bodies:
                mb = bodies.inverse_mass[w, b]
                moment_b = bodies.inverse_inertia[w, b] * (row.arm_b[0] * p[1] - row.arm_b[1] * p[0])
                bodies.shift[w, b] = bodies.shift[w, b] + wp.vec3d(mb * p[0], mb * p[1], moment_b)
