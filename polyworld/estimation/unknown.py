"""A number of the world that a fit may change."""

from __future__ import annotations

from dataclasses import dataclass

from polyworld.recording import Run


@dataclass(frozen=True)
class Unknown:
    """A number of the world that a fit may change.

    paths: parameter paths (`polyworld.parameters`) that take its value, all the same. start: its value where nothing
    is known, the neutral one for a missing effect. lower, upper: bounds. typical: a change of it that would be
    ordinary (the width of the prior), from which steps and the power check take their scale. run: the one run that it
    is of; in all others the paths keep the world's value. plausible: magnitude of the departure from `start` that
    physics makes ordinary, as the standard deviation of a normal prior; None where nothing is known.
    """

    name: str
    paths: tuple[str, ...]
    unit: str
    start: float
    lower: float
    upper: float
    typical: float
    run: str | None = None
    plausible: float | None = None

    def is_of(self, run: Run) -> bool:
        """Whether its value counts in a run, or in a window of a run."""
        return self.run in (None, run.window_of or run.name)
