"""A step of bodies that hang on joints as a tree, and touch nothing, in the joints' own freedoms.

Runge-Kutta of eighth order with errors of fifth and third (Hairer, Norsett & Wanner, Solving Ordinary Differential
Equations I, 2nd ed., sec. II.10): the joints hold to rounding, whatever the step. A step whose error is too large is
cut, and so is one in which an axis that slips comes to rest, or a motor is switched. Where an axis sticks, is stopped
or driven towards a speed, the bodies are left to `joint_step`.
"""

import warp as wp

from polyworld.model.arrays import NEVER
from polyworld.solver.spatial.joint_layout import BALL, SLIDER, Joints
from polyworld.solver.spatial.layout import Parameters, State
from polyworld.solver.spatial.tree_dynamics import (
    accelerate,
    begin_links,
    load_links,
    update_links,
)
from polyworld.solver.spatial.tree_layout import FREE, angular, linear

STAGES = 13
NODES = 13  # rows of the method
FIFTH = 14
THIRD = 15
EXACT = wp.float64(1.0e-5)  # most that a step's error may be, as a share of the largest speed
PRECISION = wp.float64(2.5e-3)  # the same per length of two of the user's steps, so that shorter ones err less [1/s]
ORDER = wp.float64(1.0 / 8.0)
REST = wp.float64(1.0e-9)  # speeds below this [m/s or rad/s] have no error to speak of
CAUTION = wp.float64(0.9)  # share of the step whose error would just be small enough
LONGER = wp.float64(5.0)  # times the last step, that the next may be
RESTING = wp.float64(1.0e-9)  # speed of an axis at rest [m/s or rad/s]
SMALLEST = wp.float64(1.0 / 64.0)  # part of two of the user's steps, in which motion is not smooth
NOTHING = wp.float64(1.0e-9)  # part of a step in which nothing moves
SLIPPING = wp.float64(0.5)  # cosine of the rotation of a ball's slip in a step


@wp.func(inline=False)
def move_tree(
    parameters: wp.array[Parameters],
    joints: wp.array[Joints],
    state: wp.array[State],
    w: int,
    k: int,
    gravity: wp.vec3d,
    time: wp.float64,
    longest: wp.float64,
    whole: wp.float64,
) -> wp.float64:
    """Move the bodies on by one step of at most `longest`. Returns its length [s], 0 where the joints stop that.

    whole: length of two of the user's steps, by which it is exact.
    """
    zero = wp.float64(0.0)
    for j in range(joints[0].count):
        if joints[0].kinds[j].driven == 2:
            return zero
    begin_links(joints, state, k)
    wanted = joints[0].tree.wanted[k]
    part = longest
    tolerance = wp.min(PRECISION * whole, EXACT)
    while part >= SMALLEST * whole:
        part = until_switched(joints, k, time, part)
        if not find_slip_directions(parameters, joints, state, w, k, gravity, time):
            return zero
        allowed = tolerance * wp.min(part / whole, wp.float64(1.0))  # errors add up over the parts of a step
        error = try_step(parameters, joints, state, w, k, gravity, time, part) / allowed
        if not (error <= wp.float64(1.0)):  # also where it is no number
            share = wp.float64(0.1)
            if error > wp.float64(1.0):
                share = wp.clamp(CAUTION * wp.pow(error, -ORDER), share, wp.float64(0.8))
            part = part * share
            wanted = part
            continue
        until = slipping(joints, k)
        if until < wp.float64(1.0):
            part = part * until
            if part < NOTHING * longest:
                return zero
            continue
        if not within_reach(joints, state, k, part):
            part = wp.float64(0.5) * part
            continue
        if not kept_on(joints, k):
            return zero
        take_step(parameters, joints, state, k)
        following = LONGER * part
        if error > wp.float64(1.0e-8):
            following = wp.min(following, part * CAUTION * wp.pow(error, -ORDER))
        if part < wanted:  # cut for another reason than its error
            following = wp.max(following, wanted)
        joints[0].tree.wanted[k] = following
        return part
    joints[0].tree.wanted[k] = zero
    return zero


