"""A rollout as the page shows it: motion, points of deformable objects, events, and how it ended."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from atw_mcp.probing.readouts import reported_events
from atw_mcp.viewer import document as view
from atw_mcp.viewer import world_parts
from atw_mcp.viewer.effects import pushes_view
from atw_mcp.viewer.misfits import misfits_view
from atw_mcp.viewer.packing import Blocks
from atw_mcp.viewer.quantities import quantities_view
from atw_mcp.viewer.sampling import MOST_NUMBERS, at_samples, chosen_samples, rounded, sampled
from polyworld.data.tracks import ObservedTracks
from polyworld.probing.readouts.rope_line import rope_line
from polyworld.trajectory import Event, Rollout, Trajectory
from polyworld.world import World
from polyworld.world.materials import material_of

MOST_EVENTS = 2000  # as many marks as a wide screen's timeline has pixels


def rollout_view(
    identifier: str,
    world: World,
    result: Rollout,
    blocks: Blocks,
    *,
    label: str,
    base: str | None = None,
    edits: list[view.EditWords] | None = None,
    tracks: ObservedTracks | None = None,
    most_numbers: int = MOST_NUMBERS,
    spread: view.Spread | None = None,
) -> view.RolloutView:
    """Return a rollout of a world.

    base: rollout of the world that edits made this one from. tracks: measured positions that the world is meant to
    follow, in its time base. most_numbers: see `sampling`.
    """
    whole = result.trajectory
    rows = chosen_samples(world, whole, most_numbers)
    run = at_samples(whole, rows)
    events, left_out = shown_events(world, result)
    notes = [sampled(rows, len(whole.times)), left_out, result.why_no_contacts() or ""]
    return view.RolloutView(
        id=identifier,
        world=world.id,
        label=label,
        base=base,
        edits=edits or [],
        status=result.status,
        why_ended=result.why_ended(),
        horizon=result.horizon,
        names=list(run.names),
        times=blocks.floats(run.times),
        positions=blocks.floats(run.positions),
        orientations=blocks.floats(run.orientations),
        velocities=blocks.floats(run.velocities),
        spins=blocks.floats(run.angular_velocities),
        active=blocks.raw(run.active),
        deformed=[
            world_parts.Deformed(name=name, points=blocks.floats(rounded(shown_points(world, run, name))))
            for name in run.deformables
        ],
        quantities=quantities_view(world, run, blocks),
        events=[event_mark(event) for event in events],
        pushes=pushes_view(world, replace(result, trajectory=run), blocks),
        misfits=[] if tracks is None else misfits_view(world, whole, tracks, blocks),
        sampled="; ".join(note for note in notes if note),
        spread=spread,
    )


def shown_events(world: World, result: Rollout) -> tuple[tuple[Event, ...], str]:
    """Return the events worth reporting, of very many the hardest contacts, and a note about those left out."""
    events = reported_events(world, result)
    if len(events) <= MOST_EVENTS:
        return events, ""
    order = sorted(range(len(events)), key=lambda k: (events[k].impulse is not None, -(events[k].impulse or 0.0), k))
    kept = tuple(events[k] for k in sorted(order[:MOST_EVENTS]))
    return kept, f"{MOST_EVENTS} of {len(events)} events, those of the largest impulses"


def event_mark(event: Event) -> view.EventMark:
    """Return an event."""
    return view.EventMark.model_validate(event.to_dict())


def shown_points(world: World, run: Trajectory, name: str) -> NDArray[np.float64]:
    """Return the points (T, k, 3) of a deformable object; of a rope, those of its line."""
    if material_of(world.deformable(name)).form == "line":
        return rope_line(world, run, name)
    return run.deformables[name].points
