"""Pulleys: where the rope touches a wheel, what the wheel's turning resists with, and nodes that run over it.

The arc of rope that lies on a wheel has no nodes: its mass turns with the wheel (I/R^2 + linear density R wrap),
its weight drives it, and half of its length belongs to each of the two links next to the wheel. In these the rope
flows at the wheel's speed, so that their rest lengths change while their sum does not. A node that reaches the tangent
point goes on at the other one and the links swap: rest lengths add up exactly as before, and energy changes by
the square of the difference in strain between two neighbouring links. A rope that has come off its wheel, its wrap
fallen to zero, runs straight by, without friction, until it lies on it again.
"""

import math

import warp as wp

from polyworld.solver.coupled.nodes import Nodes
from polyworld.solver.rope.ends import end_node, point_mobility, point_velocity, push_body
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)

SKIPPED = wp.constant(wp.float64(0.125))  # mean length that a node skips on each side of a wheel, over a segment's
NEAREST = wp.constant(wp.float64(0.1))  # distance from a wheel at which a node passes it, over a segment's
# A node passes a wheel where it is NEAREST to it, and goes on this far beyond it, over a segment's length: a nearer
# one would swing across the rope faster than the inner step resolves.
BEYOND = wp.constant(wp.float64(0.15))
# Least mass of rope that moves with a wheel, over a segment's: that whose weight acts there. A lighter one would be
# thrown about by this weight where the rope is slack.
LEAST_INERTIA = wp.constant(wp.float64(0.25))
# Mass that moves with a wheel from which the rope has come off, over the least one that lies on it: next to none, so
# that the tensions on both sides are equal.
LOOSE = wp.constant(wp.float64(1.0e-6))
RETURNS = wp.constant(wp.float64(0.5 * math.pi))  # wrap up to which rope can come back on a wheel in one step [rad]
TURN = wp.constant(wp.float64(2.0 * math.pi))
NEAR_ENDS = wp.constant(wp.float64(0.05))  # part of a straight line next to its ends, that no wheel divides it in


@wp.func
def mobility_along(
    ropes: Ropes,
    state: RopeState,
    inverse_mass: wp.array2d[wp.float64],
    w: int,
    r: int,
    element: int,
    n: wp.vec3d,
) -> wp.float64:
    """Velocity per impulse of an element along n, of a wheel that of its centre [1/kg]."""
    if element < 0:
        return wp.dot(n, state.wheels[w, ropes.first_wheel[r] - 1 - element].mobility * n)
    if element == 0:
        return wp.dot(n, state.end_mobility[w, r, 0] * n)
    if element == ropes.nodes[r] - 1:
        return wp.dot(n, state.end_mobility[w, r, 1] * n)
    return inverse_mass[w % inverse_mass.shape[0], ropes.first_node[r] + element]


@wp.func
def touch(centre: wp.vec3d, axis: wp.vec3d, radius: wp.float64, point: wp.vec3d, side: wp.float64) -> wp.vec3d:
    """Unit vector from the axis to where the line from a point touches the wheel: side 1 arrives, -1 leaves."""
    out = point - centre
    out = out - axis * wp.dot(axis, out)
    distance = wp.max(wp.length(out), wp.float64(1.0e-12))
    radial = out / distance
    cosine = wp.min(radius / distance, wp.float64(1.0))
    sine = side * wp.sqrt(wp.float64(1.0) - cosine * cosine)
    return radial * cosine + wp.cross(axis, radial) * sine


@wp.func
def wheel_centre(ropes: Ropes, state: RopeState, w: int, p: int) -> wp.vec3d:
    """Return where a wheel's centre now is."""
    b = ropes.wheel_body[p]
    if b < 0:
        return ropes.wheel_centre[p]
    return state.bodies[w, b].x + state.bodies[w, b].rotation * ropes.wheel_centre[p]


@wp.func
def rim_point(ropes: Ropes, state: RopeState, w: int, p: int, point: wp.vec3d, side: int) -> wp.vec3d:
    """Return where the line from a point now touches a wheel: side 1 arrives, -1 leaves; the centre of an eye."""
    b = ropes.wheel_body[p]
    centre = wheel_centre(ropes, state, w, p)
    axis = ropes.wheel_axis[p]
    if b >= 0:
        axis = state.bodies[w, b].rotation * axis
    if ropes.wheel_radius[p] <= wp.float64(0.0):
        return centre
    return centre + touch(centre, axis, ropes.wheel_radius[p], point, wp.float64(side)) * ropes.wheel_radius[p]


@wp.func
def turned_by(axis: wp.vec3d, a: wp.vec3d, b: wp.vec3d) -> wp.float64:
    """Angle about the axis from a to b, 0 where a is zero."""
    if wp.length_sq(a) == wp.float64(0.0):
        return wp.float64(0.0)
    return wp.atan2(wp.dot(axis, wp.cross(a, b)), wp.dot(a, b))


