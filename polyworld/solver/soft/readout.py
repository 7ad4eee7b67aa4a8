"""Readable quantities of soft bodies at one moment."""

import warp as wp

from polyworld.solver.soft import slices as flat
from polyworld.solver.soft.material import Law, softened, von_mises
from polyworld.solver.soft.solids import Elements, common_slopes, gathered, gradient
from polyworld.solver.spatial.layout import OPTIONS

wp.set_module_options(OPTIONS)


@wp.struct
class Readings:
    """Means over an element (W, q): von Mises Cauchy stress [Pa], equivalent Green strain [1], volume [m^3]."""

    stress: wp.array2d[wp.float64]
    strain: wp.array2d[wp.float64]
    volume: wp.array2d[wp.float64]


@wp.func
def equivalent_strain(f: wp.mat33d) -> wp.float64:
    """Von Mises equivalent sqrt(2/3 e : e) of the deviator e of Green strain."""
    e = (wp.transpose(f) * f) * wp.float64(0.5)
    t = wp.trace(e)
    return wp.sqrt(wp.float64(2.0 / 3.0) * wp.max(wp.ddot(e, e) - t * t / wp.float64(3.0), wp.float64(0.0)))


@wp.func
def read(
    w: int, t: int, f: wp.mat33d, undo: wp.mat33d, volume: wp.float64, part: wp.float64, m: Law, out: Readings
) -> None:
    """Add one point's share of its element's readings."""
    j = wp.determinant(f)
    size = wp.abs(j)
    stress = von_mises(f * undo, softened(undo, m)) / wp.where(size < wp.float64(0.05), wp.float64(0.05), size)
    out.stress[w, t] = out.stress[w, t] + stress * part
    out.strain[w, t] = out.strain[w, t] + equivalent_strain(f) * part
    out.volume[w, t] = out.volume[w, t] + j * volume


@wp.kernel
def read_solids(
    elements: Elements, laws: wp.array2d[Law], x: wp.array2d[wp.vec3d], undo: wp.array3d[wp.mat33d], out: Readings
) -> None:
    """Readings of tetrahedra; `out` was cleared. undo (W, q, 4), or (1, 1, 4) identities where nothing flows."""
    w, t = wp.tid()
    m = laws[w % laws.shape[0], elements.body[t]]
    c = gathered(x, w, elements.nodes, t)
    common = common_slopes(c)
    f0 = gradient(common, c.a0, c.m01, c.m02, c.m03, elements.slopes[t, 0])
    f1 = gradient(common, c.m01, c.a1, c.m12, c.m13, elements.slopes[t, 1])
    f2 = gradient(common, c.m02, c.m12, c.a2, c.m23, elements.slopes[t, 2])
    f3 = gradient(common, c.m03, c.m13, c.m23, c.a3, elements.slopes[t, 3])
    k = w % undo.shape[0]
    e = t % undo.shape[1]
    part = wp.float64(0.25)
    read(w, t, f0, undo[k, e, 0], elements.volume[t, 0], part, m, out)
    read(w, t, f1, undo[k, e, 1], elements.volume[t, 1], part, m, out)
    read(w, t, f2, undo[k, e, 2], elements.volume[t, 2], part, m, out)
    read(w, t, f3, undo[k, e, 3], elements.volume[t, 3], part, m, out)


@wp.kernel
def read_slices(
    slices: flat.Slices, laws: wp.array2d[Law], x: wp.array2d[wp.vec3d], undo: wp.array3d[wp.mat33d], out: Readings
) -> None:
    """Readings of triangles, as `read_solids`."""
    w, t = wp.tid()
    m = laws[w % laws.shape[0], slices.body[t]]
    for point in range(3):
        before = undo[w % undo.shape[0], t % undo.shape[1], point]
        elastic = flat.across(flat.gradient(x, w, slices, t, point) * before, slices.normal, m)
        f = elastic * wp.inverse(before)
        read(w, t, f, before, slices.volume[t, point], wp.float64(1.0 / 3.0), m, out)
