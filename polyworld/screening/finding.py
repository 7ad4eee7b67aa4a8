"""Describe one finding of the screening in words and figures."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Severity = Literal["refuse", "caution"]

LISTED = 4  # names in a message, after which the rest are counted
MILLIMETRES = 0.1  # [m] below which lengths are written in millimetres


@dataclass(frozen=True)
class Finding:
    """A reason to doubt a recording before anything is fitted to it.

    kind: name of the check. message: one sentence with what seems wrong and what to do or to state otherwise. severity:
    `refuse` where going on is all but certainly a waste of time, else `caution`.
    """

    kind: str
    message: str
    severity: Severity = "caution"


def listed(names: Iterable[str]) -> str:
    """Join distinct names as `a, b and c`; of many the first, and how many more."""
    found = list(dict.fromkeys(names))
    if len(found) > LISTED + 1:
        return f"{', '.join(found[:LISTED])} and {len(found) - LISTED} more"
    return " and ".join((", ".join(found[:-1]), found[-1])) if len(found) > 1 else "".join(found)


def runs_listed(names: Iterable[str]) -> str:
    """Join names of runs, with the word `run` or `runs` before them."""
    found = list(dict.fromkeys(names))
    return f"run{'s' if len(found) > 1 else ''} {listed(found)}"


def length(metres: float) -> str:
    """Write a length [m] with its unit, in millimetres where it is short."""
    return f"{metres:.3g} m" if abs(metres) >= MILLIMETRES else f"{1e3 * metres:.3g} mm"
