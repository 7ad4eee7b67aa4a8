"""Motion between contacts: gravity, damping and sliding on the supporting plane.

Friction of a pressed patch: force and moment together lie on an elliptic limit surface and oppose
(v, r omega) (Goyal, Ruina & Papadopoulos 1991, Wear 143, 307; Howe & Cutkosky 1996, IJRR 15, 557).
"""

import warp as wp

from polyworld.solver.planar.records import Bodies, Contacts, Scene, Step

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
HALF = wp.float64(0.5)
ONE = wp.float64(1.0)
TWO = wp.float64(2.0)
FAR = wp.float64(1.0e30)
FAST, SLOW = wp.float64(4.0), wp.float64(1.0)  # times what friction takes in a step, from where schemes change


@wp.func
def slide(rate: wp.vec3d, limit: wp.float64, patch: wp.float64, stiffness: wp.float64) -> wp.vec3d:
    """Rate after friction of at most `limit` = mu |g_n| h acted, solved implicitly: it stops and never reverses.

    stiffness: m r^2 / I. With sigma = sqrt(v^2 + (r omega)^2) after the step,
    v = v0 sigma / (sigma + limit) and omega = omega0 sigma / (sigma + stiffness limit).
    """
    speed = wp.sqrt(rate[0] * rate[0] + rate[1] * rate[1])
    if patch <= ZERO or rate[2] == ZERO:
        if speed <= limit:
            return wp.vec3d(ZERO, ZERO, wp.where(patch > ZERO, ZERO, rate[2]))
        left = (speed - limit) / speed
        return wp.vec3d(rate[0] * left, rate[1] * left, rate[2])
    spin = wp.abs(patch * rate[2])
    spin_limit = stiffness * limit
    if limit <= ZERO:
        return rate
    x = speed / limit
    y = spin / spin_limit
    if x * x + y * y <= ONE:
        return wp.vec3d(ZERO, ZERO, ZERO)
    # Newton from the left of the root of a convex, falling function: monotone.
    sigma = wp.max(wp.max(speed - limit, spin - spin_limit), ZERO)
    for _ in range(40):
        p = ONE / (sigma + limit)
        q = ONE / (sigma + spin_limit)
        u = speed * p
        z = spin * q
        rise = (u * u + z * z - ONE) / (wp.float64(2.0) * (u * u * p + z * z * q))
        sigma += rise
        if rise <= wp.float64(1.0e-15) * sigma:
            break
    along = sigma / (sigma + limit)
    return wp.vec3d(rate[0] * along, rate[1] * along, rate[2] * sigma / (sigma + spin_limit))


@wp.func
def decay(damping: wp.float64, h: wp.float64) -> wp.vec3d:
    """exp(-ch), phi1 = (1 - exp(-ch))/ch and (1 - phi1)/(ch phi1): exact for dv/dt = a - c v with constant a."""
    z = damping * h
    if z < wp.float64(1.0e-4):  # series: the closed form loses digits
        phi1 = ONE - z * HALF + z * z / wp.float64(6.0)
        phi2 = HALF - z / wp.float64(6.0) + z * z / wp.float64(24.0)
        return wp.vec3d(ONE - z * phi1, phi1, phi2 / phi1)
    fall = wp.exp(-z)
    phi1 = (ONE - fall) / z
    return wp.vec3d(fall, phi1, (ONE - phi1) / (z * phi1))


@wp.func
def set_step(bodies: Bodies, w: wp.int32, i: wp.int32, h: wp.float64) -> None:
    """Damping factors of body i over a step of length h; kept while h stays the same to rounding."""
    if wp.abs(h - bodies.decay_step[w, i]) > wp.float64(1.0e-12) * h:
        bodies.decay_step[w, i] = h
        bodies.linear_decay[w, i] = decay(bodies.linear_damping[w, i], h)
        bodies.angular_decay[w, i] = decay(bodies.angular_damping[w, i], h)


@wp.func
def unheld_rate(bodies: Bodies, w: wp.int32, i: wp.int32, h: wp.float64) -> wp.vec3d:
    """Rate after h under gravity, effects and damping, without friction or contact."""
    v = bodies.rate[w, i]
    a = bodies.push[w, i]
    linear = bodies.linear_decay[w, i]
    angular = bodies.angular_decay[w, i]
    reach = h * linear[1]
    return wp.vec3d(
        v[0] * linear[0] + a[0] * reach, v[1] * linear[0] + a[1] * reach, v[2] * angular[0] + a[2] * h * angular[1]
    )