@wp.func
def place_wheels(
    ropes: Ropes, state: RopeState, nodes: Nodes, gravity: wp.array[wp.vec3d], w: int, r: int, h: wp.float64
) -> None:
    """Bring the wheels to where their carriers are, and their tangent points to where the rope now meets them."""
    first = ropes.first_link[r]
    order = first + r
    for p in range(ropes.first_wheel[r], ropes.first_wheel[r] + ropes.wheels[r]):
        if state.wheels[w, p].index < 0:
            continue
        b = ropes.wheel_body[p]
        state.wheels[w, p].centre = ropes.wheel_centre[p]
        state.wheels[w, p].axis = ropes.wheel_axis[p]
        state.wheels[w, p].mobility = wp.mat33d()
        if b >= 0:
            arm = state.bodies[w, b].rotation * ropes.wheel_centre[p]
            state.wheels[w, p].lag = (state.bodies[w, b].v - state.wheels[w, p].kept) * wp.float64(0.5)
            state.wheels[w, p].centre = state.bodies[w, b].x + arm
            state.wheels[w, p].axis = state.bodies[w, b].rotation * ropes.wheel_axis[p]
            state.wheels[w, p].mobility = (
                point_mobility(state.mechanisms, state.bodies, w, b, arm) * ropes.wheel_share[p]
            )
    for p in range(ropes.first_wheel[r], ropes.first_wheel[r] + ropes.wheels[r]):
        index = state.wheels[w, p].index
        if index < 0:
            continue
        wheel = state.wheels[w, p]
        k = first + index - 1  # the link before it
        previous = state.order[w, order + index - 1]
        following = state.order[w, order + index + 1]
        begin = wp.vec3d()
        end = wp.vec3d()
        if previous >= 0:
            begin = nodes.x[w, ropes.first_node[r] + previous]
        else:
            begin = state.wheels[w, ropes.first_wheel[r] - 1 - previous].leaves
        if following >= 0:
            end = nodes.x[w, ropes.first_node[r] + following]
        else:
            end = state.wheels[w, ropes.first_wheel[r] - 1 - following].arrives
        radius = ropes.wheel_radius[p]
        if radius > wp.float64(0.0):
            radial_in = touch(wheel.centre, wheel.axis, radius, begin, wp.float64(1.0))
            radial_out = touch(wheel.centre, wheel.axis, radius, end, wp.float64(-1.0))
            advance_in = turned_by(wheel.axis, wheel.radial_in, radial_in)
            advance_out = turned_by(wheel.axis, wheel.radial_out, radial_out)
            was_off = state.wheels[w, p].wrap <= wp.float64(0.0)
            wheel.wrap = wheel.wrap + advance_out - advance_in
            if was_off:
                # Nodes that pass turn the tangent points by anything: only a wrap that begins counts.
                wheel.wrap = turned_by(wheel.axis, radial_in, radial_out)
                if wheel.wrap > RETURNS:
                    wheel.wrap -= TURN
            if was_off and wheel.wrap > wp.float64(0.0):
                wheel.speed = wheel.speed * caught(ropes, w, r, p)
            # The middle of the arc divides it between two links: where it moves on, so does the division.
            passed = wp.float64(0.5) * (advance_in + advance_out) * radius
            state.rest[w, k] = state.rest[w, k] + passed
            state.rest[w, k + 1] = state.rest[w, k + 1] - passed
            wheel.radial_in = radial_in
            wheel.radial_out = radial_out
            wheel.arrives = wheel.centre + radial_in * radius
            wheel.leaves = wheel.centre + radial_out * radius
            if was_off and wheel.wrap > wp.float64(0.0):
                # It comes back as taut on one side as on the other.
                half = wp.float64(0.5) * radius * wheel.wrap
                into = wp.length(wheel.arrives - begin) + half
                out = wp.length(end - wheel.leaves) + half
                both = state.rest[w, k] + state.rest[w, k + 1]
                state.rest[w, k] = both * into / (into + out)
                state.rest[w, k + 1] = both - state.rest[w, k]
            if wheel.wrap <= wp.float64(0.0):
                if wheel.mode == 0:
                    wheel.mode = 1  # nothing holds it there
                span = end - begin
                part = wp.dot(wheel.centre - begin, span) / wp.max(wp.length_sq(span), wp.float64(1.0e-24))
                part = wp.clamp(part, NEAR_ENDS, wp.float64(1.0) - NEAR_ENDS)
                wheel.arrives = begin + span * part
                wheel.leaves = wheel.arrives
                # Its two links are one: they have the same strain, wherever the wheel's nearest point divides them.
                both = state.rest[w, k] + state.rest[w, k + 1]
                state.rest[w, k] = both * part
                state.rest[w, k + 1] = both - both * part
        else:
            wheel.arrives = wheel.centre
            wheel.leaves = wheel.centre
            arriving = wp.normalize(wheel.centre - begin)
            leaving = wp.normalize(end - wheel.centre)
            wheel.wrap = wp.atan2(wp.length(wp.cross(arriving, leaving)), wp.dot(arriving, leaving))
        wheel.blocked = 0
        near = NEAREST * ropes.segment_length[r]
        if previous == 0 and wp.length(wheel.arrives - begin) < near:
            wheel.blocked = is_held(ropes, state, nodes.inverse_mass, w, r, 0)
        if following == ropes.nodes[r] - 1 and wp.length(wheel.leaves - end) < near:
            wheel.blocked = -is_held(ropes, state, nodes.inverse_mass, w, r, 1)
        wheel.begin = wheel.speed
        state.wheels[w, p] = wheel
        turn_wheel(ropes, state, gravity, w, r, p, h)


