"""Check a recording before anything is fitted to it: units, axes, time base, sampling, noise, distinct courses.

Read `checks` first; then tracks (grid), statics, free_fall, time_stamps, samples, courses.
"""

from polyworld.screening.checks import Screening, screen
from polyworld.screening.finding import Finding
from polyworld.screening.settings import ScreenSettings

__all__ = ["Finding", "ScreenSettings", "Screening", "screen"]
