"""Rope that runs over wheels: rest length flows from link to link, nodes change sides, a loose end runs off."""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.rope.wheels import BEYOND, NEAREST, on_wheel, push_wheel
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)


LEAST_PART = wp.constant(wp.float64(0.02))  # straight rope that no node or flow takes from a link, over a segment's


@wp.func
def element_at(state: RopeState, ropes: Ropes, w: int, r: int, index: int) -> int:
    return state.order[w, ropes.first_link[r] + r + index]


@wp.func
def swap(ropes: Ropes, state: RopeState, w: int, r: int, p: int, side: int) -> None:
    """Exchange a wheel with the element before (side -1) or after it, and forget rates of the links around."""
    order = ropes.first_link[r] + r
    index = state.wheels[w, p].index
    node = state.order[w, order + index + side]
    state.order[w, order + index + side] = state.order[w, order + index]
    state.order[w, order + index] = node
    state.wheels[w, p].index = index + side
    low = ropes.first_link[r] + index - 1 + wp.min(side, 0)
    for k in range(low, low + 3):
        state.elongation[w, k] = wp.float64(wp.nan)
        state.held[w, k] = 0


@wp.func
def run_off(ropes: Ropes, state: RopeState, w: int, r: int, p: int) -> None:
    """Take a wheel out of the rope after an end has passed it: its two links become one."""
    first = ropes.first_link[r]
    order = first + r
    index = state.wheels[w, p].index
    k = first + index - 1
    state.rest[w, k] = state.rest[w, k] + state.rest[w, k + 1]
    state.elongation[w, k] = wp.float64(wp.nan)
    state.held[w, k] = 0
    count = state.elements[w, r]
    for e in range(index, count - 1):
        element = state.order[w, order + e + 1]
        state.order[w, order + e] = element
        if element < 0:
            state.wheels[w, ropes.first_wheel[r] - 1 - element].index = e
    for j in range(k + 1, first + count - 2):
        state.rest[w, j] = state.rest[w, j + 1]
        state.tension[w, j] = state.tension[w, j + 1]
        state.elongation[w, j] = state.elongation[w, j + 1]
        state.held[w, j] = state.held[w, j + 1]
    state.elements[w, r] = count - 1
    state.wheels[w, p].index = -1


@wp.func
def straight_rest(ropes: Ropes, state: RopeState, w: int, r: int, p: int, k: int) -> wp.float64:
    """Rest length of a link next to a wheel, without what lies on the wheel, that can be taken from it [m]."""
    stiffness = ropes.stretch_stiffness[w % ropes.stretch_stiffness.shape[0], r]
    stretch = wp.float64(1.0) + wp.max(state.tension[w, k], wp.float64(0.0)) / stiffness
    arc = wp.float64(0.5) * on_wheel(ropes, state, w, p) / stretch
    return wp.max(state.rest[w, k] - arc - LEAST_PART * ropes.segment_length[r], wp.float64(0.0))


@wp.func
def pass_node(ropes: Ropes, state: RopeState, nodes: Nodes, h: wp.float64, w: int, r: int, p: int, side: int) -> None:
    """Bring the node next to a wheel (before it: side -1, after it: 1) to the other side.

    Its velocity turns by the wrap about the axis, and the carrier takes the change of momentum.
    """
    wheel = state.wheels[w, p]
    first = ropes.first_link[r]
    node = element_at(state, ropes, w, r, wheel.index + side)
    i = ropes.first_node[r] + node
    rotation = wp.quat_from_axis_angle(wheel.axis, wp.max(wheel.wrap, wp.float64(0.0)) * wp.float64(-side))
    k = first + wheel.index - 1  # the link before the wheel
    tangent = wheel.leaves
    far = k + 1  # the link that is cut in two
    if side > 0:
        tangent = wheel.arrives
        far = k
    tangent = tangent + wheel.velocity * h
    following = element_at(state, ropes, w, r, wheel.index - side)
    span = wp.vec3d()
    if following >= 0:
        span = nodes.x[w, ropes.first_node[r] + following] - tangent
    else:
        other = state.wheels[w, ropes.first_wheel[r] - 1 - following]
        span = wp.where(side > 0, other.leaves, other.arrives) + other.velocity * h - tangent
    length = wp.length(span)
    away = span / wp.max(length, wp.float64(1.0e-12))
    # Both parts of the link that is cut have the strain that it has now, so that the cut costs no energy.
    arc = wp.float64(0.5) * on_wheel(ropes, state, w, p)
    whole = length + arc
    if following < 0:
        whole += wp.float64(0.5) * on_wheel(ropes, state, w, ropes.first_wheel[r] - 1 - following)
    stretch = wp.max(whole / state.rest[w, far], wp.float64(1.0))
    # Half of the way to the next node where that has come near, too.
    room = wp.float64(0.5) * wp.min(straight_rest(ropes, state, w, r, p, far) * stretch, length)
    beyond = wp.min(BEYOND * ropes.segment_length[r], room)
    near = (arc + beyond) / stretch
    if whole < state.rest[w, far]:
        # Slack stays next to the wheel, where rope does not push.
        near = state.rest[w, far] - (length - beyond)
    if side < 0:
        state.rest[w, k - 1] = state.rest[w, k - 1] + state.rest[w, k]
        state.rest[w, k + 1] = state.rest[w, k + 1] - near
        state.rest[w, k] = near
    else:
        state.rest[w, k + 2] = state.rest[w, k + 2] + state.rest[w, k + 1]
        state.rest[w, k] = state.rest[w, k] - near
        state.rest[w, k + 1] = near
    nodes.x[w, i] = tangent + away * beyond
    before = nodes.v[w, i]
    nodes.v[w, i] = wheel.velocity + wp.quat_rotate(rotation, before - wheel.velocity)
    share = nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i]
    push_wheel(ropes, state, w, p, (before - nodes.v[w, i]) * (wp.float64(1.0) / share))
    swap(ropes, state, w, r, p, side)


