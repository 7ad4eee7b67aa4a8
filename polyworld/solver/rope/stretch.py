"""Tension of ropes, solved implicitly: one direct solve of a tridiagonal system for each rope.

A link of rest length L and stiffness k = EA/L carries the tension
    T = k ((l - L) + beta dt (u' - u) + (alpha dt + tau) u'),
u and u' being the rates of lengthening before and after the inner step. With alpha = tau = 0 this is symplectic Euler
with the inertia M + beta dt^2 K: without numerical damping, stable for any stiffness where beta >= 1/4, and of a
frequency that is low by beta (omega dt)^2 / 2. beta goes from the 1/12 that cancels the leading error of a resolved
link to the 1 at which even an unresolved one bounces without gaining energy; alpha damps unresolved links alone, by a
Kelvin time of at most UNRESOLVED dt. A link pushes with its own Euler load, pi^2 EI/L^2, at most: beyond that it has
buckled, and a rope without bending stiffness goes slack.
"""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.ends import join_end, prepare_end
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.rope.tensions import apply_tensions, calm_overloaded, keep_outside, stop_load
from polyworld.solver.rope.wheels import (
    is_off,
    judge_wheel,
    mobility_along,
    move_carrier,
    on_wheel,
    place_wheels,
)
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)

UNRESOLVED = wp.constant(wp.float64(0.05))
EULER = wp.constant(wp.float64(9.869604401089358))  # pi^2
SEARCHES = 12  # for the links that are slack, and the wheels that stick
SHORTEST = wp.constant(wp.float64(1.0e-6))  # rest length that counts in a link's stiffness, over a segment's


@wp.func
def half_arc(ropes: Ropes, state: RopeState, w: int, r: int, element: int) -> wp.float64:
    """Return the part of a wheel's arc that belongs to a link next to it."""
    if element >= 0:
        return wp.float64(0.0)
    p = ropes.first_wheel[r] - 1 - element
    return wp.float64(0.5) * on_wheel(ropes, state, w, p)


@wp.func
def speed_of(ropes: Ropes, state: RopeState, v: wp.array2d[wp.vec3d], w: int, r: int, element: int) -> wp.vec3d:
    """Velocity of a node, or of a wheel's centre in the inner step before."""
    if element >= 0:
        return v[w, ropes.first_node[r] + element]
    return state.wheels[w, ropes.first_wheel[r] - 1 - element].velocity


@wp.func
def turning_mobility(ropes: Ropes, state: RopeState, w: int, r: int, element: int) -> wp.float64:
    """Speed of the rope past a wheel per impulse along it [1/kg], 0 for a node."""
    if element >= 0:
        return wp.float64(0.0)
    return state.wheels[w, ropes.first_wheel[r] - 1 - element].inverse_mass


