"""Anderson's acceleration of the sweeps of a contact solver.

A sweep maps impulses to better ones. The next starts from the mixture of what the last sweeps ended with for which
their changes, mixed by the same weights, are least (Anderson 1965, J. ACM 12, 547; Walker & Ni 2011, SIAM J. Numer.
Anal. 49, 1715); it makes the impulses admissible. Velocities are linear in impulses, so that one mixture serves both.
"""

import warp as wp

from polyworld.solver.spatial.constraints import ROWS
from polyworld.solver.spatial.layout import Row, State

SWEEPS = 4  # that are mixed
GROWN = wp.float64(4.0)  # times the least squared change, at which what was kept is of another set of contacts
DEPENDENT = wp.float64(1.0e-12)  # share of a squared change that is rounding


@wp.func
def impulses(rows: wp.array[Row], r: int) -> wp.vec3d:
    return wp.vec3d(rows[r].impulse, rows[r + 1].impulse, rows[r + 2].impulse)


@wp.func(inline=False)
def begin_mixing(state: wp.array[State], w: int, count: int) -> None:
    """Keep the impulses of so many contacts, from which the next sweep starts."""
    rows = state[0].rows[w]
    starts = state[0].mix_start[w]
    for c in range(count):
        starts[c] = impulses(rows, ROWS * c)
    if state[0].resisting[w] == 1:
        for c in range(state[0].max_contacts, state[0].max_contacts + count):
            starts[c] = impulses(rows, ROWS * c)
    state[0].mixed[w] = 0


@wp.func(inline=False)
def note_changes(state: wp.array[State], w: int, first: int, last: int, slot: int) -> wp.vec4d:
    """Keep what the last sweep did to the contacts [first, last); return its products with what sweeps did before."""
    rows = state[0].rows[w]
    starts = state[0].mix_start[w]
    ends = state[0].mix_end[w]
    changes = state[0].mix_change[w]
    total = wp.vec4d()
    for c in range(first, last):
        r = ROWS * c
        at = SWEEPS * c
        end = impulses(rows, r)
        change = end - starts[c]
        ends[at + slot] = end
        changes[at + slot] = change
        weighed = wp.vec3d(change[0] * rows[r].k, change[1] * rows[r + 1].k, change[2] * rows[r + 2].k)
        total += wp.vec4d(
            wp.dot(weighed, changes[at]),
            wp.dot(weighed, changes[at + 1]),
            wp.dot(weighed, changes[at + 2]),
            wp.dot(weighed, changes[at + 3]),
        )
    return total


@wp.func
def mixture(
    kept: wp.array[wp.vec3d], at: int, s0: wp.float64, s1: wp.float64, s2: wp.float64, s3: wp.float64
) -> wp.vec3d:
    return kept[at] * s0 + kept[at + 1] * s1 + kept[at + 2] * s2 + kept[at + 3] * s3


@wp.func(inline=False)
def set_mixture(state: wp.array[State], w: int, first: int, last: int, shares: wp.vec4d) -> None:
    """Set the impulses of the contacts [first, last)."""
    rows = state[0].rows[w]
    starts = state[0].mix_start[w]
    ends = state[0].mix_end[w]
    for c in range(first, last):
        r = ROWS * c
        new = mixture(ends, SWEEPS * c, shares[0], shares[1], shares[2], shares[3])
        starts[c] = new
        rows[r].impulse = new[0]
        rows[r + 1].impulse = new[1]
        rows[r + 2].impulse = new[2]


@wp.func(inline=False)
def set_velocities(state: wp.array[State], w: int, slot: int, shares: wp.vec4d) -> None:
    """Keep the velocities that the last sweep ended with, and mix them."""
    bodies = state[0].bodies[w]
    speeds = state[0].mix_v[w]
    spins = state[0].mix_w[w]
    for i in range(state[0].objects):
        at = SWEEPS * i
        speeds[at + slot] = bodies[i].v
        spins[at + slot] = bodies[i].w
        bodies[i].v = mixture(speeds, at, shares[0], shares[1], shares[2], shares[3])
        bodies[i].w = mixture(spins, at, shares[0], shares[1], shares[2], shares[3])


@wp.func
def least_change(products: wp.mat44d, slot: int, count: int) -> wp.vec4d:
    """Return the shares, of sum 1, of up to four sweeps for which their changes cancel best.

    products: of the changes with one another; slot: of the last sweep, count: how many are known.
    """
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    a = wp.mat33d()  # of the differences between the last change and those before
    b = wp.vec3d()
    for i in range(count - 1):
        p = (slot + SWEEPS - 1 - i) % SWEEPS
        b[i] = products[slot, slot] - products[slot, p]
        for j in range(count - 1):
            q = (slot + SWEEPS - 1 - j) % SWEEPS
            a[i, j] = products[slot, slot] - products[slot, p] - products[slot, q] + products[p, q]
    for i in range(3):  # Cholesky's factorisation; what depends on the others is left out
        least = DEPENDENT * (a[i, i] + products[slot, slot])
        for j in range(i):
            a[i, i] = a[i, i] - a[i, j] * a[i, j] * a[j, j]
            b[i] = b[i] - a[i, j] * b[j]
        for m in range(i + 1, 3):
            for j in range(i):
                a[m, i] = a[m, i] - a[m, j] * a[i, j] * a[j, j]
            if a[i, i] > least:
                a[m, i] = a[m, i] / a[i, i]
            else:
                a[m, i] = zero
        if a[i, i] > least:
            a[i, i] = a[i, i]
        else:
            a[i, i] = zero
    shares = wp.vec4d()
    shares[slot] = one
    x = wp.vec3d()
    for back in range(3):
        i = 2 - back
        if a[i, i] > zero:
            x[i] = b[i] / a[i, i]
            for m in range(i + 1, 3):
                x[i] = x[i] - a[m, i] * x[m]
        if i < count - 1:
            p = (slot + SWEEPS - 1 - i) % SWEEPS
            shares[p] = x[i]
            shares[slot] = shares[slot] - x[i]
    return shares


@wp.func(inline=False)
def mix_sweeps(state: wp.array[State], w: int, contacts: int, products: wp.mat44d) -> wp.mat44d:
    """Mix the impulses of so many contacts, and the velocities, of the last sweeps.

    Takes and returns the products of the sweeps' changes, squares of impulses times velocities per impulse [J].
    """
    known = state[0].mixed[w]
    turning = state[0].max_contacts
    slot = known % SWEEPS
    total = note_changes(state, w, 0, contacts, slot)
    if state[0].resisting[w] == 1:
        total += note_changes(state, w, turning, turning + contacts, slot)
    count = wp.min(known + 1, SWEEPS)
    least = total[slot]
    for p in range(SWEEPS):
        if p < count and p != slot:
            least = wp.min(least, products[p, p])
        products[slot, p] = total[p]
        products[p, slot] = total[p]
    shares = wp.vec4d()
    shares[slot] = wp.float64(1.0)
    if total[slot] > GROWN * least:
        count = 0
    else:
        shares = least_change(products, slot, count)
    state[0].mixed[w] = 0
    if count > 0:
        state[0].mixed[w] = known + 1
    set_mixture(state, w, 0, contacts, shares)
    if state[0].resisting[w] == 1:
        set_mixture(state, w, turning, turning + contacts, shares)
    set_velocities(state, w, slot, shares)
    return products
