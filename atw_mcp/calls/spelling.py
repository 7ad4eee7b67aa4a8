"""Suggest a known word for one that is misspelt."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

NEAR = 0.65  # how alike words must be to be meant: delete is not release
LONGEST_WORD = 200  # characters compared: a longer word is none that is meant


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """' (did you mean ...?)' where one of the known words is near, else nothing."""
    close = difflib.get_close_matches(word[:LONGEST_WORD], list(known), n=1, cutoff=NEAR)
    return f" (did you mean {close[0]!r}?)" if close else ""