@wp.func
def asleep(bodies: Bodies, w: wp.int32, i: wp.int32) -> bool:
    """Check whether a body is at rest and what pushes it is less than the supporting plane holds."""
    v = bodies.rate[w, i]
    if v[0] != ZERO or v[1] != ZERO or v[2] != ZERO:
        return False
    a = bodies.push[w, i]
    return a[2] == ZERO and a[0] * a[0] + a[1] * a[1] <= bodies.hold[w, i] * bodies.hold[w, i]


@wp.func
def pressed_speed(v: wp.vec3d, r: wp.float64) -> wp.float64:
    """Return the speed that friction of a patch of radius r opposes: sqrt(v^2 + (r omega)^2)."""
    return wp.sqrt(v[0] * v[0] + v[1] * v[1] + r * r * v[2] * v[2])


@wp.func
def ramp(speed: wp.float64, limit: wp.float64, begin: wp.float64) -> wp.float64:
    """0 up to `begin` times the limit, 1 from one and a half times that: schemes change without a jump,
    which a collision would make much of."""
    return wp.clamp(TWO * (speed / (begin * limit) - ONE), ZERO, ONE)


@wp.func
def with_sliding_friction(
    unheld: wp.vec3d, middle: wp.vec3d, limit: wp.float64, r: wp.float64, k: wp.float64
) -> wp.vec3d:
    """Return a rate less the sliding friction that opposes the rate at the middle of the step."""
    slowdown = limit / pressed_speed(middle, r)
    return wp.vec3d(
        unheld[0] - slowdown * middle[0], unheld[1] - slowdown * middle[1], unheld[2] - slowdown * k * middle[2]
    )


@wp.func
def free_rate(bodies: Bodies, w: wp.int32, i: wp.int32, h: wp.float64) -> wp.vec3d:
    """Rate after h without contact: the direction of sliding friction is taken at the middle of the step."""
    hold = bodies.hold[w, i]
    if hold > ZERO and asleep(bodies, w, i):
        return wp.vec3d(ZERO, ZERO, ZERO)
    unheld = unheld_rate(bodies, w, i, h)
    if hold <= ZERO:
        return unheld
    patch = bodies.patch[w, i]
    r = patch[0]
    k = patch[1]
    limit = hold * h * bodies.linear_decay[w, i][1]
    v = bodies.rate[w, i]
    half_push = bodies.push[w, i] * (HALF * h)
    sigma = pressed_speed(v, r)
    middle = v
    near = ONE - ramp(sigma, limit, FAST)
    if near < ONE:  # far from stopping: an explicit half step finds the direction
        slowdown = HALF * limit / sigma
        middle = v + half_push - wp.vec3d(slowdown * v[0], slowdown * v[1], slowdown * k * v[2])
    if near == ZERO:
        return with_sliding_friction(unheld, middle, limit, r, k)
    after = slide(unheld, limit, r, k)
    if after[0] == ZERO and after[1] == ZERO:
        return after
    if half_push[0] == ZERO and half_push[1] == ZERO and (r == ZERO or v[2] == ZERO):
        return after  # the direction does not change: already exact
    middle = middle * (ONE - near) + slide(v + half_push, HALF * limit, r, k) * near
    stopping = ONE - ramp(pressed_speed(middle, r), limit, SLOW)
    if stopping == ONE:
        return after
    return after * stopping + with_sliding_friction(unheld, middle, limit, r, k) * (ONE - stopping)


@wp.func
def shift_of(v: wp.vec3d, u: wp.vec3d, linear: wp.vec3d, angular: wp.vec3d, h: wp.float64) -> wp.vec3d:
    """Change of pose over h from the rate v to u: exact for constant acceleration with damping.

    linear, angular: see `decay`.
    """
    x = linear[1] * h * v[0] + linear[2] * h * (u[0] - linear[0] * v[0])
    y = linear[1] * h * v[1] + linear[2] * h * (u[1] - linear[0] * v[1])
    z = angular[1] * h * v[2] + angular[2] * h * (u[2] - angular[0] * v[2])
    return wp.vec3d(x, y, z)


