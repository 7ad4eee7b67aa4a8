"""Forces on attachments to the world by the tension of ropes, which their own solver finds."""

import warp as wp

from polyworld.solver.coupled.attachment_layout import Fastenings, OnWorld
from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.rope.layout import Ropes, RopeState
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)


@wp.kernel
def resist_tensions(clock: Clock, nodes: Nodes, held: OnWorld, ropes: Ropes, state: RopeState, f: Fastenings) -> None:
    """Add the tensions of the links on both sides of a held node to its attachment's force."""
    w, k = wp.tid()
    i = held.node[k]
    a = held.attachment[k]
    if clock.dt[w] <= wp.float64(0.0) or f.released[w, a] == 1 or nodes.active[w, i] == 0:
        return
    for r in range(ropes.nodes.shape[0]):
        own = i - ropes.first_node[r]
        if own < 0 or own >= ropes.nodes[r]:
            continue
        first = ropes.first_link[r]
        for e in range(state.elements[w, r]):
            if state.order[w, first + r + e] != own:
                continue
            if e > 0:
                pull = state.direction[w, first + e - 1] * state.tension[w, first + e - 1]
                f.impulse[w, a] += pull * clock.dt[w]
            if e < state.elements[w, r] - 1:
                pull = state.direction[w, first + e] * state.tension[w, first + e]
                f.impulse[w, a] -= pull * clock.dt[w]