@wp.kernel
def prepare_links(clock: Clock, nodes: Nodes, ropes: Ropes, state: RopeState) -> None:
    """Directions, lengths and what the tension will be made of; wheels and ends where the rope meets them."""
    w, r = wp.tid()
    inverse_mass = nodes.inverse_mass
    h = clock.dt[w]
    if h <= wp.float64(0.0) or nodes.active[w, ropes.first_node[r]] == 0:
        return
    one = wp.float64(1.0)
    first = ropes.first_link[r]
    order = first + r
    half_fall = clock.gravity[w % clock.gravity.shape[0]] * (wp.float64(0.5) * h)
    for end in range(2):
        prepare_end(ropes, state, inverse_mass, half_fall, w, r, end)
    if ropes.wheels[r] > 0:
        place_wheels(ropes, state, nodes, clock.gravity, w, r, h)
    stiffness = ropes.stretch_stiffness[w % ropes.stretch_stiffness.shape[0], r]
    damping = ropes.stretch_damping[w % ropes.stretch_damping.shape[0], r]
    shortest = SHORTEST * ropes.segment_length[r]
    before = state.before[w, r]
    base = ropes.first_node[r]
    row = w % inverse_mass.shape[0]
    final = ropes.nodes[r] - 1
    a = state.order[w, order]
    xa = nodes.x[w, base]
    ma = wp.float64(0.0)
    last = wp.vec3d()
    for k in range(state.elements[w, r] - 1):
        b = state.order[w, order + k + 1]
        xb = wp.vec3d()
        mb = wp.float64(0.0)
        if b >= 0:
            xb = nodes.x[w, base + b]
            mb = inverse_mass[row, base + b]
        else:
            xb = state.wheels[w, ropes.first_wheel[r] - 1 - b].arrives
        span = xb - xa
        length = wp.length(span)
        n = state.direction[w, first + k]
        if length > wp.float64(1.0e-9):
            n = span / length
        state.direction[w, first + k] = n
        rest = state.rest[w, first + k]
        elongation = length - rest
        ka = ma
        kb = mb
        if a <= 0:
            ka = mobility_along(ropes, state, inverse_mass, w, r, a, n)
        if b < 0 or b == final:
            kb = mobility_along(ropes, state, inverse_mass, w, r, b, n)
        if a < 0 or b < 0:
            elongation += half_arc(ropes, state, w, r, a) + half_arc(ropes, state, w, r, b)
        spring = stiffness / wp.max(rest, shortest)
        # The flow over a wheel next to it swings a link too, the faster the less rope lies on the wheel.
        flow = turning_mobility(ropes, state, w, r, a) + turning_mobility(ropes, state, w, r, b)
        z = h * h * spring * (ka + kb + flow)
        stiff = z / (wp.float64(4.0) + z)
        beta = one / wp.float64(12.0) + stiff * wp.float64(11.0 / 12.0)
        past = state.elongation[w, first + k]
        if wp.isnan(past):
            rate = wp.dot(n, speed_of(ropes, state, nodes.v, w, r, b) - speed_of(ropes, state, nodes.v, w, r, a))
        else:
            rate = (elongation - past) / before
        gain = h * ((beta + UNRESOLVED * stiff) * h + damping)
        state.compliance[w, first + k] = one / (spring * gain)
        state.diagonal[w, first + k] = ka + kb + one / (spring * gain)
        if a < 0:
            state.coupled[w, first + k - 1] = -wp.dot(last, state.wheels[w, ropes.first_wheel[r] - 1 - a].mobility * n)
        elif k > 0:
            state.coupled[w, first + k - 1] = -ma * wp.dot(last, n)
        last = n
        xa = xb if b >= 0 else state.wheels[w, ropes.first_wheel[r] - 1 - b].leaves
        ma = mb
        state.target[w, first + k] = (elongation - beta * h * rate) / gain
        state.elongation[w, first + k] = elongation
        state.tension[w, first + k] = wp.float64(0.0)
        a = b
    state.before[w, r] = h


@wp.func
def lowest_tension(bending: wp.float64, rest: wp.float64, a: int, b: int) -> wp.float64:
    if a < 0 or b < 0:
        return wp.float64(0.0)
    return -EULER * bending / (rest * rest)


@wp.func
def find_rates(
    ropes: Ropes, state: RopeState, nodes: Nodes, half_fall: wp.vec3d, h: wp.float64, w: int, r: int
) -> None:
    """Right-hand sides at the present velocities; the turning of wheels is added where the system is solved.

    A link that turns grows by dt^2 (its transverse velocity)^2 / 2 l within the step, which counts in its rate.
    """
    first = ropes.first_link[r]
    order = first + r
    base = ropes.first_node[r]
    row = w % nodes.inverse_mass.shape[0]
    final = ropes.nodes[r] - 1
    a = state.order[w, order]
    va = nodes.v[w, base] - state.end_lag[w, r, 0]
    for k in range(state.elements[w, r] - 1):
        b = state.order[w, order + k + 1]
        vb = wp.vec3d()
        if b < 0:
            vb = state.wheels[w, ropes.first_wheel[r] - 1 - b].velocity
        elif b == final:
            vb = nodes.v[w, base + b] - state.end_lag[w, r, 1]
        else:
            vb = nodes.v[w, base + b]
            if nodes.inverse_mass[row, base + b] > wp.float64(0.0):
                vb = vb - half_fall
        apart = vb - va
        rate = wp.dot(state.direction[w, first + k], apart)
        if a >= 0 and b >= 0:
            turning = wp.float64(0.5) * h * (wp.length_sq(apart) - rate * rate)
            rate += turning / (state.elongation[w, first + k] + state.rest[w, first + k])
        state.right[w, first + k] = (
            state.target[w, first + k] + rate / h - state.compliance[w, first + k] * state.tension[w, first + k]
        )
        a = b
        va = vb