@wp.func
def stopped_at(bodies: Bodies, w: wp.int32, i: wp.int32, h: wp.float64) -> wp.float64:
    """Part of a step of length h in which friction stops a body: the root of |v + a s h| = s limit, where speeds and
    spins count by their limits, as in `slide`."""
    v = bodies.rate[w, i]
    a = bodies.push[w, i] * (h * bodies.linear_decay[w, i][1])
    limit = bodies.hold[w, i] * h * bodies.linear_decay[w, i][1]
    rotational = ZERO
    patch = bodies.patch[w, i]
    if patch[0] > ZERO:
        rotational = patch[0] / (patch[1] * limit)
    along = ONE / limit
    square = (a[0] * a[0] + a[1] * a[1]) * along * along + a[2] * a[2] * rotational * rotational - ONE
    linear = (v[0] * a[0] + v[1] * a[1]) * along * along + v[2] * a[2] * rotational * rotational
    begin = (v[0] * v[0] + v[1] * v[1]) * along * along + v[2] * v[2] * rotational * rotational
    if begin <= ZERO:
        return ZERO
    root = wp.sqrt(wp.max(linear * linear - square * begin, ZERO))
    if linear < ZERO:  # this form of the root neither cancels nor minds a push as great as the friction
        return wp.min(ONE, begin / (root - linear))
    if square >= ZERO:
        return ONE
    return wp.min(ONE, (linear + root) / -square)


@wp.func
def find_shift(
    bodies: Bodies, w: wp.int32, i: wp.int32, v: wp.vec3d, u: wp.vec3d, h: wp.float64, coupled: wp.int32
) -> wp.vec3d:
    """Return the change of pose over h from the rate v to u; a stop within h by friction alone is respected."""
    if v[0] == ZERO and v[1] == ZERO and v[2] == ZERO and u[0] == ZERO and u[1] == ZERO and u[2] == ZERO:
        return wp.vec3d()
    shift = shift_of(v, u, bodies.linear_decay[w, i], bodies.angular_decay[w, i], h)
    x = shift[0]
    y = shift[1]
    z = shift[2]
    if u[0] == ZERO and u[1] == ZERO and coupled == 0 and bodies.hold[w, i] > ZERO:
        # Friction stopped it before the step ended: distance v^2 / 2 mu g, not v h / 2.
        time = HALF * h * stopped_at(bodies, w, i, h)
        x = time * v[0]
        y = time * v[1]
        z = time * v[2] if u[2] == ZERO else z
    return wp.vec3d(x, y, z)


@wp.func
def pose_at(scene: Scene, bodies: Bodies, w: wp.int32, i: wp.int32, time: wp.float64, whole: wp.float64) -> wp.vec3d:
    """Pose `time` into a step of length `whole`: quadratic in time through the pose, the rate and the shift."""
    if i >= scene.bodies:
        return bodies.static_pose[w, i - scene.bodies]
    gone = time - bodies.since[w, i]
    h = whole - bodies.since[w, i]
    part = gone / h
    straight = bodies.rate[w, i] * gone
    return bodies.pose[w, i] + straight + (bodies.shift[w, i] - bodies.rate[w, i] * h) * (part * part)


@wp.func
def rate_at(scene: Scene, bodies: Bodies, w: wp.int32, i: wp.int32, time: wp.float64, whole: wp.float64) -> wp.vec3d:
    """Rate `time` into a step of length `whole` along the path that `pose_at` follows."""
    if i >= scene.bodies:
        return wp.vec3d()
    h = whole - bodies.since[w, i]
    part = (time - bodies.since[w, i]) / h
    return bodies.rate[w, i] + (bodies.shift[w, i] / h - bodies.rate[w, i]) * (TWO * part)


@wp.func
def couple_bodies(scene: Scene, bodies: Bodies, contacts: Contacts, step: Step) -> None:
    """Mark the members that contact rows act on; their rates are what these begin from."""
    for m in range(step.members):
        i = bodies.members[step.w, m]
        bodies.coupled[step.w, i] = 0
        bodies.next_rate[step.w, i] = bodies.rate[step.w, i]
    for k in range(step.active):
        r = contacts.active[step.slot, k]
        bodies.coupled[step.w, contacts.rows[step.slot, step.half, r].a] = 1
        b = contacts.rows[step.slot, step.half, r].b
        if b < scene.bodies:
            bodies.coupled[step.w, b] = 1


@wp.func
def predict_rates(bodies: Bodies, step: Step) -> None:
    """Rates at the end of a step without contacts; without friction, too, of the bodies these act on."""
    w = step.w
    for m in range(step.members):
        i = bodies.members[w, m]
        if step.alike == 0 or step.begin > ZERO:
            set_step(bodies, w, i, step.h)
        if bodies.coupled[w, i] == 1:
            bodies.rate[w, i] = bodies.next_rate[w, i]  # impacts may have changed it
            bodies.next_rate[w, i] = unheld_rate(bodies, w, i, step.h)
            bodies.drag[w, i] = wp.vec3d()
        else:
            bodies.next_rate[w, i] = free_rate(bodies, w, i, step.h)


