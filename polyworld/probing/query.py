"""Decide a predicate over an interval of a rollout. What the rollout does not cover is unknown, never false.

Evidence of `in_contact`, `collides` and `nearer_than` names the closest approach of the two surfaces
(`polyworld.probing.closest_approach` says what of it is exact): how narrowly a thing did or did not happen.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from polyworld.probing.closest_approach import ClosestApproach, closest_approach
from polyworld.probing.crossings import Interval, clipped, first_crossing, where_positive
from polyworld.probing.margins import passing_offset, state_margin, why_unknown
from polyworld.probing.point_approach import point_gaps
from polyworld.probing.predicates import (
    Collides,
    ComesToRest,
    Holds,
    InContact,
    NearerThan,
    Occupies,
    PassesBefore,
    Predicate,
    ReachesBefore,
    WithinDistance,
    names_in,
)
from polyworld.trajectory import Rollout, Trajectory
from polyworld.trajectory.events import rest_events
from polyworld.world import World

Aggregation = Literal["any", "all", "first", "last", "count", "fraction"]

# Statements that need no place of an object's centre: there may be none of a fluid.
_PLACELESS = Occupies | Holds | InContact | Collides | PassesBefore | ReachesBefore

WET = 0.5  # of a grid cell: the gap up to which a fluid's particles, balls of a quarter cell, touch a surface
ROUNDING = 1e-9  # [s]: an interval that ends at the horizon may have been computed another way


@dataclass(frozen=True)
class QueryResult:
    """The answer to a query.

    decided: whether the rollout covers what the question needs; value is None where it does not, and
    `reason` says why. value: bool for any and all; a time [s] for first and last, or None, decided, where it
    never holds; int for count; 0..1 for fraction. intervals: when the predicate holds, within the covered
    part of the interval asked for. asked: the interval asked for, or the default. evidence: the numbers it was
    decided on. sampled_every [s]: the longest time between the samples it was judged on, None where contact events
    alone decided. margin: of any and all, by how much it is true (positive) or false (negative), in `margin_unit`: the
    predicate's quantity beyond its threshold, for contacts minus the gap of the surfaces, for an order the lead of a
    over b; None where there is no such number. margin_at [s]: when it is that, None of an order.
    """

    value: bool | int | float | None
    decided: bool
    reason: str | None
    intervals: tuple[Interval, ...]
    covered: Interval | None
    evidence: dict[str, Any]
    asked: Interval | None = None
    sampled_every: float | None = None
    margin: float | None = None
    margin_unit: str | None = None
    margin_at: float | None = None

    def to_dict(self) -> dict[str, Any]:
        """The result as JSON-ready values."""
        return {
            "value": self.value,
            "decided": self.decided,
            "reason": self.reason,
            "intervals": [list(i) for i in self.intervals],
            "covered": None if self.covered is None else list(self.covered),
            "asked": None if self.asked is None else list(self.asked),
            "evidence": self.evidence,
            **(
                {}
                if self.margin is None
                else {"margin": self.margin, "margin_unit": self.margin_unit, "margin_at_s": self.margin_at}
            ),
            **({} if self.sampled_every is None else {"sampled_every_s": self.sampled_every}),
        }


def query(
    rollout: Rollout,
    world: World,
    predicate: Predicate,
    interval: Interval | None = None,
    aggregation: Aggregation = "any",
) -> QueryResult:
    """Decide `predicate` over `interval` (start, end) [s], both ends included.

    The default is the stretch in which every named object takes part, to the end of the rollout. States are read
    at the samples and crossings found on the straight line between them; contacts are exact. Raises ValueError
    for an interval that ends before it begins, for a rollout of another world, and for an aggregation that the
    predicate does not have.
    """
    if rollout.world_id != world.id:
        raise ValueError(f"the rollout is of {rollout.world_id}, the world is {world.id}")
    if isinstance(predicate, PassesBefore | ReachesBefore) and aggregation != "any":
        raise ValueError(f"{predicate.predicate} is an order, not a state: its only aggregation is any")
    if isinstance(predicate, Collides | ComesToRest) and aggregation in ("all", "fraction"):
        raise ValueError(f"{predicate.predicate} holds at instants: its aggregations are any, first, last, count")
    starts = start_times(world)
    late = {name: starts[name] for name in names_in(predicate) if starts.get(name, 0.0) > 0.0}
    joined = max(late.values(), default=0.0)
    asked = interval if interval is not None else (min(joined, rollout.horizon), rollout.horizon)
    if not (np.isfinite(asked[0]) and np.isfinite(asked[1]) and asked[0] <= asked[1]):
        raise ValueError(f"an interval is (start, end) with start <= end, got {asked}")
    result = replace(_decided(rollout, world, predicate, asked, aggregation), asked=asked)
    fluids = {d.name for d in world.of_form("liquid")}
    if result.covered is not None and not (
        isinstance(predicate, InContact | Collides) and not fluids & set(names_in(predicate))
    ):
        result = replace(result, sampled_every=sampled_every(rollout.trajectory))
    if result.decided or joined <= asked[0]:
        return result
    # An object that joins late leaves the start uncovered: state the question that can be answered, and its answer.
    reason = f"{result.reason}: " + " and ".join(f"{name!r} joins at {time:.6g} s" for name, time in late.items())
    end = rollout.horizon if result.covered is None else result.covered[1]
    whole = (np.ceil(joined * 1e6) / 1e6, np.floor(end * 1e6) / 1e6)  # as it can be written, inside what is covered
    then = _decided(rollout, world, predicate, whole, aggregation) if whole[0] < whole[1] else result
    if then.covered is not None:
        answer = f"it is {_said(then.value)}" if then.decided else "it is unknown too"
        reason += f". Asked over [{whole[0]:.10g}, {whole[1]:.10g}] {answer}"
    return replace(result, reason=reason)


def sampled_every(trajectory: Trajectory) -> float | None:
    """The longest time between two samples of a trajectory [s]; None where there are fewer than two."""
    gaps = np.diff(trajectory.times)
    return float(f"{gaps.max():.12g}") if len(gaps) else None


def start_times(world: World) -> dict[str, float]:
    """When each moving object joins [s]; fluids are there from the beginning."""
    return {o.name: float(getattr(o, "start_time", 0.0)) for o in (*world.objects, *world.deformables)}


def _said(value: bool | int | float | None) -> str:
    if value is None:
        return "never"
    return str(value).lower() if isinstance(value, bool) else f"{value:.6g}"


def _decided(
    rollout: Rollout, world: World, predicate: Predicate, asked: Interval, aggregation: Aggregation
) -> QueryResult:
    objects = list(world.moving_names)
    statics = [s.name for s in world.statics]
    may_be_static = isinstance(predicate, InContact | Collides | WithinDistance)
    for position, name in enumerate(names_in(predicate)):
        if name not in objects and not (may_be_static and name in statics):
            kind = "static: nothing of the kind is tracked" if name in statics else "not in this world"
            return _unknown(f"{name!r} is {kind}; objects: {objects}" + (f"; statics: {statics}" * may_be_static))
        if name in statics and position == 0:
            return _unknown(f"{name!r} is static: give the object that moves first; objects: {objects}")
    reason = why_unknown(world, rollout.trajectory, predicate)
    if reason is not None:
        return _unknown(reason)
    covered = _coverage(rollout, world, predicate, *asked)
    if isinstance(covered, str):
        return _unknown(covered)
    if isinstance(predicate, PassesBefore | ReachesBefore):
        return _order(rollout.trajectory, predicate, covered, asked)
    if isinstance(predicate, ComesToRest):
        rests = [e for e in rest_events(world, rollout.trajectory) if e.participants == (predicate.object,)]
        holds = clipped([(e.time, e.time) for e in rests], covered)
        return _aggregate(aggregation, holds, covered, asked, {"comes_to_rest_at_s": [time for time, _ in holds]})
    if isinstance(predicate, InContact | Collides):
        wet = _wet(rollout.trajectory, world, predicate, covered)
        if isinstance(wet, str):
            return _unknown(wet)
        if wet is None:
            recorded = rollout.horizon if rollout.contacts_until is None else rollout.contacts_until
            if recorded < covered[0] or recorded <= 0.0:
                return _unknown(str(rollout.why_no_contacts()))
            covered = (covered[0], min(covered[1], recorded))
            wet = _contacts(rollout, predicate, covered)
        holds, evidence = wet
        extremes, moments, unit = None, (np.nan, np.nan), "m"
    else:
        between = None
        if isinstance(predicate, WithinDistance) and predicate.b is not None:
            between = _approach(rollout, world, predicate, covered)
        holds, evidence, extremes, moments, unit = _states(rollout.trajectory, world, predicate, covered, between)
    if isinstance(predicate, InContact | Collides | NearerThan):
        nearest = _approach(rollout, world, predicate, covered)
        evidence = {**evidence, "closest_approach": nearest}
        if extremes is None and nearest is not None and aggregation == "any":
            extremes, moments = (-nearest["gap_m"],) * 2, (nearest["time"],) * 2
    result = _aggregate(aggregation, holds, covered, asked, evidence)
    if extremes is None or not result.decided or aggregation not in ("any", "all"):
        return result
    which = int(aggregation == "any")
    return replace(result, margin=float(extremes[which]), margin_unit=unit, margin_at=float(moments[which]))


def _unknown(
    reason: str,
    holds: tuple[Interval, ...] = (),
    covered: Interval | None = None,
    evidence: dict[str, Any] | None = None,
) -> QueryResult:
    return QueryResult(None, False, reason, holds, covered, evidence or {})


def _coverage(rollout: Rollout, world: World, predicate: Predicate, start: float, end: float) -> Interval | str:
    """The part of an interval that the rollout simulated with all objects active; else why there is none.

    A fluid without a drop has no place: what is said of its centre or of its motion is covered while there is some.
    """
    times = rollout.trajectory.times
    if len(times) == 0:
        return "the rollout has no samples"
    first, last = float(times[0]), float(times[-1])
    starts = start_times(world)
    for name in names_in(predicate):
        first = max(first, starts.get(name, first))
        if name in rollout.trajectory.deformables and not isinstance(predicate, _PLACELESS):
            there = np.flatnonzero(np.isfinite(rollout.trajectory.positions[:, rollout.trajectory.index(name), 0]))
            if not len(there):
                return f"there is none of {name!r} in the covered {first:.6g} to {last:.6g} s"
            first, last = max(first, float(times[there[0]])), min(last, float(times[there[-1]]))
    if start > last + ROUNDING or end < first - ROUNDING:
        return f"the interval {start:.6g} to {end:.6g} s lies outside the covered {first:.6g} to {last:.6g} s"
    return max(start, first), min(end, last)


def _aggregate(
    aggregation: Aggregation,
    holds: tuple[Interval, ...],
    covered: Interval,
    asked: Interval,
    evidence: dict[str, Any],
) -> QueryResult:
    from_start = covered[0] <= asked[0] + ROUNDING
    to_end = covered[1] >= asked[1] - ROUNDING
    whole = from_start and to_end
    inside = sum(b - a for a, b in holds)
    length = covered[1] - covered[0]
    throughout = bool(holds) and inside >= length - ROUNDING
    value: bool | int | float | None
    if aggregation == "any":
        decided, value = bool(holds) or whole, bool(holds)
    elif aggregation == "all":
        decided, value = whole or not throughout, throughout
    elif aggregation == "first":
        decided, value = from_start and (bool(holds) or to_end), holds[0][0] if holds else None
    elif aggregation == "last":
        decided, value = to_end and (bool(holds) or from_start), holds[-1][1] if holds else None
    elif aggregation == "count":
        decided, value = whole, len(holds)
    else:
        decided, value = whole, inside / length if length > 0 else float(bool(holds))
    if not decided:
        return _unknown(
            f"only {covered[0]:.6g} to {covered[1]:.6g} s of {asked[0]:.6g} to {asked[1]:.6g} s is covered, "
            f"which does not decide {aggregation!r}",
            holds,
            covered,
            evidence,
        )
    reason = "it never holds in the interval" if value is None else None
    return QueryResult(value, True, reason, holds, covered, evidence)


def _contacts(
    rollout: Rollout, predicate: InContact | Collides, covered: Interval
) -> tuple[tuple[Interval, ...], dict[str, Any]]:
    spans, used = _touching(rollout, set(names_in(predicate)))
    if isinstance(predicate, Collides):
        spans = [(a, a) for a, _ in spans if covered[0] <= a <= covered[1]]
    return clipped(spans, covered), {"events": used}


def _wet(
    trajectory: Trajectory, world: World, predicate: InContact | Collides, covered: Interval
) -> tuple[tuple[Interval, ...], dict[str, Any]] | str | None:
    """Return when a fluid touches the other, by its particles' positions; why that is unknown; None without a fluid.

    The solver has events of contacts between solids alone.
    """
    fluids = {d.name: d for d in world.of_form("liquid")}
    named = [n for n in names_in(predicate) if n in fluids]
    if not named or world.fluid_grid is None:
        return None
    if predicate.b is None:
        return f"contacts of a fluid are judged pair by pair: name what {predicate.a!r} may touch in b"
    fluid = named[0]
    other = predicate.b if fluid == predicate.a else predicate.a
    gaps = point_gaps(world, trajectory, fluid, other, np.arange(len(trajectory.times)))
    if gaps is None:
        return f"how near {fluid!r} comes to {other!r} is not known: it is a mesh without a closed form"
    margin = WET * world.fluid_grid.cell - np.where(np.isfinite(gaps), gaps, np.inf)
    margin = np.maximum(margin, -1e6)  # far away: there is none of it
    spans = where_positive(trajectory.times, margin, covered)
    if isinstance(predicate, Collides):
        spans = tuple((a, a) for a, _ in spans)
    return spans, {"touches_within_m": WET * world.fluid_grid.cell}


def _touching(rollout: Rollout, wanted: set[str]) -> tuple[list[Interval], list[dict[str, Any]]]:
    """When all of `wanted` take part in one contact, and the events that say so."""
    spans: list[Interval] = []
    used = []
    open_since: dict[tuple[str, ...], float] = {}
    for event in rollout.events:
        if event.kind not in ("contact_begin", "contact_end") or not wanted <= set(event.participants):
            continue
        if event.kind == "contact_begin":
            open_since[event.participants] = event.time
        else:
            spans.append((open_since.pop(event.participants, 0.0), event.time))
        used.append(event.to_dict())
    return spans + [(since, rollout.horizon) for since in open_since.values()], used


def _approach(
    rollout: Rollout, world: World, predicate: InContact | Collides | NearerThan | WithinDistance, covered: Interval
) -> dict[str, Any] | None:
    """How near the surfaces come, to the nearest of all where the predicate names one object alone."""
    starts = start_times(world)
    others = [predicate.b] if predicate.b is not None else [*starts, *(s.name for s in world.statics)]
    found: list[ClosestApproach] = []
    for other in others:
        touches = clipped(_touching(rollout, {predicate.a, other})[0], covered)
        start = max(covered[0], starts.get(other, 0.0))
        if other == predicate.a:
            continue
        if touches:
            found.append(ClosestApproach(0.0, touches[0][0], other))
        elif start <= covered[1]:
            nearest = closest_approach(world, rollout.trajectory, predicate.a, other, (start, covered[1]))
            found += [] if nearest is None else [nearest]
    return min(found, key=lambda f: (f.gap, f.time)).to_dict() if found else None


def _states(
    trajectory: Trajectory, world: World, predicate: Predicate, covered: Interval, nearest: dict[str, Any] | None
) -> tuple[tuple[Interval, ...], dict[str, Any], tuple[float, float], tuple[float, float], str]:
    """Return the intervals in which the predicate's margin is positive, the range of the quantity behind it, and the
    least and the greatest margin with their times and unit.

    nearest: the closest approach of two surfaces, which may lie between samples.
    """
    state = state_margin(trajectory, world, predicate)
    quantity, margin, label = state.quantity, state.margin, state.label
    times = trajectory.times
    if nearest is not None and nearest["time"] not in times:
        row, gap = int(np.searchsorted(times, nearest["time"])), nearest["gap_m"]
        times, quantity = np.insert(times, row, nearest["time"]), np.insert(quantity, row, gap)
        margin = state.margin[0] + state.quantity[0] - quantity  # the distance asked for, less the gap
    inner = (times > covered[0]) & (times < covered[1])
    grid = np.unique(np.concatenate([[covered[0]], times[inner], [covered[1]]]))
    q = np.interp(grid, times, quantity)
    low, high = int(np.argmin(q)), int(np.argmax(q))
    evidence = {
        label: {
            "lowest": float(q[low]),
            "at": float(grid[low]),
            "highest": float(q[high]),
            "highest_at": float(grid[high]),
        }
    }
    m = np.interp(grid, times, margin)
    least, greatest = int(np.argmin(m)), int(np.argmax(m))
    extremes, moments = (float(m[least]), float(m[greatest])), (float(grid[least]), float(grid[greatest]))
    return where_positive(times, margin, covered), evidence, extremes, moments, state.unit


def _order(
    trajectory: Trajectory, predicate: PassesBefore | ReachesBefore, covered: Interval, asked: Interval
) -> QueryResult:
    passed: dict[str, float | None] = {}
    for name in (predicate.a, predicate.b):
        offset = passing_offset(trajectory, predicate, name, covered)
        inside = isinstance(predicate, ReachesBefore) and bool(np.interp(covered[0], trajectory.times, offset) > 0.0)
        passed[name] = covered[0] if inside else first_crossing(trajectory.times, offset, covered)
    evidence = {"passes_at_s": passed}
    a, b = passed[predicate.a], passed[predicate.b]
    if a is None and b is None:
        return _unknown("neither passes in the covered part of the interval", (), covered, evidence)
    if covered[0] > asked[0] + ROUNDING:
        reason = f"what happened before {covered[0]:.6g} s is not covered: either may have passed already"
        return _unknown(reason, (), covered, evidence)
    value = a is not None and (b is None or a < b)
    first = a if b is None or (a is not None and a < b) else b
    assert first is not None
    lead = None if a is None or b is None else b - a
    return QueryResult(value, True, None, ((first, first),), covered, evidence, margin=lead, margin_unit="s")
