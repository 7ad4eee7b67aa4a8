"""Contact episodes, written as they happen."""

import warp as wp

from polyworld.solver.planar.records import Log, Row

wp.set_module_options({"enable_backward": False})


@wp.func
def touch(log: Log, w: wp.int32, row: Row, centre: wp.vec2d, time: wp.float64, impulse: wp.float64) -> None:
    """Note that a pair touches at `time` with the row's impact impulse and, over the step, `impulse` [N s]."""
    episode = log.open[w, row.a, row.b]
    total = impulse + row.impact_impulse
    if episode >= 0 and time - log.last[w, episode] <= log.merge:
        # The points of one step belong to one first impulse.
        if time == log.begin[w, episode]:
            log.first_impulse[w, episode] = log.first_impulse[w, episode] + total
            log.speed[w, episode] = wp.max(log.speed[w, episode], row.approach)
        log.impulse[w, episode] = log.impulse[w, episode] + total
        log.last[w, episode] = time
        return
    slot = log.count[w]
    log.count[w] = slot + 1
    if slot < log.begin.shape[1]:
        log.open[w, row.a, row.b] = slot
        log.pair[w, slot] = wp.vec2i(row.a, row.b)
        log.begin[w, slot] = time
        log.last[w, slot] = time
        log.first_impulse[w, slot] = total
        log.impulse[w, slot] = total
        log.speed[w, slot] = row.approach
        log.point[w, slot] = centre + row.arm_a
