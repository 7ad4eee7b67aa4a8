"""Room for contacts in a shard: made when a step asks for more, so that results do not depend on what there was."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from polyworld.core import buffers

if TYPE_CHECKING:
    from polyworld.solver.coupled.shard import Shard

BLOWN_UP = 100.0  # speed of a node above which a world with too many contacts counts as diverged [m/s]


class Restart(Exception):
    """The run begins again, with more room than it had."""


def search_again(shard: Shard) -> None:
    """Repeat a coupling step's search for contacts of deformable objects with more room, until all worlds fit.

    Worlds that ask for too much end: as diverged where a node is faster than BLOWN_UP, else as truncated.
    """
    contacts = shard.contacts
    full = contacts.overflowed()
    if not full.any():
        return
    while full.any() and contacts.enlarge():
        contacts.search_again(shard.nodes, shard.clock)
        full = contacts.overflowed()
    for w in np.flatnonzero(full):
        speed = np.linalg.norm(np.nan_to_num(buffers.read(shard.nodes.v)[w], nan=np.inf), axis=1)
        if speed.max() > BLOWN_UP:
            shard.stop(w, int(np.argmax(speed)))
        else:
            why = f"more than {contacts.room} contacts of deformable objects at once"
            shard.truncate(w, f"{why}: they overlap too much, or a mesh is too fine for them")
    buffers.clear(contacts.found.overflowed)
    shard.recapture()


def check_bodies(shard: Shard) -> None:
    """Make room for what a coupling step's rigid bodies and fluids lacked; raises Restart where there is more now."""
    if shard.rigid is not None and shard.world.objects:
        full = shard.rigid.overflowed()
        if full.any() and shard.rigid.enlarge():
            raise Restart
        _truncate(shard, full, "more contacts of rigid objects at once than there is memory for")
    if shard.fluid is None:
        return
    if shard.fluid.enlarge():
        shard.recapture()
        raise Restart
    most = shard.fluid.particles_at_most
    _truncate(
        shard,
        shard.fluid.full,
        f"more fluid was emitted than the {most} particles that there is room for: lower the emitters' rates, or make "
        "the cells of the fluid grid larger",
    )


def _truncate(shard: Shard, worlds: NDArray[np.bool_], reason: str) -> None:
    for w in np.flatnonzero(worlds):
        shard.truncate(w, reason)
