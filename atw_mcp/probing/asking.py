"""Answer a question by the members of an ensemble, in numbers and in words."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.probing.ensemble_answers import PREDICTED, chance_of
from atw_mcp.probing.ensembles import Ensemble
from atw_mcp.probing.prediction_errors import distance, happening, speeds, travelled_since
from atw_mcp.probing.questions import AGGREGATIONS, Asked, Stated, WhichFirst, worded
from polyworld.estimation.accuracy import with_model_error
from polyworld.probing.ensemble_statistics import decisive_split, relations, varying
from polyworld.probing.predicates import Predicate
from polyworld.probing.query import QueryResult, query
from polyworld.trajectory import Rollout
from polyworld.world import World

Array = NDArray[np.float64]
SHOWN_RELATIONS = 2  # in words: the strongest
FINEST = 4  # decimal places shown
APART = 0.5  # difference of probabilities from which candidate worlds are said to disagree
ROUNDED = 0.05  # of the widest interval of a place: axes that are known exactly are so to rounding
SETTLED = 1e-4  # [m] fall between two samples up to which a body rests on something
LIGHT = 0.1  # weight below which a candidate world is outside every 80% interval, whatever it answers
LEVELS = {"80%": (10.0, 90.0), "95%": (2.5, 97.5)}
UNITS = {"when": "s", "how_often": "times", "where": "m", "how_fast": "m/s", "how_far": "m"}


def answered(asked: Asked, ensemble: Ensemble, best: Rollout, world: World) -> dict[str, Any]:
    """Return what the members say to a question, and the best fit alone: fields of `AnswerToOne` that its kind has."""
    if isinstance(asked.question, WhichFirst):
        return _which_first(asked, ensemble, best, world)
    if isinstance(asked.question, Stated):
        return _stated(asked, ensemble, best, world)
    return _measured(asked, ensemble, best, world)


def likely(values: Array) -> dict[str, Any]:
    """Return median, 80 and 95% intervals of a sample (n,)."""
    spread = {level: [float(v) for v in np.percentile(values, ends)] for level, ends in LEVELS.items()}
    return {"median": float(np.median(values)), **spread}


def _query(asked: Asked, rollout: Rollout, world: World, statement: Predicate) -> QueryResult:
    interval = getattr(asked.question, "interval", None)
    span = None if interval is None else (float(interval[0]), float(interval[1]))
    late = asked.enters(world)
    if span is not None and late is not None:  # before it enters it can do nothing
        span = (late[1], span[1])
    return query(rollout, world, statement, span, AGGREGATIONS.get(asked.question.ask, "first"))


def _each(ensemble: Ensemble, ask: Callable[[Rollout, World], QueryResult]) -> list[QueryResult]:
    return [ask(rollout, world) for rollout, world in zip(ensemble.rollouts, ensemble.worlds, strict=True)]


def _stated(asked: Asked, ensemble: Ensemble, best: Rollout, world: World) -> dict[str, Any]:
    (statement,), kind = asked.statements, asked.question.ask
    alone = _query(asked, best, world, statement)
    rows = _each(ensemble, lambda rollout, own: _query(asked, rollout, own, statement))
    known = [i for i, row in enumerate(rows) if row.decided]
    found: dict[str, Any] = {"members": len(known), "unknown": ensemble.size - len(known)}
    found["best_fit"] = alone.value if alone.decided else None
    if not known:
        return found | {"reason": rows[0].reason}
    decided = [rows[i] for i in known]
    if kind == "whether":
        return found | chance_of(ensemble, known, decided, statement)
    parameters = varying(ensemble.parameters, known)
    values = np.array([np.nan if row.value is None else float(row.value) for row in decided])
    happens = np.isfinite(values)
    found |= {"unit": UNITS[kind], "goes_with": [r.to_dict() for r in relations(parameters, values)]}
    if kind == "when":
        split = decisive_split(parameters, happens)
        found |= {"never": float(1.0 - happens.mean()), "decided_by": None if split is None else split.to_dict()}
        values = happening(values[happens], ensemble.fitted_until).ravel()
    if happens.any():
        found["value"] = likely(values)
    return found


def _which_first(asked: Asked, ensemble: Ensemble, best: Rollout, world: World) -> dict[str, Any]:
    labels = _labels(asked.statements)

    def first(rollout: Rollout, own: World) -> str | None:
        rows = [_query(asked, rollout, own, s) for s in asked.statements]
        if not all(r.decided for r in rows):
            return None
        times = [np.inf if r.value is None else float(r.value) for r in rows]
        return "none" if np.isinf(min(times)) else labels[int(np.argmin(times))]

    said = [first(r, w) for r, w in zip(ensemble.rollouts, ensemble.worlds, strict=True)]
    known = [i for i, label in enumerate(said) if label is not None]
    found: dict[str, Any] = {"members": len(known), "unknown": ensemble.size - len(known)}
    found["best_fit"] = first(best, world)
    if not known:
        return found | {"reason": "in every member one of the statements is unknown"}
    shares = {label: sum(said[i] == label for i in known) / len(known) for label in (*labels, "none")}
    shares = {label: share for label, share in shares.items() if share > 0.0}
    likeliest = max(shares, key=lambda label: shares[label])
    split = decisive_split(varying(ensemble.parameters, known), np.array([said[i] == likeliest for i in known]))
    return found | {"probabilities": shares, "decided_by": None if split is None else split.to_dict()}


def _labels(statements: Sequence[Predicate]) -> list[str]:
    return [f"{i}. {worded(s)}" for i, s in enumerate(statements, start=1)]


def _measured(asked: Asked, ensemble: Ensemble, best: Rollout, world: World) -> dict[str, Any]:
    q = asked.question
    alone = _state(q, best, world)
    states = np.array([_state(q, r, w) for r, w in zip(ensemble.rollouts, ensemble.worlds, strict=True)])
    known = np.flatnonzero(np.isfinite(states).all(axis=1))
    found: dict[str, Any] = {"members": len(known), "unknown": ensemble.size - len(known)}
    one = len(alone) == 1
    found["best_fit"] = None if not np.isfinite(alone).all() else float(alone[0]) if one else [float(v) for v in alone]
    if not len(known):
        end = float(best.trajectory.times[-1]) if len(best.trajectory.times) else 0.0
        return found | {"reason": f"{q.object} is not there at that time in any member; they were run to {end:.4g} s"}
    parameters = varying(ensemble.parameters, known)
    values = states[known]
    widest = int(np.argmax(np.ptp(np.percentile(values, (10, 90), axis=0), axis=0)))
    if q.ask == "how_fast":
        spread = np.stack([speeds(ensemble, int(i), q.object, _end(q, ensemble.rollouts[i])) for i in known], axis=1)
        spread = spread.reshape(-1, 1)
    else:
        spread = with_model_error(values, np.array([_reach(q, ensemble, int(i)) for i in known]))
        if q.ask == "where":  # errors take it no lower than it ever is in a member, as on a floor
            spread[:, 2] = np.maximum(spread[:, 2], min(_lowest(ensemble.rollouts[int(i)], q.object) for i in known))
    widths = [np.ptp(np.percentile(sample[:, widest], (10, 90))) for sample in (values, spread)]
    part = float(widths[0] / max(widths[1], 1e-12)) ** 2
    found |= {"unit": UNITS[q.ask], "goes_with": [r.to_dict() for r in relations(parameters, values[:, widest], part)]}
    if q.ask != "where":
        return found | {"value": likely(np.abs(spread[:, 0]))}
    found["place"] = {axis: likely(spread[:, i]) for i, axis in enumerate("xyz")}
    if world.camera is not None:
        pixels = world.camera.project(spread)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        if len(pixels):
            found["place"] |= {axis: likely(pixels[:, i]) for i, axis in enumerate("uv")}
    return found


def _state(q: Any, rollout: Rollout, world: World) -> Array:
    """Return place (3,), speed (1,) or distance (1,) of a member at the time asked for; NaN where there is none."""
    trajectory = rollout.trajectory
    width = 3 if q.ask == "where" else 1
    if q.object not in trajectory.names or not len(trajectory.times):
        return np.full(width, np.nan)
    time = _end(q, rollout)
    starts = {o.name: float(getattr(o, "start_time", 0.0)) for o in (*world.objects, *world.deformables)}
    begins = max(starts.get(name, 0.0) for name in (q.object, getattr(q, "to", None) or q.object))
    if not begins - 1e-9 <= time <= float(trajectory.times[-1]) + 1e-9:
        return np.full(width, np.nan)
    own = _at(trajectory.times, trajectory.positions[:, trajectory.index(q.object)], time)
    if q.ask == "where":
        return own
    if q.ask == "how_fast":
        speed = _at(trajectory.times, trajectory.velocities[:, trajectory.index(q.object)], time)
        return np.array([np.linalg.norm(speed)])
    if q.to is None:
        there = _at(trajectory.times, trajectory.positions[:, trajectory.index(q.object)], starts.get(q.object, 0.0))
    elif q.to in trajectory.names:
        there = _at(trajectory.times, trajectory.positions[:, trajectory.index(q.to)], time)
    else:
        there = np.asarray(next((s.position for s in world.statics if s.name == q.to), (np.nan,) * 3), dtype=float)
    return np.array([np.linalg.norm(own - there)])


def _end(q: Any, rollout: Rollout) -> float:
    return float(rollout.trajectory.times[-1]) if q.at is None else float(q.at)


def _lowest(rollout: Rollout, name: str) -> float:
    """Return the least height [m] that an object comes to where it lands on something; else minus infinity."""
    trajectory = rollout.trajectory
    heights = trajectory.positions[:, trajectory.index(name), 2]
    falls = np.diff(heights) < -SETTLED
    landed = (np.maximum.accumulate(falls) & ~falls).any()
    return float(np.nanmin(heights)) if landed else -np.inf


def _reach(q: Any, ensemble: Ensemble, member: int) -> Array:
    """Return with what a member's error goes: distances travelled by axis (3,) [m], or their sum (1,)."""
    rollout, since = ensemble.rollouts[member], ensemble.fitted_until
    end = max(_end(q, rollout), since)
    if q.ask == "where":
        found: Array = travelled_since(ensemble, member, q.object, np.array([end]))[0]
        return found
    names = [name for name in (q.object, getattr(q, "to", None)) if name is not None]
    return np.array([distance(rollout, names, since, end)])


