"""The time loop of the planar solver: one thread advances one world from its first sample to its last."""

import warp as wp

from polyworld.effects import Motion
from polyworld.solver.core.effect_forces import effect_forces, half_step
from polyworld.solver.core.episodes import Episode, Log, record_touch
from polyworld.solver.planar.contact import (
    find_near,
    find_rows,
    part_overlaps,
    resolve_impacts,
    separation_speed,
    solve_contact_velocities,
)
from polyworld.solver.planar.contact_effects import set_plane_friction, set_row_friction
from polyworld.solver.planar.impact_time import longest_path, next_impact
from polyworld.solver.planar.joints import begin_hinges, project_hinge_rates, project_hinges
from polyworld.solver.planar.motion import find_shift, free_rate, pose_at, set_step, unheld_rate
from polyworld.solver.planar.records import Bodies, Contacts, Joints, References, Row, Samples, Scene

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
TWO = wp.float64(2.0)
SPLITS = 64
ABSURD = wp.float64(1.0e6)  # [m/s]; initial speeds are bounded by 1e5
SLOWEST = wp.float64(1.0e-4)  # a body that parts faster than this and its push gives in a step is in the air [m/s]
PARTING = wp.float64(0.02)  # time in which an overlap shrinks to 1/e [s]


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

    What contacts, hinges and the supporting plane will do until then is what they did in the last step.
    """
    g = bodies.gravity[w]
    push = wp.vec3d(g[0], g[1], ZERO)
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
def note_touch(bodies: Bodies, w: wp.int32, i: wp.int32) -> None:
    if bodies.touching[w, i] % 2 == 0:
        bodies.touching[w, i] = bodies.touching[w, i] + 1


@wp.func
def renew_pushes(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    w: wp.int32,
    half: wp.int32,
    rows: wp.int32,
    time: wp.float64,
    step: wp.float64,
    h: wp.float64,
) -> None:
    """Compute pushes again where an impact has changed the rate, or a contact has started or ended.

    In `touching`, the lowest bit is this step's, the next the last step's.
    """
    n = scene.bodies
    for i in range(n):
        bodies.touching[w, i] = (bodies.touching[w, i] % 2) * 2
    for k in range(rows):
        row = contacts.rows[w, half, k]
        if row.touching == 1:
            slowest = wp.length(bodies.push[w, row.a])
            if row.b < n:
                slowest = wp.max(slowest, wp.length(bodies.push[w, row.b]))
            if separation_speed(scene, bodies, w, row)[0] <= slowest * step + SLOWEST:
                note_touch(bodies, w, row.a)
                if row.b < n:
                    note_touch(bodies, w, row.b)
    for i in range(n):
        changed = bodies.touching[w, i] == 1 or bodies.touching[w, i] == 2
        if bodies.coupled[w, i] == 1 and wp.length_sq(bodies.next_rate[w, i] - bodies.rate[w, i]) > ZERO:
            bodies.rate[w, i] = bodies.next_rate[w, i]
            changed = True
        if changed:
            bodies.push[w, i] = find_push(scene, bodies, w, i, time, h)


@wp.func
def touch_of(bodies: Bodies, w: wp.int32, row: Row, time: wp.float64, impulse: wp.float64) -> Episode:
    """Return the touch of a row at `time` by its impact and, over the step, by `impulse` [N s]; plane coordinates."""
    touch = Episode()
    touch.a = row.a
    touch.b = row.b
    touch.begin = time
    touch.last = time
    touch.first_impulse = impulse + row.impact_impulse
    touch.impulse = touch.first_impulse
    touch.speed = row.approach
    pose = bodies.pose[w, row.a]
    touch.position = wp.vec3d(pose[0] + row.arm_a[0], pose[1] + row.arm_a[1], ZERO)
    return touch


@wp.kernel(enable_backward=False)
def rollout(
    scene: Scene,
    bodies: Bodies,
    contacts: Contacts,
    joints: Joints,
    log: Log,
    samples: Samples,
    references: References,
    offset: wp.int32,
) -> None:
    w = offset + wp.tid()
    own = scene.schedule.own[w]
    n = scene.bodies
    near_count = wp.int32(0)
    row_count = wp.int32(0)
    half = wp.int32(0)
    room = -ONE  # motion for which the near list still holds
    old_h = ONE
    scale = bodies.time_scale[w]
    start = ZERO
    dead = wp.int32(0)
    time = ZERO
    for segment in range(scene.schedule.reach[w]):
        end = scene.schedule.end[own, segment] * scale
        steps = scene.schedule.steps[own, segment]
        joined = wp.int32(0)
        for i in range(n):
            if scene.schedule.joins[i] == segment:
                room = -ONE
                joined = wp.int32(1)
        if joints.count > 0 and joined == 1:
            begin_hinges(scene, joints, w, segment)
        step = ZERO
        if steps > 0:
            step = (end - start) / wp.float64(steps)
        for number in range(steps):
            if dead == 1:
                break
            left = step
            splits = wp.int32(0)
            while left > wp.float64(1.0e-12) * step and dead == 0:
                h = left
                time = start + wp.float64(number + 1) * step - left
                # What pushes each body, and how fast the fastest is.
                fastest = ZERO
                if scene.contact_laws > 0:
                    set_plane_friction(references.scene, references.bodies, w, segment, h)
                for i in range(n):
                    if scene.schedule.joins[i] <= segment:
                        v = bodies.rate[w, i]
                        push = find_push(scene, bodies, w, i, time, h)
                        bodies.push[w, i] = push
                        bodies.next_rate[w, i] = v
                        bodies.coupled[w, i] = joints.hinged[i]
                        speed = wp.sqrt(v[0] * v[0] + v[1] * v[1])
                        if not (speed < ABSURD and wp.abs(v[2]) < ABSURD * wp.float64(100.0)):
                            dead = wp.int32(1)
                            samples.outcome.diverged_object[w] = i
                            samples.outcome.diverged_time[w] = time
                        fastest = wp.max(fastest, speed + wp.length(push) * h)
                if dead == 1:
                    break
                if room < TWO * fastest * h:
                    room = scene.skin + wp.float64(8.0) * fastest * h
                    near_count = find_near(scene, bodies, contacts, w, segment, room)
                half = 1 - half
                rows = find_rows(scene, bodies, contacts, samples, w, half, near_count, row_count, h / old_h)
                row_count = rows
                ratio = h / old_h
                old_h = h
                if scene.contact_laws > 0:
                    set_row_friction(references.scene, references.bodies, references.contacts, w, half, rows)
                if rows > 0:
                    resolve_impacts(scene, bodies, contacts, joints, references, w, half, rows, step)
                    for k in range(rows):
                        row = contacts.rows[w, half, k]
                        bodies.coupled[w, row.a] = 1
                        if row.b < n:
                            bodies.coupled[w, row.b] = 1
                if scene.forces > 0:
                    renew_pushes(scene, bodies, contacts, w, half, rows, time, step, h)
                set_step(scene, bodies, w, h)
                for i in range(n):
                    if scene.schedule.joins[i] <= segment:
                        if bodies.coupled[w, i] == 1:
                            bodies.rate[w, i] = bodies.next_rate[w, i]  # impacts may have changed it
                            bodies.next_rate[w, i] = unheld_rate(bodies, w, i, h)
                            bodies.drag[w, i] = wp.vec3d()
                        else:
                            bodies.next_rate[w, i] = free_rate(bodies, w, i, h)
                if rows > 0 or joints.count > 0:
                    solve_contact_velocities(scene, bodies, contacts, joints, w, half, rows, ratio, h)
                for i in range(n):
                    if scene.schedule.joins[i] <= segment:
                        find_shift(bodies, w, i, h)
                if rows > 0:
                    part_overlaps(scene, bodies, contacts, w, half, rows, ONE - wp.exp(-h / PARTING))
                reach = ZERO
                for i in range(n):
                    if scene.schedule.joins[i] <= segment:
                        reach = wp.max(reach, TWO * longest_path(scene, bodies, w, i, h))
                part = h
                if splits < SPLITS:
                    part = next_impact(scene, bodies, contacts, w, half, rows, near_count, reach, h)
                for k in range(near_count):  # the gaps stay lower bounds
                    contacts.near_gap[w, k] = contacts.near_gap[w, k] - reach * (part / h)
                if log.record == 1:
                    for k in range(rows):
                        row = contacts.rows[w, half, k]
                        if row.touching == 1:
                            record_touch(log, w, touch_of(bodies, w, row, time, row.impulse * part / h))
                if scene.forces > 0 and TWO * h >= step:
                    for i in range(n):
                        if scene.schedule.joins[i] <= segment:
                            bodies.reaction[w, i] = (bodies.next_rate[w, i] - unheld_rate(bodies, w, i, h)) / h
                share = part / h
                moved = ZERO
                for i in range(n):
                    if scene.schedule.joins[i] <= segment:
                        was = bodies.pose[w, i]
                        if part == h:
                            bodies.pose[w, i] = was + bodies.shift[w, i]
                            bodies.rate[w, i] = bodies.next_rate[w, i]
                        else:
                            bodies.pose[w, i] = pose_at(scene, bodies, w, i, part, h)
                            bodies.rate[w, i] = wp.lerp(bodies.rate[w, i], bodies.next_rate[w, i], share)
                        now = bodies.pose[w, i]
                        moved = wp.max(moved, wp.length(wp.vec2d(now[0] - was[0], now[1] - was[1])))
                if joints.count > 0:
                    shifted = project_hinges(scene, bodies, joints, w)
                    moved += shifted
                    for k in range(near_count):
                        contacts.near_gap[w, k] = contacts.near_gap[w, k] - TWO * shifted
                    project_hinge_rates(scene, bodies, joints, w)
                room -= TWO * moved
                left -= part
                splits += 1
        start = end
        time = end
        sample = scene.schedule.sample[own, segment]
        if sample >= 0 and dead == 0:
            for i in range(n):
                samples.pose[w, sample, i] = bodies.pose[w, i]
                samples.rate[w, sample, i] = bodies.rate[w, i]
    if log.record == 1 and dead == 0 and n > 0:
        half = 1 - half
        for i in range(n):
            bodies.next_rate[w, i] = bodies.rate[w, i]
        rows = find_rows(scene, bodies, contacts, samples, w, half, near_count, 0, ZERO)
        for k in range(rows):
            row = contacts.rows[w, half, k]
            if row.touching == 1:
                record_touch(log, w, touch_of(bodies, w, row, time, ZERO))
