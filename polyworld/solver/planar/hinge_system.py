"""The compliance matrix of all hinges: how the pivots part per unit impulse at each, and its direct solution.

A block Cholesky factorisation L D L^T with blocks of 2 x 2, by the pattern that `elimination` found.
"""

import warp as wp

from polyworld.solver.planar.records import Joints

wp.set_module_options({"enable_backward": False})

ZERO = wp.float64(0.0)
ONE = wp.float64(1.0)
RANK = wp.float64(1.0e-10)  # a pivot less than this, of what it was, is rounding: other hinges hold that direction


@wp.func
def sign_of(e: wp.int32) -> wp.float64:
    """Return the sign of a hinge's impulse on end e: it acts on the second, its opposite on the first."""
    return wp.where(e == 0, -ONE, ONE)


@wp.func
def assemble(
    count: wp.int32,
    ends: wp.int32,
    body: wp.array2d[wp.int32],
    active: wp.array[wp.int32],
    couplings: wp.array2d[wp.int32],
    arms: wp.array2d[wp.vec2d],
    mobility: wp.array[wp.vec2d],
    diagonal: wp.array[wp.vec3d],
    blocks: wp.array[wp.mat22d],
) -> None:
    """Write the matrix for these moment arms. mobility: change of a body's motion per unit force and moment."""
    for j in range(count):
        k = wp.vec3d(ONE, ZERO, ONE)
        if active[j] == 1:
            k = wp.vec3d()
            for e in range(ends):
                i = body[j, e]
                if i >= 0:
                    m = mobility[i]
                    arm = arms[j, e]
                    k += wp.vec3d(m[0] + m[1] * arm[1] * arm[1], -m[1] * arm[0] * arm[1], m[0] + m[1] * arm[0] * arm[0])
        diagonal[j] = k
    for b in range(blocks.shape[0]):
        blocks[b] = wp.mat22d()
    for t in range(couplings.shape[0]):
        r = couplings[t, 2]
        c = couplings[t, 4]
        if active[r] == 1 and active[c] == 1:
            m = mobility[couplings[t, 1]]
            p = arms[r, couplings[t, 3]]
            q = arms[c, couplings[t, 5]]
            sign = wp.where(couplings[t, 3] == couplings[t, 5], ONE, -ONE)
            b = couplings[t, 0]
            linear = sign * m[0]
            angular = sign * m[1]
            blocks[b] = blocks[b] + wp.mat22d(
                linear + angular * p[1] * q[1],
                -angular * p[1] * q[0],
                -angular * p[0] * q[1],
                linear + angular * p[0] * q[0],
            )


@wp.func
def factorise(
    order: wp.array[wp.int32],
    first_block: wp.array[wp.int32],
    block_row: wp.array[wp.int32],
    first_update: wp.array[wp.int32],
    updates: wp.array2d[wp.int32],
    diagonal: wp.array[wp.vec3d],
    blocks: wp.array[wp.mat22d],
    pivots: wp.array[wp.vec3d],
) -> None:
    """Replace the matrix by D^-1 and L.

    pivots: inverses of the larger, negative where of yy, and of the smaller, 0 where redundant; xy over the larger.
    """
    for j in range(order.shape[0]):
        pivots[j] = diagonal[j]
    for n in range(order.shape[0]):
        c = order[n]
        d = diagonal[c]
        # The larger pivot first, so that what a redundant direction gives up is taken by no impulse much larger.
        turned = d[2] > d[0]
        size = pivots[c]
        upper = ZERO
        if wp.max(d[0], d[2]) > RANK * wp.where(turned, size[2], size[0]):
            upper = ONE / wp.max(d[0], d[2])
        slope = d[1] * upper
        rest = wp.min(d[0], d[2]) - slope * d[1]
        lower = ZERO
        if rest > RANK * wp.where(turned, size[0], size[2]):
            lower = ONE / rest
        pivots[c] = wp.vec3d(upper, lower, slope)
        inverse = wp.vec3d(upper + slope * slope * lower, -slope * lower, lower)
        if turned:
            pivots[c] = wp.vec3d(-upper, lower, slope)
            inverse = wp.vec3d(lower, -slope * lower, upper + slope * slope * lower)
        diagonal[c] = inverse
        for u in range(first_update[n], first_update[n + 1]):
            left = blocks[updates[u, 1]]
            t = updates[u, 0]
            blocks[t] = blocks[t] - left * wp.mat22d(inverse[0], inverse[1], inverse[1], inverse[2]) * wp.transpose(
                blocks[updates[u, 2]]
            )
        for b in range(first_block[n], first_block[n + 1]):
            a = blocks[b]
            x0 = a[0, 0] * inverse[0] + a[0, 1] * inverse[1]
            x1 = a[0, 0] * inverse[1] + a[0, 1] * inverse[2]
            y0 = a[1, 0] * inverse[0] + a[1, 1] * inverse[1]
            y1 = a[1, 0] * inverse[1] + a[1, 1] * inverse[2]
            blocks[b] = wp.mat22d(x0, x1, y0, y1)
            r = block_row[b]
            diagonal[r] = diagonal[r] - wp.vec3d(
                x0 * a[0, 0] + x1 * a[0, 1], y0 * a[0, 0] + y1 * a[0, 1], y0 * a[1, 0] + y1 * a[1, 1]
            )


