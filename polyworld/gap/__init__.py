"""Find where simulated and measured motion disagree, name the missing effect, and prove what adding it is worth.

Read `method` first; then set_aside (outlying), searching (search, contest, moves), decide (model_error, stability),
checks, remainder, report.
"""

from polyworld.gap.method import GapSettings, find_gap
from polyworld.gap.report import GapReport

__all__ = ["GapReport", "GapSettings", "find_gap"]
