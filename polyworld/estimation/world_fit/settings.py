"""Settings of the stages that fit a spatial world of rigid bodies, each number with its reason."""

from __future__ import annotations

from dataclasses import dataclass

from polyworld.estimation.fit_settings import SupportSettings as SupportSettings


@dataclass(frozen=True)
class PrefixSettings:
    """How to fit over growing stretches.

    starts: most starts tried. seed: of the further ones. stages: shares of the samples; the first shows initial states
    and seldom more than one contact. iterations: at most, in each stage; the last has all parameters to settle.
    tolerance: converged when an iteration gains less than this share of the loss, a hundredth of what `behind` decides
    on. behind: times the lowest loss over a stretch above which a further start is abandoned. scatter: standard
    deviations of a prior by which a further start departs, so that starts cover what the prior holds likely. distance:
    the same of distances from a camera. distances: starts that are added where such a distance is hardly known.
    """

    starts: int = 3
    seed: int = 0
    stages: tuple[float, ...] = (0.35, 0.7, 1.0)
    iterations: tuple[int, ...] = (6, 8, 16)
    tolerance: float = 1e-3
    behind: float = 1.1
    scatter: float = 1.0
    distance: float = 1.5
    distances: int = 8

    def __post_init__(self) -> None:
        if self.starts < 1:
            raise ValueError(f"starts must be at least 1, got {self.starts}")
        if len(self.stages) != len(self.iterations):
            raise ValueError(f"stages and iterations must be equally many, got {self.stages} and {self.iterations}")
        if list(self.stages) != sorted(self.stages) or self.stages[0] <= 0.0 or self.stages[-1] != 1.0:
            raise ValueError(f"stages must increase within (0, 1] and end at 1, got {self.stages}")
        if self.behind < 1.0:
            raise ValueError(f"behind must be at least 1, got {self.behind}")


@dataclass(frozen=True)
class AlternativeSettings:
    """How to search for other minima where the first start reaches the noise.

    draws: from the priors, judged by one rollout each: with 100, one in thirty of the prior's mass is met with 97%.
    descents: from the likeliest of them. iterations, tolerance: of each. same: deviations of a prior within which two
    outcomes are one minimum. extreme: deviations below and above the mean at which every friction starts in the
    slippery and in the rough world: nearly all of the prior lies between. least: share of the mean below which none
    starts.
    """

    draws: int = 100
    descents: int = 2
    iterations: int = 16
    tolerance: float = 1e-3
    same: float = 0.1
    extreme: float = 2.0
    least: float = 0.1


@dataclass(frozen=True)
class ResistanceSettings:
    """How to choose laws of resistance.

    iterations: of a law's fit, which begins at the optimum without it. step: of a law's range, by which its derivative
    at zero is taken: small beside what matters, large beside rounding. beyond: times its usual range that a law is
    fitted over, since on its bound it would lose to one that is not. worth_fitting: share of the needed gain that the
    score test must predict; it is linear, and errs on the low side.
    """

    iterations: int = 6
    step: float = 2e-3
    beyond: float = 5.0
    worth_fitting: float = 0.5


@dataclass(frozen=True)
class WideningSettings:
    """How to widen bounds.

    rounds, iterations: at most; three rounds widen a range by `wider` cubed. near: share of the width of its bounds
    within which a value lies on one, as `FittedValue.at_bound` has it. wider: factor by which a range grows, large
    enough that few rounds do and small enough that the scale of the search stays that of the parameter.
    """

    rounds: int = 3
    iterations: int = 8
    near: float = 0.01
    wider: float = 3.0


@dataclass(frozen=True)
class OutlyingSettings:
    """most: share of an object's frames up to which single ones are outlying; beyond it the fit is off."""

    most: float = 0.2


@dataclass(frozen=True)
class OrdinarySettings:
    """Means and standard deviations of priors of contacts, masses and spins.

    friction, restitution: dry contacts of wood, plastic, rubber, metal and felt mostly lie within two deviations.
    most_friction: rubber on rubber. rolling: of the radius, mean and deviation of the lever arm of rolling resistance,
    between steel on steel (0.001) and a soft ball on carpet (0.05); most_rolling: of the radius, a deflated ball. mass:
    deviation as a share of the mass at the density assumed: wood against plastic against a hollow body. surface_speed
    [m/s]: at the surface by a spin that is not observed, as a hand gives. slip: deviation of a spin as a share of the
    rolling one, of a body that may slide instead. reach: deviations within which a spin is searched. alike: bodies of
    one shape and size from which on they are taken for pieces of one set. joint: of the acceleration of gravity by dry
    friction, and [1/s] by damping, that a joint may cause; more stops it within a second.
    """

    friction: tuple[float, float] = (0.35, 0.2)
    restitution: tuple[float, float] = (0.5, 0.25)
    most_friction: float = 2.0
    rolling: float = 0.015
    most_rolling: float = 0.3
    mass: float = 0.6
    surface_speed: float = 0.5
    slip: float = 0.5
    reach: float = 6.0
    alike: int = 3
    joint: float = 0.3
