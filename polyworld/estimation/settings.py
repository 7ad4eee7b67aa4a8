"""Settings of the gate and of the searches for initial states, each with its reason: one validated object a stage."""

from __future__ import annotations

from dataclasses import dataclass

from polyworld.world.settings_checks import require_positive, require_shares


@dataclass(frozen=True)
class GateSettings:
    """When a fit leaves only noise.

    level: share of good fits that may fail; a search must not raise one false alarm in a hundred. tests: of which the
    least p counts: of all modes, of the lowest, of the worst series (Bonferroni). lowest: modes in which most of what a
    model lacks shows; the fit of the state takes up two or three of them. line: probability below which a rhythm in
    higher modes is not put down to noise; lower than `level`, since every frequency is asked. loud: mean square, in
    noise variances, beyond which residuals are no noise of that level, whatever their course. left: part of a direction
    that the fit must have left for it to count. loose: by how much more than its error a correlation may be off, since
    it was drawn from much the same residuals. louder: most relative error of the power in low modes, where no
    correlation explains the residuals. edge: least relative error of a noise level.
    """

    level: float = 0.003
    tests: float = 3.0
    lowest: int = 5
    line: float = 1e-4
    loud: float = 9.0
    left: float = 0.15
    loose: float = 3.0
    louder: float = 0.5
    edge: float = 0.02

    def __post_init__(self) -> None:
        require_positive(self)
        require_shares(self, ("level", "line", "left"))


@dataclass(frozen=True)
class RefitSettings:
    """Which runs of a fit are fitted again by themselves, because their initial state is in a wrong local minimum.

    explained: chi2 per measurement of the worst of the better half of the runs, up to which the law explains these.
    Where it does, a run is ill whose chi2 is above theirs by `unlikely` standard deviations, and by the
    share `odd` even if it is long, since a law may be a little off. Elsewhere it is ill at `worse` times theirs. worth:
    chi2 by which a run has got worse that a step of the shared values left in another minimum. behind: chi2 by which
    the better half of the runs, taken twice, may be behind the best's where some fit ill. iterations: of a run by
    itself; stepwise: the same at each of many horizons.
    """

    explained: float = 1.5
    unlikely: float = 3.0
    odd: float = 0.25
    worse: float = 3.0
    worth: float = 10.0
    behind: float = 50.0
    iterations: int = 12
    stepwise: int = 6

    def __post_init__(self) -> None:
        require_positive(self)


@dataclass(frozen=True)
class ProjectionSettings:
    """Steps of shared values that the initial states of all runs follow (variable projection).

    hopeless: chi2 per measurement of the better half of the runs beyond which no step is tried. steps: at most. alike:
    standard errors within which two steps are one; little: below which a step is none. asked: runs that are left out in
    turn, at most: those without which the step would change most. followed: of the steps that result, those for which
    runs that got worse are fitted again; searches: such fits in all. gain: fall of chi2 for which it goes on.
    iterations: of a run by itself; together: of all runs after a step. rough: fall of chi2 below which a run is at
    rest.
    """

    hopeless: float = 10.0
    steps: int = 4
    alike: float = 0.5
    little: float = 0.1
    asked: int = 5
    followed: int = 2
    searches: int = 4
    gain: float = 2.0
    iterations: int = 5
    together: int = 4
    rough: float = 0.5

    def __post_init__(self) -> None:
        require_positive(self)


@dataclass(frozen=True)
class MultistartSettings:
    """How the initial state of one run is sought from many starts, where bodies collide.

    first: part of the run's time that is fitted before all else. stages: to the whole run, tried in turn; where one
    division ends in a wrong minimum, another may not. kept: states that are fitted side by side. drawn: states drawn
    around the best for each of these, of which the nearest to the data are fitted; widths: standard deviations in which
    they are drawn, in turn. unknown: the same before anything is fitted, in typical changes. iterations: at each stage;
    last: at the whole. rough, tolerance: fall of chi2 below which these are at rest. patterns: of the signs of
    unobserved spins at most, those with few flips first; all of six bodies. rounds: of them at most, since what a
    pattern leads to may be near to another. flipped: iterations for each pattern; finished: how many of them are fitted
    to the end.
    """

    first: float = 0.05
    stages: tuple[int, ...] = (14, 11, 17)
    kept: int = 3
    drawn: int = 100
    widths: tuple[float, ...] = (1.0, 2.0)
    unknown: float = 0.1
    iterations: int = 2
    last: int = 12
    rough: float = 1.0
    tolerance: float = 1e-2
    patterns: int = 64
    rounds: int = 2
    flipped: int = 3
    finished: int = 8

    def __post_init__(self) -> None:
        require_positive(self)
        require_shares(self, ("first",))


GATE, REFIT, PROJECTION, MULTISTART = GateSettings(), RefitSettings(), ProjectionSettings(), MultistartSettings()
