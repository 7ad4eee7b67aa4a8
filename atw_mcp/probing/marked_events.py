"""Events of a rollout that pictures mark: one star for a collision, however often the two touch in it."""

from __future__ import annotations

from atw_mcp.probing.readouts import SAME_BLOW_FRAMES, reported_events
from polyworld.trajectory import Event, Rollout
from polyworld.world import World


def marked_events(world: World, rollout: Rollout) -> tuple[Event, ...]:
    """Return the first touch of every reported collision, and releases of fastenings, in order of time."""
    gap = SAME_BLOW_FRAMES * world.time.seconds_per_frame
    last: dict[tuple[str, ...], float] = {}
    found = []
    for event in reported_events(world, rollout):
        if event.kind == "release":
            found.append(event)
        if event.kind in ("contact_begin", "contact_end"):
            goes_on = event.time - last.get(event.participants, -float("inf")) <= gap
            last[event.participants] = event.time
            if event.kind == "contact_begin" and not goes_on:
                found.append(event)
    return tuple(found)
