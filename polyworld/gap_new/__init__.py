"""Find where simulated and measured motion disagree, name the missing effect, and prove what adding it is worth.

It selects laws by held-out prediction, and is to take the place of `polyworld.gap`, which the server still uses. Read
`method` first; then ground, hypothesis, propose, search, held_out, choose, set_aside, verdict, report.
"""

from polyworld.gap_new.method import find_gap
from polyworld.gap_new.report import GapReport
from polyworld.gap_new.settings import GapSettings

__all__ = ["GapReport", "GapSettings", "find_gap"]
