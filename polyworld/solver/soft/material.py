"""The elastic law of soft bodies: a neo-Hookean solid that is finite under any deformation.

Energy per volume at rest, with F the deformation gradient, I = |F|^2 and J = det F:
mu/2 (I - 3) - mu/2 log(I + 1) + lam/2 (J - alpha)^2, of Smith, De Goes & Kim (2018, Stable Neo-Hookean Flesh
Simulation). It agrees with Hooke's law for small strain when mu = 4/3 G and lam = Lame's lambda + 5/6 G.

The second term stiffens with the fourth power of stretch. So that one time step serves any deformation, J there is
taken of stretches that saturate between `SOFT_FROM` and `SOFT_TO`; all smaller stretches are untouched.
"""

import warp as wp

SOFT_FROM = wp.constant(wp.float64(1.3))  # principal stretch from which volume change counts less
SOFT_TO = wp.constant(wp.float64(1.6))  # principal stretch it counts as at most
# lam_point at most, in units of the shear modulus. Held to volume in every point, nearly incompressible bodies would
# bend too little; held to it on average only, one layer of elements would bend too much. Measured on cantilevers.
POINT_SHARE = wp.constant(wp.float64(2.25))
VISCOUS_SQUARE = wp.constant(wp.float64(3.0 * 1.2 * 1.2))  # |F|^2 above which the viscous law grows no more


@wp.struct
class Law:
    """Moduli [Pa] of one body in one world, in the energy's form; alpha without unit; tau: damping time [s].

    lam is the sum of lam_mean, which resists the change of an element's volume, and lam_point, of each point's.
    """

    mu: wp.float64
    lam_mean: wp.float64
    lam_point: wp.float64
    alpha: wp.float64
    tau: wp.float64


@wp.func
def law(youngs_modulus: wp.float64, poisson_ratio: wp.float64, tau: wp.float64) -> Law:
    """Moduli of the energy from those of Hooke's law."""
    shear = youngs_modulus / (wp.float64(2.0) * (wp.float64(1.0) + poisson_ratio))
    first = wp.float64(2.0) * shear * poisson_ratio / (wp.float64(1.0) - wp.float64(2.0) * poisson_ratio)
    m = Law()
    m.mu = wp.float64(4.0 / 3.0) * shear
    lam = first + wp.float64(5.0 / 6.0) * shear
    m.lam_point = wp.min(lam, POINT_SHARE * shear)
    m.lam_mean = lam - m.lam_point
    m.alpha = wp.float64(1.0) + shear / lam
    m.tau = tau
    return m


@wp.func
def cofactor(f: wp.mat33d) -> wp.mat33d:
    """Derivative of det F by F."""
    r0 = wp.vec3d(f[0, 0], f[0, 1], f[0, 2])
    r1 = wp.vec3d(f[1, 0], f[1, 1], f[1, 2])
    r2 = wp.vec3d(f[2, 0], f[2, 1], f[2, 2])
    return wp.matrix_from_rows(wp.cross(r1, r2), wp.cross(r2, r0), wp.cross(r0, r1))


@wp.func
def saturated(stretch: wp.float64) -> wp.float64:
    """The stretch itself up to SOFT_FROM, then smoothly towards SOFT_TO."""
    room = SOFT_TO - SOFT_FROM
    return wp.where(stretch <= SOFT_FROM, stretch, SOFT_FROM + room * wp.tanh((stretch - SOFT_FROM) / room))


@wp.func
def saturation(stretch: wp.float64) -> wp.float64:
    """Derivative of `saturated`."""
    t = wp.tanh((stretch - SOFT_FROM) / (SOFT_TO - SOFT_FROM))
    return wp.where(stretch <= SOFT_FROM, wp.float64(1.0), wp.float64(1.0) - t * t)


@wp.struct
class Response:
    """Of one point: shear, first Piola-Kirchhoff stress [Pa] without that of volume change; j, change of volume that
    counts; slope, its derivative by the deformation gradient."""

    shear: wp.mat33d
    slope: wp.mat33d
    j: wp.float64


@wp.func
def response(f: wp.mat33d, m: Law) -> Response:
    """What the deformation gradient f asks of the material."""
    c = wp.transpose(f) * f
    square = wp.trace(c)
    r = Response()
    r.shear = f * (m.mu * (wp.float64(1.0) - wp.float64(1.0) / (square + wp.float64(1.0))))
    r.slope = cofactor(f)
    r.j = (f[0, 0] * r.slope[0, 0] + f[0, 1] * r.slope[0, 1]) + f[0, 2] * r.slope[0, 2]
    # A bound of the largest principal stretch that costs no eigenvalues: mean plus deviation of those of C.
    mean = square / wp.float64(3.0)
    deviation = wp.max(wp.ddot(c, c) - square * mean, wp.float64(0.0))
    if mean + wp.sqrt(wp.float64(2.0 / 3.0) * deviation) > SOFT_FROM * SOFT_FROM:
        # With r_i = saturated(s_i) / s_i the saturated J is J r_1 r_2 r_3; its derivative is cof F times a tensor with
        # the principal directions v_i of C and the values r_j r_k saturation(s_i).
        v, squares = wp.eig3(c)
        small = wp.float64(1.0e-12)
        s0 = wp.sqrt(wp.max(squares[0], small))
        s1 = wp.sqrt(wp.max(squares[1], small))
        s2 = wp.sqrt(wp.max(squares[2], small))
        r0 = saturated(s0) / s0
        r1 = saturated(s1) / s1
        r2 = saturated(s2) / s2
        values = wp.vec3d(r1 * r2 * saturation(s0), r2 * r0 * saturation(s1), r0 * r1 * saturation(s2))
        r.slope = r.slope * (v * wp.diag(values) * wp.transpose(v))
        r.j = r.j * r0 * r1 * r2
    return r


@wp.func
def stress(r: Response, mean: wp.float64, m: Law) -> wp.mat33d:
    """First Piola-Kirchhoff stress [Pa] of a point whose element's mean change of volume is `mean`."""
    pressure = m.lam_mean * (mean - m.alpha) + m.lam_point * (r.j - m.alpha)
    return r.shear + r.slope * pressure


@wp.func
def viscous_stress(f: wp.mat33d, rate: wp.mat33d, m: Law) -> wp.mat33d:
    """Kelvin-Voigt stress [Pa]: tau times Hooke's law of the rate of Green strain, as first Piola-Kirchhoff stress.

    Linear in the rate of f, zero for a rigid motion, and never a source of energy. Far stretched, f counts as
    scaled down, so that the law's stiffness stays bounded.
    """
    square = wp.ddot(f, f)
    scaled = f * wp.sqrt(wp.min(wp.float64(1.0), VISCOUS_SQUARE / square)) if square > VISCOUS_SQUARE else f
    e = wp.transpose(scaled) * rate
    strain = (e + wp.transpose(e)) * wp.float64(0.5)
    shear = wp.float64(0.75) * m.mu
    first = m.lam_mean + m.lam_point - wp.float64(0.625) * m.mu
    s = strain * (wp.float64(2.0) * shear) + wp.identity(n=3, dtype=wp.float64) * (first * wp.trace(strain))
    return scaled * s * m.tau
