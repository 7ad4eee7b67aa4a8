"""Contact episodes, written as they happen."""

import warp as wp

from polyworld.solver.spatial.constraints import ROWS
from polyworld.solver.spatial.layout import Episode, Log, State


@wp.func(inline=False)
def record_contacts(
    log: wp.array[Log], state: wp.array[State], w: int, k: int, half: int, time: wp.float64, h: wp.float64
) -> None:
    """Note every pair that carried a normal impulse in the step of length h that begins at `time`."""
    base = half * state[0].max_manifolds
    offset = half * state[0].max_contacts
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
            continue
        episode = log[0].open[w, m.a, m.b]
        if episode >= 0 and time - log[0].episodes[w, episode].last <= log[0].merge:
            if time == log[0].episodes[w, episode].begin:  # another triangle of one mesh
                log[0].episodes[w, episode].first_impulse += impulse
            log[0].episodes[w, episode].impulse += impulse
            log[0].episodes[w, episode].last = last
            continue
        slot = log[0].count[w]
        log[0].count[w] = slot + 1
        if slot < log[0].episodes.shape[1]:
            e = Episode()
            e.a = m.a
            e.b = m.b
            e.begin = time
            e.last = last
            e.first_impulse = impulse
            e.impulse = impulse
            e.speed = m.approach
            if touching > wp.float64(0.0):
                e.position = centre / touching
            else:
                e.position = state[0].contacts[k, m.first].point
            log[0].episodes[w, slot] = e
            log[0].open[w, m.a, m.b] = slot
