"""Thresholds of the screening, in units of the noise or as shares of what is measured, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass

from polyworld.world.settings_checks import require_positive, require_shares

SHARES = (
    *("negligible", "agreeing", "refusing", "oblique", "hop_share", "overlap", "on_grid", "irregular_share"),
    *("repeated_share", "deep_share"),
)


@dataclass(frozen=True)
class ScreenSettings:
    """Thresholds of all checks; values must be positive, shares at most 1.

    All checks
        significant: standard errors beyond which an estimate is not noise; 5, because a recording is asked some
        hundred questions. moved: the same of a track's range, which for noise alone is 5 to 6. negligible: part of a
        range, an acceleration or a number of samples below which there is none; a tenth is what free fall and grids
        leave room for. few_samples: of a moving object in a run; two states per axis and their covariance need twice as
        many.
    Free fall
        unlike: factor between acceleration and gravity from which on units are asked for; drag, wind and lift make
        tens of percent. unit_tolerance: of the logarithm of that factor, what drag may take off or lift add.
        close_match: the same for factors below `no_effect`, which an effect might make by itself. constant: relative
        deviation within which accelerations agree; free fall varies by its drag, other motion by its whole size.
        agreeing, refusing: shares of windows and tracks that have to agree for a caution and a refusal. bend: residual
        of a parabola, as a part of its height, that is still free fall; drag leaves 0.025 where the acceleration
        doubles within a window, a bounce 0.1 and more. oblique: cosine from which on a direction is that of an axis;
        0.94 is 20 degrees.
    Sampling
        unresolved: mean squared step over variance, from which on successive positions look independent: 2 for white
        noise, 1 for an oscillation of 6 samples a period. hops, hop_share: number and share of a run's samples in
        bounces shorter than the sampling interval; every ball that comes to rest has some.
        weakest: relative standard error of the ordinary acceleration at which effects of tens of percent are lost.
    Courses
        same_course: rms difference of two paths, as a part of their rms extent, that a hand makes in repeating a
        launch. same_place: the same of their offset, 0.4 of the rms extent being a tenth of the range, over which place
        and speed hardly separate. shift: part of the shorter run by which clocks may differ. overlap: least common
        part.
    Pixels and repeated rows
        rounding_share: part of the noise's standard deviation from which on rounding matters; a quarter of the
        variance. resolved: rounding finer than this part of the motion's extent is that of the numbers themselves.
        differences: other than zero that a grid is read from; off by less than `negligible` with probability 0.2 each.
        on_grid: share of them that has to be. multiples: different ones, or changes: between rest and a step, that a
        grid has to show, because a constant velocity has steps of one size too. pixel_steps: ratio of steps from pixel
        to pixel, along a row, a column or a diagonal, seen at an angle. conversions: numbers of frames for which a
        conversion of frame rates shows one. repeated_share: of rows, and repeated_least rows, from which on repeats are
        reported; single ones do no harm.
    Times
        irregular: relative deviation of an interval from a multiple of the median one; irregular_share: of intervals.
        slow: interval [s] above which times may be milliseconds, 250 frames a second. same_rate: relative difference
        of such an interval from that of a usual camera, for times in whole milliseconds.
    Statics
        deep: penetration as a part of the body's radius, in addition to `significant` noise; corners of a cube measured
        by motion capture reach 0.08 into their table. deep_share, deep_least: share and number of samples; contacts
        that compress a ball last a few samples.
    """

    significant: float = 5.0
    moved: float = 8.0
    negligible: float = 0.1
    few_samples: int = 8
    unlike: float = 2.5
    unit_tolerance: float = 0.25
    close_match: float = 0.08
    no_effect: float = 10.0
    constant: float = 0.35
    agreeing: float = 0.6
    refusing: float = 0.8
    bend: float = 0.03
    oblique: float = 0.94
    unresolved: float = 1.5
    hops: int = 8
    hop_share: float = 0.1
    weakest: float = 0.1
    same_course: float = 0.05
    same_place: float = 0.4
    shift: float = 0.25
    overlap: float = 0.6
    rounding_share: float = 0.5
    resolved: float = 1e-5
    differences: int = 12
    on_grid: float = 0.95
    multiples: int = 3
    changes: int = 6
    pixel_steps: float = 3.0
    conversions: int = 2
    repeated_share: float = 0.02
    repeated_least: int = 2
    irregular: float = 0.1
    irregular_share: float = 0.2
    slow: float = 4.0
    same_rate: float = 0.02
    deep: float = 0.1
    deep_share: float = 0.01
    deep_least: int = 5

    def __post_init__(self) -> None:
        require_positive(self)
        require_shares(self, SHARES)
        if self.refusing < self.agreeing:
            raise ValueError(f"refusing ({self.refusing}) must not be below agreeing ({self.agreeing})")
        for name in ("unlike", "no_effect", "pixel_steps"):
            if getattr(self, name) <= 1.0:
                raise ValueError(f"{name} is a factor above 1, got {getattr(self, name)!r}")


DEFAULT = ScreenSettings()
