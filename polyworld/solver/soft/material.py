"""The law of soft bodies: a neo-Hookean solid that is finite under any deformation, may be viscous and may flow.

Energy per volume at rest, with F the deformation gradient, I = |F|^2 and J = det F:
mu/2 (I - 3) - mu/2 log(I + 1) + lam/2 (J - alpha)^2, of Smith, De Goes & Kim (2018, Stable Neo-Hookean Flesh
Simulation). It agrees with Hooke's law for small strain when mu = 4/3 G and lam = Lame's lambda + 5/6 G.

The last term stiffens with the fourth power of stretch. So that one time step serves any deformation, J there is
taken of stretches that saturate between `FREE` and `FULL`; smaller stretches are untouched.
"""

import warp as wp

FREE = wp.constant(wp.float64(1.3))  # principal stretch from which volume change counts less
FULL = wp.constant(wp.float64(1.6))  # principal stretch it counts as at most
VISCOUS_SQUARE = wp.constant(wp.float64(3.3))  # |F|^2 above which the viscous law grows no more; 3 at rest
SQUASHED = wp.constant(wp.float64(0.2))  # J below which nothing flows: the elements would degenerate
FLOWN = wp.constant(wp.float64(16.0))  # |Fp^-1|^2 beyond which nothing flows any more
SOFTENED = wp.constant(wp.float64(6.0))  # |Fp^-1|^2 beyond which moduli fall, as the elements' step would


@wp.struct
class Law:
    """Moduli of one body in one world [Pa], in the energy's form; alpha has no unit.

    lam is the sum of lam_mean, which resists the change of an element's volume, and lam_point, of each point's.
    viscous_shear, viscous_first: Lame's constants times the damping time [Pa s]. yield_stress: von Mises stress at
    which it flows, negative: never. stages: steps in which viscous forces are integrated, 0 for with the others.
    """

    mu: wp.float64
    lam_mean: wp.float64
    lam_point: wp.float64
    alpha: wp.float64
    viscous_shear: wp.float64
    viscous_first: wp.float64
    yield_stress: wp.float64
    stages: wp.int32


@wp.struct
class Response:
    """Of one point: shear, first Piola-Kirchhoff stress [Pa] without that of volume change; j, change of volume that
    counts; slope, its derivative by the deformation gradient."""

    shear: wp.mat33d
    slope: wp.mat33d
    j: wp.float64


@wp.func
def cofactor(f: wp.mat33d) -> wp.mat33d:
    """Derivative of det F by F."""
    r0 = wp.vec3d(f[0, 0], f[0, 1], f[0, 2])
    r1 = wp.vec3d(f[1, 0], f[1, 1], f[1, 2])
    r2 = wp.vec3d(f[2, 0], f[2, 1], f[2, 2])
    return wp.matrix_from_rows(wp.cross(r1, r2), wp.cross(r2, r0), wp.cross(r0, r1))


@wp.func
def saturated(stretch: wp.float64) -> wp.float64:
    """Return the stretch itself up to FREE, then smoothly towards FULL."""
    room = FULL - FREE
    return wp.where(stretch <= FREE, stretch, FREE + room * wp.tanh((stretch - FREE) / room))


@wp.func
def saturation(stretch: wp.float64) -> wp.float64:
    """Derivative of `saturated`."""
    t = wp.tanh((stretch - FREE) / (FULL - FREE))
    return wp.where(stretch <= FREE, wp.float64(1.0), wp.float64(1.0) - t * t)


@wp.func
def shear_modulus(square: wp.float64, m: Law) -> wp.float64:
    """Factor of F in the stress, with square = |F|^2."""
    return m.mu * (wp.float64(1.0) - wp.float64(1.0) / (square + wp.float64(1.0)))


@wp.func
def response(f: wp.mat33d, m: Law) -> Response:
    """Return the material's response to the deformation gradient f."""
    u = wp.vec3d(f[0, 0], f[1, 0], f[2, 0])
    v = wp.vec3d(f[0, 1], f[1, 1], f[2, 1])
    n = wp.vec3d(f[0, 2], f[1, 2], f[2, 2])
    uu = wp.dot(u, u)
    vv = wp.dot(v, v)
    nn = wp.dot(n, n)
    uv = wp.dot(u, v)
    vn = wp.dot(v, n)
    nu = wp.dot(n, u)
    square = uu + vv + nn
    r = Response()
    r.shear = f * shear_modulus(square, m)
    r.slope = cofactor(f)
    r.j = (f[0, 0] * r.slope[0, 0] + f[0, 1] * r.slope[0, 1]) + f[0, 2] * r.slope[0, 2]
    # A bound of the largest principal stretch that costs no eigenvalues: mean plus deviation of those of C.
    mean = square / wp.float64(3.0)
    two = wp.float64(2.0)
    deviation = uu * uu + vv * vv + nn * nn + two * (uv * uv + vn * vn + nu * nu) - square * mean
    room = FREE * FREE - mean
    if room < wp.float64(0.0) or deviation > wp.float64(1.5) * room * room:
        # With r_i = saturated(s_i) / s_i the saturated J is J r_1 r_2 r_3; its derivative is cof F times a tensor with
        # the principal directions v_i of C and the values r_j r_k saturation(s_i).
        q, squares = wp.eig3(wp.transpose(f) * f)
        small = wp.float64(1.0e-12)
        s0 = wp.sqrt(wp.max(squares[0], small))
        s1 = wp.sqrt(wp.max(squares[1], small))
        s2 = wp.sqrt(wp.max(squares[2], small))
        r0 = saturated(s0) / s0
        r1 = saturated(s1) / s1
        r2 = saturated(s2) / s2
        values = wp.vec3d(r1 * r2 * saturation(s0), r2 * r0 * saturation(s1), r0 * r1 * saturation(s2))
        r.slope = r.slope * (q * wp.diag(values) * wp.transpose(q))
        r.j = r.j * r0 * r1 * r2
    return r


