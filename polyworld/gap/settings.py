"""The settings of the gap's decision, each with its reason; no other module of this package holds a tuned number."""

from __future__ import annotations

from dataclasses import dataclass, fields


@dataclass(frozen=True)
class SearchSettings:
    """How widely hypotheses are searched for.

    max_effects: added at most; sums of more mimic nearly anything. contenders: hypotheses fitted at each step; the
    right one was among the ten of largest predicted gain in all development cases. starts: of each that are tried.
    parents: hypotheses that a further effect is added to. few: contenders followed to the end where none explains the
    data. half: share of the best gain below which a contender is left after its first iterations. credible: difference
    of the extended BIC within which hypotheses stand side by side (10 is "very strong", Kass & Raftery 1995). close:
    the same before all is fitted with care. far, farther: chi2 per measurement of the parents, beyond which effects
    compete on segments, and on short ones; slopes of whole runs predict little there. nearly: the same below which
    short steps may be what is missing. rough: first iterations of a contender. rounds: of iterations to the end.
    onward: relative fall of chi2 for which a fit goes on.
    """

    max_effects: int = 3
    contenders: int = 10
    starts: int = 3
    parents: int = 3
    few: int = 3
    half: float = 0.5
    credible: float = 10.0
    close: float = 50.0
    far: float = 3.0
    farther: float = 10.0
    nearly: float = 5.0
    rough: int = 3
    rounds: int = 5
    onward: float = 0.01

    def __post_init__(self) -> None:
        _positive(self)


@dataclass(frozen=True)
class DecisionSettings:
    """How a verdict is reached.

    decisive: difference of the extended BIC beyond which a hypothesis is out of reach; 10 is "very strong" on the
    scale of Kass & Raftery (1995, J. Am. Stat. Assoc. 90, 773). reach: the same within which a runner-up that does not
    explain the data all the same contradicts a name; up to 2 is "not worth more than a bare mention" there. stable:
    share of the subsets, a quarter left out, in which an effect has to be chosen; nine in ten, as the benchmarks ask
    of a name. subsets: how many; 200 give that share to 2%. fewest_runs: distinct courses without which stability over
    runs cannot be measured: with two, leaving one out leaves nothing to compare. clearly: standard errors by which
    held-out data must be predicted better. closed: share of the gap that effects other than plain laws have to close
    to be named with a remainder: what leaves more than a quarter of it does not explain it.
    """

    decisive: float = 10.0
    reach: float = 2.0
    stable: float = 0.9
    subsets: int = 200
    fewest_runs: int = 3
    clearly: float = 1.0
    closed: float = 0.75

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
    that what happens in many runs is never an exception. excess: the same factor for whole runs under the best law;
    explained: chi2 per measurement of most runs up to which that law is one to judge a run by: under a wrong law, runs
    differ by their speeds alone.
    jump: standard errors of a jump between segments that count as an event where `apart` holds, too.
    """

    most: float = 0.25
    misfit: float = 6.0
    apart: float = 6.0
    excess: float = 4.0
    explained: float = 3.0
    jump: float = 12.0

    def __post_init__(self) -> None:
        _positive(self)
        if not self.most < 0.5:
            raise ValueError(f"most is a share of the runs below one half, so that the others decide; got {self.most}")


def _positive(settings: object) -> None:
    for field in fields(settings):  # type: ignore[arg-type]
        value = getattr(settings, field.name)
        if not value > 0:
            raise ValueError(f"{field.name} must be positive, got {value}")
