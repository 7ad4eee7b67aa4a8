"""Seal a part of a recording, which no step sees before the verdict, and measure the gap that is left there."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.least_squares import Point
from polyworld.estimation.readout import CHANNELS
from polyworld.gap.cross_validation import run_error
from polyworld.gap.fitting import Fitted, fit, share_left
from polyworld.gap.ground import ground_of
from polyworld.gap.hypothesis import Hypothesis
from polyworld.gap.settings import GapSettings
from polyworld.world import World

Array = NDArray[np.float64]


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
    settings, why = settings or GapSettings(), "as asked"
    if runs is None and len(recording.runs) == 1:
        return _of_time(recording.runs[0], begin, settings)
    if runs is None:
        runs, why = _spare(recording, settings), "the last of those whose objects other runs show too"
    elif not runs:
        return Split(recording, None, "nothing sealed, as asked")
    if not runs:
        return Split(recording, None, f"nothing sealed: {len(recording.runs)} runs, of which none can be spared")
    held_out = recording.select(tuple(runs))
    left = tuple(r for r in recording.runs if r.name not in runs)
    if not left:
        raise ValueError("all runs would be sealed: leave at least one to fit")
    return Split(Recording(left), held_out, f"sealed runs {list(runs)}, {why}")


def _spare(recording: Recording, settings: GapSettings) -> list[str]:
    """Return the last runs whose objects others show too, as many as may be sealed."""
    left, chosen = list(recording.runs), list[str]()
    most = max(1, round(settings.sealed_share * len(left))) if len(left) >= settings.sealed_runs else 0
    for run in reversed(recording.runs):
        if len(chosen) < most and set(run.names) <= {n for r in left if r is not run for n in r.names}:
            left.remove(run)
            chosen.insert(0, run.name)
    return chosen


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


UNITS = ("m", "rad", "rad/s")  # of positions, turns and spins


@dataclass(frozen=True)
class SealedGap:
    """The gap before and after.

    before, after: root mean squares over runs in standard deviations of the noise. share: of the gap beyond the noise
    that is left. by_run: both errors. gap_before, gap_after, noise_floor: residuals of positions beyond the noise, and
    the noise, as root mean squares in `unit`; of turns or spins where no position was measured.
    """

    before: float
    after: float
    share: float
    by_run: dict[str, tuple[float, float]]
    gap_before: float
    gap_after: float
    noise_floor: float
    unit: str

    @property
    def closed(self) -> float | None:
        """Share of the gap that is closed; None where there was none."""
        return 1.0 - self.gap_after / self.gap_before if self.gap_before > 0.0 else None

    def to_json(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self) | {"closed": self.closed}


def settled_alike(worlds: tuple[World, World], recording: Recording, settings: GapSettings) -> tuple[Fitted, Fitted]:
    """Fit the initial states of two worlds to a recording, so that neither loses by a fit that was trapped."""
    first, second = (fit(ground_of(world, recording, settings), Hypothesis(world), growing=True) for world in worlds)
    return _better(first, second), _better(second, first)


def _better(own: Fitted, other: Fitted) -> Fitted:
    same = [len(a) == len(b) for a, b in zip(own.of_states(), other.of_states(), strict=True)]
    if not all(same):
        return own
    again = fit(own.ground, own.hypothesis, Point(own.values, other.point.states), scale=own.scale)
    return min(own, again, key=lambda f: f.objective)


def gap_between(before: Fitted, after: Fitted) -> SealedGap:
    """Measure the gap that two fits to the same runs leave."""
    errors = [_errors(f) for f in (before, after)]
    one, other = (float(np.sqrt(np.mean(e**2))) for e in errors)
    names = [r.name for r in before.ground.recording.runs]
    by_run = {n: (float(a), float(b)) for n, a, b in zip(names, *errors, strict=True)}
    (gap_before, floor, unit), (gap_after, *_) = (left_in_units(f) for f in (before, after))
    return SealedGap(one, other, share_left(one, other), by_run, gap_before, gap_after, floor, unit)


def sealed_gap(
    null: Fitted, best: Fitted, sealed: Recording, world_there: Callable[[World], World] | None = None
) -> SealedGap:
    """Measure the gap on sealed runs. world_there: gives a world as it is where these begin."""
    before, after = (f.hypothesis.fitted_world(f.values) for f in (null, best))
    if world_there is not None:
        before, after = world_there(before), world_there(after)
    return gap_between(*settled_alike((before, after), sealed, null.ground.settings))


def _errors(fitted: Fitted) -> Array:
    return np.array(
        [
            run_error(one.residuals, len(states), readout.columns())
            for one, states, readout in zip(fitted.slopes, fitted.of_states(), fitted.ground.readouts, strict=True)
        ]
    )


def left_in_units(fitted: Fitted) -> tuple[float, float, str]:
    """Return the residuals beyond the noise, and the noise, as root mean squares corrected for the states fitted, and
    their unit: of positions, or of the angles that they all stand for, else of turns or spins."""
    readouts = fitted.ground.readouts
    kind = next(k for k in range(3) if any((g.columns() % CHANNELS // 3 == k).any() for g in readouts))
    angles = kind == 0 and all(len(g.tangents) == len(g.run.names) for g in readouts)
    total = noise = count = paid = 0.0
    for one, states, readout in zip(fitted.slopes, fitted.of_states(), readouts, strict=True):
        columns = readout.columns()
        own = columns % CHANNELS // 3 == kind
        sigma = readout.sigma[readout.measured][own]
        if angles:
            tangents = np.stack(list(readout.tangents.values()), axis=1)
            arc = np.abs(tangents[readout.rows()[own], columns[own] // CHANNELS, columns[own] % CHANNELS])
            sigma = sigma / arc / np.array(readout.run.arms)[columns[own] // CHANNELS]
        total += float(((one.residuals[own] * sigma) ** 2).sum())
        noise += float((sigma**2).sum())
        count += float(own.sum())
        paid += len(states) * float(own.sum()) / max(len(columns), 1)
    floor = noise / max(count, 1.0)
    left = float(np.sqrt(max(total / max(count - paid, 1.0) - floor, 0.0)))
    return left, float(np.sqrt(floor)), UNITS[1 if angles else kind]
