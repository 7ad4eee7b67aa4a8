"""Choose where each segment's initial state starts: lines through few or many samples, on either side of the cut.

An impact shortly after or before a cut spoils the line through the samples it lies between, and which lines are spoilt
differs from body to body. Every body's state is estimated from several stretches of samples, and the estimates under
which the segment's simulation is nearest to the data are taken, body by body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.continuity import jumps
from polyworld.estimation.least_squares import Chains, Point
from polyworld.estimation.problem import Segment
from polyworld.estimation.segment_forward import Settings
from polyworld.estimation.states import StateCoordinates, _free
from polyworld.recording import Run
from polyworld.representations.rigid import RigidObject

Array = NDArray[np.float64]

FORWARD = (5, 3, 2)  # samples after the cut, besides those of the default estimate
BACKWARD = (8, 5, 3)  # samples before it
SWEEPS = 2
SPINS = (-2.0, -0.7, 0.7, 2.0)  # starts of unobserved spins, in their ordinary size


def best_guesses(chains: Chains, values: Array) -> tuple[Array, ...]:
    """Return initial states[segment] (N,) chosen among estimates from several stretches of samples."""
    problem = chains.problem
    options = [_options(chains, s) for s in problem.segments]
    states = [np.array(g) for g in problem.guess]
    for _ in range(SWEEPS):
        tried = [_tried(states[s.index], options[s.index]) for s in problem.segments]
        settings = [
            Settings(s.index, np.repeat(values[None], len(t), axis=0), t)
            for s, t in zip(problem.segments, tried, strict=True)
        ]
        costs = _segment_costs(chains, settings)
        mixed = []
        for s, _t, cost in zip(problem.segments, tried, costs, strict=True):
            mixed.append(_mixed(states[s.index], options[s.index], cost))
        settings = [
            Settings(s.index, np.repeat(values[None], 2, axis=0), np.array([m, t[int(np.argmin(c))]]))
            for s, t, m, c in zip(problem.segments, tried, mixed, costs, strict=True)
        ]
        for s, item, cost in zip(problem.segments, settings, _segment_costs(chains, settings), strict=True):
            states[s.index] = item.states[int(np.argmin(cost))]
    return tuple(states)


def propagated(chains: Chains, at: Point) -> Point:
    """Return the point with bodies' states replaced by those at the previous segment's end, where that is nearer.

    A segment whose own samples led to a wrong minimum, behind an impact that they do not resolve, is entered as its
    predecessor leaves it.
    """
    problem = chains.problem
    settings = [Settings(s.index, at.values[None], at.states[s.index][None]) for s in problem.segments]
    outcomes = chains.forward.outcomes(settings)
    found = jumps(chains.continuity, outcomes, [s.states for s in settings])
    options: list[list[tuple[slice, Array]]] = [[] for _ in problem.segments]
    for boundary, jump in zip(chains.continuity.boundaries, found, strict=True):
        layout, place = problem.segments[boundary.after].layout, 0
        row = 0
        for own in layout.states:
            if own.linkage is None:
                count = sum(not label.startswith("effects.") for label in own.labels)
                where = slice(place, place + len(own.labels))
                value = at.states[boundary.after][where].copy()
                if count == len(own.labels):
                    value += chains.continuity.signs(own.labels) * jump[0, row : row + count]
                    options[boundary.after].append((where, value))
                row += count
            place += len(own.labels)
    return _improved(chains, at, options)


def _segment_costs(chains: Chains, settings: Sequence[Settings]) -> list[Array]:
    """chi2 (k,) of every segment, correlations of the noise left aside."""
    found = []
    for item, outcome in zip(settings, chains.forward.outcomes(settings), strict=True):
        own = chains.problem.segments[item.run]
        sigma, kept = chains.noise.sigma[own.run][own.own], chains.noise.kept[own.run][own.own]
        cost = ((outcome.residual / sigma * kept) ** 2).sum(axis=1)
        found.append(np.where(np.isfinite(cost), cost, np.inf))
    return found


def _tried(now: Array, options: Sequence[tuple[slice, Array]]) -> Array:
    """The present state and each option put into it, (k, N)."""
    found = np.repeat(now[None], 1 + len(options), axis=0)
    for row, (where, values) in enumerate(options, start=1):
        found[row, where] = values
    return found


def _mixed(now: Array, options: Sequence[tuple[slice, Array]], costs: Array) -> Array:
    """Every body's best option where it is better than the present state."""
    best: dict[int, tuple[float, slice, Array]] = {}
    for (where, values), cost in zip(options, costs[1:], strict=True):
        if cost < costs[0] and cost < best.get(where.start, (np.inf,))[0]:
            best[where.start] = (float(cost), where, values)
    mixed = now.copy()
    for _, where, values in best.values():
        mixed[where] = values
    return mixed


