"""Forces on bodies between contacts: gravity, and effects as they are at the middle of the step."""

import warp as wp

from polyworld.effects import Motion
from polyworld.solver.core.effect_forces import effect_forces, half_step
from polyworld.solver.planar.contact_effects import set_plane_friction
from polyworld.solver.planar.motion import unheld_rate
from polyworld.solver.planar.records import Bodies, Contacts, References, Samples, Scene, Step
from polyworld.solver.planar.rows import row_velocity

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
TWO = wp.float64(2.0)
FAR = wp.float64(1.0e30)
ABSURD = wp.float64(1.0e6)  # [m/s]; initial speeds are bounded by 1e5
SLOWEST = wp.float64(1.0e-4)  # a body that parts faster than this and its push gives in a step is in the air [m/s]


@wp.func
def effects_at(
    scene: Scene, bodies: Bodies, w: wp.int32, i: wp.int32, pose: wp.vec3d, rate: wp.vec3d, t: wp.float64
) -> wp.vec3d:
    """Acceleration of body i by the effects that act on it, in the plane."""
    to_world = wp.transpose(scene.axes)
    gravity = bodies.gravity[w]
    motion = Motion()
    motion.mass = bodies.mass[w, i]
    motion.radius = scene.effect_radius[i]
    motion.x = to_world * wp.vec3d(pose[0], pose[1], bodies.height[w, i])
    motion.v = to_world * wp.vec3d(rate[0], rate[1], ZERO)
    motion.omega = to_world * wp.vec3d(ZERO, ZERO, rate[2])
    motion.t = bodies.time_origin[w] + t
    motion.gravity = to_world * gravity
    if bodies.touching[w, i] % 2 == 1 or (scene.supports == 1 and gravity[2] < ZERO):
        motion.contact = ONE
    wrench = effect_forces(scene.effects, w, i, motion)
    f = scene.axes * wp.spatial_top(wrench) * bodies.inverse_mass[w, i]
    m = scene.axes * wp.spatial_bottom(wrench) * bodies.inverse_inertia[w, i]
    return wp.vec3d(f[0], f[1], m[2])


@wp.func
def find_push(scene: Scene, bodies: Bodies, w: wp.int32, i: wp.int32, time: wp.float64, h: wp.float64) -> wp.vec3d:
    """Acceleration by gravity and effects; effects as they are at the middle of the step: second order.

    What contacts and the supporting plane will do until then is what they did in the last step.
    """
    g = bodies.gravity[w]
    push = wp.vec3d(g[0], g[1], ZERO) + bodies.control[w, i]
    if scene.forces > 0:
        pose = bodies.pose[w, i]
        rate = bodies.rate[w, i]
        half = HALF * h
        slowing = bodies.linear_damping[w, i]
        damped = wp.vec3d(slowing * rate[0], slowing * rate[1], bodies.angular_damping[w, i] * rate[2])
        first = push + effects_at(scene, bodies, w, i, pose, rate, time) - damped + bodies.reaction[w, i]
        pose_then, rate_then = half_step(pose, rate, first, half)
        push = push + effects_at(scene, bodies, w, i, pose_then, rate_then, time + half)
    return push


@wp.func
def find_pushes(scene: Scene, bodies: Bodies, references: References, samples: Samples, step: Step) -> wp.float64:
    """Find what pushes each member; return the greatest acceleration, FAR where one is too fast."""
    w = step.w
    if scene.contact_laws > 0:
        set_plane_friction(references.scene, references.bodies, w, step.members, step.h)
    heaviest = ZERO
    absurd = wp.int32(0)
    for m in range(step.members):
        i = bodies.members[w, m]
        v = bodies.rate[w, i]
        push = find_push(scene, bodies, w, i, step.time, step.h)
        bodies.push[w, i] = push
        if not (v[0] * v[0] + v[1] * v[1] < ABSURD * ABSURD and wp.abs(v[2]) < ABSURD * wp.float64(100.0)):
            if absurd == 0:
                samples.outcome.diverged_object[w] = i
            absurd = wp.int32(1)
            if samples.outcome.overflowed[w] == 0:
                samples.outcome.diverged_time[w] = step.time
        heaviest = wp.max(heaviest, push[0] * push[0] + push[1] * push[1])
    return wp.where(absurd == 1, FAR, wp.sqrt(heaviest))


@wp.func
def note_touch(bodies: Bodies, w: wp.int32, i: wp.int32) -> None:
    """Mark a body as touching another in this step."""
    if bodies.touching[w, i] % 2 == 0:
        bodies.touching[w, i] = bodies.touching[w, i] + 1


@wp.func
def renew_pushes(scene: Scene, bodies: Bodies, contacts: Contacts, references: References, step: Step) -> None:
    """Compute pushes again where an impact has changed the rate, or a contact has started or ended.

    In `touching`, the lowest bit is this step's, the next the last step's.
    """
    w = step.w
    n = scene.bodies
    for m in range(step.members):
        i = bodies.members[w, m]
        bodies.touching[w, i] = (bodies.touching[w, i] % 2) * 2
    for k in range(step.active):
        r = contacts.active[step.slot, k]
        if contacts.rows[step.slot, step.half, r].touching == 1:
            a = contacts.rows[step.slot, step.half, r].a
            b = contacts.rows[step.slot, step.half, r].b
            slowest = wp.length(bodies.push[w, a])
            if b < n:
                slowest = wp.max(slowest, wp.length(bodies.push[w, b]))
            parting = row_velocity(references.scene, references.contacts, bodies.next_rate, w, step.slot, step.half, r)[
                0
            ]
            if parting <= slowest * step.whole + SLOWEST:
                note_touch(bodies, w, a)
                if b < n:
                    note_touch(bodies, w, b)
    for m in range(step.members):
        i = bodies.members[w, m]
        changed = bodies.touching[w, i] == 1 or bodies.touching[w, i] == 2
        if (
            step.islands > 0
            and bodies.coupled[w, i] == 1
            and wp.length_sq(bodies.next_rate[w, i] - bodies.rate[w, i]) > ZERO
        ):
            bodies.rate[w, i] = bodies.next_rate[w, i]
            changed = True
        if changed:
            bodies.push[w, i] = find_push(scene, bodies, w, i, step.time, step.h)


@wp.func
def note_reactions(bodies: Bodies, step: Step) -> None:
    """Keep what contacts and the supporting plane did to the bodies in a step for the next."""
    w = step.w
    if TWO * step.h >= step.whole:
        for m in range(step.members):
            i = bodies.members[w, m]
            change = bodies.next_rate[w, i] - unheld_rate(bodies, w, i, step.h)
            bodies.reaction[w, i] = change / step.h