@wp.func(inline=False)
def find_slip_directions(
    parameters: wp.array[Parameters],
    joints: wp.array[Joints],
    state: wp.array[State],
    w: int,
    k: int,
    gravity: wp.vec3d,
    time: wp.float64,
) -> bool:
    """Set the slip direction of axes with dry friction; at rest, by the push. Returns whether all do slip."""
    zero = wp.float64(0.0)
    resting = wp.int32(0)
    for n in range(joints[0].tree.count):
        d = joints[0].tree.kinds[n]
        if d.freedoms == 1:
            direction = zero
            if joints[0].joint[k, d.joint].friction > zero:
                start_speed = joints[0].tree.coordinates[k, d.first].start_speed
                if wp.abs(start_speed) > RESTING:
                    direction = wp.sign(start_speed)
                else:
                    resting = 1
            joints[0].tree.coordinates[k, d.first].direction = direction
    if resting == 0:
        return True
    for _pass in range(2):  # without friction of what rests, and with it
        update_links(joints, k, 0)
        load_links(parameters, joints, state, w, k, gravity, time)
        accelerate(joints, k, 0, time)
        for n in range(joints[0].tree.count):
            d = joints[0].tree.kinds[n]
            if d.freedoms != 1 or joints[0].joint[k, d.joint].friction <= zero:
                continue
            if wp.abs(joints[0].tree.coordinates[k, d.first].start_speed) <= RESTING:
                rate = joints[0].tree.rates[k, d.first]
                if _pass == 1 and rate * joints[0].tree.coordinates[k, d.first].direction <= zero:
                    return False
                joints[0].tree.coordinates[k, d.first].direction = wp.sign(rate)
    joints[0].tree.known[k] = 1
    return True


@wp.func
def slipping(joints: wp.array[Joints], k: int) -> wp.float64:
    """Part of the step up to which no axis that slips comes to rest, nearly: 1 where none does."""
    part = wp.float64(1.0)
    for f in range(joints[0].tree.freedoms):
        direction = joints[0].tree.coordinates[k, f].direction
        if direction * joints[0].tree.coordinates[k, f].speed < -RESTING:
            start_speed = wp.abs(joints[0].tree.coordinates[k, f].start_speed)
            part = wp.min(part, start_speed / (start_speed + wp.abs(joints[0].tree.coordinates[k, f].speed)))
    return part


@wp.func
def until_switched(joints: wp.array[Joints], k: int, time: wp.float64, h: wp.float64) -> wp.float64:
    """Part of a step of length h up to which no motor goes on or off; a motor makes the first stage unknown."""
    until = h
    for j in range(joints[0].count):
        if joints[0].kinds[j].driven == 1:
            joints[0].tree.known[k] = 0
            delay = joints[0].joint[k, j].delay
            on = joints[0].kinds[j].switched_on + delay - time
            off = joints[0].kinds[j].switched_off + delay - time
            if on > NOTHING * h:
                until = wp.min(until, on)
            if off > NOTHING * h:
                until = wp.min(until, off)
    return until


@wp.func(inline=False)
def try_step(
    parameters: wp.array[Parameters],
    joints: wp.array[Joints],
    state: wp.array[State],
    w: int,
    k: int,
    gravity: wp.vec3d,
    time: wp.float64,
    h: wp.float64,
) -> wp.float64:
    """Links where they would be after a step. Returns its error, as a share of the largest speed."""
    freedoms = joints[0].tree.freedoms
    coordinates = joints[0].tree.coordinates
    method = joints[0].tree.method
    slopes = joints[0].tree.slopes
    rates = joints[0].tree.rates
    middle = time + wp.float64(0.5) * h
    for stage in range(STAGES):
        for f in range(freedoms):
            position = wp.float64(0.0)
            gain = wp.float64(0.0)
            for s in range(stage):
                share = method[stage, s]
                position += share * slopes[k, s * freedoms + f]
                gain += share * rates[k, s * freedoms + f]
            coordinates[k, f].position = position * h
            coordinates[k, f].speed = coordinates[k, f].start_speed + gain * h
        update_links(joints, k, stage * freedoms)
        if stage > 0 or joints[0].tree.known[k] == 0:
            instant = time + method[NODES, stage] * h
            load_links(parameters, joints, state, w, k, gravity, instant)
            accelerate(joints, k, stage, middle)
    joints[0].tree.known[k] = 1
    return error_of(joints, k, h)


@wp.func
def slides(joints: wp.array[Joints], n: int, m: int) -> int:
    """1 where freedom m of link n is measured in metres, 0 where it is in radians."""
    kind = joints[0].tree.kinds[n].kind
    if kind == SLIDER or (kind == FREE and m >= 3):
        return 1
    return 0


