"""Number of inner steps of a coupling step: waves across a taut rope are explicit, and tension is not known before.

A node between links of tension T and length l swings across them at omega^2 of up to 2 (T/l + T'/l')/m (Gershgorin),
to which bending adds 16 EI/(rho L^4). The number of inner steps follows the mean tension of the coupling step before,
for each world alone, and never falls below the number the world began with. Rope that runs over a wheel goes no
further in one than a node is from the wheel where it passes it.
"""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.rope.wheels import BEYOND, NEAREST, on_wheel
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)

STEPS_PER_RADIAN = wp.constant(wp.float64(1.0 / 0.9))  # 0.45 of the longest stable step, 2/omega
REMEMBERED = wp.constant(
    wp.float64(0.5)
)  # time in which a past need is forgotten: what snatched once does so again [s]
MOST_STEPS = 1024  # a rope that asks for more is about to diverge


@wp.func
def fastest_swing(ropes: Ropes, state: RopeState, inverse_mass: wp.array2d[wp.float64], w: int, r: int) -> wp.float64:
    """Square of the highest angular frequency of one rope [1/s^2]."""
    first = ropes.first_link[r]
    order = first + r
    row = w % inverse_mass.shape[0]
    highest = wp.float64(0.0)
    thinnest = ropes.segment_length[r]  # length of a segment next to which rope bends
    before = wp.float64(0.0)
    shortest = wp.float64(0.05) * ropes.segment_length[r]
    for k in range(state.elements[w, r] - 1):
        b = state.order[w, order + k + 1]
        length = state.elongation[w, first + k] + state.rest[w, first + k]
        for side in range(2):
            element = state.order[w, order + k + side]
            if element < 0:
                p = ropes.first_wheel[r] - 1 - element
                length -= wp.float64(0.5) * on_wheel(ropes, state, w, p)
        if not (length > shortest):  # not a number where the rate is not known
            length = shortest
        if ropes.wheels[r] > 0:
            thinnest = wp.min(thinnest, wp.max(length, BEYOND * ropes.segment_length[r]))
        after = wp.max(state.mean_tension[w, first + k], wp.float64(0.0)) / length
        if k > 0:
            a = state.order[w, order + k]
            if a >= 0:
                highest = wp.max(highest, (before + after) * inverse_mass[row, ropes.first_node[r] + a])
        before = after
        if b < 0:
            before = wp.float64(0.0)
    density = ropes.linear_density[w % ropes.linear_density.shape[0], r]
    bending = ropes.bending_stiffness[w % ropes.bending_stiffness.shape[0], r]
    cell = ropes.segment_length[r] * ropes.segment_length[r]
    short = thinnest / ropes.segment_length[r]
    return wp.float64(2.0) * highest + wp.float64(16.0) * bending / (density * cell * cell * short * short)


@wp.kernel
def choose_inner_steps(clock: Clock, nodes: Nodes, ropes: Ropes, state: RopeState) -> None:
    """Before a coupling step: how many inner steps it has."""
    w = wp.tid()
    if clock.h[w] <= wp.float64(0.0):
        return
    if state.least_steps[w] == 0:
        state.least_steps[w] = clock.inner_steps[w]
    square = wp.float64(0.0)
    for r in range(ropes.nodes.shape[0]):
        if nodes.active[w, ropes.first_node[r]] == 1:
            square = wp.max(square, fastest_swing(ropes, state, nodes.inverse_mass, w, r))
    wanted = clock.h[w] * wp.sqrt(square) * STEPS_PER_RADIAN
    for r in range(ropes.nodes.shape[0]):
        for p in range(ropes.first_wheel[r], ropes.first_wheel[r] + ropes.wheels[r]):
            if state.wheels[w, p].index >= 0:
                flow = clock.h[w] * wp.abs(state.wheels[w, p].speed)
                wanted = wp.max(wanted, flow / (NEAREST * ropes.segment_length[r]))
    wanted = wp.min(wanted, wp.float64(MOST_STEPS))
    kept = state.need[w] * wp.exp(-clock.h[w] / REMEMBERED)
    if wanted > kept:
        kept = wanted
    state.need[w] = kept
    clock.inner_steps[w] = wp.max(state.least_steps[w], wp.int32(wp.ceil(kept)))
