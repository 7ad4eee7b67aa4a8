"""Contact episodes, from the first touch of a pair to its last: written as they happen, and read as events."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray

from polyworld.core import buffers
from polyworld.trajectory import Event

Array = NDArray[np.float64]

MERGE = 0.05  # a contact that opens for less than this goes on: rattling is one contact [s]
EPISODES = 1024  # contact episodes kept for a world; more is an error, not a silence


@wp.struct
class Episode:
    """A contact of a and b from its first touch to its last [s], impulses [N s], greatest first approach speed [m/s].

    first_impulse: of what touches in the step that begins with the episode. position: of the first touch [m].
    """

    a: int
    b: int
    begin: wp.float64
    last: wp.float64
    first_impulse: wp.float64
    impulse: wp.float64
    speed: wp.float64
    position: wp.vec3d


@wp.struct
class Log:
    """Contact episodes (W, E), how many began (W,), and which one is open for a pair (W, n, m), -1 for none."""

    episodes: wp.array2d[Episode]
    count: wp.array[wp.int32]  # may exceed the capacity: the rest was not stored
    open: wp.array3d[wp.int32]
    merge: wp.float64  # a contact that opens for less than this goes on [s]
    record: int


@wp.func
def record_touch(log: Log, w: int, touch: Episode) -> None:
    """Add what a pair went through in one step to its open episode, or begin an episode with it."""
    k = log.open[w, touch.a, touch.b]
    if k >= 0 and touch.begin - log.episodes[w, k].last <= log.merge:
        if touch.begin == log.episodes[w, k].begin:  # another point of the first touch
            log.episodes[w, k].first_impulse += touch.first_impulse
            log.episodes[w, k].speed = wp.max(log.episodes[w, k].speed, touch.speed)
        log.episodes[w, k].impulse += touch.impulse
        log.episodes[w, k].last = touch.last
        return
    slot = log.count[w]
    log.count[w] = slot + 1
    if slot < log.episodes.shape[1]:
        log.episodes[w, slot] = touch
        log.open[w, touch.a, touch.b] = slot


class ContactLog:
    """Contact episodes of W worlds between n objects and m others; `record` is what kernels write to."""

    def __init__(
        self,
        n_worlds: int,
        names: Sequence[str],
        others: Sequence[str],
        *,
        record: bool,
        capacity: int = EPISODES,
    ) -> None:
        """names (n,), others (m,): of an episode's a and b. record: whether any are kept."""
        self._names, self._others = tuple(names), tuple(others)
        self._capacity = capacity
        self.record = Log()
        self.record.record = int(record)
        self.record.merge = MERGE
        self.record.episodes = buffers.zeros((n_worlds, capacity if record else 1), Episode)
        self.record.count = buffers.zeros((n_worlds,), wp.int32)
        pairs = (n_worlds, len(self._names), len(self._others))
        self.record.open = buffers.zeros(pairs if record else (1, 1, 1), wp.int32)
        self._open, self._count = buffers.Mirror(self.record.open), buffers.Mirror(self.record.count)

    def saved(self) -> dict[str, NDArray[Any]]:
        """Return the episodes of the only world so far, and which are open."""
        count = self._count.pull().copy()
        kept = buffers.read(self.record.episodes)[0, : count[0]].copy()
        return {"log.count": count, "log.open": self._open.pull().copy(), "log.episodes": kept}

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Take what `saved` returned, where contacts are recorded."""
        if not self.record.record:
            return
        episodes = saved["log.episodes"]
        if len(episodes) > self._capacity:
            raise RuntimeError(f"{len(episodes)} contacts began before; room for {self._capacity}")
        for kept, name in ((self._open, "log.open"), (self._count, "log.count")):
            kept.values[:] = saved[name]
            kept.push()
        buffers.write(self.record.episodes, episodes, np.s_[0, : len(episodes)])

    def clear(self) -> None:
        """Empty the log: no contact has started."""
        for kept, none in ((self._open, -1), (self._count, 0)):
            kept.values[:] = none
            kept.push()

    def events(
        self, w: int, end: float, what: str = "contacts", place: Callable[[Any], Array] | None = None
    ) -> tuple[Event, ...]:
        """Return the contact events of world w in order of time; a contact that lasts to `end` [s] has no end.

        what: the contacts' name in an error. place: returns the position (3,) of an episode in world axes; default: as
        it is stored. Raises RuntimeError where more contacts began than there is room for.
        """
        if not self.record.record:
            return ()
        count = int(self._count.pull()[w])
        if count > self._capacity:
            raise RuntimeError(f"{count} {what} began; room for {self._capacity}: shorten the horizon")
        found = []
        for e in buffers.read(self.record.episodes[w])[:count]:
            pair = tuple(sorted((self._names[e["a"]], self._others[e["b"]])))
            x, y, z = (float(v) for v in (e["position"] if place is None else place(e)))
            begin, last = float(e["begin"]), float(e["last"])
            found.append(Event("contact_begin", begin, pair, (x, y, z), float(e["first_impulse"]), float(e["speed"])))
            if last < end:
                found.append(Event("contact_end", last, pair, None, float(e["impulse"])))
        return tuple(sorted(found, key=lambda e: (e.time, e.participants, e.kind)))