@wp.func
def error_of(joints: wp.array[Joints], k: int, h: wp.float64) -> wp.float64:
    """Return the root mean square error of all speeds and positions, each relative to its scale."""
    freedoms = joints[0].tree.freedoms
    coordinates = joints[0].tree.coordinates
    method = joints[0].tree.method
    slopes = joints[0].tree.slopes
    rates = joints[0].tree.rates
    scale = wp.vec2d(REST, REST)
    fifths = wp.vec2d()
    thirds = wp.vec2d()
    for n in range(joints[0].tree.count):
        d = joints[0].tree.kinds[n]
        for m in range(d.freedoms):
            f = d.first + m
            of = slides(joints, n, m)
            fifth = wp.vec2d()
            third = wp.vec2d()
            most = wp.abs(coordinates[k, f].start_speed) + wp.abs(coordinates[k, f].speed)
            for s in range(STAGES):
                changes = wp.vec2d(h * rates[k, s * freedoms + f], slopes[k, s * freedoms + f])
                fifth += changes * method[FIFTH, s]
                third += changes * method[THIRD, s]
                most = wp.max(most, wp.abs(changes[0]))
            # Added, not compared, so that what is no number shows.
            fifths[of] = fifths[of] + wp.dot(fifth, fifth)
            thirds[of] = thirds[of] + wp.dot(third, third)
            scale[of] = wp.max(scale[of], most)
    fifth_square = wp.float64(0.0)
    third_square = wp.float64(0.0)
    for of in range(2):
        each = wp.float64(1.0) / (scale[of] * scale[of] * wp.float64(freedoms))
        fifth_square += fifths[of] * each
        third_square += thirds[of] * each
    if fifth_square == wp.float64(0.0):
        return wp.float64(0.0)
    return fifth_square / wp.sqrt(fifth_square + wp.float64(0.01) * third_square)


@wp.func
def kept_on(joints: wp.array[Joints], k: int) -> bool:
    """Check whether balls with friction keep slipping as they did, and no joint is at a stop."""
    zero = wp.float64(0.0)
    for n in range(joints[0].tree.count):
        d = joints[0].tree.kinds[n]
        if d.kind == FREE or d.freedoms == 0:
            continue
        joint = joints[0].joint[k, d.joint]
        if d.kind == BALL and joint.friction > zero:
            together = zero
            before = zero
            after = zero
            for m in range(d.freedoms):
                start_speed = joints[0].tree.coordinates[k, d.first + m].start_speed
                speed = joints[0].tree.coordinates[k, d.first + m].speed
                together += start_speed * speed
                before += start_speed * start_speed
                after += speed * speed
            if not (together > SLIPPING * wp.sqrt(before * after)):
                return False
        if joints[0].kinds[d.joint].bounded > 0:
            position = joint.position + d.sign * joints[0].tree.coordinates[k, d.first].position
            if joint.lower > wp.float64(-0.5 * NEVER) and wp.min(position, joint.position) <= joint.lower:
                return False
            if joint.upper < wp.float64(0.5 * NEVER) and wp.max(position, joint.position) >= joint.upper:
                return False
    return True


@wp.func
def within_reach(joints: wp.array[Joints], state: wp.array[State], k: int, h: wp.float64) -> bool:
    """Check whether all links stay where contacts were looked for, as far as they leave a straight path."""
    within = wp.int32(1)
    for n in range(joints[0].tree.count):
        i = joints[0].tree.kinds[n].body
        x = state[0].bodies[k, i].x + state[0].bodies[k, i].v * h
        off = wp.length(joints[0].tree.links[k, n].x - x)
        joints[0].tree.links[k, n].bend = wp.float64(2.0) * off / (h * h)
        if off > state[0].bodies[k, i].swept:
            within = 0
    return within == 1


@wp.func
def take_step(parameters: wp.array[Parameters], joints: wp.array[Joints], state: wp.array[State], k: int) -> None:
    """Copy the links' poses to the bodies."""
    freedoms = joints[0].tree.freedoms
    for n in range(joints[0].tree.count):
        d = joints[0].tree.kinds[n]
        motion = joints[0].tree.links[k, n].motion
        omega = angular(motion)
        rel = joints[0].tree.links[k, n].x - joints[0].tree.links[k, n].origin
        v = linear(motion) + wp.cross(omega, rel)
        state[0].bodies[k, d.body].x = joints[0].tree.links[k, n].x
        state[0].bodies[k, d.body].q = joints[0].tree.links[k, n].q
        state[0].bodies[k, d.body].rotation = joints[0].tree.links[k, n].rotation
        state[0].bodies[k, d.body].v = v
        state[0].bodies[k, d.body].w = omega
        if parameters[0].forces > 0:
            a = joints[0].tree.links[k, n].acceleration
            turning = angular(a)
            going = linear(a) + wp.cross(turning, rel) + wp.cross(omega, v)
            state[0].reaction[k, d.body] = going - joints[0].tree.links[k, n].free
            state[0].reaction_turning[k, d.body] = turning - joints[0].tree.links[k, n].free_turning
        if d.freedoms == 1:
            joints[0].joint[k, d.joint].position += d.sign * joints[0].tree.coordinates[k, d.first].position
    for f in range(freedoms):
        joints[0].tree.rates[k, f] = joints[0].tree.rates[k, (STAGES - 1) * freedoms + f]
    joints[0].ready[k] = 0
