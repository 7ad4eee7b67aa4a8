"""Suggest a known word for one that is misspelt, or means the same."""

from __future__ import annotations

import difflib
from collections.abc import Iterable

NEAR = 0.65  # ratio of matching letters from which a word is meant: delete is not release
MEANT = {
    **dict.fromkeys(("touch", "touches", "hit", "hits", "collide", "contact"), "collides"),
    **dict.fromkeys(("delete", "erase"), "remove"),
}
LONGEST_WORD = 200  # characters compared: a longer word is none that is meant


def did_you_mean(word: str, known: Iterable[str]) -> str:
    """' (did you mean ...?)' where one of the known words is near, else nothing."""
    known = list(known)
    close = difflib.get_close_matches(word[:LONGEST_WORD], known, n=1, cutoff=NEAR)
    meant = MEANT.get(word.lower())
    near = meant if meant in known else next(iter(close), None)
    return f" (did you mean {near!r}?)" if near else ""