@wp.kernel
def pass_wheels(clock: Clock, nodes: Nodes, ropes: Ropes, state: RopeState) -> None:
    """Let rope flow past the wheels of one rope, after its nodes have moved."""
    w, r = wp.tid()
    h = clock.dt[w]
    if h <= wp.float64(0.0) or nodes.active[w, ropes.first_node[r]] == 0:
        return
    first = ropes.first_link[r]
    stiffness = ropes.stretch_stiffness[w % ropes.stretch_stiffness.shape[0], r]
    for p in range(ropes.first_wheel[r], ropes.first_wheel[r] + ropes.wheels[r]):
        if state.wheels[w, p].index < 0:
            continue
        k = first + state.wheels[w, p].index - 1
        upstream = k
        if state.wheels[w, p].speed < wp.float64(0.0):
            upstream = k + 1
        stretch = wp.float64(1.0) + state.tension[w, upstream] / stiffness
        flow = state.wheels[w, p].speed * h / stretch
        most = straight_rest(ropes, state, w, r, p, upstream)
        flow = wp.clamp(flow, -most, most)
        state.rest[w, k] = state.rest[w, k] - flow
        state.rest[w, k + 1] = state.rest[w, k + 1] + flow
        for half in range(2):
            side = 2 * half - 1
            index = state.wheels[w, p].index
            if index < 0:
                continue
            link = first + index - 1 + half
            node = element_at(state, ropes, w, r, index + side)
            if node < 0:
                continue
            i = ropes.first_node[r] + node
            if nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i] <= wp.float64(0.0):
                continue
            n = state.direction[w, link] * wp.float64(-side)  # towards the wheel
            tangent = state.wheels[w, p].arrives
            if side > 0:
                tangent = state.wheels[w, p].leaves
            left = wp.dot(n, tangent + state.wheels[w, p].velocity * h - nodes.x[w, i])
            # A node that flies up to the wheel ahead of slack rope stays before it: the rope between has yet to flow.
            left = wp.max(left, straight_rest(ropes, state, w, r, p, link))
            if left >= NEAREST * ropes.segment_length[r]:
                continue
            # One that was brought here and goes on does not turn back.
            parts = wp.dot(n, nodes.v[w, i] - state.wheels[w, p].velocity) < wp.float64(0.0)
            if parts and left > LEAST_PART * ropes.segment_length[r]:
                continue
            if node == 0 or node == ropes.nodes[r] - 1:
                if state.attached[w, r, half] == 0:
                    run_off(ropes, state, w, r, p)
            else:
                far = first + index - half
                following = element_at(state, ropes, w, r, index - side)
                is_free = straight_rest(ropes, state, w, r, p, far) > LEAST_PART * ropes.segment_length[r]
                if following >= 0:  # no room for a node where the next one is as near
                    tangent = wp.where(side > 0, state.wheels[w, p].arrives, state.wheels[w, p].leaves)
                    room = wp.length(nodes.x[w, ropes.first_node[r] + following] - tangent)
                    is_free = is_free and room > NEAREST * ropes.segment_length[r]
                    # Slack rope bends where it will: a node in it would make it straight, of energy out of nothing.
                    if ropes.bending_stiffness[w % ropes.bending_stiffness.shape[0], r] > wp.float64(0.0):
                        room += wp.float64(0.5) * on_wheel(ropes, state, w, p)
                        is_free = is_free and room > state.rest[w, far]
                if is_free:
                    pass_node(ropes, state, nodes, h, w, r, p, side)
            break
