"""Names of other formats as names of a world."""

from __future__ import annotations

import re


class Names:
    """Gives each part a name of its own that a world may have: letters, digits, _ and -, at most 64."""

    def __init__(self) -> None:
        self._taken: set[str] = set()
        self.changed: list[str] = []

    def take(self, wanted: str, default: str) -> str:
        """Return `wanted` as a world may spell it, or `default` where it is empty, with a number where it is taken."""
        base = re.sub(r"[^A-Za-z0-9_\-]", "_", wanted).lstrip("_-")[:60] or default
        name, number = base, 2
        while name in self._taken:
            name, number = f"{base[:55]}_{number}", number + 1
        self._taken.add(name)
        if wanted and name != wanted:
            self.changed.append(f"{wanted!r} is called {name!r}")
        return name