@wp.func
def find_shifts(bodies: Bodies, step: Step) -> None:
    """Find the change of pose of each body over a step."""
    for m in range(step.members):
        i = bodies.members[step.w, m]
        v = bodies.rate[step.w, i]
        bodies.shift[step.w, i] = find_shift(
            bodies, step.w, i, v, bodies.next_rate[step.w, i], step.h, bodies.coupled[step.w, i]
        )


@wp.func
def measure_path(scene: Scene, i: wp.int32, first: wp.vec3d, shift: wp.vec3d, h: wp.float64) -> wp.vec2d:
    """Return bounds of how far any point of body i, and its centre, move over h from this rate by this shift [m]."""
    if wp.length_sq(first) + wp.length_sq(shift) == ZERO:
        return wp.vec2d()
    last = shift * (TWO / h) - first
    spin = wp.max(wp.abs(first[2]), wp.abs(last[2])) * (scene.bound[i] - scene.sweep[i])
    square = first[0] * first[0] + first[1] * first[1]
    speed = wp.sqrt(wp.max(square, last[0] * last[0] + last[1] * last[1]))
    return wp.vec2d((speed + spin) * h, speed * h)


@wp.func
def note_path(bodies: Bodies, w: wp.int32, i: wp.int32, ahead: wp.vec2d, path: wp.vec3d) -> wp.vec3d:
    """Keep bounds of a path, and return those over all members: see `measure_paths`."""
    bodies.ahead[w, i] = ahead
    left = bodies.room[w, i][1] - ahead[1]
    return wp.vec3d(wp.max(path[0], ahead[0]), wp.min(path[1], left), wp.min(path[2], left - ahead[1]))


@wp.func
def measure_paths(scene: Scene, bodies: Bodies, step: Step) -> wp.vec3d:
    """Return the longest path of a point; the least margin left when the step ends, and after one more like it [m]."""
    w = step.w
    found = wp.vec3d(ZERO, FAR, FAR)
    for m in range(step.members):
        i = bodies.members[w, m]
        ahead = measure_path(scene, i, bodies.rate[w, i], bodies.shift[w, i], step.h)
        found = note_path(bodies, w, i, ahead, found)
    return found


@wp.func
def set_free_paths(scene: Scene, bodies: Bodies, step: Step) -> wp.vec3d:
    """Set rates at the end of a step and changes of pose where no contact acts; see `measure_paths`."""
    w = step.w
    found = wp.vec3d(ZERO, FAR, FAR)
    for m in range(step.members):
        i = bodies.members[w, m]
        if step.alike == 0 or step.begin > ZERO:
            set_step(bodies, w, i, step.h)
        bodies.next_rate[w, i] = free_rate(bodies, w, i, step.h)
    for m in range(step.members):  # a loop of its own: a processor overlaps the latencies of a few short ones
        i = bodies.members[w, m]
        v = bodies.rate[w, i]
        shift = find_shift(bodies, w, i, v, bodies.next_rate[w, i], step.h, 0)
        bodies.shift[w, i] = shift
        found = note_path(bodies, w, i, measure_path(scene, i, v, shift, step.h), found)
    return found


@wp.func
def move_bodies(scene: Scene, bodies: Bodies, step: Step, time: wp.float64) -> None:
    """Move the members along their paths to `time` in the step [s]; at its end, the next step begins."""
    w = step.w
    for m in range(step.members):
        i = bodies.members[w, m]
        if time == step.whole:
            bodies.pose[w, i] = bodies.pose[w, i] + bodies.shift[w, i]
            bodies.rate[w, i] = bodies.next_rate[w, i]
            ahead = bodies.ahead[w, i]
            bodies.room[w, i] = bodies.room[w, i] + wp.vec2d(ahead[0], -ahead[1])
        else:
            share = (time - bodies.since[w, i]) / (step.whole - bodies.since[w, i])
            bodies.pose[w, i] = pose_at(scene, bodies, w, i, time, step.whole)
            bodies.rate[w, i] = wp.lerp(bodies.rate[w, i], bodies.next_rate[w, i], share)
            part = bodies.ahead[w, i] * share
            bodies.room[w, i] = bodies.room[w, i] + wp.vec2d(part[0], -part[1])
            if time > step.begin:
                bodies.cuts[w, i] = bodies.cuts[w, i] + 1
            bodies.since[w, i] = time
    if time == step.whole and step.effort > 0:  # impacts have cut paths
        for m in range(step.members):
            i = bodies.members[w, m]
            bodies.since[w, i] = ZERO
            bodies.cuts[w, i] = 0
