"""Clock and motion of nodes and bodies in an inner step: forces that act on mass, velocities, positions."""

import warp as wp

from polyworld.solver.coupled.nodes import Clock, Nodes
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)

FASTEST = wp.constant(wp.float64(1.0e6))  # a node beyond this speed has diverged [m/s]


@wp.kernel
def begin_coupling_step(clock: Clock) -> None:
    clock.inner[0] = 0


@wp.kernel
def begin_inner_step(clock: Clock) -> None:
    """Length of the inner step that begins, 0 for a world that has taken all of its own."""
    w = wp.tid()
    clock.dt[w] = wp.float64(0.0)
    if clock.inner[0] < clock.inner_steps[w]:
        clock.dt[w] = clock.h[w] / wp.float64(clock.inner_steps[w])


@wp.kernel
def count_inner_step(clock: Clock) -> None:
    clock.inner[0] = clock.inner[0] + 1


@wp.kernel
def advance_time(clock: Clock) -> None:
    w = wp.tid()
    clock.time[w] = clock.time[w] + clock.h[w]


@wp.kernel
def external_forces(clock: Clock, nodes: Nodes, damping: wp.array2d[wp.float64], before: wp.array2d[wp.vec3d]) -> None:
    """Set the force on each node to its weight and linear damping; the stages add theirs. Notes its velocity."""
    w, i = wp.tid()
    if clock.dt[w] <= wp.float64(0.0):
        return
    before[w, i] = nodes.v[w, i]
    m = nodes.mass[w % nodes.mass.shape[0], i]
    c = damping[w % damping.shape[0], nodes.owner[i]]
    nodes.f[w, i] = (clock.gravity[w % clock.gravity.shape[0]] - c * nodes.v[w, i]) * m


@wp.kernel
def accelerate(clock: Clock, nodes: Nodes) -> None:
    """Velocities after the forces."""
    w, i = wp.tid()
    if clock.dt[w] <= wp.float64(0.0) or nodes.active[w, i] == 0:
        return
    u = nodes.v[w, i] + nodes.f[w, i] * (nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i] * clock.dt[w])
    nodes.v[w, i] = u - nodes.across * wp.dot(nodes.across, u)


@wp.kernel
def move(clock: Clock, nodes: Nodes) -> None:
    """Positions from velocities. Gravity acts half the step's end velocity, which makes free fall exact; as a constant
    shift of the velocity it leaves the symplectic Euler scheme what it is.
    """
    w, i = wp.tid()
    h = clock.dt[w]
    if h <= wp.float64(0.0) or nodes.active[w, i] == 0:
        return
    u = nodes.v[w, i]
    if nodes.inverse_mass[w % nodes.inverse_mass.shape[0], i] > wp.float64(0.0):
        u = u - clock.gravity[w % clock.gravity.shape[0]] * (wp.float64(0.5) * h)
    nodes.x[w, i] = nodes.x[w, i] + u * h


@wp.kernel
def activate(clock: Clock, nodes: Nodes, start: wp.array[wp.float64], scale: wp.array[wp.float64]) -> None:
    """Nodes take part from their object's start time on."""
    w, i = wp.tid()
    begins = start[nodes.owner[i]] * scale[w % scale.shape[0]]
    nodes.active[w, i] = wp.where(clock.time[w] >= begins - wp.float64(1.0e-9), 1, 0)


@wp.kernel
def find_divergence(clock: Clock, nodes: Nodes, node: wp.array[wp.int32], when: wp.array[wp.float64]) -> None:
    """First node of each world that is not finite or too fast, unless one was found before."""
    w = wp.tid()
    if node[w] >= 0:
        return
    for i in range(nodes.x.shape[1]):
        p = nodes.x[w, i]
        u = nodes.v[w, i]
        good = wp.isfinite(p[0]) and wp.isfinite(p[1]) and wp.isfinite(p[2]) and wp.length_sq(u) < FASTEST * FASTEST
        if not good:
            node[w] = i
            when[w] = clock.time[w]
            return