@wp.func
def stress(r: Response, mean: wp.float64, m: Law) -> wp.mat33d:
    """First Piola-Kirchhoff stress [Pa] of a point whose element's mean change of volume is `mean`."""
    pressure = m.lam_mean * (mean - m.alpha) + m.lam_point * (r.j - m.alpha)
    return r.shear + r.slope * pressure


@wp.func
def viscous_stress(f: wp.mat33d, rate: wp.mat33d, m: Law) -> wp.mat33d:
    """Kelvin-Voigt stress [Pa]: Hooke's law of the rate of Green strain, as first Piola-Kirchhoff stress.

    Linear in the rate of f, zero for a rigid motion, and never a source of energy. Far stretched, f counts as
    scaled down, so that the law's stiffness stays bounded.
    """
    square = wp.ddot(f, f)
    scaled = f * wp.sqrt(VISCOUS_SQUARE / wp.max(square, VISCOUS_SQUARE))
    e = wp.transpose(scaled) * rate
    s = (e + wp.transpose(e)) * m.viscous_shear
    s = s + wp.identity(n=3, dtype=wp.float64) * (m.viscous_first * wp.trace(e))
    return scaled * s


@wp.func
def von_mises(f: wp.mat33d, m: Law) -> wp.float64:
    """Von Mises stress [Pa] of an elastic deformation gradient: of Kirchhoff stress, which is J times Cauchy's."""
    c = wp.transpose(f) * f
    square = wp.trace(c)
    deviation = wp.max(wp.ddot(c, c) - square * square / wp.float64(3.0), wp.float64(0.0))
    return shear_modulus(square, m) * wp.sqrt(wp.float64(1.5) * deviation)


@wp.func
def softened(undo: wp.mat33d, m: Law) -> Law:
    """Return the law where the plastic deformation has the inverse `undo`: what flowed far resists less, so that the
    stable step, which that deformation shortens, stays that of the body at rest."""
    n = m
    square = wp.ddot(undo, undo)
    if square > SOFTENED:
        part = SOFTENED / square
        n.mu = m.mu * part
        n.lam_mean = m.lam_mean * part
        n.lam_point = m.lam_point * part
    return n


@wp.func
def must_flow(elastic: wp.mat33d, m: Law) -> wp.bool:
    """Check whether a point with this elastic deformation gradient yields."""
    return von_mises(elastic, m) > m.yield_stress and wp.determinant(elastic) > SQUASHED


@wp.func
def flow(elastic: wp.mat33d, undo: wp.mat33d, m: Law) -> wp.mat33d:
    """Return the inverse of the plastic deformation after flow, `undo` before it, with elastic = F undo.

    Return mapping at constant volume: the deviator of the elastic logarithmic strain is scaled until the von Mises
    stress is the yield stress (Simo & Hughes 1998, Computational Inelasticity, chapter 9). What would then have
    flowed too far does not flow: the elements keep a shape that the time step suits.
    """
    v, squares = wp.eig3(wp.transpose(elastic) * elastic)
    small = wp.float64(1.0e-8)
    half = wp.float64(0.5)
    e = wp.vec3d(
        half * wp.log(wp.max(squares[0], small)),
        half * wp.log(wp.max(squares[1], small)),
        half * wp.log(wp.max(squares[2], small)),
    )
    mean = (e[0] + e[1] + e[2]) / wp.float64(3.0)
    d = e - wp.vec3d(mean, mean, mean)
    volume = wp.exp(mean)
    scale = wp.float64(1.0)
    for _ in range(8):  # the stress is nearly proportional to the scale
        left = wp.diag(wp.vec3d(wp.exp(scale * d[0]), wp.exp(scale * d[1]), wp.exp(scale * d[2])) * volume)
        scale = scale * wp.min(m.yield_stress / wp.max(von_mises(left, m), small), wp.float64(1.0) / scale)
    gone = (scale - wp.float64(1.0)) * d
    change = wp.diag(wp.vec3d(wp.exp(gone[0]), wp.exp(gone[1]), wp.exp(gone[2])))
    after = undo * (v * change * wp.transpose(v))
    if wp.ddot(after, after) > FLOWN:
        return undo
    return after


@wp.func
def flowed_strain(before: wp.mat33d, after: wp.mat33d) -> wp.float64:
    """Equivalent plastic strain [1] by which `flow` changed the inverse plastic deformation: sqrt(2/3) |log change|,
    with (change - 1 / change) / 2 for the logarithm."""
    e = (wp.inverse(before) * after - wp.inverse(after) * before) * wp.float64(0.5)
    return wp.sqrt(wp.float64(2.0 / 3.0) * wp.ddot(e, e))
