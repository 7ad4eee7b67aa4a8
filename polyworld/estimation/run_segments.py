"""Cut runs into segments that begin where data determine a state, each with an initial state of its own."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.linkage import is_held, linkages
from polyworld.estimation.predictability import extent_of, predictable_instants, swings_on_others
from polyworld.world import World

Array = NDArray[np.float64]

FEWEST = 16  # samples of a segment
MOST = 1024  # samples of a run that is fitted as one
SEGMENT = 512  # samples of the segments of a longer one, about
SHORTEST = 40  # samples of a segment of a run that cannot be predicted
ABOUT = 8  # samples about the start of a stretch that have to lie on a parabola,
ROUGH = 1.4  # and times what one ordinarily leaves, beyond which no stretch begins there


def in_segments(recording: Recording, *worlds: World) -> Recording:
    """Split the long runs of a recording into segments, where all the worlds may start anywhere and each shows how.

    Over a long run a small error of a parameter adds up to turns and bounces, rollouts need steps as fine as the whole
    run asks for, and each costs the whole run. Segments have initial states of their own (multiple shooting without
    conditions of continuity); what they show of an effect comes from what it does within one, and from how that differs
    from one to another. Bodies that swing on each other are followed only as far as the first world can predict them.
    """
    swinging = swings_on_others(worlds[0])
    if not swinging and all(len(run.times) <= MOST for run in recording.runs):
        return recording
    if any(_slips(world) or not starts_anywhere(world, recording) for world in worlds):
        return recording
    parts: list[Run] = []
    for run in recording.runs:
        parts += _between(run, _predictable_edges(worlds[0], run) if swinging else _even_edges(run))
    return Recording(tuple(parts))


def split_runs(recording: Recording, names: Sequence[str]) -> Recording:
    """Split each of the named runs into two segments."""
    parts: list[Run] = []
    for run in recording.runs:
        if run.name not in names:
            parts.append(run)
            continue
        count = len(run.times)
        reach = range(count // 2 - count // 8, count // 2 + count // 8 + 1)
        parts += _between(run, [0, smooth_near(roughness(run), count // 2, reach), count])
    return Recording(tuple(parts))


def of_whole_runs(world: World, recording: Recording, parts: Recording) -> World:
    """Convert a world that was found on segments for whole runs: where frames were dropped is given by the run's name
    and a time from its start."""
    seen = world.observer
    part = next((r for r in parts.runs if seen is not None and r.name == seen.shift_run and r.part_of), None)
    if seen is None or part is None:
        return world
    whole = next(r for r in recording.runs if r.name == part.part_of)
    later = float(part.times[0] - whole.times[0])
    moved = seen.model_copy(update={"shift_run": whole.name, "shift_time": seen.shift_time + later})
    return world.model_copy(update={"observer": moved})


def _slips(world: World) -> bool:
    """Return whether the observer's clock slips, at an instant that counts from the start of a whole run."""
    return world.observer is not None and world.observer.shift != 0.0


def _even_edges(run: Run) -> list[int]:
    """Return where segments of a long run begin, and the last ends; just begin and end of one that is not long."""
    count = len(run.times)
    if count <= MOST:
        return [0, count]
    number, rough, edges = count // SEGMENT, roughness(run), [0]
    for k in range(1, number):
        middle, reach = k * count // number, count // number // 4
        edges.append(smooth_near(rough, middle, range(middle - reach, middle + reach + 1)))
    return [*edges, count]


