"""The tracks of an observation while corrections are applied to them, before anybody looks at the video again."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from atw_mcp.perception.constraints import Constraint, Exclusion, Rest, renamed
from atw_mcp.perception.corrections import Correction
from atw_mcp.perception.eye.seeds import Seed
from atw_mcp.perception.masks import Mask, RunLengthMask
from atw_mcp.perception.observation import ImageObservation, ObservationError, ObservedObject
from polyworld.world.camera import Camera

_NAME = re.compile(r"^[A-Za-z0-9][A-Za-z0-9_\-]{0,63}$")


class TrackEdits:
    """The tracks of an observation while corrections are applied to them, in order.

    masks (T): of each object; described: the object as it was observed, where the edits did not touch it; constraints:
    those that held before, in the names of now; said: those that the corrections state; again: whether bodies that have
    seeds are to be followed again.
    """

    def __init__(self, observation: ImageObservation, camera: Camera | None) -> None:
        self.observation, self._camera = observation, camera
        self.masks = {o.name: self._decoded(o.masks) for o in observation.objects}
        self.described: dict[str, ObservedObject] = {o.name: o for o in observation.objects}
        self.constraints: list[Constraint] = list(observation.constraints)
        self.scene = observation.scene
        self.said: list[Constraint] = []
        self.notes: list[str] = []
        self.again = False

    @property
    def names(self) -> list[str]:
        """Names of the objects now."""
        return list(self.masks)

    def apply(self, correction: Correction) -> None:
        """Apply one correction, or keep what it states; raises ObservationError where it cannot be."""
        correction.check()
        kind, name = correction.kind, correction.object or ""
        if kind == "rename":
            self._rename(name, correction.name or "")
        elif kind == "drop":
            self._known(name)
            self._forget(name)
        elif kind == "merge":
            self._merge(correction.first or "", correction.second or "")
        elif kind == "split":
            self._split(name, correction.frame or 0, correction.name or "")
        else:
            if kind == "add":
                self.masks[self._free(name)] = self._decoded([None] * len(self.observation.frames))
            self.said.append(self._constraint(correction))

    def check(self) -> None:
        """Raise ObservationError for a statement about an object that there is not."""
        for statement in self.said:
            if statement.object is not None:
                self._known(statement.object)

    def _constraint(self, said: Correction) -> Constraint:
        """Return the constraint that a correction states."""
        name, first = said.object or "", said.frame or 0
        last = first if said.last_frame is None else said.last_frame
        for frame in (first, last):
            self.observation.row(frame)
        width, height = self.observation.video.width, self.observation.video.height
        if said.kind in ("outline", "add"):
            return said.seed(width, height)
        if said.position is not None:
            if self._camera is None:
                raise ObservationError("a place in the world needs a camera: CalibrateCamera first")
            u, v = (float(x) for x in self._camera.project(np.array([said.position]))[0])
            if not (0 <= u < width and 0 <= v < height):
                raise ObservationError(
                    f"{name} in frame {first}: the place {said.position} is seen at pixel ({u:.0f}, {v:.0f}), "
                    f"outside the image of {width} x {height}"
                )
            x, y, z = said.position
            return Seed(name, "centre", first, (u, v), (x, y, z))
        if last < first:
            raise ObservationError(f"last_frame {last} is before frame {first}")
        if said.kind == "rest":
            return Rest(name, first, last)
        region = said.region(width, height)
        if region is None and said.object is None:
            raise ObservationError("exclude needs an object, a region (box or mask), or both")
        return Exclusion(first, last, said.object, region)

    def _free(self, name: str) -> str:
        """Return a name for an object; raises ObservationError where it is taken or not allowed."""
        if not _NAME.match(name):
            raise ObservationError(
                f"{name!r} is not a name: 1 to 64 letters, digits, _ or -, beginning with one of the first two"
            )
        if name in self.masks:
            raise ObservationError(f"the name {name!r} is taken; objects: {self.names}")
        return name

    def _decoded(self, masks: Sequence[RunLengthMask | None]) -> list[Mask]:
        empty = np.zeros((self.observation.video.height, self.observation.video.width), dtype=bool)
        return [empty if m is None else m.decode() for m in masks]

    def _known(self, name: str) -> None:
        if name not in self.masks:
            raise ObservationError(f"unknown object {name!r}; objects: {self.names}")

    def _rename(self, old: str, name: str) -> None:
        self._known(old)
        self._free(name)

        def other(known: str) -> str:
            return name if known == old else known

        self.masks = {other(k): v for k, v in self.masks.items()}
        self.described = {other(k): replace(v, name=other(k)) for k, v in self.described.items()}
        self.constraints = [renamed(c, old, name) for c in self.constraints]
        self.said = [renamed(c, old, name) for c in self.said]
        if self.scene is not None:
            self.scene = self.scene.renamed(old, name)

    def _forget(self, name: str) -> None:
        self.masks.pop(name)
        self.described.pop(name, None)
        self.constraints = [c for c in self.constraints if c.object != name]
        self.said = [c for c in self.said if c.object != name]

    def _merge(self, first: str, second: str) -> None:
        self._known(first)
        self._known(second)
        if first == second:
            raise ObservationError("merge needs two different objects")
        both = sum(bool(a.any() and b.any()) for a, b in zip(self.masks[first], self.masks[second], strict=True))
        if both:
            self.notes.append(f"{first} and {second} were merged though both are seen in {both} frames")
        if self.seeded(first) or self.seeded(second):
            self._seed_from_mask(first)
            self._seed_from_mask(second)
            self.again = True
        self.masks[first] = [a | b for a, b in zip(self.masks[first], self.masks.pop(second), strict=True)]
        self.described.pop(first, None)
        self.described.pop(second, None)
        absent = self._absent(first) & self._absent(second)
        kept = [renamed(c, second, first) for c in self.constraints if not _whole(c, (first, second))]
        self.constraints = [*dict.fromkeys(kept), *self._absences(first, absent)]
        self.said = [renamed(c, second, first) for c in self.said]

    def _split(self, name: str, frame: int, new: str) -> None:
        self._known(name)
        row = self.observation.row(frame)
        seen = [t for t, mask in enumerate(self.masks[name]) if mask.any()]
        if not seen or not seen[0] < row <= seen[-1]:
            frame_of = self.observation.frames
            first, last = (min(seen[0] + 1, seen[-1]), seen[-1]) if seen else (0, 0)
            raise ObservationError(f"{name} can be split at frames {frame_of[first]}..{frame_of[last]}, not at {frame}")
        self._free(new)
        series = self.masks[name]
        empty = np.zeros_like(series[0])
        self.masks[name] = [m if t < row else empty for t, m in enumerate(series)]
        self.masks[new] = [empty if t < row else m for t, m in enumerate(series)]
        self.described.pop(name, None)
        if not self.seeded(name):
            return
        later = {f for f in self.observation.frames if f >= frame}
        self.constraints = [
            replace(c, object=new) if isinstance(c, Seed) and c.object == name and c.frame in later else c
            for c in self.constraints
        ]
        if self.scene is not None and name in self.scene.solids:
            off, across = (
                names | ({new} if name in names else set()) for names in (self.scene.off_plane, self.scene.across)
            )
            solids = {**self.scene.solids, new: self.scene.solids[name]}
            self.scene = replace(self.scene, solids=solids, off_plane=off, across=across)
        for part in (name, new):
            self._seed_from_mask(part)
        earlier = set(self.observation.frames) - later
        self.constraints += [*self._absences(name, later), *self._absences(new, earlier)]
        self.again = True

    def seeded(self, name: str) -> bool:
        """Whether an object has a seed."""
        return any(isinstance(c, Seed) and c.object == name for c in self.constraints)

    def _seed_from_mask(self, name: str) -> None:
        """Give an object without seeds its mask where that is largest."""
        if not self.seeded(name):
            row = int(np.argmax([mask.sum() for mask in self.masks[name]]))
            mask = RunLengthMask.encode(self.masks[name][row])
            self.constraints.append(Seed(name, "mask", self.observation.frames[row], mask))

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
