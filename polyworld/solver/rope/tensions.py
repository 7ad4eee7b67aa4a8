"""Apply the tensions of ropes to nodes, ends and wheels, and average them over a step."""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.ends import end_node, push_end
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.rope.wheels import (
    move_carrier,
    push_wheel,
)
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)


@wp.func
def stop_load(ropes: Ropes, state: RopeState, v: wp.array2d[wp.vec3d], w: int, r: int, p: int) -> None:
    """Stop an end that has come to a wheel with what it carries, without rebound."""
    k = ropes.first_link[r] + state.wheels[w, p].index - 1
    n = state.direction[w, k]
    end = wp.int32(0)
    if state.wheels[w, p].blocked < 0:
        n = -state.direction[w, k + 1]
        end = 1
    approach = wp.dot(n, v[w, end_node(ropes, r, end)] - state.end_lag[w, r, end] - state.wheels[w, p].velocity)
    mobility = wp.dot(n, state.end_mobility[w, r, end] * n) + wp.dot(n, state.wheels[w, p].mobility * n)
    if approach > wp.float64(0.0) and mobility > wp.float64(0.0):
        impulse = n * (approach / mobility)
        push_end(ropes, state, v, w, r, end, -impulse)
        push_wheel(ropes, state, w, p, impulse)
        move_carrier(ropes, state, w, p)


@wp.func
def apply_tensions(ropes: Ropes, state: RopeState, nodes: Nodes, w: int, r: int, h: wp.float64) -> None:
    """Add the changes to the tensions, and their impulses to nodes, bodies and carriers."""
    first = ropes.first_link[r]
    order = first + r
    links = state.elements[w, r] - 1
    row = w % nodes.inverse_mass.shape[0]
    base = ropes.first_node[r]
    before = wp.vec3d()
    for k in range(links):
        change = state.change[w, first + k]
        state.tension[w, first + k] = state.tension[w, first + k] + change
        after = state.direction[w, first + k] * (change * h)
        impulse = after - before
        element = state.order[w, order + k]
        if element < 0:
            push_wheel(ropes, state, w, ropes.first_wheel[r] - 1 - element, impulse)
        elif k == 0:
            push_end(ropes, state, nodes.v, w, r, 0, impulse)
        else:
            i = base + element
            nodes.v[w, i] = nodes.v[w, i] + impulse * nodes.inverse_mass[row, i]
        before = after
    push_end(ropes, state, nodes.v, w, r, 1, -before)


@wp.func
def keep_outside(
    ropes: Ropes, state: RopeState, nodes: Nodes, h: wp.float64, w: int, r: int, p: int, side: int
) -> None:
    """Stop the inner node next to a wheel, before it (side -1) or after it, where it would go into it.

    Taut rope runs past the rim; a slack one may fall on it.
    """
    element = state.order[w, ropes.first_link[r] + r + state.wheels[w, p].index + side]
    if element <= 0 or element == ropes.nodes[r] - 1:
        return
    i = ropes.first_node[r] + element
    share = nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i]
    out = nodes.x[w, i] - state.wheels[w, p].centre
    out = out - state.wheels[w, p].axis * wp.dot(state.wheels[w, p].axis, out)
    distance = wp.length(out)
    if share <= wp.float64(0.0) or distance < wp.float64(1.0e-9):
        return
    n = out / distance
    room = wp.max(distance - ropes.wheel_radius[p], wp.float64(0.0))
    approach = -wp.dot(n, nodes.v[w, i] - state.wheels[w, p].velocity) - room / h
    if approach > wp.float64(0.0):
        impulse = n * (approach / (share + wp.dot(n, state.wheels[w, p].mobility * n)))
        nodes.v[w, i] = nodes.v[w, i] + impulse * share
        push_wheel(ropes, state, w, p, -impulse)


@wp.func
def calm_overloaded(ropes: Ropes, state: RopeState, nodes: Nodes, w: int, r: int, h: wp.float64) -> None:
    """Take away swing across links whose tension has just become more than the inner step resolves.

    After a snatch the next coupling step has more inner steps (`pace`); until then the nodes of a link whose swing is
    unstable, z^2 = h^2 T/l (1/m + 1/m') > 1, give up 1 - 1/z^2 of their relative velocity across it.
    """
    v = nodes.v
    first = ropes.first_link[r]
    order = first + r
    row = w % nodes.inverse_mass.shape[0]
    base = ropes.first_node[r]
    limit = ropes.segment_length[r] / (h * h)
    one = wp.float64(1.0)
    a = state.order[w, order]
    for k in range(state.elements[w, r] - 1):
        b = state.order[w, order + k + 1]
        if a >= 0 and b >= 0:
            ma = nodes.inverse_mass[row, base + a]
            mb = nodes.inverse_mass[row, base + b]
            z = state.tension[w, first + k] * (ma + mb)
            if z > limit:
                n = state.direction[w, first + k]
                apart = v[w, base + b] - v[w, base + a]
                swing = (apart - n * wp.dot(n, apart)) * ((one - limit / z) / (ma + mb))
                if a > 0 or state.attached[w, r, 0] == 0:
                    v[w, base + a] = v[w, base + a] + swing * ma
                if b < ropes.nodes[r] - 1 or state.attached[w, r, 1] == 0:
                    v[w, base + b] = v[w, base + b] - swing * mb
        a = b


@wp.kernel
def average_tensions(clock: Clock, tension: wp.array2d[wp.float64], mean: wp.array2d[wp.float64]) -> None:
    """Mean tension over the inner steps of a coupling step."""
    w, k = wp.tid()
    if clock.dt[w] > wp.float64(0.0):
        mean[w, k] = mean[w, k] + (tension[w, k] - mean[w, k]) / wp.float64(clock.inner[0] + 1)
