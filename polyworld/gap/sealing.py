"""Seal a part of a recording: data that no step sees before the verdict."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.gap.settings import GapSettings
from polyworld.world import World


@dataclass(frozen=True)
class Split:
    """A recording split into what is fitted and what is held out, None where nothing could be spared.

    summary: what was done, for readers. into [s]: how long after the world's time 0 the held-out part begins, where it
    is the later part of a run.
    """

    fitted: Recording
    held_out: Recording | None
    summary: str
    into: float = 0.0

    def held_out_world(self, world: World) -> World:
        """Return the world as it is when the held-out part begins: objects that joined before are there."""
        if self.into == 0.0:
            return world
        document = world.model_dump()
        for item in (*document["objects"], *document["deformables"]):
            if item.get("start_time"):
                item["start_time"] = max(item["start_time"] - self.into, 0.0)
        return World.model_validate(document)


def hold_out(
    recording: Recording,
    runs: Sequence[str] | None = None,
    *,
    begin: float | None = None,
    settings: GapSettings | None = None,
) -> Split:
    """Hold out the runs named; by default the last quarter of three or more runs, or of the time of the only run.

    Of several runs that show different objects, those are held out whose objects other runs show too. begin [s]: from
    when on the only run is held out instead. Raises KeyError for unknown runs, ValueError where nothing would be left
    to fit.
    """
    settings = settings or GapSettings()
    if runs is not None and not runs:
        return Split(recording, None, "nothing sealed, as asked")
    if runs is not None:
        return _of_runs(recording, tuple(runs), "as asked")
    if len(recording.runs) == 1:
        return _of_time(recording.runs[0], begin, settings)
    chosen = _spare(recording, settings)
    if chosen:
        return _of_runs(recording, chosen, "the last of those whose objects other runs show too")
    return Split(recording, None, f"nothing sealed: {len(recording.runs)} runs, of which none can be spared")


def _of_runs(recording: Recording, names: tuple[str, ...], why: str) -> Split:
    held_out = recording.select(names)
    left = tuple(r for r in recording.runs if r.name not in names)
    if not left:
        raise ValueError("all runs would be sealed: leave at least one to fit")
    return Split(Recording(left), held_out, f"sealed runs {list(names)}, {why}")


def _spare(recording: Recording, settings: GapSettings) -> tuple[str, ...]:
    left = list(recording.runs)
    chosen: list[str] = []
    most = max(1, round(settings.sealed_share * len(left))) if len(left) >= settings.sealed_runs else 0
    for run in reversed(recording.runs):
        others = {n for r in left if r is not run for n in r.names}
        if len(chosen) < most and set(run.names) <= others:
            left.remove(run)
            chosen.append(run.name)
    return tuple(reversed(chosen))


def _of_time(run: Run, begin: float | None, settings: GapSettings) -> Split:
    count = len(run.times)
    late = round(settings.sealed_share * count) if begin is None else int(np.sum(run.times >= begin - 1e-9))
    if min(late, count - late) < settings.sealed_instants:
        return Split(Recording((run,)), None, f"nothing sealed: {count} instants are too few to divide")
    early = np.arange(count) < count - late
    first = float(run.times[count - late])
    later = replace(run.rows(~early), name=f"{run.name}-later", lead=0.0)
    summary = f"sealed the time from {first:.6g} s on, with an initial state of its own"
    return Split(Recording((run.rows(early),)), Recording((later,)), summary, first - run.origin)
