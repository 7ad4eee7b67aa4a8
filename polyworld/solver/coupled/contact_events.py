"""Contact events of deformable objects: episodes from the first touch of a pair to its last."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import warp as wp

from polyworld.core import buffers
from polyworld.solver.coupled.contact_layout import Tally
from polyworld.solver.spatial.layout import OPTIONS, Episode
from polyworld.trajectory import Event

wp.set_module_options(OPTIONS)

MERGE = 0.05  # a contact that opens for less than this goes on [s]
EPISODES = 1024  # kept for a world; more is an error, not a silence
_MERGE = wp.constant(wp.float64(MERGE))


@wp.kernel
def record_contacts(
    tally: Tally, episodes: wp.array2d[Episode], count: wp.array[wp.int32], open_: wp.array3d[wp.int32]
) -> None:
    """Note every pair that carried an impulse in the coupling step, and empty the tally."""
    w = wp.tid()
    for a in range(tally.impulse.shape[1]):
        for b in range(tally.impulse.shape[2]):
            impulse = tally.impulse[w, a, b]
            if impulse <= wp.float64(0.0):
                continue
            tally.impulse[w, a, b] = wp.float64(0.0)
            k = open_[w, a, b]
            if k >= 0 and tally.begin[w, a, b] - episodes[w, k].last <= _MERGE:
                episodes[w, k].impulse += impulse
                episodes[w, k].last = tally.last[w, a, b]
                continue
            slot = count[w]
            count[w] = slot + 1
            if slot < episodes.shape[1]:
                e = Episode()
                e.a = a
                e.b = b
                e.begin = tally.begin[w, a, b]
                e.last = tally.last[w, a, b]
                e.first_impulse = tally.first_impulse[w, a, b]
                e.impulse = impulse
                e.speed = tally.speed[w, a, b]
                e.position = tally.position[w, a, b]
                episodes[w, slot] = e
                open_[w, a, b] = slot


class ContactLog:
    """Contact episodes of W worlds between D deformable objects and B bodies, or each other."""

    def __init__(self, n_worlds: int, tally: Tally, names: Sequence[str], others: Sequence[str]) -> None:
        """names: of the deformables (D,); others: of bodies, then deformables (B + D,)."""
        self._tally = tally
        self._names, self._others = tuple(names), tuple(others)
        self._w = n_worlds
        record = bool(tally.record)
        self._episodes: Any = buffers.zeros((n_worlds, EPISODES if record else 1), Episode)
        self._count: Any = buffers.zeros((n_worlds,), wp.int32)
        self._open: Any = buffers.zeros(tally.impulse.shape, wp.int32)

    def reset(self) -> None:
        """Clear the log: no contact has started."""
        self._tally.impulse.numpy()[:] = 0.0
        self._open.numpy()[:] = -1
        self._count.numpy()[:] = 0

    def launch(self) -> None:
        """Launch the record of one coupling step."""
        if self._tally.record:
            buffers.launch(
                record_contacts,
                self._w,
                [self._tally, self._episodes, self._count, self._open],
            )

    def events(self, w: int, end: float, longest_step: float) -> tuple[Event, ...]:
        """Events of world w in order of time; a contact that lasts to the `end` of the run has no end.

        Raises RuntimeError where more contacts began than there is room for.
        """
        if not self._tally.record:
            return ()
        count = int(self._count.numpy()[w])
        if count > EPISODES:
            raise RuntimeError(
                f"{count} contacts of deformable objects began; room for {EPISODES}: shorten the horizon"
            )
        found = []
        for e in self._episodes.numpy()[w, :count]:
            pair = tuple(sorted((self._names[e["a"]], self._others[e["b"]])))
            x, y, z = np.asarray(e["position"], dtype=float).tolist()
            begin, last = float(e["begin"]), float(e["last"])
            found.append(Event("contact_begin", begin, pair, (x, y, z), float(e["first_impulse"]), float(e["speed"])))
            if last < end - 2.0 * longest_step:
                found.append(Event("contact_end", last, pair, None, float(e["impulse"])))
        return tuple(sorted(found, key=lambda e: (e.time, e.participants, e.kind)))