@wp.func
def substitute(
    order: wp.array[wp.int32],
    first_block: wp.array[wp.int32],
    block_row: wp.array[wp.int32],
    diagonal: wp.array[wp.vec3d],
    blocks: wp.array[wp.mat22d],
    pivots: wp.array[wp.vec3d],
    kept: wp.array[wp.vec2d],
    x: wp.array[wp.vec2d],
) -> None:
    """Replace the right-hand side x by the solution, which takes back what was `kept` in redundant directions."""
    count = order.shape[0]
    for n in range(count):
        v = x[order[n]]
        for b in range(first_block[n], first_block[n + 1]):
            a = blocks[b]
            r = block_row[b]
            x[r] = x[r] - wp.vec2d(a[0, 0] * v[0] + a[0, 1] * v[1], a[1, 0] * v[0] + a[1, 1] * v[1])
    for m in range(count):
        n = count - 1 - m
        c = order[n]
        d = diagonal[c]
        v = wp.vec2d(d[0] * x[c][0] + d[1] * x[c][1], d[1] * x[c][0] + d[2] * x[c][1])
        for b in range(first_block[n], first_block[n + 1]):
            a = blocks[b]
            y = x[block_row[b]]
            v = v - wp.vec2d(a[0, 0] * y[0] + a[1, 0] * y[1], a[0, 1] * y[0] + a[1, 1] * y[1])
        p = pivots[c]
        if p[1] == ZERO:
            if p[0] > ZERO:
                v = wp.vec2d(v[0] + p[2] * kept[c][1], -kept[c][1])
            elif p[0] < ZERO:
                v = wp.vec2d(-kept[c][0], v[1] + p[2] * kept[c][0])
            else:
                v = -kept[c]
        x[c] = v


@wp.func(inline=False)
def factorise_hinges(joints: wp.array[Joints], w: wp.int32, slot: wp.int32) -> None:
    """Assemble and factorise the matrix for the present moment arms and mobilities."""
    diagonal = joints[0].diagonal[slot]
    blocks = joints[0].blocks[slot]
    assemble(
        joints[0].count,
        joints[0].ends,
        joints[0].body,
        joints[0].active[w],
        joints[0].couplings,
        joints[0].moment_arm[w],
        joints[0].mobility[slot],
        diagonal,
        blocks,
    )
    factorise(
        joints[0].order,
        joints[0].first_block,
        joints[0].block_row,
        joints[0].first_update,
        joints[0].updates,
        diagonal,
        blocks,
        joints[0].pivots[slot],
    )


@wp.func
def find_gaps(joints: wp.array[Joints], motion: wp.array[wp.vec3d], w: wp.int32, slot: wp.int32) -> wp.float64:
    """Set the right-hand side to minus how the pivots part by these motions; return the largest."""
    largest = ZERO
    for j in range(joints[0].count):
        gap = wp.vec2d()
        if joints[0].active[w, j] == 1:
            for e in range(joints[0].ends):
                i = joints[0].body[j, e]
                if i >= 0:
                    m = motion[i]
                    arm = joints[0].moment_arm[w, j, e]
                    gap += wp.vec2d(m[0] - m[2] * arm[1], m[1] + m[2] * arm[0]) * sign_of(e)
        joints[0].change[slot, j] = -gap
        joints[0].kept[slot, j] = wp.vec2d()
        largest = wp.max(largest, wp.dot(gap, gap))
    return wp.sqrt(largest)


@wp.func(inline=False)
def solve_hinge_system(joints: wp.array[Joints], slot: wp.int32) -> None:
    """Replace the right-hand side by the impulses that bring the change which it asks for."""
    substitute(
        joints[0].order,
        joints[0].first_block,
        joints[0].block_row,
        joints[0].diagonal[slot],
        joints[0].blocks[slot],
        joints[0].pivots[slot],
        joints[0].kept[slot],
        joints[0].change[slot],
    )
