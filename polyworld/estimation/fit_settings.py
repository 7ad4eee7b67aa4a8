"""Settings of fits: priors of constants, links between stretches, least squares, prediction; each with its reason."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

Gaussian = tuple[float, float]
# Mean coefficient against dry surfaces, and standard deviation of its logarithm, by words in the name of a material:
# ranges of engineering handbooks (Avallone, Baumeister & Sadegh, Marks' Handbook, 11th ed., section 3.2; the sliding
# coefficients of dry pairs with wood, stone, plastic and steel) taken for two deviations, and no less than a third,
# since the surface counts as much as the material that is named.
FRICTION_OF = {
    "rubber": (0.7, 0.35),
    "metal": (0.3, 0.35),
    "steel": (0.3, 0.35),
    "iron": (0.3, 0.35),
    "aluminium": (0.3, 0.35),
    "brass": (0.3, 0.35),
    "wood": (0.4, 0.35),
    "plastic": (0.3, 0.35),
    "glass": (0.35, 0.4),
    "ice": (0.04, 0.5),
}


@dataclass(frozen=True)
class PriorSettings:
    """Mean and standard deviation of what is ordinary, of logarithms where the name begins with `ln`."""

    ln_friction: Gaussian = (-0.92, 0.5)  # 0.4: dry contacts of wood, plastic, rubber, metal lie within two deviations
    friction_of: Mapping[str, Gaussian] = field(default_factory=lambda: FRICTION_OF)
    ln_departure: float = 0.25  # of a body from others whose materials were not stated either
    ln_surface: Gaussian = (-0.36, 0.5)  # 0.7: of the surface's own coefficient, which sets that of pairs of bodies
    restitution: Gaussian = (0.5, 0.15)
    # Of what has no faces or edges that chatter: clay 0.2, wood 0.6, rubber 0.8, glass and steel 0.9 and more.
    restitution_of_balls: Gaussian = (0.7, 0.2)
    linear_damping: float = 0.15  # [1/s] half-normal
    quadratic_damping: float = 0.1  # [1/m] half-normal: a ball of 4 cm in air has 0.15
    angular_damping: float = 0.15  # [1/s] half-normal
    joint_friction: float = 0.1  # of the weight held, half-normal: bearings and tracks are made to slide
    pin: float = 0.1  # radius of a hinge over the distance of what it holds: few are thicker
    joint_damping: float = 0.15  # [1/s] half-normal
    ln_mass: float = 0.6  # wood against plastic against a hollow body; of masses that were not given
    ln_rolling: Gaussian = (-4.6, 1.0)  # 0.01 of the radius: steel on steel has 0.002, a soft ball on carpet 0.07
    surface_speed: float = 0.5  # [m/s] at the surface by a spin that was not observed, as a hand gives
    slip: float = 0.35  # of the rolling spin, by which that of a supported ball may depart from rolling


@dataclass(frozen=True)
class SupportSettings:
    """When a surface supports a body.

    upward: cosine between its normal and the vertical below which nothing rests on it: friction of 1.7 and more would
    be needed. close: share of a body's half height by which its mean height may be off that of rest beyond its noise,
    since sizes and cameras are known no better. sigmas: standard errors within which heights and their trend are those
    of a body on the surface. flat: cosine within which a body's axis lies along or across the normal, 26 degrees, more
    than tracks err and less than half way to an edge. steady: samples looked at, as many as show a trend and no more
    than a free stretch usually has.
    """

    upward: float = 0.5
    close: float = 0.15
    sigmas: float = 4.0
    flat: float = 0.9
    steady: int = 12


@dataclass(frozen=True)
class LinkSettings:
    """Links between the stretches of a run that a collision separates.

    gain: chi-square by which two quadratics must beat one cubic about an instant for a velocity jump: a ninth of a
    sample's worth of noise does it once in a million instants. window: samples on either side. Bodies that take part
    keep their place to `place` [m] and their velocity to a share `jump` of the largest change of velocity, what rigid
    impact models are off by; the others to `close` [m] and `near` [m/s], hundredths of ordinary sizes and speeds. Their
    surfaces turn as exactly. again: frames within which a second contact of a pair is part of the same collision.
    passes: over the pulses that take the place of links in a fitted world: the first is exact where nothing resists and
    nothing is touched in the meantime.
    """

    gain: float = 40.0
    window: int = 10
    place: float = 0.03
    jump: float = 0.1
    close: float = 0.003
    near: float = 0.03
    again: int = 6
    passes: int = 3


@dataclass(frozen=True)
class ModelSettings:
    """tolerance: share of a body's size to which rigid bodies and simple contacts describe a path at best; added in
    quadrature to the measured noise. path: half width of the error of a predicted place, as a share of the distance
    travelled since the last fitted frame: chosen on yes/no questions about two rendered clips; 80%
    intervals of scenes by other engines then hold 84% a second later, and 44% without it."""

    tolerance: float = 0.002
    path: float = 0.04


@dataclass(frozen=True)
class DescentSettings:
    """Least squares.

    huber: standard deviations beyond which residuals count linearly. same: relative change of the residuals' scale that
    moves a minimum by less than its error. dampings: factors on Marquardt's parameter tried in one batch. least: of it,
    where steps have been good: below a thousandth of the curvature steps are Gauss and Newton's. rest: fall of
    chi-square, in squared scales, below which an iteration gains nothing; twice in a row ends a stage. step: share of a
    prior's deviation, or of a state's, by which derivatives are taken; wide: with deformable bodies, whose particles
    and contacts come and go. substep [s]: of spatial worlds while they are fitted: paths over a second then depart by a
    millimetre or less from those of finer steps. renewed: steps after which derivatives are taken by differences
    again, a secant's until then. few, seldom: dampings and renewed with deformable objects, whose rollouts take a
    second.
    """

    huber: float = 4.0
    same: float = 0.1
    dampings: tuple[float, ...] = (0.01, 0.1, 1.0, 10.0, 100.0, 1000.0)
    few: tuple[float, ...] = (0.1, 1.0, 100.0)
    least: float = 1e-3
    renewed: int = 1
    seldom: int = 6
    iterations: int = 25
    rest: float = 0.2
    step: float = 2e-3
    wide: float = 0.05
    substep: float = 0.008
    opening: int = 8  # samples of the first stage: they show initial states and seldom a contact
    stages: tuple[float, ...] = (0.35, 0.7, 1.0)


@dataclass(frozen=True)
class FitSettings:
    """Settings of all stages of a fit."""

    priors: PriorSettings = field(default_factory=PriorSettings)
    model: ModelSettings = field(default_factory=ModelSettings)
    links: LinkSettings = field(default_factory=LinkSettings)
    descent: DescentSettings = field(default_factory=DescentSettings)
