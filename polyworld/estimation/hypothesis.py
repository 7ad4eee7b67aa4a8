"""A hypothesis: none, one or several missing effects put into a world, and where its fit begins."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.candidate import Candidate, Variant
from polyworld.estimation.unknown import Unknown
from polyworld.world import World
from polyworld.world.parameters import with_parameters

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Part:
    """One effect of a hypothesis and the way it is put into the world."""

    candidate: Candidate
    variant: Variant


@dataclass(frozen=True)
class Hypothesis:
    """Base unknowns, and effects on top of them. world: with all of the effects in it, each doing nothing yet."""

    world: World
    base: tuple[Unknown, ...]
    parts: tuple[Part, ...] = ()

    @property
    def unknowns(self) -> tuple[Unknown, ...]:
        """Everything that is fitted besides initial states: the base's, then each effect's."""
        return (*self.base, *(u for part in self.parts for u in part.variant.unknowns))

    @property
    def names(self) -> tuple[str, ...]:
        """Standard names of its effects."""
        return tuple(part.candidate.name for part in self.parts)

    @property
    def extra(self) -> int:
        """Number of unknowns beyond the base's."""
        return len(self.unknowns) - len(self.base)

    @property
    def title(self) -> str:
        """For readers: "quadratic_drag + tilt", or "base"."""
        return " + ".join(_titled(part) for part in self.parts) or "base"

    def of_part(self, index: int, values: Array) -> dict[str, float]:
        """Return values of one part's unknowns by name, of all shared values (S,)."""
        start = len(self.base) + sum(len(p.variant.unknowns) for p in self.parts[:index])
        own = self.parts[index].variant.unknowns
        return {u.name: float(v) for u, v in zip(own, values[start : start + len(own)], strict=True)}

    def starts(self, before: Array) -> tuple[Array, ...]:
        """Shared values (S,) at each start of the last part, given those of all that comes before it."""
        own = self.parts[-1].variant
        return tuple(np.concatenate([before, _at(own.unknowns, start)]) for start in own.starts)

    def stepped(self, substep: float) -> Hypothesis:
        """Return the same with another longest integration step [s]."""
        if self.world.time.substep == substep:
            return self
        return replace(self, world=self.world.with_substep(substep))

    def fitted_world(self, values: Array, run: Run | None = None) -> World:
        """Return the world with shared values (S,) written into it; of unknowns of one run each, those of the first, or
        of the run that is named."""
        numbers: dict[str, float] = {}
        for u, v in zip(self.unknowns, values, strict=True):
            for path in u.paths if run is None or u.is_of(run) else ():
                numbers.setdefault(path, float(v))
        return with_parameters(self.world, numbers) if numbers else self.world


def extended(hypothesis: Hypothesis, candidate: Candidate, recording: Recording) -> tuple[Hypothesis, ...]:
    """Return the hypotheses that one more effect makes of one, a variant each.

    None where the effect is already in it, cannot apply, or would move a number that is free already.
    """
    if candidate.name in hypothesis.names:
        return ()
    taken = {path for u in hypothesis.unknowns for path in u.paths}
    return tuple(
        Hypothesis(variant.world, hypothesis.base, (*hypothesis.parts, Part(candidate, variant)))
        for variant in candidate.variants(hypothesis.world, recording)
        if not taken & {path for u in variant.unknowns for path in u.paths}
    )


def without_part(
    base: Hypothesis, hypothesis: Hypothesis, index: int, values: Array, recording: Recording
) -> tuple[Hypothesis, Array] | None:
    """Return the hypothesis less one effect, and the values that stay; None where the rest cannot be built that way."""
    smaller = base
    kept = [values[: len(base.base)]]
    for i, part in enumerate(hypothesis.parts):
        if i == index:
            continue
        ways = [h for h in extended(smaller, part.candidate, recording) if _alike(h.parts[-1].variant, part.variant)]
        if not ways:
            return None
        smaller = ways[0]
        old = hypothesis.of_part(i, values)
        kept.append(np.array([old[u.name] for u in smaller.parts[-1].variant.unknowns]))
    return smaller, np.concatenate(kept)


def _alike(one: Variant, other: Variant) -> bool:
    return one.label == other.label and [u.name for u in one.unknowns] == [u.name for u in other.unknowns]


def _at(unknowns: Sequence[Unknown], start: Mapping[str, float]) -> Array:
    return np.array([start.get(u.name, u.start) for u in unknowns], dtype=float)


def _titled(part: Part) -> str:
    return f"{part.candidate.name} ({part.variant.label})" if part.variant.label else part.candidate.name
