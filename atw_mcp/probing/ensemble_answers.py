"""Answers of an ensemble's members, in numbers and in words: how probable, how narrow, and what decides it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.calls.intervals import Span
from atw_mcp.probing import readouts
from atw_mcp.probing.ensembles import Ensemble
from atw_mcp.probing.prediction_errors import SETTINGS, chances, travelled_since
from polyworld.estimation.accuracy import with_model_error
from polyworld.probing.compare import Comparison, compare
from polyworld.probing.ensemble_statistics import (
    LEVEL,
    Probability,
    Split,
    decisive_split,
    interval_of,
    relations,
    varying,
)
from polyworld.probing.predicates import Predicate
from polyworld.probing.query import QueryResult
from polyworld.trajectory import Rollout
from polyworld.world import World

Array = NDArray[np.float64]

MOST_EVENTS = 24  # rows of a timeline over all members
PERCENT = f"{100 * LEVEL:.0f}%"


def chance_of(
    ensemble: Ensemble, members: Sequence[int], results: Sequence[QueryResult], statement: Predicate
) -> dict[str, Any]:
    """Return how probable a statement is by the members that decide it, what decides it, and what its margin goes with.

    members: their numbers. results: their answers, in the same order.
    """
    parameters = varying(ensemble.parameters, members)
    true = np.array([bool(result.value) for result in results])
    each = chances(ensemble, members, results, statement)
    split = decisive_split(parameters, true)
    mean = float(each.mean())
    part = float(each.var()) / max(mean * (1.0 - mean), 1e-12)  # of the variance of true and false
    margins = np.array([_number(result.margin) for result in results])
    chance = _probability(true, each, ensemble)
    return {
        "probability": chance["probability"],
        "less_sure_because": chance.get("less_sure_because"),
        "decided_by": None if split is None else split.to_dict(),
        "goes_with": [r.to_dict() for r in relations(parameters, margins, part)],
    }


def rollout_answer(ensemble: Ensemble, horizon: float) -> dict[str, Any]:
    """When what happens, in how many members, and where each object ends up."""
    completed = [i for i in range(ensemble.size) if ensemble.rollouts[i].status == "completed"]
    names = ensemble.rollouts[0].trajectory.names
    about: dict[str, Any] = {"members": ensemble.size, "diverged": ensemble.size - len(completed)}
    if not completed:
        return about
    events: dict[tuple[str, tuple[str, ...], int], list[tuple[float, Array]]] = {}
    for i in completed:
        for key, time, place in _happenings(ensemble.worlds[i], ensemble.rollouts[i], horizon):
            events.setdefault(key, []).append((time, place))
    rows = []
    for (what, objects, ordinal), found in events.items():
        rows.append(
            {
                "what": what,
                "objects": list(objects),
                **({"occurrence": ordinal} if ordinal > 1 else {}),
                **_counted_true(len(found), len(completed)),
                f"time_{PERCENT}": interval_of(np.array([time for time, _ in found])),
                f"place_{PERCENT}": _place(np.array([place for _, place in found])),
            }
        )
    rows.sort(key=lambda row: row[f"time_{PERCENT}"]["median"])
    likely = sorted(rows, key=lambda row: -row["true"])[:MOST_EVENTS]
    ends = {}
    for name in names:
        places = np.array([_end(ensemble.rollouts[i], name) for i in completed])
        until = np.array([horizon])
        far = [travelled_since(ensemble, i, name, until)[0] for i in completed]
        ends[name] = with_model_error(places, np.array(far))
    return about | {
        "timeline": [row for row in rows if row in likely],
        "rows_left_out": len(rows) - len(likely),
        "ends": [{"object": n, f"position_{PERCENT}": _place(p)} for n, p in ends.items() if np.isfinite(p).all()],
    }


def rollout_in_words(about: dict[str, Any]) -> str:
    """The same as a clause: what happens in some members but not in all comes first."""
    members = about["members"] - about["diverged"]
    if not members:
        return f"all {about['members']} members diverge"
    rows = sorted(about["timeline"], key=lambda row: (row["true"] == members, row[f"time_{PERCENT}"]["median"]))
    texts = []
    for row in rows[:6]:
        when = row[f"time_{PERCENT}"]
        who = " and ".join(row["objects"]) + f" {row['what']}"
        again = f" (occurrence {row['occurrence']})" if "occurrence" in row else ""
        texts.append(
            f"{who}{again} in {row['true']} of {members} at {when['median']:.3g} s "
            f"({when['from']:.3g} to {when['to']:.3g})"
        )
    return f"of {members} members: " + ("; ".join(texts) if texts else "nothing happens in any")


def trajectory_answer(
    ensemble: Ensemble, name: str, span: Span, columns: Sequence[str], timed: Sequence[Sequence[Any]]
) -> dict[str, Any]:
    """Median and interval over the members of one object's columns at some times, and of its motion in a few numbers.

    Places after the last fitted frame have the model's own error too. timed: (time, frame) of each row. Members that do
    not reach a time are left out of it.
    """
    chosen = [key for key in columns if key not in ("time", "frame")]
    times = np.array([row[0] for row in timed])
    tables, motions, periods = [], [], []
    for world, rollout in zip(ensemble.worlds, ensemble.rollouts, strict=True):
        own = Span(span.start, min(span.end, float(rollout.trajectory.times[-1])), world.time.seconds_per_frame)
        whole = Span(0.0, float(rollout.trajectory.times[-1]), world.time.seconds_per_frame)
        read = readouts.series(world, rollout, name, whole, ["time", *chosen])
        rows = np.array([[_number(value) for value in row] for row in read]).reshape(-1, 1 + len(chosen))
        if "yaw_deg" in chosen:
            rows[:, 1 + chosen.index("yaw_deg")] = np.unwrap(rows[:, 1 + chosen.index("yaw_deg")], period=360.0)
        tables.append(_interpolated(times, rows))
        motions.append(readouts.motion(rollout, name, own))
        periods.append(readouts.periods_of(rollout, name, own) or {})
    table = np.stack(tables)  # (N, T, columns)
    far = np.array([travelled_since(ensemble, i, name, times) for i in range(ensemble.size)])  # (N, T, 3)
    widths = [far[..., "xyz".index(c)] if c in ("x", "y", "z") else np.zeros(far.shape[:2]) for c in chosen]
    spread = with_model_error(table, np.stack(widths, axis=-1))
    cells = [[_cell(spread[:, t, c]) for c in range(len(chosen))] for t in range(len(times))]
    about: dict[str, Any] = {
        "members": ensemble.size,
        "columns": ["time", "frame", *chosen],
        "cells": f"over the members: median, and the {PERCENT} interval from, to",
        "rows": [[*stamp, *row] for stamp, row in zip(timed, cells, strict=True)],
        "motion": {
            key: interval_of(known)
            for key in ("displacement", "path_length", "highest_speed", "final_speed")
            if len(known := np.array([m[key] for m in motions if key in m and np.isfinite(m[key])]))
        },
    }
    axes = sorted({axis for found in periods for axis in found})
    about["period"] = {
        axis: {
            "found_in": sum(axis in found for found in periods),
            **interval_of(np.array([found[axis]["seconds"] for found in periods if axis in found])),
        }
        for axis in axes
    }
    return about


def trajectory_in_words(about: dict[str, Any], name: str) -> str:
    """The same as a clause."""
    if "displacement" not in about["motion"]:
        return f"{name} takes part in none of {about['members']} members"
    far, speed = about["motion"]["displacement"], about["motion"]["final_speed"]
    text = (
        f"{name} ends {far['median']:.3g} m ({far['from']:.3g} to {far['to']:.3g}) from where it began, at "
        f"{speed['median']:.3g} m/s ({speed['from']:.3g} to {speed['to']:.3g})"
    )
    for axis, row in about["period"].items():
        text += f"; period of {axis} {row['median']:.4g} s ({row['from']:.4g} to {row['to']:.4g})"
    return text


def compared_members(
    first: Ensemble, second: Ensemble, objects: Sequence[str] | None, tolerance: float
) -> list[Comparison]:
    """Compare the same members of two ensembles, of reported events alone."""
    return [
        compare(
            replace(a, events=readouts.reported_events(first.worlds[i], a)),
            replace(b, events=readouts.reported_events(second.worlds[i], b)),
            objects,
            tolerance=tolerance,
        )
        for i, (a, b) in enumerate(zip(first.rollouts, second.rollouts, strict=True))
    ]


def comparison_answer(first: Ensemble, second: Ensemble, results: Sequence[Comparison]) -> dict[str, Any]:
    """In how many members each object is displaced and each event is new or gone, and by how much."""
    count = len(results)
    parameters = varying(first.parameters, range(count))
    rows = []
    for name in [d.name for d in results[0].objects]:
        own = [next((d for d in result.objects if d.name == name), None) for result in results]
        moved = np.array([d is not None and d.apart_from is not None for d in own])
        finals = np.array([_number(None if d is None else d.final) for d in own])
        split = decisive_split(parameters, moved)
        row: dict[str, Any] = {"object": name, "displaced": _probability(moved, moved.astype(float), first)}
        row |= {"decided_by": None if split is None else split.to_dict()}
        row |= {"decided_by_in_words": None if split is None else _split_in_words(split, first.units)}
        if np.isfinite(finals).any():
            row |= {"final_distance": interval_of(finals[np.isfinite(finals)])}
        rows.append(row)
    span = Span(0.0, min(result.horizon for result in results), first.worlds[0].time.seconds_per_frame)
    gone = [readouts.in_order(c.events_only_in_base, first.rollouts[i], span) for i, c in enumerate(results)]
    new = [readouts.in_order(c.events_only_in_other, second.rollouts[i], span) for i, c in enumerate(results)]
    return {"members": count, "objects": rows, "events": {"gone": _counted(gone), "new": _counted(new)}}


def comparison_in_words(about: dict[str, Any]) -> str:
    """The same as a clause."""
    texts = []
    for row in about["objects"]:
        if not row["displaced"]["true"]:
            continue
        far = row.get("final_distance")
        texts.append(
            f"{row['object']} displaced in {row['displaced']['true']} of {about['members']}"
            + (f", at the end by {far['median']:.3g} m ({far['from']:.3g} to {far['to']:.3g})" if far else "")
            + (f" ({row['decided_by_in_words']})" if row["decided_by_in_words"] else "")
        )
    for word, rows in about["events"].items():
        striking = [row for row in rows if row["what"] != "comes to rest"][:4]
        texts += [
            f"{' and '.join(row['objects'])} {row['what']} {word} in {row['true']} of {about['members']}"
            for row in striking
        ]
    return f"of {about['members']} members: " + ("; ".join(texts) if texts else "nothing is displaced in any")


def _counted(timelines: Sequence[list[dict[str, Any]]]) -> list[dict[str, Any]]:
    """Events by kind and participants, with the number of members they occur in, most frequent first."""
    times: dict[tuple[str, tuple[str, ...]], list[float]] = {}
    for rows in timelines:
        seen = set()
        for row in rows:
            key = row["what"], tuple(row["objects"])
            if key not in seen:
                seen.add(key)
                times.setdefault(key, []).append(row["time"])
    counted = [
        {
            "what": what,
            "objects": list(objects),
            **_counted_true(len(found), len(timelines)),
            f"time_{PERCENT}": interval_of(np.array(found)),
        }
        for (what, objects), found in times.items()
    ]
    return sorted(counted, key=lambda row: -row["true"])[:MOST_EVENTS]


def _interpolated(times: Array, rows: Array) -> Array:
    """Columns (T, c) at some times of rows (n, 1 + c) whose first column is the time; NaN outside them."""
    if not len(rows):
        return np.full((len(times), rows.shape[1] - 1), np.nan)
    return np.stack(
        [np.interp(times, rows[:, 0], column, left=np.nan, right=np.nan) for column in rows[:, 1:].T], axis=1
    )


def _cell(values: Array) -> list[float] | None:
    known = values[np.isfinite(values)]
    if not len(known):
        return None
    spread = interval_of(known)
    return [spread["median"], spread["from"], spread["to"]]


def _happenings(
    world: World, rollout: Rollout, horizon: float
) -> list[tuple[tuple[str, tuple[str, ...], int], float, Array]]:
    """Timeline of one member: (what, who, how many times so far), time [s], and place of the first of them (3,) [m]."""
    span = Span(0.0, max(horizon, float(rollout.trajectory.times[-1])), world.time.seconds_per_frame)
    counts: dict[tuple[str, tuple[str, ...]], int] = {}
    found = []
    for row in readouts.timeline(world, rollout, span):
        key = row["what"], tuple(row["objects"])
        counts[key] = counts.get(key, 0) + 1
        found.append(((*key, counts[key]), float(row["time"]), _at(rollout, row["objects"], row["time"])))
    return found


def _at(rollout: Rollout, objects: Sequence[str], time: float) -> Array:
    trajectory = rollout.trajectory
    name = next((name for name in objects if name in trajectory.names), None)
    if name is None:
        return np.full(3, np.nan)
    places = trajectory.positions[:, trajectory.index(name)]
    return np.array([np.interp(time, trajectory.times, places[:, axis]) for axis in range(3)])


def _end(rollout: Rollout, name: str) -> Array:
    end: Array = rollout.trajectory.positions[-1, rollout.trajectory.index(name)]
    return end


def _place(places: Array) -> dict[str, list[float]]:
    """Median and interval of places (n, 3), coordinate by coordinate."""
    spreads = [interval_of(places[:, axis]) for axis in range(3)]
    return {key: [spread[key] for spread in spreads] for key in ("median", "from", "to")}


PREDICTED = "it is decided after the last fitted frame"


def _probability(true: NDArray[np.bool_], chance: Array, ensemble: Ensemble) -> dict[str, Any]:
    """Count members, and the probability that admits errors of prediction and that the fitted world may be wrong.

    chance (n,): probability of the statement in each member.
    """
    found = _counted_true(int(true.sum()), len(true))
    reasons = []
    if not np.array_equal(chance, true):
        expected = Probability(float(chance.sum()), len(chance))
        found |= {"probability": expected.share, "probability_interval": list(expected.interval)}
        if abs(expected.share - found["true"] / len(true)) >= SETTINGS.notable:
            reasons.append(PREDICTED)
    if ensemble.wrong:
        sure = 1.0 - ensemble.wrong
        found["probability"] = sure * found["probability"] + 0.5 * ensemble.wrong
        found["probability_interval"] = [sure * end + 0.5 * ensemble.wrong for end in found["probability_interval"]]
        reasons.append(ensemble.why)
    return found | ({"less_sure_because": " and ".join(reasons)} if reasons else {})


def _counted_true(true: int, members: int) -> dict[str, Any]:
    found = Probability(true, members)
    return {
        "true": true,
        "false": members - true,
        "probability": found.share,
        "probability_interval": list(found.interval),
    }


def _split_in_words(split: Split, units: dict[str, str]) -> str:
    unit = units.get(split.parameter, "1")
    side = "above" if split.true_where == "below" else "below"
    value = f"{split.threshold:.3g}" + (f" {unit}" if unit not in ("", "1") else "")
    return f"false where {split.parameter} is {side} {value} ({split.agree} of {split.members} members agree)"


def _number(value: float | int | bool | None) -> float:
    return float("nan") if value is None else float(value)