def _at(times: Array, values: Array, time: float) -> Array:
    return np.array([np.interp(time, times, values[:, axis]) for axis in range(values.shape[1])])


def disagree(answers: Sequence[dict[str, Any]], shares: Sequence[float]) -> bool:
    """Return whether candidate worlds answer apart: probabilities by half, or a number's 80% intervals not meeting."""
    answers = [answer for answer, share in zip(answers, shares, strict=True) if share >= LIGHT]
    chances = [a.get("probabilities", {"": a.get("probability", 0.0)}) for a in answers]
    for label in {label for chance in chances for label in chance}:
        shares = [chance.get(label, 0.0) for chance in chances]
        if max(shares) - min(shares) > APART:
            return True
    spreads = [a.get("place") or ({"": a["value"]} if "value" in a else {}) for a in answers]
    for axis in {axis for spread in spreads for axis in spread}:
        ends = [spread[axis]["80%"] for spread in spreads if axis in spread]
        widest = max(high - low for spread in spreads for low, high in (own["80%"] for own in spread.values()))
        if max(low for low, _ in ends) - min(high for _, high in ends) > ROUNDED * widest:
            return True
    return False


def in_words(about: dict[str, Any], named: list[str], unseen: set[str], until: float) -> str:
    if about.get("disagree"):
        return "the worlds disagree, ask each alone: " + "; ".join(f"{w}: {a}" for w, a in about["by_world"].items())
    if "reason" in about:
        return f"unknown: {about['reason']}"
    if "probability" in about:
        text = f"probability {about['probability']:.2g}"
    elif "probabilities" in about:
        shares = sorted(about["probabilities"].items(), key=lambda item: -item[1])
        text = ", ".join(f"{label}: {share:.2g}" for label, share in shares)
    elif "place" in about:
        text = ", ".join(f"{axis} {_spread(about['place'][axis])}" for axis in "xyz") + " m, with 80% intervals"
    elif "value" in about:
        text = f"{_spread(about['value'])} {about['unit']}, with its 80% interval"
        text += f", not until {until:.4g} s with probability {about['never']:.2g}" if about.get("never") else ""
    else:
        text = f"not until {until:.4g} s, in any member"
    if about["unknown"]:
        text += f"; unknown in {about['unknown']} of {about['members'] + about['unknown']} members"
    why = about.get("less_sure_because")
    if why and why != PREDICTED:  # the result as a whole says until when frames were fitted
        text += f"; no surer because {why.removeprefix(f'{PREDICTED} and ')}"
    split = about.get("decided_by")
    if split:
        text += f"; decided by {split['parameter']}: true {split['true_where']} {split['threshold']:.3g}"
    elif named:
        text += f"; goes with {', '.join(named[:SHOWN_RELATIONS])}"
    prior = [name for name in named[: 1 if split else SHOWN_RELATIONS] if name in unseen]
    return text + (f" ({', '.join(prior)}: no frame shows it, taken from its prior)" if prior else "")


def _spread(about: dict[str, Any]) -> str:
    narrow = _narrow(about)
    low, high = narrow["80%"]
    return f"{narrow['median']:g} ({low:g} to {high:g})"


def brief(row: dict[str, Any]) -> dict[str, Any]:
    """Return an answer without what its own record repeats: the answer in words, and its numbers where there is one."""
    brief = {name: row[name] for name in ("question", "answer", "evidence", "rollout")}
    if row.get("disagree"):  # a median of separate answers is none of them
        return brief | {"disagree": True}
    brief |= {name: row[name] for name in ("probability", "probabilities", "never", "unit", "by_world") if name in row}
    if "value" in row:
        brief["value"] = _narrow(row["value"])
    if "place" in row:
        brief["place"] = {axis: _narrow(row["place"][axis]) for axis in "xyz"}
    return brief


def _narrow(spread: dict[str, Any]) -> dict[str, Any]:
    """Return median and 80% interval to the digits that its width allows."""
    low, high = spread["80%"]
    digits = min(max(0, 2 - math.floor(math.log10(high - low))), FINEST) if high > low else FINEST
    return {"median": round(spread["median"], digits), "80%": [round(low, digits), round(high, digits)]}
