"""Kelvin-Voigt damping of stretch and shear over one inner step, stable however strong it is.

Explicit damping forces would need steps that shorten with the square of the element: for a delay of 10 ms some fifty
times shorter ones than elasticity does. The linear law dv/dt = a - M^-1 K_d v, with the shape and the acceleration a by
all other forces held still, is integrated over the step by Legendre stages instead (RKL2: Meyer, Balsara & Aslam
2014, J. Comput. Phys. 257, 594), whose number grows with the square root of the damping. They are second order in
the step, keep linear and angular momentum to rounding, damp every mode by a factor between 0 and 1, so that the
symplectic scheme stays stable, and end where a and damping balance, so that overdamped cloth creeps at its rate.

Velocities are those that positions change with, see `drift`. Held nodes take part with the velocity they are led
at; what damping does to them is added to their force, for those who ask what holds them.
"""

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.solver.cloth.layout import BLOCK, FLATTEST, OPTIONS, Damping, Surface, drift
from polyworld.solver.coupled.nodes import Clock, Nodes

wp.set_module_options(OPTIONS)


def stages_for(strength: NDArray[np.float64]) -> NDArray[np.int32]:
    """Number of stages, odd, for the product of step and largest damping rate; 0 where there is none.

    Stable up to (s^2 + s - 2) / 2.
    """
    least = np.ceil(0.5 * (np.sqrt(9.0 + 8.0 * strength) - 1.0)).astype(np.int32)
    odd = np.maximum(least, 3) | 1
    return np.where(strength > 0, odd, 0).astype(np.int32)


@wp.kernel
def begin_damping(clock: Clock, nodes: Nodes, damping: Damping) -> None:
    """Acceleration by the other forces, and the velocities before it."""
    w, k = wp.tid()
    h = clock.dt[w]
    if h <= wp.float64(0.0) or damping.stages[w] == 0:
        return
    for n in range(k * BLOCK, wp.min((k + 1) * BLOCK, damping.nodes.shape[0])):
        i = damping.nodes[n]
        inverse = nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i]
        push = nodes.f[w, i] * (inverse * wp.float64(nodes.active[w, i]))
        damping.push[w, n] = push
        u = drift(nodes.v[w, i], clock.gravity[w % clock.gravity.shape[0]], inverse, h) - push * h
        damping.start[w, n] = u
        damping.last[w, n] = u
        damping.force[w, n] = wp.vec3d()


@wp.func
def velocity(
    inverse_mass: wp.array2d[wp.float64], v_in: wp.array2d[wp.vec3d], damping: Damping, w: int, n: int
) -> wp.vec3d:
    if inverse_mass[w % inverse_mass.shape[0], damping.nodes[n]] == wp.float64(0.0):
        return damping.start[w, n]
    return v_in[w, n]


@wp.func
def add_damping_force(
    nodes: Nodes, v_in: wp.array2d[wp.vec3d], surface: Surface, damping: Damping, w: int, t: int
) -> None:
    two = wp.float64(2.0)
    c = damping.corners[t]
    g = surface.inverse_rest[t]
    f1 = damping.first[w, t]
    f2 = damping.second[w, t]
    u = damping.stretch[w, t]
    v0 = velocity(nodes.inverse_mass, v_in, damping, w, c[0])
    w1 = velocity(nodes.inverse_mass, v_in, damping, w, c[1]) - v0
    w2 = velocity(nodes.inverse_mass, v_in, damping, w, c[2]) - v0
    g1 = w1 * g[0, 0] + w2 * g[1, 0]
    g2 = w1 * g[0, 1] + w2 * g[1, 1]
    # Half the rate of C; the rate of U follows from it as S does from T, see forces.py.
    r11 = wp.dot(f1, g1)
    r22 = wp.dot(f2, g2)
    r12 = wp.float64(0.5) * (wp.dot(f1, g2) + wp.dot(f2, g1))
    j = wp.max(u[0] * u[1] - u[2] * u[2], FLATTEST)
    scale = wp.float64(1.0) / ((u[0] + u[1]) * j)
    a = u[1] * u[1]
    b = u[0] * u[0]
    d = u[2] * u[2]
    p = u[1] * u[2]
    q = u[0] * u[2]
    e11 = scale * ((j + a) * r11 - two * p * r12 + d * r22)
    e22 = scale * ((j + b) * r22 - two * q * r12 + d * r11)
    e12 = scale * ((j + u[0] * u[1] + d) * r12 - p * r11 - q * r22)
    m = surface.materials[w, surface.cloth[t]]
    t11 = m.stretch * e11 + m.cross * e22
    t22 = m.stretch * e22 + m.cross * e11
    t12 = m.shear * e12
    scale = scale * surface.area[t] * m.stretch_delay
    s11 = scale * ((j + a) * t11 - two * p * t12 + d * t22)
    s22 = scale * ((j + b) * t22 - two * q * t12 + d * t11)
    s12 = scale * ((j + u[0] * u[1] + d) * t12 - p * t11 - q * t22)
    p1 = f1 * s11 + f2 * s12
    p2 = f1 * s12 + f2 * s22
    k1 = p1 * g[0, 0] + p2 * g[0, 1]
    k2 = p1 * g[1, 0] + p2 * g[1, 1]
    wp.atomic_add(damping.force, w, c[0], k1 + k2)
    wp.atomic_add(damping.force, w, c[1], -k1)
    wp.atomic_add(damping.force, w, c[2], -k2)


