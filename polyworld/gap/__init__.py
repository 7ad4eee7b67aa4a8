"""Find the physical effect that a world lacks to explain measured motion.
Before any fit, `screen` checks the recording: units, axes, time base, sampling, distinct courses."""

from polyworld.gap.screen import Screening, screen
from polyworld.gap.screen_finding import Finding
from polyworld.gap.screen_settings import ScreenSettings

__all__ = ["Finding", "ScreenSettings", "Screening", "screen"]
