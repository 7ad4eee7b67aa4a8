"""Renaming, dropping, merging and splitting tracks: edits of an observation that need no look at the video."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from atw_mcp.perception.constraints import Constraint, Exclusion, Seed, renamed
from atw_mcp.perception.corrections import (
    Correction,
    Drop,
    Merge,
    Outline,
    Rename,
    Split,
    Statement,
    checked_name,
)
from atw_mcp.perception.masks import Mask, RunLengthMask
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject


class TrackEdits:
    """The tracks of an observation while corrections are applied to them, in order.

    found: masks (T) of each object before any constraint; current: as the observation has them; described: the object
    as it was observed, where the edits did not touch it; constraints: those that hold, in the names of now; statements:
    those of the corrections that say where objects are.
    """

    def __init__(self, observation: ImageObservation) -> None:
        self.observation = observation
        self.current = {o.name: self._decoded(o.masks) for o in observation.objects}
        self.found = {
            o.name: self._decoded(observation.found[o.name]) if o.name in observation.found else self.current[o.name]
            for o in observation.objects
        }
        self.described: dict[str, ObservedObject] = {o.name: o for o in observation.objects}
        self.constraints: list[Constraint] = list(observation.constraints)
        self.statements: list[Statement] = []
        self.notes: list[str] = []

    @property
    def names(self) -> list[str]:
        """Names of the objects now."""
        return list(self.found)

    def apply(self, correction: Correction) -> None:
        """Apply one correction, or keep it as a statement; raises ObservationError where it cannot be."""
        if isinstance(correction, Rename):
            self._rename(correction)
        elif isinstance(correction, Drop):
            self._known(correction.object)
            self._forget(correction.object)
        elif isinstance(correction, Merge):
            self._merge(correction)
        elif isinstance(correction, Split):
            self._split(correction)
        else:
            if isinstance(correction, Outline) and correction.add:
                name = checked_name(correction.object, self.names)
                self.found[name], self.current[name] = (
                    self._decoded([None] * self._count),
                    self._decoded([None] * self._count),
                )
            self.statements.append(correction)

    def check(self) -> None:
        """Raise ObservationError for a statement about an object that there is not."""
        for statement in self.statements:
            if statement.object is not None:
                self._known(statement.object)

    @property
    def _count(self) -> int:
        return len(self.observation.frames)

    def _decoded(self, masks: Sequence[RunLengthMask | None]) -> list[Mask]:
        empty = np.zeros((self.observation.video.height, self.observation.video.width), dtype=bool)
        return [empty if m is None else m.decode() for m in masks]

    def _known(self, name: str) -> None:
        if name not in self.found:
            raise ObservationError(f"unknown object {name!r}; objects: {self.names}")

    def _rename(self, correction: Rename) -> None:
        self._known(correction.object)
        name = checked_name(correction.name, self.names)

        def other(known: str) -> str:
            return name if known == correction.object else known

        self.found = {other(k): v for k, v in self.found.items()}
        self.current = {other(k): v for k, v in self.current.items()}
        self.described = {other(k): replace(v, name=other(k)) for k, v in self.described.items()}
        self.constraints = [renamed(c, correction.object, name) for c in self.constraints]
        self.statements = [replace(s, object=name) if s.object == correction.object else s for s in self.statements]

    def _forget(self, name: str) -> None:
        for known in (self.found, self.current, self.described):
            known.pop(name, None)
        self.constraints = [c for c in self.constraints if c.object != name]
        self.statements = [s for s in self.statements if s.object != name]

    def _merge(self, correction: Merge) -> None:
        first, second = correction.first, correction.second
        self._known(first)
        self._known(second)
        if first == second:
            raise ObservationError("merge needs two different objects")
        both = sum(bool(a.any() and b.any()) for a, b in zip(self.current[first], self.current[second], strict=True))
        if both:
            self.notes.append(f"{first} and {second} were merged though both are seen in {both} frames")
        for known in (self.found, self.current):
            known[first] = [a | b for a, b in zip(known[first], known.pop(second), strict=True)]
        self.described.pop(first, None)
        self.described.pop(second, None)
        absent = self._absent(first) & self._absent(second)
        kept = [renamed(c, second, first) for c in self.constraints if not _whole(c, (first, second))]
        self.constraints = [*_united(kept, first), *self._absences(first, absent)]
        self.statements = [replace(s, object=first) if s.object == second else s for s in self.statements]

    def _split(self, correction: Split) -> None:
        name = correction.object
        self._known(name)
        row = self.observation.row(correction.frame)
        seen = [t for t, mask in enumerate(self.current[name]) if mask.any()]
        if not seen or not seen[0] < row <= seen[-1]:
            frame_of = self.observation.frames
            first, last = (min(seen[0] + 1, seen[-1]), seen[-1]) if seen else (0, 0)
            raise ObservationError(
                f"{name} can be split at frames {frame_of[first]}..{frame_of[last]}, not at {correction.frame}"
            )
        new = checked_name(correction.name, self.names)
        for known in (self.found, self.current):
            series = known[name]
            empty = np.zeros_like(series[0])
            known[name] = [m if t < row else empty for t, m in enumerate(series)]
            known[new] = [empty if t < row else m for t, m in enumerate(series)]
        self.described.pop(name, None)
        later = {f for f in self.observation.frames if f >= correction.frame}
        earlier = set(self.observation.frames) - later
        self.constraints = [
            renamed(c, name, new) if isinstance(c, Seed) and c.object == name and c.frame in later else c
            for c in self.constraints
        ]
        if any(c.object in (name, new) for c in self.constraints if isinstance(c, Seed)):
            self.constraints += [*self._absences(name, later), *self._absences(new, earlier)]

    def _absent(self, name: str) -> set[int]:
        """Frames in which an object was said to be nowhere."""
        return {
            frame
            for c in self.constraints
            if isinstance(c, Exclusion) and _whole(c, (name,))
            for frame in self.observation.frames
            if c.first <= frame <= c.last
        }

    def _absences(self, name: str, frames: set[int]) -> list[Constraint]:
        """Exclusions of an object from the whole image in some frames."""
        made: list[Constraint] = []
        for frame in sorted(frames):
            last = made[-1] if made else None
            before = self.observation.frames[max(self.observation.row(frame) - 1, 0)]
            if isinstance(last, Exclusion) and last.last == before:
                made[-1] = replace(last, last=frame)
            else:
                made.append(Exclusion(frame, frame, name))
        return made


def _whole(constraint: Constraint, names: tuple[str, ...]) -> bool:
    """Check whether a constraint says that one of the objects is nowhere in the image."""
    return isinstance(constraint, Exclusion) and constraint.mask is None and constraint.object in names


def _united(constraints: list[Constraint], name: str) -> list[Constraint]:
    """Return the constraints with several seeds of an object in one frame made one."""
    seeds: dict[int, Seed] = {}
    rest: list[Constraint] = []
    for c in constraints:
        if not isinstance(c, Seed) or c.object != name:
            rest.append(c)
        elif c.frame in seeds:
            both = seeds[c.frame].mask.decode() | c.mask.decode()
            seeds[c.frame] = replace(seeds[c.frame], mask=RunLengthMask.encode(both))
        else:
            seeds[c.frame] = c
    return [*rest, *seeds.values()]
