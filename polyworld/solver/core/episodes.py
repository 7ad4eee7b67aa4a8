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
Ints = NDArray[np.int64]

# A contact that opens for less than this goes on: rattling is one contact [s]. Under gravity that is a hop of 3 mm,
# slower than 0.25 m/s.
MERGE = 0.05
EPISODES = 65_536  # that the worlds of a batch have room for at first, all together: 7 MB where they are used
FEWEST_EPISODES = 64  # that each of them has
MOST_EPISODES = 250_000  # of one world: some 30 MB here, and 250 MB as events, which are Python's objects


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
    """Contact episodes of all worlds, those of world w from first[w] on, and which is the last of each pair.

    Episodes beyond a world's room are counted and merged like the others, but not stored: `count` is what a world needs
    room for, whatever it has.
    """

    episodes: wp.array[Episode]
    first: wp.array[wp.int32]  # (W,)
    room: wp.array[wp.int32]  # (W,)
    count: wp.array[wp.int32]  # (W,) how many began
    open: wp.array3d[wp.int32]  # (W, n, m) number of the pair's last one, -1 for none
    seen: wp.array3d[wp.float64]  # (W, n, m) when the pair last touched [s]
    merge: wp.float64  # a contact that opens for less than this goes on [s]
    record: int


@wp.func
def record_touch(log: Log, w: int, touch: Episode) -> None:
    """Add what a pair went through in one step to its open episode, or begin an episode with it."""
    k = log.open[w, touch.a, touch.b]
    if k >= 0 and touch.begin - log.seen[w, touch.a, touch.b] <= log.merge:
        log.seen[w, touch.a, touch.b] = touch.last
        if k < log.room[w]:
            e = log.first[w] + k
            if touch.begin == log.episodes[e].begin:  # another point of the first touch
                log.episodes[e].first_impulse += touch.first_impulse
                log.episodes[e].speed = wp.max(log.episodes[e].speed, touch.speed)
            log.episodes[e].impulse += touch.impulse
            log.episodes[e].last = touch.last
        return
    k = log.count[w]
    log.count[w] = k + 1
    log.open[w, touch.a, touch.b] = k
    log.seen[w, touch.a, touch.b] = touch.last
    if k < log.room[w]:
        log.episodes[log.first[w] + k] = touch


@wp.func
def record_nearness(log: Log, w: int, a: int, b: int, time: wp.float64) -> None:
    """Note that a pair has not parted, without an impulse: what it bears next still belongs to the same episode."""
    if log.open[w, a, b] >= 0 and time - log.seen[w, a, b] <= log.merge:
        log.seen[w, a, b] = time


