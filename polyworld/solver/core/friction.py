"""Coulomb friction of one contact point in space, the same between rigid bodies and on deformable ones."""

import warp as wp


@wp.func
def friction_impulse(impulse: wp.vec2d, slip: wp.vec2d, k: wp.vec3d, bound: wp.float64) -> wp.vec2d:
    """Return the tangential impulse in place of `impulse`, at which a contact slips with the velocity `slip`.

    It sticks if it can. Else a step along the velocity, by the same factor in both directions, is projected on the disc
    of radius `bound`: at the fixed point the impulse then opposes the velocity. k: velocity per impulse, xx, xy, yy.
    """
    x = impulse[0]
    y = impulse[1]
    det = k[0] * k[2] - k[1] * k[1]
    sx = x - (k[2] * slip[0] - k[1] * slip[1]) / det
    sy = y - (k[0] * slip[1] - k[1] * slip[0]) / det
    if sx * sx + sy * sy > bound * bound:
        mean = wp.float64(0.5) * (k[0] + k[2])
        half = wp.float64(0.5) * (k[0] - k[2])
        largest = mean + wp.sqrt(half * half + k[1] * k[1])
        sx = x - slip[0] / largest
        sy = y - slip[1] / largest
        size = wp.sqrt(sx * sx + sy * sy)
        if size > bound:
            sx = sx * bound / size
            sy = sy * bound / size
    return wp.vec2d(sx, sy)


@wp.func
def disc_impulse(
    impulse: wp.vec2d, slip: wp.vec2d, mass: wp.vec3d, relaxation: wp.float64, bound: wp.float64
) -> wp.vec2d:
    """As `friction_impulse`, for contacts that are visited often.

    mass: impulse per velocity, xx, xy, yy; relaxation: 1 over the largest velocity per impulse of any direction.
    """
    sx = impulse[0] - (mass[0] * slip[0] + mass[1] * slip[1])
    sy = impulse[1] - (mass[1] * slip[0] + mass[2] * slip[1])
    if sx * sx + sy * sy > bound * bound:
        sx = impulse[0] - slip[0] * relaxation
        sy = impulse[1] - slip[1] * relaxation
        square = sx * sx + sy * sy
        if square > bound * bound:
            shorter = bound / wp.sqrt(square)
            sx = sx * shorter
            sy = sy * shorter
    return wp.vec2d(sx, sy)
