"""The catalogue of effects that may be missing: modules of this package tell theirs in `CANDIDATES`."""

from __future__ import annotations

import difflib
import importlib
import pkgutil
from collections.abc import Sequence
from functools import cache

from polyworld.estimation.candidate import Candidate

# Groups in the order in which readers meet them; within a group, the order of its module.
_GROUPS = ("base", "force", "contact", "structure", "joint", "material", "observer")


def catalogue() -> dict[str, Candidate]:
    """Every candidate by name. Raises ValueError where two modules use one name."""
    return {c.name: c for c in _all()}


def named(names: Sequence[str]) -> list[Candidate]:
    """The candidates of these names, each once. Raises ValueError naming the nearest and all choices."""
    known = catalogue()
    unknown = [name for name in dict.fromkeys(names) if name not in known]
    if unknown:
        near = [match for name in unknown for match in difflib.get_close_matches(name, known, n=1)]
        hint = f" (did you mean {', '.join(near)}?)" if near else ""
        raise ValueError(f"no effects {unknown}{hint}; effects: {', '.join(known)}")
    return [known[name] for name in dict.fromkeys(names)]


@cache
def _all() -> tuple[Candidate, ...]:
    found: dict[str, Candidate] = {}
    for module in sorted(m.name for m in pkgutil.iter_modules(__path__)):
        for candidate in getattr(importlib.import_module(f"{__name__}.{module}"), "CANDIDATES", ()):
            if candidate.name in found:
                raise ValueError(f"two candidates are called {candidate.name!r}; one is in {module}")
            found[candidate.name] = candidate
    return tuple(sorted(found.values(), key=lambda c: _GROUPS.index(c.group)))


__all__ = ["catalogue", "named"]
