"""What a long run is at, for whoever waits: to standard error, so that the tables stay alone on standard output."""

from __future__ import annotations

import sys


def show(text: str) -> None:
    """Print a line at once."""
    print(f"... {text}", file=sys.stderr, flush=True)
