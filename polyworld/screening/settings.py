"""Thresholds of the screening, in units of the noise or as shares of what is measured, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass

from polyworld.world.settings_checks import require_positive, require_shares

SHARES = (
    *("negligible", "agreeing", "refusing", "oblique", "hop_share", "overlap", "on_grid", "irregular_share"),
    *("repeated_share", "deep_share"),
)
FACTORS = ("unlike", "no_effect", "pixel_steps")  # above 1


@dataclass(frozen=True)
class ScreenSettings:
    """Thresholds of all checks; values must be positive, shares at most 1.

    In the order of the checks: all of them, free fall, sampling, courses, pixels and repeated rows, times, statics.
    """

    significant: float = 5.0  # standard errors that are not noise, of some hundred questions that a recording is asked
    moved: float = 8.0  # the same of a track's range, which for noise alone is 5 to 6
    negligible: float = 0.1  # part of a range, an acceleration or a number: what free fall and grids leave room for
    few_samples: int = 8  # of a moving object in a run; two states per axis and their covariance need twice as many

    unlike: float = 2.5  # ratio to gravity from which on units are asked for; drag and lift make tens of percent
    unit_tolerance: float = 0.25  # of the logarithm of that ratio, what drag may take off or lift add
    close_match: float = 0.08  # the same for factors below `no_effect`, which an effect might make by itself
    no_effect: float = 10.0
    constant: float = 0.35  # relative deviation of one acceleration: falls vary by drag, other motion by its whole size
    agreeing: float = 0.6  # share of windows and tracks that have to agree for a caution,
    refusing: float = 0.8  # and for a refusal
    bend: float = 0.03  # residual over height of a fall: drag that doubles an acceleration leaves 0.025, a bounce 0.1
    oblique: float = 0.94  # cosine, of 20 degrees, from which on a direction is that of an axis

    unresolved: float = 1.5  # mean squared step over variance: 2 of white noise, 1 of 6 samples an oscillation
    hops: int = 8  # samples in bounces shorter than the sampling interval,
    hop_share: float = 0.1  # and their share; every ball that comes to rest has some
    weakest: float = 0.1  # relative error of ordinary accelerations at which effects of tens of percent are lost

    same_course: float = 0.05  # rms difference over rms extent that a hand makes in repeating a launch
    same_place: float = 0.4  # of an offset, a tenth of the range, over which place and speed hardly separate
    shift: float = 0.25  # part of the shorter run by which clocks may differ
    overlap: float = 0.6  # least common part

    rounding_share: float = 0.5  # of the noise's deviation, a quarter of its variance, from which on rounding matters
    resolved: float = 1e-5  # part of the extent: finer rounding is that of the numbers themselves
    differences: int = 12  # that a grid is read from; off by less than `negligible` with probability 0.2 each
    on_grid: float = 0.95  # share of them that has to be
    multiples: int = 3  # of a step that differ, since a constant velocity has steps of one size too,
    changes: int = 6  # or changes between rest and a step
    pixel_steps: float = 3.0  # ratio of steps along a row, a column or a diagonal of pixels, seen at an angle
    conversions: int = 2  # numbers of frames for which a conversion of frame rates shows one
    repeated_share: float = 0.02  # of rows,
    repeated_least: int = 2  # and rows, from which on repeats are reported; single ones do no harm

    irregular: float = 0.1  # relative deviation of an interval from a multiple of the median one,
    irregular_share: float = 0.2  # and share of such intervals
    slow: float = 4.0  # [s] between samples above which times may be milliseconds, of 250 frames a second
    same_rate: float = 0.02  # relative difference from a usual camera's interval, for times in whole milliseconds

    deep: float = 0.1  # penetration over radius beyond noise; a cube's corners in motion capture reach 0.08
    deep_share: float = 0.01  # share,
    deep_least: int = 5  # and number of samples; contacts that compress a ball last a few

    def __post_init__(self) -> None:
        require_positive(self)
        require_shares(self, SHARES)
        if self.refusing < self.agreeing:
            raise ValueError(f"refusing ({self.refusing}) must not be below agreeing ({self.agreeing})")
        for name in FACTORS:
            if getattr(self, name) <= 1.0:
                raise ValueError(f"{name} is a factor above 1, got {getattr(self, name)!r}")


DEFAULT = ScreenSettings()
