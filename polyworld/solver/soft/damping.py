"""Strong damping in few stages: an explicit method whose stable step grows with the square of their number.

RKL1 of Meyer, Balsara & Aslam (2014, J. Comput. Phys. 257, 594): s stages integrate dv/dt = a - D v over a step dt
stably while dt times the highest rate of D is at most s^2 + s. What the other forces did to the velocity in the step
is the constant a. Momentum is conserved exactly, which an implicit solution cut off early would not do.
"""

import warp as wp

from polyworld.solver.soft.material import Law
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)


@wp.struct
class Velocities:
    """Of the M nodes of soft bodies, (W, M): before the other forces acted, change by these, of the stage before the
    last, and the viscous force of this stage. node, body (M,): row of the node arrays, column of the laws."""

    node: wp.array[wp.int32]
    body: wp.array[wp.int32]
    start: wp.array2d[wp.vec3d]
    change: wp.array2d[wp.vec3d]
    last: wp.array2d[wp.vec3d]


@wp.kernel
def keep(keeping: Velocities, laws: wp.array2d[Law], v: wp.array2d[wp.vec3d]) -> None:
    """Note the velocities before the other forces act."""
    w, i = wp.tid()
    if laws[w % laws.shape[0], keeping.body[i]].stages > 0:
        keeping.start[w, i] = v[w, keeping.node[i]]


@wp.kernel
def begin(
    keeping: Velocities,
    laws: wp.array2d[Law],
    dt: wp.array[wp.float64],
    v: wp.array2d[wp.vec3d],
    f_out: wp.array2d[wp.vec3d],
) -> None:
    """Go back to the velocities before the other forces acted, and note what these did."""
    w, i = wp.tid()
    if dt[w] > wp.float64(0.0) and laws[w % laws.shape[0], keeping.body[i]].stages > 0:
        n = keeping.node[i]
        keeping.change[w, i] = v[w, n] - keeping.start[w, i]
        v[w, n] = keeping.start[w, i]
        keeping.last[w, i] = keeping.start[w, i]
        f_out[w, n] = wp.vec3d()


@wp.kernel
def finish_stage(
    keeping: Velocities,
    laws: wp.array2d[Law],
    stage: int,
    dt: wp.array[wp.float64],
    inverse_mass: wp.array2d[wp.float64],
    active: wp.array2d[wp.int32],
    v: wp.array2d[wp.vec3d],
    f: wp.array2d[wp.vec3d],
) -> None:
    """Velocities after stage j from those after j - 1 and j - 2; f (W, N) holds the viscous forces, and is cleared."""
    w, i = wp.tid()
    s = laws[w % laws.shape[0], keeping.body[i]].stages
    if dt[w] <= wp.float64(0.0) or stage > s:
        return
    n = keeping.node[i]
    j = wp.float64(stage)
    count = wp.float64(s)
    ahead = (wp.float64(2.0) * j - wp.float64(1.0)) / j
    part = ahead * wp.float64(2.0) / (count * count + count)
    g = dt[w] * inverse_mass[w % inverse_mass.shape[0], n] * wp.float64(active[w, n])
    now = v[w, n]
    v[w, n] = now * ahead + keeping.last[w, i] * (wp.float64(1.0) - ahead) + (keeping.change[w, i] + f[w, n] * g) * part
    keeping.last[w, i] = now
    f[w, n] = wp.vec3d()
