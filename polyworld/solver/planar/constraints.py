"""The impulses of a step at contact rows, and the parting of overlaps."""

import warp as wp

from polyworld.solver.planar.records import Bodies, Contacts, Scene, Step
from polyworld.solver.planar.relaxation import relax
from polyworld.solver.planar.rows import GOOD, apply_impulse, pushed_along, row_velocity, slow_approach

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
TWO = wp.float64(2.0)
FORCE_VISITS = 4096  # of rows, that any island is worth,
FORCE_SWEEPS, MOST_SWEEPS = 64, 300  # and bounds of the sweeps that make them
CONVERGED = wp.float64(1.0e-11)  # change of speed in a sweep that counts as none, of what the step changes it by
PARTING = wp.float64(0.02)  # time in which an overlap shrinks to 1/e [s]


@wp.func(inline=False)
def solve_contact_velocities(
    scene: wp.array[Scene], bodies: wp.array[Bodies], contacts: wp.array[Contacts], step: Step
) -> None:
    """Solve the impulses over h at touching rows, with friction on the supporting plane.

    No row approaches at the end of the step.
    """
    w = step.w
    slot = step.slot
    half = step.half
    h = step.h
    for island in range(step.islands):
        pushed = ZERO
        heaviest = ZERO
        first = bodies[0].first_row[w, island]
        last = bodies[0].first_row[w, island + 1]
        for k in range(first, last):
            r = contacts[0].order[slot, k]
            a = contacts[0].rows[slot, half, r].a
            b = contacts[0].rows[slot, half, r].b
            parting = row_velocity(scene, contacts, bodies[0].rate, w, slot, half, r)[0]
            solved = contacts[0].rows[slot, half, r].touching
            # A body that has just bounced may come back as fast as it left, within the step.
            target = -wp.max(ZERO, parting)
            if solved == 0:
                gap = contacts[0].rows[slot, half, r].gap
                if gap <= step.reach and -parting <= slow_approach(
                    step, pushed_along(scene, bodies, contacts, step, r)
                ):
                    # The gap closes, at most, by the mean of the speeds before and after.
                    solved = wp.int32(1)
                    target = wp.min(ZERO, -parting - TWO * (gap - HALF * scene[0].touch) / h)
            contacts[0].rows[slot, half, r].solved = solved
            contacts[0].rows[slot, half, r].sticks = 0
            contacts[0].rows[slot, half, r].slip_target = ZERO
            contacts[0].rows[slot, half, r].target = target
            force = contacts[0].rows[slot, half, r].force
            if solved == 1:
                limit = contacts[0].rows[slot, half, r].friction * force[0]
                force = wp.vec3d(force[0], wp.clamp(force[1], -limit, limit), force[2])
                apply_impulse(scene, bodies, contacts, w, slot, half, r, force)
                heaviest = wp.max(heaviest, wp.length(bodies[0].push[w, a]))
                pushed = wp.max(pushed, wp.length(bodies[0].push[w, a]) * h)
                pushed = wp.max(pushed, wp.length(bodies[0].rate[w, a]))
                if b < scene[0].bodies:
                    pushed = wp.max(pushed, wp.length(bodies[0].push[w, b]) * h)
                    pushed = wp.max(pushed, wp.length(bodies[0].rate[w, b]))
            else:
                force = wp.vec3d()
            contacts[0].rows[slot, half, r].impulse = force
        relax(
            scene,
            bodies,
            contacts,
            w,
            slot,
            half,
            island,
            wp.clamp(FORCE_VISITS // (last - first + 1), FORCE_SWEEPS, MOST_SWEEPS),
            CONVERGED * pushed,
            GOOD * slow_approach(step, heaviest),
            h,
        )
        for k in range(first, last):
            r = contacts[0].order[slot, k]
            contacts[0].rows[slot, half, r].force = contacts[0].rows[slot, half, r].impulse


@wp.func
def separate_overlaps(
    scene: wp.array[Scene], bodies: wp.array[Bodies], contacts: wp.array[Contacts], step: Step
) -> None:
    """Move overlapping bodies apart by a share of the overlap, without giving them speed.

    What closes slowly within the step stops at the middle of the contact band, as an inelastic impact would.
    """
    w = step.w
    share = ONE - wp.exp(-step.h / PARTING)
    for k in range(step.active):
        r = contacts[0].active[step.slot, k]
        gap = contacts[0].rows[step.slot, step.half, r].gap
        depth = share * (-gap - wp.float64(4.0) * scene[0].touch)
        touching = contacts[0].rows[step.slot, step.half, r].touching
        if touching == 0:
            depth = ZERO
        closes = touching == 0 or contacts[0].rows[step.slot, step.half, r].approach > ZERO
        if closes and contacts[0].rows[step.slot, step.half, r].solved == 1:
            end = gap + row_velocity(scene, contacts, bodies[0].shift, w, step.slot, step.half, r)[0]
            depth = wp.max(depth, wp.min(gap, HALF * scene[0].touch) - end)
        if depth > ZERO:
            a = contacts[0].rows[step.slot, step.half, r].a
            b = contacts[0].rows[step.slot, step.half, r].b
            arm_a = contacts[0].rows[step.slot, step.half, r].arm_a
            arm_b = contacts[0].rows[step.slot, step.half, r].arm_b
            p = contacts[0].rows[step.slot, step.half, r].normal * (
                depth * contacts[0].rows[step.slot, step.half, r].mass[0]
            )
            ma = bodies[0].inverse_mass[w, a]
            moment_a = bodies[0].inverse_inertia[w, a] * (arm_a[0] * p[1] - arm_a[1] * p[0])
            bodies[0].shift[w, a] = bodies[0].shift[w, a] - wp.vec3d(ma * p[0], ma * p[1], moment_a)
            if b < scene[0].bodies:
                mb = bodies[0].inverse_mass[w, b]
                moment_b = bodies[0].inverse_inertia[w, b] * (arm_b[0] * p[1] - arm_b[1] * p[0])
                bodies[0].shift[w, b] = bodies[0].shift[w, b] + wp.vec3d(mb * p[0], mb * p[1], moment_b)
