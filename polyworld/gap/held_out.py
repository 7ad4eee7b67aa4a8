"""Data held out: which part of a recording no step sees before the verdict, and the gap that a world leaves there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation import profile
from polyworld.estimation.design import Design, design
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.noise import UNITS, Noise, first_kind, measured_noise
from polyworld.estimation.run_segments import in_segments
from polyworld.gap.settings import HoldOutSettings
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
    settings: HoldOutSettings | None = None,
) -> Split:
    """Hold out the runs named; by default the last quarter of three or more runs, or of the time of the only run.

    Of several runs that show different objects, those are held out whose objects other runs show too. begin [s]: from
    when on the only run is held out instead. Raises KeyError for unknown runs, ValueError where nothing would be left
    to fit.
    """
    settings = settings or HoldOutSettings()
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


def _spare(recording: Recording, settings: HoldOutSettings) -> tuple[str, ...]:
    left = list(recording.runs)
    chosen: list[str] = []
    most = max(1, round(settings.share * len(left))) if len(left) >= settings.fewest_runs else 0
    for run in reversed(recording.runs):
        others = {n for r in left if r is not run for n in r.names}
        if len(chosen) < most and set(run.names) <= others:
            left.remove(run)
            chosen.append(run.name)
    return tuple(reversed(chosen))


def _of_time(run: Run, begin: float | None, settings: HoldOutSettings) -> Split:
    count = len(run.times)
    late = round(settings.share * count) if begin is None else int(np.sum(run.times >= begin - 1e-9))
    if min(late, count - late) < settings.fewest_instants:
        return Split(Recording((run,)), None, f"nothing sealed: {count} instants are too few to divide")
    early = np.arange(count) < count - late
    first = float(run.times[count - late])
    later = replace(run.rows(~early), name=f"{run.name}-later", lead=0.0)
    summary = f"sealed the time from {first:.6g} s on, with an initial state of its own"
    return Split(Recording((run.rows(early),)), Recording((later,)), summary, first - run.origin)


@dataclass(frozen=True)
class HeldOutGap:
    """Root-mean-square residuals of positions [m] (else of orientations [rad] or spins [rad/s]) beyond the noise.

    noise_floor: the noise itself. closed: share of the gap that the effect closes, 1 - gap_after / gap_before; None
    where there was none to close.
    """

    gap_before: float
    gap_after: float
    noise_floor: float
    closed: float | None
    unit: str

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return asdict(self)

    @property
    def contradicts(self) -> str | None:
        """In words, that a world which explains the fitted data does not explain these; None where it does."""
        if not self.gap_after > max(self.noise_floor, self.gap_before - self.gap_after):
            return None  # it is noise, or more of the gap was closed than is left
        return (
            f"the sealed data do not support this: of a gap of {self.gap_before:.3g} {self.unit} there "
            f"{self.gap_after:.3g} {self.unit} are left, with a noise of {self.noise_floor:.3g} {self.unit}; what "
            "explains the data fitted is not all that acts, or not what does"
        )


def held_out_gap(before: World, after: World, recording: Recording, known: Noise | None = None) -> HeldOutGap:
    """Measure the gap on held-out runs before and after: what runs share stays as fitted, initial states are fitted.

    Each run, and each part of a long one, has an initial state of its own. known: noise of the same measurements in
    other runs, which is no less in these: few samples hide its correlation.
    """
    worlds = (before, after)
    cut = in_segments(recording, *worlds)
    plans = [design(world, cut) for world in worlds]
    plan = plans[0]
    noise = measured_noise(plan)
    kind = first_kind(plan.series)
    floor = _noise_level(plan, noise, kind)
    if known is not None:
        levels = [level.sigma**2 for level in known.levels if level.kind == kind]
        floor = max(floor, float(np.sqrt(np.mean(levels)))) if levels else floor
    forwards = [Forward(p, world, ()) for p, world in zip(plans, worlds, strict=True)]
    none, horizons = np.zeros(0), profile.horizons_for(plan)
    fits = [profile.fit(f, noise, none, profile.start_states(f.design), horizons=horizons) for f in forwards]
    gaps = []
    for forward, own, other, theirs in zip(forwards, fits, reversed(fits), reversed(plans), strict=True):
        # Neither world is to lose by a fit that was trapped.
        again = profile.fit(forward, noise, none, _carried(forward.design, theirs, other.states))
        gaps.append(_beyond_noise(forward.design, forward, min(own, again, key=lambda f: f.chi2), kind, floor))
    closed = 1.0 - gaps[1] / gaps[0] if gaps[0] > 0.0 else None
    return HeldOutGap(gaps[0], gaps[1], floor, closed, UNITS[kind])


def _carried(plan: Design, other: Design, states: Sequence[Array]) -> tuple[Array, ...]:
    """Return initial states of another design of the same runs, as far as they are coordinates of this one too."""
    carried = []
    for own, theirs, known in zip(plan.runs, other.runs, states, strict=True):
        fitted = dict(zip(theirs.labels, known, strict=True))
        carried.append(np.array([fitted.get(label, v) for label, v in zip(own.labels, own.start, strict=True)]))
    return tuple(carried)


def _noise_level(plan: Design, noise: Noise, kind: str) -> float:
    levels = [noise.sigma[s.run][s.where] for s in plan.series if s.kind == kind]
    return float(np.sqrt(np.mean(np.concatenate(levels) ** 2)))


def _beyond_noise(plan: Design, forward: Forward, fit: profile.Fit, kind: str, floor: float) -> float:
    """Return the residual's mean square, corrected for the initial states fitted, less the noise's; as a root."""
    settings = [Settings(r.index, np.zeros((1, 0)), fit.states[r.index][None]) for r in plan.runs]
    total, count = 0.0, 0
    for r, raw in zip(plan.runs, forward.residuals(settings), strict=True):
        for s in r.series:
            if s.kind == kind:
                total += float(np.sum(raw[0, s.where] ** 2))
                count += len(s.rows)
    fitted = sum(r.count for r in plan.runs) * count / plan.length  # unknowns that these components paid for
    if not np.isfinite(total):
        return float("inf")
    return float(np.sqrt(max(total / max(count - fitted, 1.0) - floor**2, 0.0)))
