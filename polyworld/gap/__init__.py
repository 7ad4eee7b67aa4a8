"""Find where simulated and measured motion disagree, name the missing effect, and prove what adding it is worth.

It selects laws by held-out prediction. Read `method` first; then ground, hypothesis, propose, search, cross_validation,
choose, set_aside, verdict, report.
"""

from polyworld.gap.method import find_gap
from polyworld.gap.report import GapReport
from polyworld.gap.settings import GapSettings

__all__ = ["GapReport", "GapSettings", "find_gap"]
