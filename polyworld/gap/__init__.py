"""Find where simulated and measured motion disagree, name the missing effect, and prove what adding it is worth.

Read `method` first; then screen, outlying, searching, decide (model_error, stability), remainder, report.
"""

from polyworld.gap.method import GapSettings, find_gap
from polyworld.gap.report import GapReport
from polyworld.gap.screen import Screening, screen
from polyworld.gap.screen_finding import Finding
from polyworld.gap.screen_settings import ScreenSettings

__all__ = ["Finding", "GapReport", "GapSettings", "ScreenSettings", "Screening", "find_gap", "screen"]
