"""Which part of a recording is sealed: kept from every step, until the very end shows what an added effect is worth."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from polyworld.recording import Recording, Run
from polyworld.world import World

SHARE = 0.25  # of the runs, or of a single run's time
FEWEST = 3  # runs of which one can be spared
LEAST = 12  # instants that each part of a divided run must keep


@dataclass(frozen=True)
class HeldBack:
    """A recording in two parts. sealed: None where nothing could be spared; said tells what was done. into: how long
    after the world's time 0 the sealed part begins, where it is the later part of a run [s]."""

    fitted: Recording
    sealed: Recording | None
    said: str
    into: float = 0.0

    def sealed_world(self, world: World) -> World:
        """The world as it is at the beginning of the sealed part: who joined before is there."""
        if self.into == 0.0:
            return world
        document = world.model_dump()
        for item in (*document["objects"], *document["deformables"]):
            if item.get("start_time"):
                item["start_time"] = max(item["start_time"] - self.into, 0.0)
        return World.model_validate(document)


def hold_back(recording: Recording, runs: Sequence[str] | None = None, begin: float | None = None) -> HeldBack:
    """Seal the runs named; without names the last quarter of three or more runs, or of the time of the only run.

    Of several runs that show different objects, those are sealed whose objects other runs show too. begin: instant [s]
    from which the only run is sealed instead. Raises KeyError for unknown runs, ValueError where nothing would be left
    to fit.
    """
    if runs is not None and not runs:
        return HeldBack(recording, None, "nothing sealed, as asked")
    if runs is not None:
        return _sealed_runs(recording, tuple(runs), "as asked")
    if len(recording.runs) >= FEWEST:
        chosen = _spare(recording)
        if chosen:
            return _sealed_runs(recording, chosen, "the last of those whose objects other runs show too")
    if len(recording.runs) == 1:
        return _divided(recording.runs[0], begin)
    return HeldBack(recording, None, f"nothing sealed: {len(recording.runs)} runs, of which none can be spared")


def _sealed_runs(recording: Recording, names: tuple[str, ...], why: str) -> HeldBack:
    sealed = recording.select(names)
    left = tuple(r for r in recording.runs if r.name not in names)
    if not left:
        raise ValueError("all runs would be sealed: leave at least one to fit")
    return HeldBack(Recording(left), sealed, f"sealed runs {list(names)}, {why}")


def _spare(recording: Recording) -> tuple[str, ...]:
    left = list(recording.runs)
    chosen: list[str] = []
    for run in reversed(recording.runs):
        if len(chosen) >= max(1, round(SHARE * len(recording.runs))):
            break
        others = {n for r in left if r is not run for n in r.names}
        if set(run.names) <= others:
            left.remove(run)
            chosen.append(run.name)
    return tuple(reversed(chosen))


def _divided(run: Run, begin: float | None) -> HeldBack:
    count = len(run.times)
    late = round(SHARE * count) if begin is None else int(np.sum(run.times >= begin - 1e-9))
    if late < LEAST or count - late < LEAST:
        return HeldBack(Recording((run,)), None, f"nothing sealed: {count} instants are too few to divide")
    rows = np.arange(count) < count - late
    first = float(run.times[count - late])
    later = replace(run.rows(~rows), name=f"{run.name}-later", lead=0.0)
    return HeldBack(
        Recording((run.rows(rows),)),
        Recording((later,)),
        f"sealed the time from {first:.6g} s on, with an initial state of its own",
        first - run.origin,
    )
