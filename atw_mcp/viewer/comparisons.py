"""A branch beside its base: how far objects are displaced, and which events are gone, new or shifted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from atw_mcp.probing.readouts import reported_events
from atw_mcp.viewer import document as view
from atw_mcp.viewer.rollouts import event_mark
from evidence_store import Evidence
from polyworld.probing.compare import compare
from polyworld.trajectory import Rollout
from polyworld.world import World


def comparisons_view(
    worlds: Mapping[str, World],
    rollouts: Mapping[str, Rollout],
    bases: Mapping[str, str | None],
    evidence: Sequence[Evidence],
) -> tuple[list[view.ComparisonView], list[str]]:
    """Return comparisons of what CompareWorlds was asked to compare, and of every branch with its base; and sentences
    about those that cannot be made.

    bases: of each rollout the one of the unedited world, None where there is none.
    """
    asked: dict[tuple[str, str], Evidence | None] = {}
    for row in evidence:
        if row.tool == "CompareWorlds" and row.status == "completed":
            asked[str(row.arguments.get("base")), str(row.arguments.get("edited"))] = row
    for edited, base in bases.items():
        if base is not None:
            asked.setdefault((base, edited), None)
    found, missing = [], []
    for (base, edited), asking in asked.items():
        if base not in rollouts or edited not in rollouts:
            continue
        try:
            found.append(_compared(worlds, rollouts, base, edited, asking))
        except ValueError as error:
            missing.append(f"{base} and {edited} are not compared: {error}.")
    return found, missing


def _compared(
    worlds: Mapping[str, World], rollouts: Mapping[str, Rollout], base: str, edited: str, row: Evidence | None
) -> view.ComparisonView:
    # As CompareWorlds: what stands in one world and drops in the other is a new collision.
    first, second = (
        replace(result, events=reported_events(worlds[result.world_id], result))
        for result in (rollouts[base], rollouts[edited])
    )
    options = {} if row is None or row.arguments.get("tolerance") is None else {"tolerance": row.arguments["tolerance"]}
    result = compare(first, second, None, **options)
    moved = [o for o in result.objects if o.apart_from is not None]
    words = [f"{o.name} by up to {o.largest:.3g} m" for o in moved]
    only = [*result.objects_only_in_base, *result.objects_only_in_other]
    summary = f"displaced: {', '.join(words) or 'nothing'}" + (f"; only in one: {', '.join(only)}" if only else "")
    return view.ComparisonView(
        base=base,
        edited=edited,
        evidence=None if row is None else row.id,
        summary=summary if row is None else row.summary,
        displaced=[
            view.Displaced(object=o.name, most=o.largest, time=o.largest_time)
            for o in result.objects
            if o.largest is not None and o.largest_time is not None
        ],
        gone=[event_mark(event) for event in result.events_only_in_base],
        new=[event_mark(event) for event in result.events_only_in_other],
        shifted=[
            view.ShiftedEvent(event=event_mark(match.base), shift=match.shift)
            for match in result.events_in_both
            if abs(match.shift) > _spacing(first)
        ],
    )


def _spacing(result: Rollout) -> float:
    """Return the longest time between two samples [s]."""
    return float(np.diff(result.trajectory.times).max(initial=0.0))
