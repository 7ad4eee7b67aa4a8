"""Estimate the impulse that a world lacks at the joints of segments, each of which is fitted by itself.

Neighbouring segments of a run, fitted with initial states of their own (multiple shooting without conditions of
continuity), disagree where they meet. Position is continuous, velocity is not: the change of the velocity given that
the positions agree is what weak-constraint assimilation (Tremolet 2006, doi:10.1256/qj.05.224) calls model error, here
the missing impulse per mass. A force that acts throughout shows as changes that are alike at all joints.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording, Run
from polyworld.estimation.descent import standard_steps
from polyworld.estimation.design import Design, RunDesign, design
from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.normal_equations import PRIOR, NormalEquations
from polyworld.gap.segment_context import SegmentContext, segment_context

Array = NDArray[np.float64]

PIECES = 8  # segments of an ordinary run: enough to see where, long enough to see anything
DAMPING = 1e-12  # relative, of the curvature: only against rounding


@dataclass(frozen=True)
class SegmentJump:
    """Change of an object's velocity (3,) [m/s] between two segments of a run, and its place (3,) [m]; NaN along axes
    that were not measured. time [s]: by the run's clock. sigma: standard deviation along the change [m/s], widened
    where the segments themselves fit worse than noise allows."""

    run: str
    name: str
    time: float
    place: Array
    change: Array
    sigma: float

    @property
    def sigmas(self) -> float:
        """Size in its standard deviations."""
        return float(np.linalg.norm(np.nan_to_num(self.change))) / self.sigma


def segment_jumps(trial: FittedHypothesis) -> tuple[SegmentJump, ...] | None:
    """Return the jumps between segments of all runs, by run and time; None where runs cannot be cut: deformable
    objects, unobserved states, too few samples, no positions.

    The shared unknowns keep the values of the trial; only the segments' initial states are fitted.
    """
    seen = trial.hypothesis.world.observer
    cut = None if seen is not None and seen.shift_run is not None else segment_context(trial.context, PIECES)
    if cut is None:
        return None
    owner = cut.segments.run
    joints = [k for k in range(len(owner) - 1) if owner[k] == owner[k + 1] and _places_of(cut, k)]
    if not joints:
        return None
    world = trial.hypothesis.fitted_world(trial.values)
    fitted = cut.fit_base(Hypothesis(world, ()), np.zeros(0))
    forward = fitted.context.forward(fitted.hypothesis)
    covariance = NormalEquations(forward, fitted.fit.linear).reduced(DAMPING, PRIOR)[0]
    covariance = covariance * np.maximum(np.nan_to_num(fitted.misfits, nan=1.0, posinf=1.0), 1.0)[:, None, None]
    steps = standard_steps(forward, fitted.fit.linear)[1]
    plan = _joint_design(cut, joints)
    at = [k + side for k in joints for side in (0, 1)]  # the segment that each run of the plan is simulated from
    joined = Forward(plan, world, (), trial.context.cancelled)
    places = _simulated(joined, [fitted.fit.states[k] for k in at], [steps[k] for k in at])
    found: list[SegmentJump] = []
    for j, k in enumerate(joints):
        before, after = places[2 * j], places[2 * j + 1]
        run = plan.runs[2 * j + 1].run
        for column, name in enumerate(run.names):
            own = _jump(before[:, :, column], after[:, :, column], covariance[[k, k + 1]], float(np.diff(run.times)[0]))
            if own is not None:
                change, sigma = own
                whole = run.part_of or run.window_of or run.name
                found.append(SegmentJump(whole, name, float(run.times[0]), after[0, 0, column], change, sigma))
    return tuple(found)


def _places_of(cut: SegmentContext, k: int) -> bool:
    """Return whether positions were measured in a segment."""
    return any(s.kind == "position" for s in cut.segments.parts.runs[k].series)


def _joint_design(cut: SegmentContext, joints: Sequence[int]) -> Design:
    """Lay out, for every joint, the segment before it and the one after it: each from its start, sampled at the first
    two instants after the joint."""
    segments, runs, states = cut.segments, [], []
    for k in joints:
        for side in (0, 1):
            own = segments.parts.runs[k + side]
            runs.append(_sampled(segments.whole.runs[segments.run[k]].run, own.run, segments.parts.runs[k + 1].run))
            states.append(own.states)
    laid = design(segments.parts.world, Recording(tuple(runs)), initial="given")
    return replace(laid, runs=tuple(replace(r, states=s) for r, s in zip(laid.runs, states, strict=True)))


def _sampled(whole: Run, segment: Run, later: Run) -> Run:
    """Return a run that starts as a segment does and has the first two instants of the later one, all that was ever
    measured of positions there; what it says was measured only says where to simulate."""
    times = np.unique(np.concatenate([segment.times[:1], later.times[:2]]))
    shape = (len(times), len(whole.names))
    measured = np.isfinite(whole.positions).any(axis=0)
    return replace(
        whole,
        name=f"{segment.name} at {later.times[0]:.9g}",
        times=times,
        positions=np.where(measured, np.zeros((*shape, 3)), np.nan),
        orientations=np.full((*shape, 4), np.nan),
        angular_velocities=np.full((*shape, 3), np.nan),
        lead=0.0,
        window_of=segment.window_of,
    )


def _simulated(forward: Forward, states: Sequence[Array], steps: Sequence[Array]) -> list[Array]:
    """Return places (1 + N, 2, n, 3) [m] at the last two instants of each run: from its initial state (N,), and their
    derivatives by its coordinates, as difference quotients over steps (N,)."""
    settings = []
    for own, start, step in zip(forward.design.runs, states, steps, strict=True):
        turned = np.concatenate([start[None], start + np.diag(step)])
        settings.append(Settings(own.index, np.zeros((len(turned), 0)), turned))
    found = []
    for own, step, raw in zip(forward.design.runs, steps, forward.residuals(settings), strict=True):
        places = _places(own, raw)
        places[1:] = (places[1:] - places[:1]) / step[:, None, None, None]
        found.append(places)
    return found


def _places(own: RunDesign, raw: Array) -> Array:
    """Return simulated places (k, 2, n, 3) of residuals (k, m) against measured zeros; NaN along unmeasured axes."""
    places = np.full((len(raw), len(own.times), len(own.run.names), 3), np.nan)
    for s in own.series:
        places[:, s.rows, own.run.names.index(s.name), s.axis] = raw[:, s.where]
    last: Array = places[:, -2:]
    return last


def _jump(before: Array, after: Array, covariance: Array, step: float) -> tuple[Array, float] | None:
    """Return the change (3,) of the velocity and its standard deviation along it, given that positions agree; None
    where a rollout diverged or nothing was measured.

    before, after (1 + N, 2, 3): places, and their derivatives. covariance (2, N, N) of the two initial states.
    """
    measured = np.isfinite(after[0, 0]) & np.isfinite(before[0, 0])
    count = int(measured.sum())
    if count == 0:
        return None
    total, spread = np.zeros(2 * count), np.zeros((2 * count, 2 * count))
    for sign, places, own in ((-1.0, before, covariance[0]), (1.0, after, covariance[1])):
        here = places[:, :, measured]
        both = np.concatenate([here[:, 0], (here[:, 1] - here[:, 0]) / step], axis=1)  # place and velocity
        slopes, n = both[1:], len(both) - 1
        total += sign * both[0]
        spread += slopes.T @ own[:n, :n] @ slopes
    if not (np.isfinite(total).all() and np.isfinite(spread).all()):
        return None
    gain = spread[count:, :count] @ np.linalg.pinv(spread[:count, :count], hermitian=True)
    velocity = total[count:] - gain @ total[:count]
    left = spread[count:, count:] - gain @ spread[:count, count:]
    size = float(np.linalg.norm(velocity))
    along = velocity / size if size > 0.0 else np.eye(count)[0]
    change = np.full(3, np.nan)
    change[measured] = velocity
    sigma = float(np.sqrt(max(along @ left @ along, 0.0)))
    return (change, sigma) if sigma > 0.0 else None
