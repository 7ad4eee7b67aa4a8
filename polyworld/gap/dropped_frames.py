"""Where frames may have been dropped or repeated unnoticed: the score of every onset, without a simulation for each.

From an onset on, a stamp that is too early by a small shift displaces what is seen by the shift times the velocity. So
one rollout of what is fitted already, seen a little later from its start on, gives the slopes of the residuals by the
shift for all onsets at once; projected off all that is fitted (Rao 1948), they predict the gain of a shift there.

Frames are dropped and repeated whole. A shift by less than half a frame is what an impact leaves that lasts a few
milliseconds in truth and none in the model, and is no onset.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.design import RunDesign
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.forward import Settings
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.normal_equations import within_reach
from polyworld.estimation.score_test import ScoreTestStart

Array = NDArray[np.float64]

MOST_ONSETS = 400  # of one run that are scored; longer runs are scored at every second, third ... stamp
BETWEEN = 4  # scored onsets between two that are both reported
WHOLE = 0.5  # of a frame, from which on a shift is nearer to one frame than to none
SMALL = 0.1  # of a frame, by which what is seen is shifted for a slope
ENDS = 3  # samples before the first onset and after the last


@dataclass(frozen=True)
class Onset:
    """A possible onset in a run: its time from the run's start [s], midway between two stamps; the shift [s], positive
    where frames were dropped; and by how much chi2 would fall."""

    time: float
    shift: float
    gain: float


def dropped_frame_starts(
    context: FitContext, trial: FittedHypothesis, hypothesis: Hypothesis, run: RunDesign, count: int
) -> tuple[Onset, ...]:
    """Return the onsets in a run at which dropped or repeated frames would explain most of a fit's residuals, best
    first.

    hypothesis: the fitted one with a shift in that run. At most `count`, none where the run is too short.
    """
    own = hypothesis.parts[-1].variant.unknowns
    longest = max(max(abs(u.lower), abs(u.upper)) for u in own if u.name == "shift")
    times = run.times
    if len(times) < 2 * ENDS + 1:
        return ()
    ground = trial.nuisance
    stride = 1 + (len(times) - 2 * ENDS) // MOST_ONSETS
    first_after = np.arange(ENDS, len(times) - ENDS + 1, stride)
    slopes = ground.off(run.index, _slopes(context, trial, hypothesis, run, first_after))
    rest = ground.off(run.index, trial.fit.linear.r[run.index])
    shared = ground.slopes[run.index]
    pulls = sum(
        (a.T @ ground.off(r, trial.fit.linear.r[r]) for r, a in enumerate(ground.slopes)), np.zeros(shared.shape[1])
    )
    across = slopes @ shared  # (K, S)
    information = (slopes**2).sum(axis=1) - np.einsum("ks,st,kt->k", across, ground.inverse, across)
    gradient = slopes @ rest - across @ ground.inverse @ pulls
    known = information > 1e-9 * information.max(initial=0.0)
    frame = float(np.median(np.diff(times)))
    shift = np.clip(np.where(known, -gradient / np.where(known, information, 1.0), 0.0), -longest, longest)
    known &= np.abs(shift) >= WHOLE * frame
    gain = -(2.0 * gradient * shift + information * shift**2)
    chosen: list[int] = []
    for k in np.argsort(-gain, kind="stable"):
        if len(chosen) < count and known[k] and all(abs(k - other) >= BETWEEN for other in chosen):
            chosen.append(int(k))
    return tuple(
        Onset(float(0.5 * (times[i - 1] + times[i])), float(shift[k]), float(gain[k]))
        for k, i in ((k, int(first_after[k])) for k in chosen)
    )


def score_test_dropped_frames(
    context: FitContext, trial: FittedHypothesis, hypotheses: Sequence[Hypothesis], keep: int
) -> list[ScoreTestStart]:
    """Return where to begin fits of hypotheses whose last part is a shift in one run: the `keep` best onsets of all
    runs."""
    found: list[ScoreTestStart] = []
    for hypothesis in hypotheses:
        part = hypothesis.parts[-1].variant
        observer = part.world.observer
        run = next((r for r in context.design.runs if observer is not None and r.run.name == observer.shift_run), None)
        if run is None:
            continue
        for onset in dropped_frame_starts(context, trial, hypothesis, run, keep):
            given = {"shift": onset.shift, "shift_time": onset.time}
            values = np.concatenate([trial.values, [given[u.name] for u in part.unknowns]])
            before = np.concatenate([trial.values, [(given | {"shift": 0.0})[u.name] for u in part.unknowns]])
            (slope,) = _slopes(context, trial, hypothesis, run, np.searchsorted(run.times, [onset.time]))
            states = list(trial.fit.states)
            answer = trial.nuisance.answers[run.index] @ (slope * onset.shift)
            states[run.index] = states[run.index] + within_reach(answer, run.typical)
            found.append(ScoreTestStart(hypothesis, values, trial.chi2 - onset.gain, before, tuple(states)))
    return sorted(found, key=lambda tested: tested.chi2)[:keep]


def _slopes(
    context: FitContext, trial: FittedHypothesis, hypothesis: Hypothesis, run: RunDesign, first_after: NDArray[np.int64]
) -> Array:
    """Whitened derivatives (K, m) of a run's residuals by a shift from each of K stamps on."""
    own = hypothesis.parts[-1].variant.unknowns
    step = SMALL * float(np.median(np.diff(run.times)))
    begin = {u.name: u.lower for u in own}
    shared = np.array([[*trial.values, *((begin | {"shift": s})[u.name] for u in own)] for s in (0.0, step)])
    states = np.repeat(trial.fit.states[run.index][None], 2, axis=0)
    (raw,) = context.forward(hypothesis).residuals([Settings(run.index, shared, states)])
    row = np.zeros(run.length, dtype=np.int64)
    for s in run.series:
        row[s.where] = s.rows
    late = row[None] >= first_after[:, None]
    return context.noise.whiten(run.index, np.nan_to_num(raw[1] - raw[0]) / step * late)