@wp.kernel
def add_damping_forces(
    stage: int, clock: Clock, nodes: Nodes, v_in: wp.array2d[wp.vec3d], surface: Surface, damping: Damping
) -> None:
    """Damping forces at the velocities v_in, those of the stage before."""
    w, k = wp.tid()
    if clock.dt[w] <= wp.float64(0.0) or stage > damping.stages[w]:
        return
    for t in range(k * BLOCK, wp.min((k + 1) * BLOCK, surface.corners.shape[0])):
        add_damping_force(nodes, v_in, surface, damping, w, t)


@wp.func
def weight(j: int) -> wp.float64:
    """b_j of the scheme."""
    if j < 2:
        return wp.float64(1.0 / 3.0)
    x = wp.float64(j * (j + 1))
    return (x - wp.float64(2.0)) / (wp.float64(2.0) * x)


@wp.kernel
def take_stage(
    stage: int, clock: Clock, nodes: Nodes, v_in: wp.array2d[wp.vec3d], v_out: wp.array2d[wp.vec3d], damping: Damping
) -> None:
    """Stage j: from the start, the stages j - 1 (v_in) and j - 2 (v_out, which it replaces)."""
    w, k = wp.tid()
    h = clock.dt[w]
    s = damping.stages[w]
    if h <= wp.float64(0.0) or stage > s:
        return
    one = wp.float64(1.0)
    j = wp.float64(stage)
    step = wp.float64(4.0) / wp.float64(s * s + s - 2)
    b = weight(stage)
    mu = (wp.float64(2.0) * j - one) / j * b / weight(stage - 1)
    nu = -(j - one) / j * b / weight(wp.max(stage - 2, 0))
    late = -(one - weight(stage - 1)) * mu
    for n in range(k * BLOCK, wp.min((k + 1) * BLOCK, damping.nodes.shape[0])):
        a = damping.push[w, n] + damping.force[w, n] / nodes.mass[w % nodes.mass.shape[0], damping.nodes[n]]
        change = a * (h * step)
        damping.force[w, n] = wp.vec3d()
        if stage == 1:
            damping.rate[w, n] = change
            v_out[w, n] = damping.start[w, n] + change * b
        else:
            v_out[w, n] = (
                v_in[w, n] * mu
                + v_out[w, n] * nu
                + damping.start[w, n] * (one - mu - nu)
                + change * mu
                + damping.rate[w, n] * late
            )


@wp.kernel
def end_damping(clock: Clock, nodes: Nodes, damping: Damping) -> None:
    """Damped velocities of free nodes, and the force on held ones."""
    w, k = wp.tid()
    h = clock.dt[w]
    if h <= wp.float64(0.0) or damping.stages[w] == 0:
        return
    for n in range(k * BLOCK, wp.min((k + 1) * BLOCK, damping.nodes.shape[0])):
        i = damping.nodes[n]
        u = damping.other[w, n]  # the number of stages is odd: the last one wrote here
        if nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i] == wp.float64(0.0):
            nodes.f[w, i] = nodes.f[w, i] + (u - damping.start[w, n]) * (nodes.mass[w % nodes.mass.shape[0], i] / h)
        elif nodes.active[w, i] == 1:
            nodes.v[w, i] = u + clock.gravity[w % clock.gravity.shape[0]] * (wp.float64(0.5) * h)
