"""The settings of the gap's decision, each with its reason; what decides holds no tuned number elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from polyworld.world.settings_checks import require_positive


@dataclass(frozen=True)
class BaseSettings:
    """How the base is fitted, and when the noise is estimated again from what a fit leaves.

    iterations: of the fit that all others start from. rough: of the same at each horizon, before it is known how far
    from the data it is. far_off: chi2 per measurement beyond which where exactly a fit ends means nothing; such a fit
    goes on only while rough iterations leave less than `halved` of its chi2. refit, barely: iterations of a refit, and
    of one that is far off. refinements: of the noise after a fit, until chi2 changes by less than the share `changed`.
    level, correlation, outliers: relative change of a noise level, change of the correlation from sample to sample, and
    of the share of outlying samples, beyond which hypotheses are fitted again; less weighs no data otherwise.
    """

    iterations: int = 40
    rough: int = 5
    far_off: float = 1000.0
    halved: float = 0.5
    refit: int = 12
    barely: int = 2
    refinements: int = 2
    changed: float = 0.02
    level: float = 0.1
    correlation: float = 0.05
    outliers: float = 0.002

    def __post_init__(self) -> None:
        require_positive(self)


@dataclass(frozen=True)
class SearchSettings:
    """How widely hypotheses are searched for.

    How many
        max_effects: added at most; sums of more mimic nearly anything. contenders: hypotheses fitted at each step; the
        right one was among the ten of largest predicted gain in all development cases. few: contenders followed to the
        end where none explains the data, starts of each that are tried, hypotheses that a further effect is added to,
        and nested submodels tried in the place of each effect. impacts: starts of an effect at contacts at which
        chi2 itself is evaluated, since slopes predict nothing there. unknowns: of a law that acts everywhere alike;
        more would be one number for each run. paired: plain laws that are fitted in pairs. firsts: the same on a
        single coordinate. compared: hypotheses of each number of effects that are refitted to be compared.
    Differences of the extended BIC
        credible: within which hypotheses stand side by side (10 is "very strong", Kass & Raftery 1995). close: the
        same before all is fitted with care. single_coordinate: the same where one coordinate of one run was measured.
    chi2 per measurement
        near: below which a fit is near the data, and long steps may be why it fails. nearly: below which it is fitted
        to convergence. far, farther: of the parents, beyond which effects compete on segments, and on short ones;
        slopes of whole runs predict little there. far_colliding: in place of `far` where bodies collide.
    Shares
        half: of the best gain, below which a contender is left after its first iterations; of what is missing, that an
        effect beyond the second has to explain. one_run: of what is missing, that an effect in one run has to explain
        to be tried first. alike: of chi2, by which the residuals of two parents differ that are names for one motion.
        aside: times the least chi2 beyond which a plain law is not fitted to the end.
    Iterations
        rough: first ones of a contender. rounds: of iterations to the end. onward: relative fall of chi2 for which a
        fit goes on. care: of fits of plain laws.
    """

    max_effects: int = 3
    contenders: int = 10
    few: int = 3
    impacts: int = 12
    unknowns: int = 8
    paired: int = 4
    firsts: int = 6
    compared: int = 8
    credible: float = 10.0
    close: float = 50.0
    single_coordinate: float = 40.0
    near: float = 1.5
    nearly: float = 5.0
    far: float = 3.0
    farther: float = 10.0
    far_colliding: float = 1.06
    half: float = 0.5
    one_run: float = 0.75
    alike: float = 0.05
    aside: float = 4.0
    rough: int = 3
    rounds: int = 5
    onward: float = 0.01
    care: int = 24

    def __post_init__(self) -> None:
        require_positive(self)


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
        require_positive(self)
        if not self.stable <= 1.0:
            raise ValueError(f"stable is a share of subsets, at most 1; got {self.stable}")


@dataclass(frozen=True)
class OutlierSettings:
    """When runs or stretches of them are set aside.

    most: largest share of the runs that may be; with more, what they show is no exception. misfit: chi2 per measurement
    of a segment fitted by itself, beyond which it holds an event; a smooth force leaves less than 4 over a segment of a
    dozen samples in the development cases. exceptional: how many times the upper quartile of all segments that has to
    be, so that what happens in many runs is never an exception. excess: the same factor for whole runs under the best
    law; explained: chi2 per measurement of most runs up to which that law is one to judge a run by: under a wrong law,
    runs differ by their speeds alone. leaders: laws that are refitted without the runs that they explain worst; light:
    times the noise at which such a run keeps an initial state of its own and has no say in what is shared. iterations:
    of the fits of single segments.
    """

    most: float = 0.25
    misfit: float = 6.0
    exceptional: float = 6.0
    excess: float = 4.0
    explained: float = 3.0
    leaders: int = 3
    light: float = 30.0
    iterations: int = 5

    def __post_init__(self) -> None:
        require_positive(self)
        if not self.most < 0.5:
            raise ValueError(f"most is a share of the runs below one half, so that the others decide; got {self.most}")


@dataclass(frozen=True)
class LocaliseSettings:
    """How residuals are shared out, and what counts as a difference.

    clear: standard errors above noise from which on a level counts. parts: of every run's time; cells: of the region
    along each of its two longest sides: so few that each holds several modes of a run of a hundred samples. alarm:
    standard deviations by which the mean of a window of forecast errors announces an onset: once in a million windows
    of noise. windows: their lengths, as shares of the run's samples. after [s]: that count as just after a collision.
    lasting [s]: from which on a contact is more than a collision. grip: slip over speed, below which a ball rolls.
    named: absolute correlation of the residual's size with a quantity from which on that is named: 4% of the variance.
    """

    clear: float = 3.0
    parts: int = 6
    cells: int = 3
    alarm: float = 5.0
    windows: tuple[float, ...] = (1 / 48, 1 / 24, 1 / 12, 1 / 6)
    after: float = 0.1
    lasting: float = 0.05
    grip: float = 0.05
    named: float = 0.2


@dataclass(frozen=True)
class MapSettings:
    """How an effect with an edge is located by its strength in windows.

    windows: at most. iterations: of the fit to them; so short a window is nearly straight. samples: of each, by which
    it is counted how much of it lies inside. sure: standard deviations by which a window, or a disc, is significant.
    rough: relative error of a strength by its slope: friction ends the slide that it acts on. filled: share of a window
    that has to lie inside for the effect to show in full. bands: bounds of the radius in typical changes: small and
    large discs are sought separately. kept: discs of each band. overlap: share of the information that two of these
    must not have in common. damped: share of the strength estimated at which a fit begins: beyond its bound, as with
    less friction than none, there is no gradient. population, generations: of the search for discs.
    """

    windows: int = 512
    iterations: int = 4
    samples: int = 8
    sure: float = 4.0
    rough: float = 0.3
    filled: float = 0.4
    bands: tuple[float, ...] = (0.0, 1.2, 2.5, 5.0, np.inf)
    kept: int = 2
    overlap: float = 0.1
    damped: float = 0.7
    population: int = 40
    generations: int = 60


@dataclass(frozen=True)
class ZoomSettings:
    """How the start of an effect with a place or a rhythm is refined.

    levels: of refinement. kept: places that are refined at each. around: new ones around each. width: standard
    deviation of their distances in typical changes, halved at each level. separation: typical changes by which places
    that are kept differ.
    """

    levels: int = 3
    kept: int = 4
    around: int = 24
    width: float = 1.0
    separation: float = 0.1


@dataclass(frozen=True)
class HoldOutSettings:
    """Which part of a recording is held out.

    share: of the runs, or of the only run's time; a quarter costs the fit a seventh of its precision. fewest_runs: of
    which one can be spared; with two, the fit would rest on a single one. fewest_instants: that each part of a divided
    run must keep, for an initial state and a noise level of its own.
    """

    share: float = 0.25
    fewest_runs: int = 3
    fewest_instants: int = 12

    def __post_init__(self) -> None:
        require_positive(self)


@dataclass(frozen=True)
class ExperimentSettings:
    """Which experiments are tried, and when one decides.

    enough: separation in standard deviations of the noise that decides: an odds ratio of e^12 in a Gaussian likelihood.
    speeds: shares of the fastest start seen; laws that agree at one speed part at a multiple of it. slowest [m/s]: what
    counts as the fastest where nothing was thrown. headings, rises [rad]: directions of the start. lifts: heights of
    the start, as shares of the extent of the motion seen.
    """

    enough: float = 5.0
    speeds: tuple[float, ...] = (0.0, 1.0, 3.0)
    slowest: float = 0.5
    headings: tuple[float, ...] = (0.0, np.pi / 2, np.pi, 3 * np.pi / 2)
    rises: tuple[float, ...] = (0.0, np.pi / 4)
    lifts: tuple[float, ...] = (0.0, 1.0)


@dataclass(frozen=True)
class PowerSettings:
    """Define that an effect could have been seen.

    power: probability with which an effect of the strength reported is seen. alarm: by how much an effect must lower
    the extended BIC to be looked into, as in the search. starts: of an effect with a place or a rhythm, spread over all
    of its own, that are planted. corrections: of the strength, for effects that do not grow in proportion to it.
    """

    power: float = 0.95
    alarm: float = 10.0
    starts: int = 4
    corrections: int = 2

    def __post_init__(self) -> None:
        require_positive(self)
        if not self.power < 1.0:
            raise ValueError(f"power is a probability below 1; got {self.power}")


@dataclass(frozen=True)
class SymbolicSettings:
    """How the law of an unexplained force is sought.

    max_terms: of the law: three have up to eight numbers, as many as one expression holds. contenders: terms fitted
    in the simulator at each step, of those that the score test ranks. improvement: least fall of the extended BIC for
    one more term; less is "not worth more than a bare mention" (Kass & Raftery 1995). near: laws within this of the
    best are reported as alternatives; more is "very strong" evidence there. penalty: added for each factor that a term
    depends on, so that of laws that are indistinguishable the one that depends on less is chosen. loudest: times the
    variance seen in short differences of the data, beyond which what is left is no noise, whatever its course.
    same_noise: relative change of chi2 below which a refined noise changes no choice. steps: integration steps in all,
    after which no further law is tried: some minutes. rollout: steps that beginning a rollout costs as much as.
    """

    max_terms: int = 3
    contenders: int = 6
    improvement: float = 2.0
    near: float = 10.0
    penalty: float = 0.5
    loudest: float = 2.0
    same_noise: float = 0.02
    steps: float = 4e7
    rollout: float = 1e3

    def __post_init__(self) -> None:
        require_positive(self)
