"""The settings of the gap's decision, each with its reason; what decides holds no tuned number elsewhere."""

from __future__ import annotations

from dataclasses import dataclass, fields

# Laws that are fitted and reported beside any richer answer, and preferred to it where a small remainder explains why.
PLAIN = (
    "gravity_error",
    "restitution_error",
    "friction_error",
    "rolling_resistance",
    "linear_drag",
    "quadratic_drag",
    "viscous_friction",
    "joint_damping",
    "joint_friction",
)


@dataclass(frozen=True)
class DecisionSettings:
    """How a verdict is reached.

    decisive: difference of the extended BIC beyond which a hypothesis is out of reach; 10 is "very strong" on the
    scale of Kass & Raftery (1995, J. Am. Stat. Assoc. 90, 773). reach: the same within which a runner-up that does not
    explain the data all the same contradicts a name; up to 2 is "not worth more than a bare mention" there. asked: the
    same beyond which predictions of held-out data are not asked, since their standard error is known from few folds.
    chance: probability below which a difference is not put down to noise. stable: share of the subsets, a quarter left
    out, in which an effect has to be chosen; nine in ten, as the benchmarks ask of a name. subsets: how many; 200 give
    that share to 2%. fewest_runs: distinct courses without which stability over runs cannot be measured: with two,
    leaving one out leaves nothing to compare. clearly: standard errors by which held-out data must be predicted better;
    doubly: the same for a hypothesis that the evidence puts behind. closed: share of the gap that effects other than
    plain laws have to close to be named with a remainder, and that a plain law has to close to be one that the answer
    may imitate: what leaves more than a quarter does not explain it. left: part of a cosine mode that fitted directions
    must leave for its energy to be an estimate of model error. rounds: of choosing a leader and estimating the model
    error from it; two settle it in the development cases.
    """

    decisive: float = 10.0
    reach: float = 2.0
    asked: float = 30.0
    chance: float = 1e-3
    stable: float = 0.9
    subsets: int = 200
    fewest_runs: int = 3
    clearly: float = 1.0
    doubly: float = 2.0
    closed: float = 0.75
    left: float = 0.3
    rounds: int = 4

    def __post_init__(self) -> None:
        _positive(self)
        if not self.stable <= 1.0:
            raise ValueError(f"stable is a share of subsets, at most 1; got {self.stable}")


@dataclass(frozen=True)
class OutlierSettings:
    """When runs or stretches of them are set aside.

    most: largest share of the runs that may be; with more, what they show is no exception. misfit: chi2 per measurement
    of a segment fitted by itself, beyond which it holds an event; a smooth force leaves less than 4 over a segment of a
    dozen samples in the development cases. apart: how many times the upper quartile of all segments that has to be, so
    that what happens in many runs is never an exception. jump: standard errors of a jump between segments that count as
    an event where `apart` holds, too. excess: the same factor for whole runs under the best law; explained: chi2 per
    measurement of most runs up to which that law is one to judge a run by: under a wrong law, runs differ by their
    speeds alone. leaders: laws that are refitted without the runs that they explain worst; light: times the noise at
    which such a run keeps an initial state of its own and has no say in what is shared. iterations: of the fits of
    single segments, before and after their unobserved spins are tried the other way round.
    """

    most: float = 0.25
    misfit: float = 6.0
    apart: float = 6.0
    jump: float = 12.0
    excess: float = 4.0
    explained: float = 3.0
    leaders: int = 3
    light: float = 30.0
    iterations: int = 5

    def __post_init__(self) -> None:
        _positive(self)
        if not self.most < 0.5:
            raise ValueError(f"most is a share of the runs below one half, so that the others decide; got {self.most}")


def _positive(settings: object) -> None:
    for field in fields(settings):  # type: ignore[arg-type]
        value = getattr(settings, field.name)
        if not value > 0:
            raise ValueError(f"{field.name} must be positive, got {value}")