@wp.func
def is_held(ropes: Ropes, state: RopeState, inverse_mass: wp.array2d[wp.float64], w: int, r: int, end: int) -> int:
    """1 where an end carries a load or is held, so that it does not slip through a pulley; 0 where it is loose."""
    if inverse_mass[w % inverse_mass.shape[0], end_node(ropes, r, end)] <= wp.float64(0.0):
        return 1
    return state.attached[w, r, end]


@wp.func
def turn_wheel(
    ropes: Ropes, state: RopeState, gravity: wp.array[wp.vec3d], w: int, r: int, p: int, h: wp.float64
) -> None:
    """Return the wheel's response in its mode: inverse inertia, speed without tensions, weights of the tensions."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    radius = ropes.wheel_radius[p]
    mode = state.wheels[w, p].mode
    state.wheels[w, p].weight_in = one
    state.wheels[w, p].weight_out = one
    if mode == 0:
        state.wheels[w, p].inverse_mass = zero
        state.wheels[w, p].drive = zero
        return
    if is_off(ropes, state, w, p):
        state.wheels[w, p].inverse_mass = one / (LOOSE * moved_mass(ropes, state, w, r, p))
        state.wheels[w, p].drive = state.wheels[w, p].begin
        return
    mass = moved_mass(ropes, state, w, r, p)
    force = hidden_weight(ropes, state, gravity, w, r, p)
    damping = zero
    if slides(ropes, p):
        ratio = belt_ratio(ropes, state, w, p)
        if mode > 0:
            state.wheels[w, p].weight_in = ratio
        else:
            state.wheels[w, p].weight_out = ratio
    else:
        mass += ropes.wheel_inertia[w % ropes.wheel_inertia.shape[0], p] / (radius * radius)
        damping = ropes.bearing_damping[w % ropes.bearing_damping.shape[0], p] / (radius * radius)
        force -= wp.float64(mode) * dry_force(ropes, w, p)
    state.wheels[w, p].inverse_mass = one / (mass + h * damping)
    state.wheels[w, p].drive = (mass * state.wheels[w, p].begin + h * force) / (mass + h * damping)


@wp.func
def hidden_weight(ropes: Ropes, state: RopeState, gravity: wp.array[wp.vec3d], w: int, r: int, p: int) -> wp.float64:
    """Return the force along the rope of the weight between the points where nodes come and go [N]."""
    k = ropes.first_link[r] + state.wheels[w, p].index - 1
    skipped = (state.direction[w, k] + state.direction[w, k + 1]) * (SKIPPED * ropes.segment_length[r])
    drop = state.wheels[w, p].leaves - state.wheels[w, p].arrives + skipped
    density = ropes.linear_density[w % ropes.linear_density.shape[0], r]
    return density * wp.dot(gravity[w % gravity.shape[0]], drop)


@wp.func
def on_wheel(ropes: Ropes, state: RopeState, w: int, p: int) -> wp.float64:
    """Length of rope that lies on a wheel, 0 where the rope has come off it [m]."""
    return ropes.wheel_radius[p] * wp.max(state.wheels[w, p].wrap, wp.float64(0.0))


@wp.func
def is_off(ropes: Ropes, state: RopeState, w: int, p: int) -> bool:
    """Check whether the rope has come off its wheel."""
    return ropes.wheel_radius[p] > wp.float64(0.0) and state.wheels[w, p].wrap <= wp.float64(0.0)


@wp.func
def moved_mass(ropes: Ropes, state: RopeState, w: int, r: int, p: int) -> wp.float64:
    """Mass of the rope that moves with a wheel [kg]."""
    density = ropes.linear_density[w % ropes.linear_density.shape[0], r]
    return density * wp.max(on_wheel(ropes, state, w, p), LEAST_INERTIA * ropes.segment_length[r])


@wp.func
def caught(ropes: Ropes, w: int, r: int, p: int) -> wp.float64:
    """Share of its speed that a rope keeps as it comes back on a wheel, which stands still."""
    if slides(ropes, p):
        return wp.float64(1.0)
    radius = ropes.wheel_radius[p]
    density = ropes.linear_density[w % ropes.linear_density.shape[0], r]
    mass = density * LEAST_INERTIA * ropes.segment_length[r]
    return mass / (mass + ropes.wheel_inertia[w % ropes.wheel_inertia.shape[0], p] / (radius * radius))


@wp.func
def slides(ropes: Ropes, p: int) -> bool:
    """Check whether the rope slides over the wheel; an eye (radius 0) never turns."""
    return ropes.wheel_fixed[p] == 1 or ropes.wheel_radius[p] <= wp.float64(0.0)


@wp.func
def belt_ratio(ropes: Ropes, state: RopeState, w: int, p: int) -> wp.float64:
    """Largest ratio of the tensions on both sides: Euler-Eytelwein."""
    friction = ropes.wheel_friction[w % ropes.wheel_friction.shape[0], p]
    return wp.exp(friction * wp.max(state.wheels[w, p].wrap, wp.float64(0.0)))


@wp.func
def dry_force(ropes: Ropes, w: int, p: int) -> wp.float64:
    """Dry resistance of the bearing, as a force at the rope [N]."""
    return ropes.bearing_friction[w % ropes.bearing_friction.shape[0], p] / ropes.wheel_radius[p]


@wp.func
def judge_wheel(
    ropes: Ropes, state: RopeState, gravity: wp.array[wp.vec3d], w: int, r: int, p: int, h: wp.float64
) -> int:
    """Check whether the wheel must stick or turn otherwise than assumed, given the tensions on both sides of it."""
    k = ropes.first_link[r] + state.wheels[w, p].index - 1
    before = state.tension[w, k] + state.change[w, k]
    after = state.tension[w, k + 1] + state.change[w, k + 1]
    mode = state.wheels[w, p].mode
    zero = wp.float64(0.0)
    wheel = state.wheels[w, p]
    off = is_off(ropes, state, w, p)
    is_belt = slides(ropes, p) or off
    if mode != 0:
        resists = False
        if is_belt:
            resists = ropes.wheel_friction[w % ropes.wheel_friction.shape[0], p] > zero
        else:
            resists = dry_force(ropes, w, p) > zero
        resists = resists and not off
        speed = wheel.drive + h * wheel.inverse_mass * (wheel.weight_out * after - wheel.weight_in * before)
        if (resists and wp.float64(mode) * speed < zero) or wp.float64(wheel.blocked) * speed > zero:
            state.wheels[w, p].mode = 0
            turn_wheel(ropes, state, gravity, w, r, p, h)
            return 1
        return 0
    mass = moved_mass(ropes, state, w, r, p)
    force = hidden_weight(ropes, state, gravity, w, r, p)
    least = zero  # excess of the pull over the resistance, one way and the other
    if is_belt:
        force += mass * wheel.begin / h
        ratio = belt_ratio(ropes, state, w, p)
        if after + force > ratio * before:
            least = wp.float64(1.0)
        elif before - force > ratio * after:
            least = wp.float64(-1.0)
    else:
        mass += ropes.wheel_inertia[w % ropes.wheel_inertia.shape[0], p] / (
            ropes.wheel_radius[p] * ropes.wheel_radius[p]
        )
        pull = after - before + force + mass * wheel.begin / h
        if wp.abs(pull) > dry_force(ropes, w, p):
            least = wp.sign(pull)
    if least == zero or wp.int32(least) == wheel.blocked:
        return 0
    state.wheels[w, p].mode = wp.int32(least)
    turn_wheel(ropes, state, gravity, w, r, p, h)
    return 1


@wp.func
def move_carrier(ropes: Ropes, state: RopeState, w: int, p: int) -> None:
    """Velocity at which the wheel's centre moves in this inner step."""
    b = ropes.wheel_body[p]
    state.wheels[w, p].velocity = wp.vec3d()
    if b >= 0:
        arm = state.wheels[w, p].centre - state.bodies[w, b].x
        state.wheels[w, p].velocity = point_velocity(state.bodies, w, b, arm) - state.wheels[w, p].lag


@wp.func
def push_wheel(ropes: Ropes, state: RopeState, w: int, p: int, impulse: wp.vec3d) -> None:
    """Apply an impulse to the carrier at the wheel's centre."""
    b = ropes.wheel_body[p]
    if b >= 0:
        push_body(state.mechanisms, state.bodies, w, b, state.wheels[w, p].centre - state.bodies[w, b].x, impulse)
