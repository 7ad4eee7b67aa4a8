"""How a branch differs from its base over time: displacements, events gone and new, and the instants worth seeing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from atw_mcp.calls.intervals import Span
from atw_mcp.probing import readouts
from atw_mcp.probing.marked_events import marked_events
from polyworld.probing.compare import Comparison, compare, positions_at
from polyworld.trajectory import Event, Rollout
from polyworld.world import World

Array = NDArray[np.float64]

NEAR = 0.02  # of the time shown; instants closer than this are one picture
MOST = 4  # reasons for one instant that are said


@dataclass(frozen=True)
class Side:
    """A rollout with its world."""

    id: str
    world: World
    result: Rollout


@dataclass(frozen=True)
class Instant:
    """A frame worth seeing, and why; empty where it was asked for or fills a gap."""

    frame: int
    why: tuple[str, ...]


@dataclass(frozen=True)
class BranchDifference:
    """A branch compared with the world that it was made from."""

    base: Side
    branch: Side

    @property
    def names(self) -> tuple[str, ...]:
        """Objects of either."""
        return tuple(dict.fromkeys([*self.base.result.trajectory.names, *self.branch.result.trajectory.names]))

    @property
    def frame_time(self) -> float:
        """Seconds per frame."""
        return self.branch.world.time.seconds_per_frame

    @cached_property
    def end(self) -> float:
        """The time that both cover [s]."""
        return float(min(side.result.trajectory.times[-1] for side in (self.base, self.branch)))

    @cached_property
    def comparison(self) -> Comparison | None:
        """The comparison that CompareWorlds makes; None where events of either were not recorded."""
        sides = (self.base, self.branch)
        if any(s.result.contacts_until is not None and s.result.contacts_until <= 0.0 for s in sides):
            return None
        first, second = (replace(s.result, events=readouts.reported_events(s.world, s.result)) for s in sides)
        return compare(first, second)

    @cached_property
    def gone(self) -> list[Event]:
        """Collisions and releases that happen in the base alone."""
        return self._marked(self.base, () if self.comparison is None else self.comparison.events_only_in_base)

    @cached_property
    def new(self) -> list[Event]:
        """Collisions and releases that happen in the branch alone."""
        return self._marked(self.branch, () if self.comparison is None else self.comparison.events_only_in_other)

    def displacement(self, name: str, times: Array) -> Array:
        """Distance (T,) of an object's centre from where it is in the base [m]; NaN where it is not in both."""
        base, branch = self.base.result.trajectory, self.branch.result.trajectory
        found = np.full(len(times), np.nan)
        if name not in base.names or name not in branch.names:
            return found
        i, j = base.index(name), branch.index(name)
        known = base.active[self._rows(self.base, times), i] & branch.active[self._rows(self.branch, times), j]
        apart = positions_at(branch, j, times[known]) - positions_at(base, i, times[known])
        found[known] = np.linalg.norm(apart, axis=1)
        return found

    def instants(self, names: list[str], most: int, first: int, last: int) -> list[Instant]:
        """Frames from `first` to `last` in which the two differ most, or an event is gone or new, in order of time.

        In order of importance: the largest displacement, events gone and new, the end, the largest displacement of
        each further object; the rest are evenly spread.
        """
        frames = np.arange(first, last + 1)
        times = np.minimum(frames * self.frame_time, self.end)
        peaks = []
        for name in names:
            distance = self.displacement(name, times)
            if np.isfinite(distance).any() and np.nanmax(distance) > 0.0:
                k = int(np.nanargmax(distance))
                peaks.append(
                    (float(distance[k]), int(frames[k]), f"largest displacement of {name}, {distance[k]:.3g} m")
                )
        peaks.sort(key=lambda peak: -peak[0])
        wanted = [(frame, text) for _, frame, text in peaks[:1]]
        wanted += sorted(
            [*self._happenings(self.base, self.gone, "gone"), *self._happenings(self.branch, self.new, "new")]
        )
        wanted += [(last, "end"), *[(frame, text) for _, frame, text in peaks[1:]]]
        wanted += [(round(frame), "") for frame in np.linspace(first, last, most)]
        close = max(1.0, NEAR * (last - first))
        chosen: dict[int, list[str]] = {}
        for frame, why in wanted:
            if not first <= frame <= last:
                continue
            same = next((f for f in chosen if abs(f - frame) <= close), None)
            if same is not None and why:  # the later of the two shows both
                chosen[max(same, frame)] = [*chosen.pop(same), why]
            elif same is None and len(chosen) < most:
                chosen[frame] = [why] * bool(why)
        return [Instant(frame, _few(chosen[frame])) for frame in sorted(chosen)]

    def in_words(self, side: Side, event: Event) -> str:
        """Who does what, and when."""
        return readouts.in_words(readouts.in_order([event], side.result, Span(0.0, self.end, self.frame_time)))

    def _happenings(self, side: Side, events: list[Event], what: str) -> list[tuple[int, str]]:
        """The first frame at or after each event, and its words."""
        frame = self.frame_time
        return [(int(np.ceil(e.time / frame - 1e-6)), f"{what}: {self.in_words(side, e)}") for e in events]

    def _marked(self, side: Side, only: tuple[Event, ...]) -> list[Event]:
        return [event for event in marked_events(side.world, side.result) if event in only]

    def _rows(self, side: Side, times: Array) -> NDArray[np.int64]:
        own = side.result.trajectory.times
        rows: NDArray[np.int64] = np.abs(own[:, None] - times).argmin(axis=0)
        return rows


def _few(why: list[str]) -> tuple[str, ...]:
    """The first reasons, and how many more there are."""
    return tuple(why if len(why) <= MOST else [*why[: MOST - 1], f"and {len(why) - MOST + 1} more"])
