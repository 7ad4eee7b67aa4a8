"""Find where simulated and measured motion disagree, name the missing effect, and prove what adding it is worth.

Read `method` first; then set_aside (outlying), search_loop (search, contest, moves), decide (model_error, stability),
checks, remainder, report. Wherever the extended BIC decides, it does by `ebic`: ranks effects in `contest`, drops them
in `search`, sets one against none in `search_loop`, and gives the verdict in `decide`.
"""

from polyworld.gap.method import GapSettings, find_gap
from polyworld.gap.report import GapReport

__all__ = ["GapReport", "GapSettings", "find_gap"]
