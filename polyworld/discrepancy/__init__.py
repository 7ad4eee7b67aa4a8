"""Where simulated and measured motion disagree, which effect is missing, and what adding it is worth."""

from polyworld.discrepancy.gap import GapSettings, find_gap
from polyworld.discrepancy.report import GapReport

__all__ = ["GapReport", "GapSettings", "find_gap"]
