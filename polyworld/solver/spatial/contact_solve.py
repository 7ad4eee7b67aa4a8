"""The solver of contact forces: non-penetration, exact Coulomb friction, rolling and spinning resistance.

Projected Gauss-Seidel over contacts (Moreau 1988; Jourdan, Alart & Jean 1998, Comput. Methods Appl. Mech. Eng.
155, 31), warm started and stopped when it has converged. Friction projects on the disc, not on a pyramid, and its
fixed point opposes the sliding velocity exactly. Where many sweeps are needed they are accelerated (`acceleration`).
"""

from typing import Any

import warp as wp

from polyworld.solver.core.friction import disc_impulse
from polyworld.solver.spatial.acceleration import begin_mixing, mix_sweeps
from polyworld.solver.spatial.constraints import ROWS
from polyworld.solver.spatial.contact_energy import gains_energy, lower_friction
from polyworld.solver.spatial.joint_layout import Joints
from polyworld.solver.spatial.layout import State
from polyworld.solver.spatial.rolling import solve_rolling, solve_spin

ITERATIONS = 200
CONVERGED = wp.float64(1.0e-5)  # largest change in a sweep that counts as none, of the slowest impact's speed
# Bodies wedged between others hold forces that cancel, which fall at a steady rate: sweeps end where so many more do
# not lower the largest change, and it is small.
PATIENCE = 10
LOWER = wp.float64(0.8)  # times what it was
SMALL = wp.float64(500.0)  # times what counts as none
TRIALS = 12  # of less friction
PLAIN_SWEEPS = 3  # before acceleration begins: what has converged by then is not worth the memory