def _predictable_edges(world: World, run: Run) -> list[int]:
    """Return the same of segments that can be predicted, each from its own start."""
    count, edges, extent = len(run.times), [0], extent_of(run)
    index, rough = np.arange(count), roughness(run)
    while True:
        first = edges[-1]
        ahead = run.rows((index >= first) & (index < first + MOST))
        if not is_seen(run, ahead):
            return [0, count]
        reach = max(predictable_instants(world, ahead, extent), SHORTEST)
        length = (count - first) // -(-(count - first) // reach)  # what is left, in equal parts no longer than that
        if length == count - first:
            return [*edges, count]
        edges.append(smooth_near(rough, first + length, range(first + 3 * length // 4, first + length + 1)))


def _between(run: Run, edges: Sequence[int]) -> list[Run]:
    """Cut a run into adjacent segments; return the run itself where one of them would show too little."""
    if len(edges) == 2:
        return [run]
    kept = np.arange(len(run.times))
    pieces = [
        replace(run.rows((kept >= first) & (kept < end)), name=f"{run.name} part {k + 1}", part_of=run.name)
        for k, (first, end) in enumerate(itertools.pairwise(edges))
    ]
    return pieces if all(is_seen(run, p) for p in pieces) else [run]


def smooth_near(rough: Array, wanted: int, there: Sequence[int]) -> int:
    """Return the instant nearest to the one wanted, of those there are, at which a stretch may begin: not just before
    or at an impact, where its state could hardly be determined."""
    nearest = sorted(there, key=lambda k: abs(k - wanted))
    smooth = [k for k in nearest if rough[k] <= ROUGH]
    return smooth[0] if smooth else min(nearest, key=lambda k: rough[k])


def starts_anywhere(world: World, recording: Recording) -> bool:
    """Return whether every body that moves is rigid, free or in a linkage, there from the start, and seen in every
    run."""
    items = [world.item(name) for name in world.moving_names]
    linked = {link.item.name for linkage in linkages(world) for link in linkage.links}
    if any(is_held(world, i.name) and i.name not in linked for i in items):
        return False
    if any(getattr(j, "motor", None) is not None for j in world.joints):  # it switches at instants of a run
        return False
    if world.deformables or not all(o.start_time == 0.0 for o in world.objects):
        return False
    if any(set(run.names) != {i.name for i in items} or run.lead for run in recording.runs):
        return False
    if world.planar or not (world.statics or len(items) > 1) or not any(o.friction for o in world.objects):
        return True
    # Where turns were not measured, spins in space are as they were when a run began, which a segment cannot know.
    free = [i.name for i in items if i.name not in linked]
    turns = [run.orientations[:, run.names.index(name)] for run in recording.runs for name in free]
    return all(bool(np.isfinite(turn).any()) for turn in turns)


def roughness(run: Run) -> Array:
    """At each instant (T,), how ill a parabola of the run's usual curvature fits the next samples of any position and
    the one before them, as a multiple of what is ordinary in the run; infinite beside samples that are missing, 0 for
    the first instant and the last few.

    A body that rebounds just after a sample looks as if it had left the floor before it. Noise that hides an impact
    from differences of neighbours does not hide it from this.
    """
    count = len(run.times)
    rough = np.zeros(count)
    if count <= ABOUT:
        return rough
    powers = np.vander(np.linspace(-1.0, 1.0, ABOUT), 2)
    off = np.eye(ABOUT) - powers @ np.linalg.pinv(powers)
    half = ABOUT // 2
    for values in run.positions.reshape(count, -1).T:
        bent = values[2 * half :] - 2.0 * values[half:-half] + values[: -2 * half]
        if not np.isfinite(bent).any():
            continue
        straight = values - 0.5 * float(np.nanmedian(bent)) * (np.arange(count) / half) ** 2
        left = np.linalg.norm(sliding_window_view(straight, ABOUT) @ off, axis=1)
        if np.isfinite(left).any():
            relative = np.nan_to_num(left / max(float(np.nanmedian(left)), 1e-12), nan=np.inf)
            rough[1 : len(relative) + 1] = np.maximum(rough[1 : len(relative) + 1], relative)
    return rough


def is_seen(run: Run, piece: Run, fewest: int = FEWEST // 2) -> bool:
    """Return whether all that was measured in a run was measured at no fewer instants in a piece of it."""
    for whole, part in ((run.positions, piece.positions), (run.orientations, piece.orientations)):
        needed: Sequence[int] = np.flatnonzero(np.isfinite(whole).any(axis=0)).tolist()
        there = np.isfinite(part).sum(axis=0).ravel()
        if any(there[i] < fewest for i in needed):
            return False
    return True
