"""A hypothesis on what a world lacks: base unknowns, and effects added to it, each by one of its variants."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.estimation.unknown import Unknown
from polyworld.gap.candidate import Candidate, Variant
from polyworld.gap.settings import GapSettings
from polyworld.world import World
from polyworld.world.parameters import with_parameters

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Part:
    """An effect as it was added."""

    candidate: Candidate
    variant: Variant

    @property
    def shared(self) -> tuple[Unknown, ...]:
        """Unknowns that all runs share."""
        return tuple(u for u in self.variant.unknowns if u.run is None)

    @property
    def own(self) -> tuple[Unknown, ...]:
        """Unknowns that belong to one run each; they are fitted with its initial state."""
        return tuple(u for u in self.variant.unknowns if u.run is not None)

    @property
    def stands_in(self) -> bool:
        """Whether it has a place or a clock, by which it bends to what other laws leave."""
        return bool(self.variant.idle) or self.candidate.local or self.bends

    @property
    def placed(self) -> bool:
        """Whether it has a place or a rhythm of its own, beside the velocity of what it moves against."""
        return self.candidate.local or self.bends or any("velocity" not in i for i in self.variant.idle)

    @property
    def bends(self) -> bool:
        """Whether it is an observer's fault that changes from place to place."""
        return self.candidate.group == "observer" and any(w in self.candidate.name for w in ("distortion", "keystone"))

    @property
    def rescales(self) -> bool:
        """Whether it changes periods, by any factor: starts are compared over a short time, before phases are lost."""
        return self.candidate.name in ("length_error", "stiffness_error")

    @property
    def sudden(self) -> bool:
        """Whether it changes courses at once, so that no slope at zero strength shows it."""
        return self.candidate.local


@dataclass(frozen=True)
class Hypothesis:
    """A child world with its unknowns: base, then those of each part."""

    world: World
    base: tuple[Unknown, ...] = ()
    parts: tuple[Part, ...] = ()

    @cached_property
    def unknowns(self) -> tuple[Unknown, ...]:
        """All unknowns that runs share (S,)."""
        return (*self.base, *(u for p in self.parts for u in p.shared))

    @property
    def names(self) -> frozenset[str]:
        """Names of the effects."""
        return frozenset(p.candidate.name for p in self.parts)

    @property
    def key(self) -> frozenset[tuple[str, str]]:
        """Effects with their labels, by which hypotheses are the same."""
        return frozenset((p.candidate.name, p.variant.label) for p in self.parts)

    @property
    def title(self) -> str:
        """For readers."""
        return " + ".join(p.candidate.name for p in self.parts) or "nothing missing"

    def own(self, run: str) -> tuple[Unknown, ...]:
        """Return unknowns that belong to one run."""
        return tuple(u for p in self.parts for u in p.own if u.run == run)

    def of_part(self, index: int) -> slice:
        """Return where the shared unknowns of a part are among all."""
        first = len(self.base) + sum(len(p.shared) for p in self.parts[:index])
        return slice(first, first + len(self.parts[index].shared))

    def cost(self, settings: GapSettings) -> float:
        """Return the price of the effects in nats: one a parameter, more for places and clocks and for what is a run's
        own."""
        total = 0.0
        for p in self.parts:
            total += len(p.shared) + settings.place_cost * p.placed
            total += settings.state_cost * len(p.own)
        return total

    def surprise(self, values: Array, settings: GapSettings) -> float:
        """Return half the squared departures of values (S,) from what is ordinary, in nats: priors of that width."""
        found = 0.0
        for u, width, value in zip(self.unknowns, self.widths(settings), values, strict=True):
            found += 0.5 * ((float(value) - u.start) / width) ** 2 if np.isfinite(width) else 0.0
        return found

    def widths(self, settings: GapSettings) -> Array:
        """Return the departures (S,) from neutral that are ordinary; infinite where nothing is known."""
        size = float(np.linalg.norm(self.world.environment.gravity))
        width = [np.inf if u.plausible is None else u.plausible for u in self.base]
        for p in self.parts:
            for u in p.shared:
                known = np.inf if u.plausible is None else u.plausible
                if p.candidate.name == "gravity_error":
                    known = settings.gravity * size
                elif p.candidate.name == "tilt":
                    known = settings.level * size if size else known
                width.append(known)
        return np.array(width)

    def possible(self, values: Array, settings: GapSettings) -> bool:
        """Return whether places are within reach and strengths within what physics makes possible."""
        width = self.widths(settings)
        start = np.array([u.start for u in self.unknowns])
        return bool(np.all(np.abs(values - start) <= settings.plausible * width))

    def fitted_world(self, values: Array) -> World:
        """Return the child world with fitted values (S,)."""
        found: dict[str, float] = {}
        for u, v in zip(self.unknowns, values, strict=True):
            for path, power in zip(u.paths, u.powers or (1.0,) * len(u.paths), strict=True):
                found[path] = float(np.exp(power * v)) if u.scale == "log" else power * float(v)
        return with_parameters(self.world, found)


def extended(parent: Hypothesis, candidate: Candidate, recording: Recording) -> Iterator[Hypothesis]:
    """Return the hypotheses that one more effect makes, variant by variant."""
    if candidate.name in parent.names:
        return
    for variant in candidate.variants(parent.world, recording):
        if variant.starts:
            yield Hypothesis(variant.world, parent.base, (*parent.parts, Part(candidate, variant)))


def starts_of(hypothesis: Hypothesis) -> Array:
    """Return the starts (K, p) of the last part's shared unknowns."""
    part = hypothesis.parts[-1]
    rows: Sequence[list[float]] = [[start.get(u.name, u.start) for u in part.shared] for start in part.variant.starts]
    return np.array(rows, dtype=float).reshape(len(rows), len(part.shared))


def replace_starts(hypothesis: Hypothesis) -> Hypothesis:
    """Return the hypothesis whose last part starts at its first start alone."""
    part = hypothesis.parts[-1]
    only = replace(part.variant, starts=part.variant.starts[:1])
    return replace(hypothesis, parts=(*hypothesis.parts[:-1], replace(part, variant=only)))
