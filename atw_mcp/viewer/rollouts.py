"""A rollout as the page shows it: motion, points of deformable objects, events, and how it ended."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from atw_mcp.viewer import document as view
from atw_mcp.viewer.packing import Blocks
from atw_mcp.viewer.sampling import MOST_NUMBERS, at_samples, chosen_samples
from polyworld.probing.readouts.rope_line import rope_line
from polyworld.trajectory import Event, Rollout, Trajectory
from polyworld.world import World
from polyworld.world.materials import material_of


def rollout_view(
    identifier: str,
    world: World,
    result: Rollout,
    blocks: Blocks,
    *,
    label: str,
    base: str | None = None,
    edits: list[view.EditWords] | None = None,
    most_numbers: int = MOST_NUMBERS,
) -> view.RolloutView:
    """Return a rollout of a world.

    base: rollout of the world that edits made this one from. most_numbers: see `sampling`.
    """
    whole = result.trajectory
    rows = chosen_samples(whole, most_numbers)
    run = at_samples(whole, rows)
    sampled = ""
    if len(rows) < len(whole.times):
        step = int(rows[1] - rows[0])
        sampled = f"every {step}th of {len(whole.times)} samples and the last; events keep their own times"
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
            view.Deformed(name=name, points=blocks.floats(_points(world, run, name))) for name in run.deformables
        ],
        quantities=[],
        events=[event_mark(event) for event in result.events],
        pushes=[],
        misfits=[],
        sampled=sampled,
    )


def event_mark(event: Event) -> view.EventMark:
    """Return an event."""
    return view.EventMark.model_validate(event.to_dict())


def _points(world: World, run: Trajectory, name: str) -> NDArray[np.float64]:
    """Return the points (T, k, 3) of a deformable object; of a rope, those of its line."""
    if material_of(world.deformable(name)).form == "line":
        return rope_line(world, run, name)
    return run.deformables[name].points
