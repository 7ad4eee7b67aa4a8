"""Wrong time stamps: an offset of all, and frames that were dropped or repeated."""

from __future__ import annotations

import numpy as np

from polyworld.estimation.candidate import Candidate, Variant
from polyworld.gap.adding import one_start
from polyworld.gap.dropped_frames import dropped_frame_leads
from polyworld.gap.faults.observing import observed, of_observer
from polyworld.observer import MARGIN
from polyworld.recording import Recording, Run
from polyworld.world import World

FRAMES = 10.0  # that are ordinarily missed, or by which a recording ordinarily begins late
# Effects whose course depends on the time since the start.
_TIMED = frozenset({"periodic_forcing", "expression"})


def _interval(run: Run) -> float:
    return float(np.median(np.diff(run.times)))


def _limits(interval: float) -> dict[str, float]:
    """Bounds of a shift of time, whose ordinary size is an interval between frames."""
    return {"lower": -MARGIN * interval, "upper": MARGIN * interval, "plausible": FRAMES * interval}


def _time_offset(world: World, recording: Recording) -> tuple[Variant, ...]:
    # Free initial states take up any offset, unless something tells when the world began.
    begins = (
        any(run.lead > 0.0 for run in recording.runs)
        or bool(world.deformables)
        or any(o.start_time > 0.0 for o in world.objects)
        or any(getattr(j, "other", None) is not None for j in world.joints)
        or any(getattr(j, "motor", None) is not None for j in world.joints)
        or any(e.enabled and e.kind in _TIMED for e in world.effects)
    )
    if not begins:
        return ()
    child = observed(world)
    interval = max(_interval(run) for run in recording.runs)
    offset = of_observer(child, "time_offset", "time_offset", interval, **_limits(interval))
    return (one_start(child, (offset,)),)


def _dropped(world: World, recording: Recording) -> tuple[Variant, ...]:
    if world.observer is not None and world.observer.shift != 0.0:
        return ()
    made = []
    for run in recording.runs:
        if len(run.times) < 3:
            continue
        interval = _interval(run)
        first, last = run.lead, run.lead + float(run.times[-1] - run.times[0])
        child = observed(world, shift_run=run.name, shift_time=0.5 * (first + last))
        unknowns = (
            of_observer(child, "shift", "shift", interval, **_limits(interval)),
            of_observer(child, "shift_time", "shift_time", 10.0 * interval, lower=first, upper=last),
        )
        label = "" if len(recording.runs) == 1 else f"in run {run.name}"
        made.append(one_start(child, unknowns, label, strength="shift"))
    return tuple(made)


CANDIDATES = (
    Candidate(
        name="observer_time_offset",
        group="observer",
        law="t_seen = t - t0",
        signature="residuals along the velocity, the same delay everywhere and from the start on",
        reference="any mechanics text, change of the origin of time",
        variants=_time_offset,
        confused_with={
            "dropped_frames": "the delay is there from the first sample",
            "actuator_delay": "motion that no actuator drives is late too",
        },
    ),
    Candidate(
        name="dropped_frames",
        group="observer",
        law="t_seen = t - shift after shift_time",
        signature="from one instant on all bodies are ahead (frames dropped) or behind (repeated) by one time",
        reference="any video text; a change of the origin of time at an instant",
        variants=_dropped,
        confused_with={
            "hidden_wall": "bodies elsewhere jump at the same instant, and speeds stay as they were",
            "fan": "the jump is a displacement along the velocity, with no change of velocity",
            "observer_clock": "the delay does not grow",
        },
        leads=dropped_frame_leads,
    ),
)