def _options(chains: Chains, segment: Segment) -> list[tuple[slice, Array]]:
    found: list[tuple[slice, Array]] = []
    world = segment.layout.world(chains.problem.world)
    whole = chains.problem.whole.runs[segment.run].run
    run = segment.layout.run
    at = 0
    for own in segment.layout.states:
        where = slice(at, at + len(own.labels))
        at += len(own.labels)
        if own.linkage is not None or not isinstance(item := world.item(own.name), RigidObject):
            continue
        column = run.names.index(own.name)
        for label_at, _label in enumerate(own.labels):
            if own.spread[label_at] > 0.0:  # a spin that was not measured: its sign is a discrete question
                for spin in SPINS:
                    value = own.start.copy()
                    value[label_at] = spin * own.spread[label_at]
                    found.append((where, value))
        for count in FORWARD:
            found += _same(own, _free(world, item, run, column, count), where)
        past = _reversed(whole, float(run.times[0]))
        for count in BACKWARD:
            if past is None:
                break
            back = _free(world, item, past, column, count)
            sign = np.array([-1.0 if "velocity" in label else 1.0 for label in back.labels])
            found += _same(own, replace(back, start=back.start * sign), where)
    return found


def _same(own: StateCoordinates, other: StateCoordinates, where: slice) -> list[tuple[slice, Array]]:
    return [(where, other.start)] if other.labels == own.labels else []


def _reversed(run: Run, cut: float) -> Run | None:
    """A run backwards in time from a cut."""
    keep = run.times <= cut + 1e-9
    if keep.sum() < 4:
        return None
    past = run.rows(keep)
    return replace(
        past, times=cut - past.times[::-1], positions=past.positions[::-1], orientations=past.orientations[::-1]
    )


def flipped(chains: Chains, at: Point) -> Point:
    """Return the point with unobserved spins changed where that brings a segment nearer to its data."""
    problem = chains.problem
    options: list[list[tuple[slice, Array]]] = []
    for s in problem.segments:
        own: list[tuple[slice, Array]] = []
        place = 0
        for coordinates in s.layout.states:
            where = slice(place, place + len(coordinates.labels))
            place += len(coordinates.labels)
            for i in np.flatnonzero(coordinates.spread > 0.0):
                for spin in SPINS:
                    value = at.states[s.index][where].copy()
                    value[i] = spin * coordinates.spread[i]
                    own.append((where, value))
        options.append(own)
    if not any(options):
        return at
    return _improved(chains, at, options)


def _improved(chains: Chains, at: Point, options: Sequence[list[tuple[slice, Array]]]) -> Point:
    problem = chains.problem
    states = list(at.states)
    tried = [_tried(states[s.index], options[s.index]) for s in problem.segments]
    settings = [
        Settings(s.index, np.repeat(at.values[None], len(t), axis=0), t)
        for s, t in zip(problem.segments, tried, strict=True)
    ]
    costs = _segment_costs(chains, settings)
    settings = [
        Settings(
            s.index,
            np.repeat(at.values[None], 2, axis=0),
            np.array([_mixed(states[s.index], options[s.index], c), t[int(np.argmin(c))]]),
        )
        for s, t, c in zip(problem.segments, tried, costs, strict=True)
    ]
    for s, item, before, after in zip(problem.segments, settings, costs, _segment_costs(chains, settings), strict=True):
        if after.min() < before[0]:
            states[s.index] = item.states[int(np.argmin(after))]
    return Point(at.values, tuple(states))