@wp.func
def solve_rows(ropes: Ropes, state: RopeState, w: int, r: int, h: wp.float64) -> None:
    """Changes of the tensions: Thomas's elimination. A link at its bound has a row of its own."""
    first = ropes.first_link[r]
    order = first + r
    links = state.elements[w, r] - 1
    has_wheels = ropes.wheels[r] > 0
    passed = wp.float64(0.0)  # of the row before
    known = wp.float64(0.0)
    coupled = wp.float64(0.0)
    for k in range(first, first + links):
        diagonal = state.diagonal[w, k]
        right = state.right[w, k]
        lower = coupled
        coupled = state.coupled[w, k]
        upper = coupled
        if has_wheels:
            a = state.order[w, order + k - first]
            b = state.order[w, order + k - first + 1]
            if a < 0:
                p = ropes.first_wheel[r] - 1 - a
                diagonal += state.wheels[w, p].inverse_mass * state.wheels[w, p].weight_out
                lower -= state.wheels[w, p].inverse_mass * state.wheels[w, p].weight_in
                right -= state.wheels[w, p].speed / h
            if b < 0:
                p = ropes.first_wheel[r] - 1 - b
                diagonal += state.wheels[w, p].inverse_mass * state.wheels[w, p].weight_in
                upper -= state.wheels[w, p].inverse_mass * state.wheels[w, p].weight_out
                right += state.wheels[w, p].speed / h
        if state.held[w, k] == 1:
            passed = wp.float64(0.0)
            known = state.change[w, k]
        else:
            scale = wp.float64(1.0) / (diagonal - lower * passed)
            passed = upper * scale
            known = (right - lower * known) * scale
            state.change[w, k] = known
        state.forward[w, k] = passed
    for j in range(1, links):
        k = first + links - 1 - j
        if state.held[w, k] == 0:
            state.change[w, k] = state.change[w, k] - state.forward[w, k] * state.change[w, k + 1]


@wp.func
def review_links(ropes: Ropes, state: RopeState, w: int, r: int, h: wp.float64, release: bool) -> int:
    """Hold links whose tension fell below its bound, release those that would pull more: how many were changed."""
    first = ropes.first_link[r]
    order = first + r
    links = state.elements[w, r] - 1
    bending = ropes.bending_stiffness[w % ropes.bending_stiffness.shape[0], r]
    changed = wp.int32(0)
    for k in range(first, first + links):
        a = state.order[w, order + k - first]
        b = state.order[w, order + k - first + 1]
        lowest = wp.float64(0.0)
        if bending > wp.float64(0.0):
            lowest = lowest_tension(bending, state.rest[w, k], a, b)
        if state.held[w, k] == 0:
            if state.tension[w, k] + state.change[w, k] < lowest:
                state.held[w, k] = 1
                state.change[w, k] = lowest - state.tension[w, k]
                changed += 1
        elif release:
            missing = state.right[w, k] - state.diagonal[w, k] * state.change[w, k]
            if k > first:
                missing -= state.coupled[w, k - 1] * state.change[w, k - 1]
            if k + 1 < first + links:
                missing -= state.coupled[w, k] * state.change[w, k + 1]
            if a < 0:
                p = ropes.first_wheel[r] - 1 - a
                missing -= wheel_speed(state, w, p, k - 1, h) / h
            if b < 0:
                p = ropes.first_wheel[r] - 1 - b
                missing += wheel_speed(state, w, p, k, h) / h
            if missing > wp.float64(0.0):
                state.held[w, k] = 0
                changed += 1
    return changed


