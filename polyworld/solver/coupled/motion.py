"""Clock and motion of nodes and bodies in an inner step: forces that act on mass, velocities, positions."""

import warp as wp

from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)

FASTEST = wp.constant(wp.float64(1.0e6))  # a node beyond this speed has diverged [m/s]


@wp.kernel
def begin_coupling_step(
    inner: wp.array[wp.int32],
) -> None:
    inner[0] = 0


@wp.kernel
def begin_inner_step(
    h: wp.array[wp.float64],
    inner_steps: wp.array[wp.int32],
    inner: wp.array[wp.int32],
    dt: wp.array[wp.float64],
) -> None:
    """Length of the inner step that begins, 0 for a world that has taken all of its own."""
    w = wp.tid()
    dt[w] = wp.float64(0.0)
    if inner[0] < inner_steps[w]:
        dt[w] = h[w] / wp.float64(inner_steps[w])


@wp.kernel
def count_inner_step(inner: wp.array[wp.int32]) -> None:
    inner[0] = inner[0] + 1


@wp.kernel
def advance_time(h: wp.array[wp.float64], time: wp.array[wp.float64]) -> None:
    w = wp.tid()
    time[w] = time[w] + h[w]


@wp.kernel
def external_forces(
    dt: wp.array[wp.float64],
    gravity: wp.array[wp.vec3d],
    owner: wp.array[wp.int32],
    mass: wp.array2d[wp.float64],
    damping: wp.array2d[wp.float64],
    v: wp.array2d[wp.vec3d],
    f: wp.array2d[wp.vec3d],
    before: wp.array2d[wp.vec3d],
) -> None:
    """Set the force on each node to its weight and linear damping; the stages add theirs. Notes its velocity."""
    w, i = wp.tid()
    if dt[w] <= wp.float64(0.0):
        return
    before[w, i] = v[w, i]
    m = mass[w % mass.shape[0], i]
    c = damping[w % damping.shape[0], owner[i]]
    f[w, i] = (gravity[w % gravity.shape[0]] - c * v[w, i]) * m


@wp.kernel
def accelerate(
    dt: wp.array[wp.float64],
    inverse_mass: wp.array2d[wp.float64],
    active: wp.array2d[wp.int32],
    across: wp.vec3d,
    f: wp.array2d[wp.vec3d],
    v: wp.array2d[wp.vec3d],
) -> None:
    """Velocities after the forces; `across` is the unit normal of the motion plane, or zero in space."""
    w, i = wp.tid()
    if dt[w] <= wp.float64(0.0) or active[w, i] == 0:
        return
    u = v[w, i] + f[w, i] * (inverse_mass[w % inverse_mass.shape[0], i] * dt[w])
    v[w, i] = u - across * wp.dot(across, u)


@wp.kernel
def move(
    dt: wp.array[wp.float64],
    gravity: wp.array[wp.vec3d],
    inverse_mass: wp.array2d[wp.float64],
    active: wp.array2d[wp.int32],
    v: wp.array2d[wp.vec3d],
    x: wp.array2d[wp.vec3d],
) -> None:
    """Positions from velocities. Gravity acts half the step's end velocity, which makes free fall exact; as a constant
    shift of the velocity it leaves the symplectic Euler scheme what it is.
    """
    w, i = wp.tid()
    h = dt[w]
    if h <= wp.float64(0.0) or active[w, i] == 0:
        return
    u = v[w, i]
    if inverse_mass[w % inverse_mass.shape[0], i] > wp.float64(0.0):
        u = u - gravity[w % gravity.shape[0]] * (wp.float64(0.5) * h)
    x[w, i] = x[w, i] + u * h


@wp.kernel
def activate(
    time: wp.array[wp.float64],
    scale: wp.array[wp.float64],
    start: wp.array[wp.float64],
    owner: wp.array[wp.int32],
    active: wp.array2d[wp.int32],
) -> None:
    """Nodes take part from their object's start time on."""
    w, i = wp.tid()
    begins = start[owner[i]] * scale[w % scale.shape[0]]
    active[w, i] = wp.where(time[w] >= begins - wp.float64(1.0e-9), 1, 0)


@wp.kernel
def find_divergence(
    time: wp.array[wp.float64],
    x: wp.array2d[wp.vec3d],
    v: wp.array2d[wp.vec3d],
    node: wp.array[wp.int32],
    when: wp.array[wp.float64],
) -> None:
    """First node of each world that is not finite or too fast, unless one was found before."""
    w = wp.tid()
    if node[w] >= 0:
        return
    for i in range(x.shape[1]):
        p = x[w, i]
        u = v[w, i]
        good = wp.isfinite(p[0]) and wp.isfinite(p[1]) and wp.isfinite(p[2]) and wp.length_sq(u) < FASTEST * FASTEST
        if not good:
            node[w] = i
            when[w] = time[w]
            return
