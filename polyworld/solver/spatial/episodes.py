"""Contact episodes, written as they happen."""

import warp as wp

from polyworld.solver.core.episodes import Episode, Log, record_nearness, record_touch
from polyworld.solver.spatial.constraints import ROWS
from polyworld.solver.spatial.layout import State


@wp.func(inline=False)
def record_contacts(
    log: wp.array[Log], state: wp.array[State], w: int, k: int, half: int, time: wp.float64, h: wp.float64
) -> None:
    """Note every pair that carried a normal impulse in the step of length h that begins at `time`."""
    base = half * state[0].max_manifolds
    offset = half * state[0].max_contacts
    before_a = wp.int32(-1)
    before_b = wp.int32(-1)
    for i in range(base, base + state[0].manifold_count[k, half]):
        m = state[0].manifolds[k, i]
        impulse = wp.float64(0.0)
        centre = wp.vec3d()
        touching = wp.float64(0.0)
        for c in range(m.first, m.first + m.count):
            impulse += state[0].rows[k, ROWS * (c - offset)].impulse
            if state[0].contacts[k, c].gap <= m.close:
                centre += state[0].contacts[k, c].point
                touching += wp.float64(1.0)
        last = time
        if impulse > wp.float64(0.0):
            last = time + h
        impulse += m.impact
        state[0].manifolds[k, i].impact = wp.float64(0.0)
        state[0].manifolds[k, i].approach = wp.float64(0.0)
        if impulse <= wp.float64(0.0):
            if touching > wp.float64(0.0):
                record_nearness(log[0], w, m.a, m.b, last)
            continue
        touch = Episode()
        touch.a = m.a
        touch.b = m.b
        touch.begin = time
        touch.last = last
        touch.first_impulse = impulse
        touch.impulse = impulse
        if m.a != before_a or m.b != before_b:  # a pair's other manifolds add to its impulse alone
            touch.speed = m.approach
        before_a = m.a
        before_b = m.b
        touch.position = state[0].contacts[k, m.first].point
        if touching > wp.float64(0.0):
            touch.position = centre / touching
        record_touch(log[0], w, touch)
