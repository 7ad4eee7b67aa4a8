"""Score verdicts: right, honest, missed, uncovered or wrong."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from polyworld.core.reported import json_ready
from polyworld.gap import GapReport
from polyworld.gap.choose import credible
from polyworld.gap.fitting import Fitted
from polyworld.gap.report import effects_of
from tests.benchmarks.gaps.case import NOTHING, Case, Names
from tests.benchmarks.gaps.place import overlap

NAMED = ("identified", "identified_with_remainder")
OUTCOMES = ("right", "honest", "missed", "uncovered", "wrong")
LISTED = 5  # hypotheses of a record


def outcome(case: Case, kind: str, answers: Sequence[Names], equivalent: Sequence[Names] = ()) -> str:
    """Return the score of a verdict. answers: what it names, first, and what competes; equivalent: what it reports as
    one with the first.

    right: the truth's class of effects named alone; "nothing missing" of nothing; "unexplained" of a law outside the
    catalogue. wrong: one class, and not the truth's, though it be a part of it. honest: the truth among several answers
    or equivalents, no name at all, nothing missing where the effect does not stand out of the noise, or a part of a
    truth of which the weakest effect does not. missed: nothing missing where it does. uncovered: several answers and
    none the truth, or an alarm about nothing.
    """
    nothing = case.truths == NOTHING
    if kind == "nothing_missing":
        return "right" if nothing else "missed" if case.detectable else "honest"
    if kind == "unexplained":
        return "right" if case.outside else "uncovered" if nothing else "honest"
    found = {case.answer(a) for a in answers}
    covered = bool(found & set(case.answers))
    if len(found) == 1 and covered:
        return "right"
    if len(found) == 1 or kind in NAMED:
        part = not case.detectable and any(f and f < a for f in found for a in case.answers)
        return "honest" if part or any(case.answer(e) in case.answers for e in equivalent) else "wrong"
    return "honest" if covered else "uncovered"


def record(case: Case, report: GapReport) -> dict[str, Any]:
    """Return the score of a report with what explains it, as JSON-ready values."""
    v = report.verdict
    answers = [f.hypothesis.names for f in (v.best, *v.competitors)]
    equivalent = [f.hypothesis.names for f in v.equivalent]
    found = outcome(case, v.kind, answers, equivalent)
    aside = {a.run for a in report.set_aside}
    effects = effects_of(v.best)
    row: dict[str, Any] = {
        "name": case.name,
        "level": case.level,
        "outcome": found,
        "truth": [_text(t) for t in case.truths] or "outside",
        "verdict": v.kind,
        "named": _text(answers[0]),
        "others": [_text(a) for a in answers[1:]],
        "equivalent": [_text(e) for e in equivalent],
        "nearest_right": case.answer(answers[0]) in case.answers,
        "detectable": case.detectable,
        "noncentrality": case.noncentrality,
        "error": [v.before, v.after],
        "closed": None if report.sealed is None else report.sealed.closed,
        "values": {e["name"]: {k: [u["value"], *u["interval95"]] for k, u in e["unknowns"].items()} for e in effects},
        "inside": inside(case, effects) if found == "right" else {},
        "placed": overlap(case.places, effects, report.world) if found == "right" else {},
        "contaminated": [len(case.contaminated & aside), len(case.contaminated), len(aside - case.contaminated)],
        "aside": [[a.run, a.since] for a in report.set_aside],
        "reasons": list(v.reasons),
        "limited": report.limited is not None,
    }
    if found != "right":
        row |= {"truth_fit": _truth_fit(case, report), "pool": [_short(f) for f in report.pool[:LISTED]]}
        row["tried"] = {_text(f.hypothesis.names): round(f.total - report.pool[0].total, 1) for f in report.pool[::-1]}
    kept: dict[str, Any] = json_ready(row)
    return kept


def inside(case: Case, effects: Sequence[dict[str, Any]]) -> dict[str, bool]:
    """For every parameter of which truth and interval are known, whether the one is in the other."""
    held = {}
    for effect in effects:
        for name, true in case.numbers.get(effect["name"], {}).items():
            reported = effect["unknowns"].get(name) or effect["unknowns"].get(name.removesuffix("_z"))
            if reported and np.isfinite(reported["interval95"]).all():
                low, high = reported["interval95"]
                held[f"{effect['name']}.{name}"] = bool(low <= true <= high)
    return held


def _truth_fit(case: Case, report: GapReport) -> dict[str, Any] | None:
    """Return how the truth fared in the search: its place in the pool; None where it was not fitted to the end."""
    for rank, f in enumerate(report.pool):
        if case.answer(f.hypothesis.names) in case.answers:
            trusted = any(f is g for g in credible(report.pool, report.null))
            return _short(f) | {"rank": rank, "credible": trusted, "above_best": f.total - report.pool[0].total}
    return None


def _short(fitted: Fitted) -> dict[str, Any]:
    return {
        "names": _text(fitted.hypothesis.names),
        "labels": [p.variant.label for p in fitted.hypothesis.parts],
        "values": [float(x) for x in fitted.values],
        "error": float(np.sqrt(np.mean(fitted.errors**2))),
        "errors": [round(float(x), 2) for x in fitted.errors],
        "total": fitted.total,
        "price": fitted.price,
    }


def _text(names: Names) -> str:
    return "+".join(sorted(names)) or "nothing"


def table(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the counts of each set and level of noise."""
    found = []
    for key in dict.fromkeys((r["set"], r["asked"]) for r in rows):
        own = [r for r in rows if (r["set"], r["asked"]) == key]
        count = {o: sum(r["outcome"] == o for r in own) for o in (*OUTCOMES, "crashed")}
        held, placed = ([h for r in own for h in r.get(k, {}).values()] for k in ("inside", "placed"))
        seconds = sorted(r["seconds"] for r in own)
        line = {"set": key[0], "level": key[1], "cases": len(own)} | count
        line |= {"undetectable": sum(not r.get("detectable", True) for r in own), "inside": f"{sum(held)}/{len(held)}"}
        line["placed"] = f"{sum(placed)}/{len(placed)}"
        found.append(line | {"median_s": round(float(np.median(seconds)), 1), "max_s": round(seconds[-1], 1)})
    return found