class ContactLog:
    """Contact episodes of W worlds between n objects and m others; `record` is what kernels write to.

    A world has room for `capacity` episodes at first, and for more with `grow` or `reserve`; what is recorded does not
    depend on it.
    """

    def __init__(
        self,
        n_worlds: int,
        names: Sequence[str],
        others: Sequence[str],
        *,
        record: bool,
        capacity: int | None = None,
    ) -> None:
        """names (n,), others (m,): of an episode's a and b. record: whether any are kept."""
        self._names, self._others = tuple(names), tuple(others)
        size = (capacity or max(EPISODES // n_worlds, FEWEST_EPISODES)) if record else 1
        self.record = Log()
        self.record.record = int(record)
        self.record.merge = MERGE
        # Left unwritten, so that room which is not needed takes no memory.
        self.record.episodes = buffers.empty((n_worlds * size,), Episode)
        self.record.first = buffers.ints(np.arange(n_worlds) * size)
        self.record.room = buffers.ints(np.full(n_worlds, size))
        self.record.count = buffers.zeros((n_worlds,), wp.int32)
        pairs = (n_worlds, len(self._names), len(self._others))
        self.record.open = buffers.zeros(pairs if record else (1, 1, 1), wp.int32)
        self.record.seen = buffers.zeros(pairs if record else (1, 1, 1), wp.float64)
        self._open, self._count = buffers.Mirror(self.record.open), buffers.Mirror(self.record.count)
        self._first, self._room = buffers.Mirror(self.record.first), buffers.Mirror(self.record.room)
        self._kept = buffers.Mirror(self.record.episodes)

    def saved(self) -> dict[str, NDArray[Any]]:
        """Return the episodes of the only world so far, and which are open."""
        count, first = int(self._count.pull()[0]), int(self._first.values[0])
        return {
            "log.open": self._open.pull().copy(),
            "log.seen": buffers.read(self.record.seen).copy(),
            "log.episodes": self._kept.pull()[first : first + count].copy(),
        }

    def restore(self, saved: Mapping[str, NDArray[Any]]) -> None:
        """Take what `saved` returned, where contacts are recorded."""
        if not self.record.record:
            return
        self.clear()
        episodes = saved["log.episodes"]
        self.reserve(len(episodes))
        self._open.values[:], self._count.values[:] = saved["log.open"], len(episodes)
        self._open.push()
        self._count.push()
        first = int(self._first.values[0])
        buffers.write(self.record.episodes, episodes, np.s_[first : first + len(episodes)])
        buffers.write(self.record.seen, saved["log.seen"])

    def clear(self, worlds: Ints | slice = slice(None)) -> None:
        """Empty the log, or that of some worlds: no contact has started."""
        if self.record.record:
            self._open.pull()[worlds] = -1
            self._open.push()
        self._count.pull()[worlds] = 0
        self._count.push()

    def short(self) -> Ints:
        """Return the worlds in which more contacts began than there is room for, and may be made room for."""
        room = self._room.values
        found: Ints = np.flatnonzero((self._count.pull() > room) & (room < MOST_EPISODES))
        return found

    def grow(self, worlds: Ints) -> None:
        """Make room for as many contacts as began in these worlds; their log is to be recorded again."""
        if len(worlds):
            self._enlarge(worlds, np.minimum(self._count.pull()[worlds], MOST_EPISODES))

    def reserve(self, more: int) -> bool:
        """Make room for `more` contacts than began so far, up to MOST_EPISODES; return whether arrays were replaced."""
        needed = np.minimum(self._count.pull() + more, MOST_EPISODES)
        worlds = np.flatnonzero(needed > self._room.values)
        if not len(worlds):
            return False
        self._enlarge(worlds, np.maximum(needed[worlds], 2 * self._room.values[worlds]))
        return True

    def reserve_for(self, duration: float) -> bool:
        """As `reserve`, for all contacts that may begin within `duration` [s]: for a pair at most one every MERGE."""
        if not self.record.record:
            return False
        return self.reserve((1 + int(duration / MERGE)) * len(self._names) * len(self._others))

    def _enlarge(self, worlds: Ints, sizes: Ints) -> None:
        """Give some worlds room for so many episodes (worlds,), at the end of a longer array."""
        old = self.record.episodes
        length = old.shape[0]
        longer = buffers.empty((length + int(sizes.sum()),), Episode)
        buffers.copy(old, longer, 0, 0, length)
        ends = length + np.cumsum(sizes)
        for w, end, size in zip(worlds, ends, sizes, strict=True):
            count = int(min(self._count.values[w], self._room.values[w]))
            buffers.copy(old, longer, int(self._first.values[w]), int(end - size), count)
        self.record.episodes, self._kept = longer, buffers.Mirror(longer)
        self._first.values[worlds] = ends - sizes
        self._room.values[worlds] = sizes
        self._first.push()
        self._room.push()

    def complete_until(self, w: int) -> float | None:
        """Return the time [s] up to which the contacts of world w are recorded; None where all are."""
        if not self.record.record:
            return 0.0
        room = int(self._room.values[w])
        if self._count.pull()[w] <= room:
            return None
        return float(self._kept.pull()[self._first.values[w] + room - 1]["begin"])

    def events(self, w: int, end: float, place: Callable[[Any], Array] | None = None) -> tuple[Event, ...]:
        """Return the contact events of world w in order of time; a contact that lasts to `end` [s] has no end.

        place: returns the position (3,) of an episode in world axes; default: as it is stored. Where more contacts
        began than MOST_EPISODES, these are the first of them, see `complete_until`.
        """
        if not self.record.record:
            return ()
        first, count = int(self._first.values[w]), int(min(self._count.pull()[w], self._room.values[w]))
        found = []
        for e in self._kept.pull()[first : first + count]:
            pair = tuple(sorted((self._names[e["a"]], self._others[e["b"]])))
            x, y, z = (float(v) for v in (e["position"] if place is None else place(e)))
            begin, last = float(e["begin"]), float(e["last"])
            found.append(Event("contact_begin", begin, pair, (x, y, z), float(e["first_impulse"]), float(e["speed"])))
            if last < end:
                found.append(Event("contact_end", last, pair, None, float(e["impulse"])))
        return tuple(sorted(found, key=lambda e: (e.time, e.participants, e.kind)))
