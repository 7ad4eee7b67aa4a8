"""The catalogue of effects that may be missing: modules of this package tell theirs in `CANDIDATES`."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache

from polyworld.discrepancy.candidate import Candidate

# Groups in the order in which readers meet them; within a group, the order of its module.
_GROUPS = ("base", "force", "contact", "structure", "joint", "material", "observer")


def catalogue() -> dict[str, Candidate]:
    """Every candidate by name. Raises ValueError where two modules use one name."""
    return {c.name: c for c in _all()}


@cache
def _all() -> tuple[Candidate, ...]:
    found: dict[str, Candidate] = {}
    for module in sorted(m.name for m in pkgutil.iter_modules(__path__)):
        for candidate in getattr(importlib.import_module(f"{__name__}.{module}"), "CANDIDATES", ()):
            if candidate.name in found:
                raise ValueError(f"two candidates are called {candidate.name!r}; one is in {module}")
            found[candidate.name] = candidate
    return tuple(sorted(found.values(), key=lambda c: _GROUPS.index(c.group)))


__all__ = ["catalogue"]
