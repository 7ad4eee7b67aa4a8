"""Catalogue what may be missing: effects of `polyworld.effects`, and what is wrong with the world or its observer."""

from __future__ import annotations

import difflib
import importlib
import pkgutil
from collections.abc import Sequence
from functools import cache

from polyworld.gap import faults
from polyworld.gap.candidate import Candidate
from polyworld.gap.effect_candidates import effect_candidates

# Groups in the order in which readers meet them; within a group, candidates stand as their modules are named.
_GROUPS = ("base", "force", "contact", "structure", "joint", "material", "observer")


def catalogue() -> dict[str, Candidate]:
    """Return every candidate by name. Raises ValueError where two modules use one name."""
    return {c.name: c for c in _all()}


def named(names: Sequence[str]) -> list[Candidate]:
    """Return the candidates of these names, each once. Raises ValueError naming the nearest and all choices."""
    known = catalogue()
    unknown = [name for name in dict.fromkeys(names) if name not in known]
    if unknown:
        near = [match for name in unknown for match in difflib.get_close_matches(name, known, n=1)]
        hint = f" (did you mean {', '.join(near)}?)" if near else ""
        raise ValueError(f"no effects {unknown}{hint}; effects: {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)]


@cache
def _all() -> tuple[Candidate, ...]:
    found = list(effect_candidates())
    for module in sorted(m.name for m in pkgutil.iter_modules(faults.__path__)):
        found += getattr(importlib.import_module(f"{faults.__name__}.{module}"), "CANDIDATES", ())
    names = [c.name for c in found]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise ValueError(f"several candidates are called {', '.join(twice)}")
    return tuple(sorted(found, key=lambda c: _GROUPS.index(c.group)))


__all__ = ["catalogue", "named"]