def contact_solver(hold: Any, accelerated: bool) -> tuple[Any, Any]:
    """Return the functions `solve_manifolds` and `solve_contacts`, for a function `hold` that solves the joints.

    hold(joints, state, w, h, contacts) is visited in every sweep over so many manifolds and returns the largest
    velocity it changed. accelerated: whether contact impulses are all that changes velocities.
    """

    @wp.func(inline=False)
    def sweep(state: wp.array[State], w: int, first: int, last: int, offset: int, h: wp.float64) -> wp.float64:
        """Solve each contact of the manifolds [first, last) in turn; return the largest velocity changed [m/s]."""
        zero = wp.float64(0.0)
        bodies = state[0].bodies[w]
        manifolds = state[0].manifolds[w]
        contacts = state[0].contacts[w]
        rows = state[0].rows[w]
        worst = zero
        for i in range(first, last):
            a = manifolds[i].a
            b = manifolds[i].b
            friction = manifolds[i].friction
            torsion = manifolds[i].torsion
            rolling = manifolds[i].rolling
            start = manifolds[i].first
            ma = bodies[a].inverse_mass
            va = bodies[a].v
            wa = bodies[a].w
            mb = bodies[b].inverse_mass
            vb = bodies[b].v
            wb = bodies[b].w
            for c in range(start, start + manifolds[i].count):
                r = ROWS * (c - offset)
                d = rows[r].d
                apart = va - vb
                speed = wp.dot(d, apart) + wp.dot(rows[r].ja, wa) - wp.dot(rows[r].jb, wb)
                before = rows[r].impulse
                normal = wp.max(before + (contacts[c].target - speed) * rows[r].inverse_k, zero)
                change = normal - before
                x = rows[r + 1].impulse
                y = rows[r + 2].impulse
                bound = wp.max(friction * normal, contacts[c].stick_impulse)
                if change == zero and bound <= zero and x == zero and y == zero:
                    continue
                dx = rows[r + 1].d
                dy = rows[r + 2].d
                slip_x = wp.dot(dx, apart) + wp.dot(rows[r + 1].ja, wa) - wp.dot(rows[r + 1].jb, wb)
                slip_y = wp.dot(dy, apart) + wp.dot(rows[r + 2].ja, wa) - wp.dot(rows[r + 2].jb, wb)
                slip = wp.vec2d(slip_x, slip_y) + contacts[c].coupling_normal * change - contacts[c].target_velocity
                tangential = disc_impulse(wp.vec2d(x, y), slip, contacts[c].mass, contacts[c].relaxation, bound)
                change_x = tangential[0] - x
                change_y = tangential[1] - y
                impulse = d * change + dx * change_x + dy * change_y
                va += impulse * ma
                wa += rows[r].wa * change + rows[r + 1].wa * change_x + rows[r + 2].wa * change_y
                vb -= impulse * mb
                wb -= rows[r].wb * change + rows[r + 1].wb * change_x + rows[r + 2].wb * change_y
                rows[r].impulse = normal
                rows[r + 1].impulse = tangential[0]
                rows[r + 2].impulse = tangential[1]
                changed = wp.abs(change) * rows[r].k
                changed_x = wp.abs(change_x) * rows[r + 1].k
                changed_y = wp.abs(change_y) * rows[r + 2].k
                worst = wp.max(worst, wp.max(changed, wp.max(changed_x, changed_y)))
                if torsion > zero or rolling > zero:
                    bodies[a].v = va
                    bodies[a].w = wa
                    bodies[b].v = vb
                    bodies[b].w = wb
                    s = state[0].turning_rows + r
                    if torsion > zero:
                        changed = solve_spin(state, w, a, b, s, friction * normal * torsion)
                        worst = wp.max(worst, changed * torsion)
                    if rolling > zero:
                        turning = contacts[c].turning
                        if h <= zero:
                            turning = wp.vec2d()
                        coupling = contacts[c].coupling_rolling
                        changed = solve_rolling(state, w, a, b, s + 1, coupling, rolling * normal, turning)
                        worst = wp.max(worst, changed * rolling)
                    wa = bodies[a].w
                    wb = bodies[b].w
            bodies[a].v = va
            bodies[a].w = wa
            bodies[b].v = vb
            bodies[b].w = wb
        return worst

    @wp.func(inline=False)
    def solve_manifolds(
        joints: wp.array[Joints],
        state: wp.array[State],
        w: int,
        first: int,
        last: int,
        offset: int,
        iterations: int,
        converged: wp.float64,
        h: wp.float64,
    ) -> None:
        """Sweep over the manifolds [first, last) and all joints until no velocity changes any more.

        Normal velocities approach targets. h is the length of the step, 0 for an impact, in which finite forces do
        nothing.
        """
        contacts = state[0].contact_count[w, 0]
        if offset > 0:
            contacts = state[0].contact_count[w, 1]
        products = wp.mat44d()
        least = wp.float64(1.0e30)
        before = least
        for iteration in range(iterations):
            if wp.static(accelerated) and h > wp.float64(0.0) and iteration == PLAIN_SWEEPS:
                begin_mixing(state, w, contacts)
            changed = sweep(state, w, first, last, offset, h)
            worst = wp.max(changed, hold(joints, state, w, h, last - first))
            least = wp.min(least, worst)
            if worst < converged or iteration == iterations - 1:
                break
            if wp.static(accelerated) and h > wp.float64(0.0) and iteration >= PLAIN_SWEEPS:
                if iteration % PATIENCE == PATIENCE - 1:
                    if least > LOWER * before and worst < SMALL * converged:
                        break
                    before = least
                products = mix_sweeps(state, w, contacts, products)

    @wp.func
    def solve_contacts(joints: wp.array[Joints], state: wp.array[State], w: int, half: int, h: wp.float64) -> None:
        """Change the bodies' velocities at the end of a step of length h into admissible ones."""
        base = half * state[0].max_manifolds
        offset = half * state[0].max_contacts
        last = base + state[0].manifold_count[w, half]
        solve_manifolds(joints, state, w, base, last, offset, ITERATIONS, CONVERGED * state[0].slowest[w], h)
        if wp.static(accelerated):
            for _trial in range(TRIALS):
                if last == base or not gains_energy(state, w):
                    break
                lower_friction(state, w, base, last, offset)
                solve_manifolds(joints, state, w, base, last, offset, ITERATIONS, CONVERGED * state[0].slowest[w], h)

    return solve_manifolds, solve_contacts
