"""Every tuned number of the gap, with its reason; in nats of evidence, standard deviations of noise, or shares."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class GapSettings:
    """Settings of the search for the gap.

    Evidence. nats: difference of held-out scores within which two hypotheses are near: 100 to 1, since one name in a
    hundred may be wrong. share: of bootstrap resamplings in which a near one may be better, one standard error of a
    normal score. core: of bootstrap winners that must hold a law for it to be named. place_cost: nats beside one a
    parameter for a law with a place or a frequency: the logarithm of how many distinct ones a search looks through.
    state_cost: nats a coordinate that each run has of its own. bootstraps: resamplings, whose shares are then known to
    3 per cent.

    What counts. near_noise: held-out error in standard deviations of the noise up to which nothing is left: noise
    levels from few samples are off by a third. negligible: error over the extent of the motion that no model of a real
    scene undercuts. halved: ratio of errors that a law with a place or a clock must reach where noise is not reached.
    closed: ratio of errors, beyond the noise, that a name must reach on data held out. matters: ratio of errors below
    which a further law decides something, and share of a remainder that a richer answer may leave. plausible:
    departures from neutral, in those that physics makes ordinary, beyond which a hypothesis is impossible. gravity:
    relative, and level [rad]: tolerances to which gravity and the horizontal are known. alike: squared difference of
    two predictions over that of an effect below which they are one law: slow forcing stands in for a tilt within 4e-3,
    and is not. remainder: share of the variance beyond the noise, near which predictions are, that is no law of its
    own: laws of resistance hold to some per cent. noise_error: relative, of the noise as differences of a thousand
    samples give it. excluded: nats by which an impossible hypothesis has to be better for "nothing is missing" to be
    wrong, and one with a law for it not to be zero though its interval contains zero, and evidence that what a law
    leaves is correlated, from which on it is not named: twice `nats`.

    Search. depth: most laws together. branches: hypotheses of one depth that are extended. starts: of a law with
    places that are fitted. tried: hypotheses of one depth that are fitted to the end. samples: of a run that are
    fitted, so that twenty oscillations have a dozen each. brief, full: iterations of first and last fits. probe: share
    of an ordinary change by which score tests displace. worth: share of the best gain in fit that a hypothesis must
    have to be compared by prediction.

    Runs. fewest_runs: for which each run is one fold; folds: into which fewer runs are cut in all. outlying: times the
    median error, and the noise, beyond which a run is set aside. most_aside: share of runs that may be. soft:
    residuals, in robust standard deviations, that count linearly beyond. sealed_share: of the runs, or of the only
    run's time, that is sealed; a quarter costs the fit a seventh of its precision. sealed_runs: of which one can be
    spared; with two, the fit would rest on a single one. passes: of the search, each without the runs that the one
    before could not predict. sealed_instants: that each part of a divided run must keep, for a state of its own.
    time_limit [s]: after which the search ends with what it has. seed: of the bootstrap.
    """

    nats: float = 4.6
    share: float = 0.16
    core: float = 0.9
    place_cost: float = 2.0
    state_cost: float = 1.0
    bootstraps: int = 300
    near_noise: float = 1.5
    negligible: float = 0.005
    halved: float = 0.5
    closed: float = 0.5
    matters: float = 0.75
    plausible: float = 3.0
    gravity: float = 0.05
    level: float = 0.05
    alike: float = 2e-3
    remainder: float = 0.005
    noise_error: float = 0.02
    excluded: float = 9.0
    depth: int = 3
    branches: int = 2
    starts: int = 2
    tried: int = 10
    samples: int = 250
    brief: int = 4
    full: int = 12
    probe: float = 1e-2
    worth: float = 0.2
    fewest_runs: int = 4
    folds: int = 8
    outlying: float = 4.0
    most_aside: float = 0.34
    sealed_share: float = 0.25
    sealed_runs: int = 3
    sealed_instants: int = 12
    soft: float = 2.0
    passes: int = 3
    time_limit: float | None = None
    seed: int = 0
