"""Impulses of contact rows: normal, Coulomb friction and rolling resistance; and the forces that keep bodies apart."""

import warp as wp

from polyworld.solver.planar.joints import solve_hinge, warm_start_hinges
from polyworld.solver.planar.motion import slide, stiffness_of
from polyworld.solver.planar.records import Bodies, Contacts, Joints, Row, Scene, Step

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
ONE = wp.float64(1.0)
FAR = wp.float64(1.0e30)
FORCE_SWEEPS = 300
PARTING = wp.float64(0.02)  # time in which an overlap shrinks to 1/e [s]


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
def solve_contact_velocities(scene: Scene, bodies: Bodies, contacts: Contacts, joints: Joints, step: Step) -> None:
    """Solve the impulses over h at touching rows and hinges, with friction on the supporting plane.

    No row approaches at the end of the step; no hinge opens over it.
    """
    w = step.w
    half = step.half
    rows = step.rows
    h = step.h
    pushed = warm_start_hinges(bodies, joints, w, step.ratio, h)
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
def separate_overlaps(scene: Scene, bodies: Bodies, contacts: Contacts, step: Step) -> None:
    """Move overlapping bodies apart by a share of the overlap, without giving them speed."""
    w = step.w
    share = ONE - wp.exp(-step.h / PARTING)
    for k in range(step.rows):
        row = contacts.rows[w, step.half, k]
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
