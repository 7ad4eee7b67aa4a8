"""Worlds whose observer is at fault, and unknowns of the fault."""

from __future__ import annotations

from typing import Any

import numpy as np

from polyworld.estimation.unknown import Unknown
from polyworld.gap.adding import of_path, with_parts
from polyworld.observer import Observer
from polyworld.recording import Recording
from polyworld.world import World


def observed(world: World, **faults: Any) -> World:
    """A child world whose observer has some fields replaced; one without faults where there was none."""
    return with_parts(world, observer=(world.observer or Observer()).model_copy(update=faults))


def of_observer(world: World, field: str, name: str, typical: float, **limits: float) -> Unknown:
    """A field of a world's observer as an unknown from its value on. limits: as `of_path` takes them."""
    assert world.observer is not None
    path = f"observer.{field}"
    return of_path(world, (path,), name, world.observer.values[path], typical, **limits)


def measured_axes(recording: Recording) -> list[int]:
    """Axes of which positions were measured."""
    return [a for a in range(3) if any(np.isfinite(run.positions[..., a]).any() for run in recording.runs)]


def is_bare(world: World) -> bool:
    """Whether nothing in the world has a place or a size that data could be held against."""
    return not (world.statics or world.joints or world.deformables or world.effects)