@wp.func
def wheel_speed(state: RopeState, w: int, p: int, k: int, h: wp.float64) -> wp.float64:
    """Speed of the rope past a wheel under the changed tensions; k is the link before it."""
    return state.wheels[w, p].drive + h * state.wheels[w, p].inverse_mass * (
        state.wheels[w, p].weight_out * (state.tension[w, k + 1] + state.change[w, k + 1])
        - state.wheels[w, p].weight_in * (state.tension[w, k] + state.change[w, k])
    )


@wp.func
def base_speed(state: RopeState, w: int, p: int, k: int, h: wp.float64) -> wp.float64:
    """Speed of the rope past a wheel under the tensions so far."""
    return state.wheels[w, p].drive + h * state.wheels[w, p].inverse_mass * (
        state.wheels[w, p].weight_out * state.tension[w, k + 1] - state.wheels[w, p].weight_in * state.tension[w, k]
    )


@wp.kernel
def solve_tensions(clock: Clock, nodes: Nodes, ropes: Ropes, state: RopeState) -> None:
    """Bring the tensions of one rope into agreement with the velocities, and the velocities with the tensions."""
    w, r = wp.tid()
    h = clock.dt[w]
    if h <= wp.float64(0.0) or nodes.active[w, ropes.first_node[r]] == 0:
        return
    first = ropes.first_link[r]
    links = state.elements[w, r] - 1
    first_wheel = ropes.first_wheel[r]
    last_wheel = first_wheel + ropes.wheels[r]
    half_fall = clock.gravity[w % clock.gravity.shape[0]] * (wp.float64(0.5) * h)
    for end in range(2):
        join_end(ropes, state, nodes, w, r, end)
    for p in range(first_wheel, last_wheel):
        move_carrier(ropes, state, w, p)
        if state.wheels[w, p].blocked != 0:
            stop_load(ropes, state, nodes.v, w, r, p)
    find_rates(ropes, state, nodes, half_fall, h, w, r)
    bending = ropes.bending_stiffness[w % ropes.bending_stiffness.shape[0], r]
    order = first + r
    for k in range(links):
        if state.held[w, first + k] == 1:
            lowest = lowest_tension(
                bending, state.rest[w, first + k], state.order[w, order + k], state.order[w, order + k + 1]
            )
            state.change[w, first + k] = lowest - state.tension[w, first + k]
    changed = wp.int32(1)
    search = wp.int32(0)
    while changed > 0 and search < SEARCHES:
        for p in range(first_wheel, last_wheel):
            if state.wheels[w, p].index >= 0:
                state.wheels[w, p].speed = base_speed(state, w, p, first + state.wheels[w, p].index - 1, h)
        solve_rows(ropes, state, w, r, h)
        changed = review_links(ropes, state, w, r, h, search < SEARCHES - 2)
        if search < SEARCHES - 4:
            for p in range(first_wheel, last_wheel):
                if state.wheels[w, p].index >= 0:
                    changed += judge_wheel(ropes, state, clock.gravity, w, r, p, h)
        search += 1
    for p in range(first_wheel, last_wheel):
        if state.wheels[w, p].index >= 0:
            state.wheels[w, p].speed = wheel_speed(state, w, p, first + state.wheels[w, p].index - 1, h)
    apply_tensions(ropes, state, nodes, w, r, h)
    for p in range(first_wheel, last_wheel):
        if state.wheels[w, p].index >= 0 and not is_off(ropes, state, w, p):
            for half in range(2):
                keep_outside(ropes, state, nodes, h, w, r, p, 2 * half - 1)
    calm_overloaded(ropes, state, nodes, w, r, h)
