"""Contact events of deformable objects."""

from __future__ import annotations

from collections.abc import Sequence

import warp as wp

from polyworld.core import buffers
from polyworld.solver.core.episodes import ContactLog, Episode, Log, record_touch
from polyworld.solver.core.references import by_reference
from polyworld.solver.coupled.contact_layout import Tally
from polyworld.solver.spatial.layout import OPTIONS
from polyworld.trajectory import Event

wp.set_module_options(OPTIONS)


@wp.kernel
def record_contacts(tally: Tally, log: wp.array[Log]) -> None:
    """Record every pair that carried an impulse in the coupling step, and empty the tally."""
    w = wp.tid()
    for a in range(tally.impulse.shape[1]):
        for b in range(tally.impulse.shape[2]):
            if tally.impulse[w, a, b] > wp.float64(0.0):
                touch = Episode()
                touch.a = a
                touch.b = b
                touch.begin = tally.begin[w, a, b]
                touch.last = tally.last[w, a, b]
                touch.first_impulse = tally.first_impulse[w, a, b]
                touch.impulse = tally.impulse[w, a, b]
                touch.speed = tally.speed[w, a, b]
                touch.position = tally.position[w, a, b]
                record_touch(log[0], w, touch)
                tally.impulse[w, a, b] = wp.float64(0.0)


class DeformableContactLog:
    """Contact episodes of W worlds between D deformable objects and B bodies, or each other."""

    def __init__(self, n_worlds: int, tally: Tally, names: Sequence[str], others: Sequence[str]) -> None:
        """names: of the deformables (D,); others: of bodies, then deformables (B + D,)."""
        self._tally = tally
        self._w = n_worlds
        self._log = ContactLog(n_worlds, names, others, record=bool(tally.record))
        self._pairs = len(names) * len(others)
        self._reference = by_reference(self._log.record, Log)

    def reset(self) -> None:
        """Clear the log: no contact has started."""
        buffers.write(self._tally.impulse, 0.0)
        self._log.clear()

    def launch(self) -> None:
        """Launch the record of one coupling step."""
        if self._tally.record:
            buffers.launch(record_contacts, self._w, [self._tally, self._reference])

    def reserve(self) -> None:
        """Make room for all contacts that one coupling step may begin, as far as there may be."""
        if self._tally.record and self._log.reserve(self._pairs):
            by_reference(self._log.record, Log, self._reference)

    def complete_until(self, w: int) -> float | None:
        """Return the time [s] up to which the contacts of world w are recorded; None where all are."""
        return self._log.complete_until(w)

    def events(self, w: int, end: float, longest_step: float) -> tuple[Event, ...]:
        """Return the events of world w in order of time, see `ContactLog.events`; `end`: of the run."""
        return self._log.events(w, end - 2.0 * longest_step)
