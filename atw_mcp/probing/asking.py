"""Questions that are asked of a world, or of a changed copy of it, and what the members of its ensemble answer."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, model_validator

from atw_mcp.probing.ensemble_answers import chance_of
from atw_mcp.probing.ensembles import Ensemble
from atw_mcp.probing.prediction_errors import distance, happening, speeds, travelled_since
from polyworld.estimation.accuracy import with_model_error
from polyworld.probing.ensemble_statistics import decisive_split, relations, varying
from polyworld.probing.predicates import Predicate, names_in
from polyworld.probing.query import Aggregation, QueryResult, query, start_times
from polyworld.trajectory import Rollout
from polyworld.world import World

Array = NDArray[np.float64]
LEVELS = {"80%": (10.0, 90.0), "95%": (2.5, 97.5)}
AGGREGATIONS: dict[str, Aggregation] = {"whether": "any", "when": "first", "how_often": "count"}
UNITS = {"when": "s", "how_often": "times", "where": "m", "how_fast": "m/s", "how_far": "m"}


class _Asked(BaseModel):
    """What every question may have."""

    model_config = ConfigDict(extra="forbid")
    ask: str
    edits: list[dict[str, Any]] = Field(
        default=[],
        max_length=32,
        description="as edits of Rollout, made before the start; a list as factor or value: an answer for each number",
    )


class _Stated(_Asked):
    predicate: dict[str, Any] = Field(description="a statement as predicate of QueryWorld")
    interval: list[float] | None = Field(
        default=None, min_length=2, max_length=2, description="start, end [s]; default: all that is run"
    )


class Whether(_Stated):
    """How probable it is that the statement holds at some time, or at one."""

    ask: Literal["whether"] = "whether"
    at: float | None = Field(default=None, ge=0.0, description="time [s], instead of interval")

    @model_validator(mode="after")
    def _at_one_time(self) -> Self:
        if self.at is not None:
            if self.interval is not None:
                raise ValueError("give at or interval")
            self.interval = [self.at, self.at]
        return self


class When(_Stated):
    """When the statement holds first."""

    ask: Literal["when"] = "when"


class HowOften(_Stated):
    """How many times the statement begins to hold."""

    ask: Literal["how_often"] = "how_often"


class WhichFirst(_Asked):
    """Which of the statements holds first."""

    ask: Literal["which_first"] = "which_first"
    predicates: list[dict[str, Any]] = Field(
        min_length=2, max_length=8, description="statements as predicate of QueryWorld"
    )


class _Of(_Asked):
    object: str = Field(min_length=1, description="name")
    at: float | None = Field(default=None, ge=0.0, description="time [s]; default: the end of what is run")


class Where(_Of):
    """Where the object's centre is at a time."""

    ask: Literal["where"] = "where"


class HowFast(_Of):
    """How fast the object's centre moves at a time."""

    ask: Literal["how_fast"] = "how_fast"


class HowFar(_Of):
    """How far the object's centre is at a time from where it began, or from the centre of another object."""

    ask: Literal["how_far"] = "how_far"
    to: str | None = Field(default=None, description="another object")


Question = Annotated[
    Whether | When | HowOften | WhichFirst | Where | HowFast | HowFar,
    Field(discriminator="ask"),
]


@dataclass(frozen=True)
class Asked:
    """A question whose names and statements have been read. statements: of those that have any."""

    question: Any
    statements: tuple[Predicate, ...]

    @property
    def latest(self) -> float:
        """Latest time [s] that it names, 0 where it names none."""
        if isinstance(self.question, _Of):
            return self.question.at or 0.0
        interval = getattr(self.question, "interval", None)
        return 0.0 if interval is None else float(interval[1])

    @property
    def names(self) -> tuple[str, ...]:
        """Objects that it is about."""
        q = self.question
        if isinstance(q, _Of):
            return (q.object, q.to) if isinstance(q, HowFar) and q.to is not None else (q.object,)
        return tuple(dict.fromkeys(name for s in self.statements for name in names_in(s)))

    def in_words(self, until: float) -> str:
        """Return the question in words."""
        q = self.question
        if isinstance(q, _Of):
            end = f" {q.to}" if isinstance(q, HowFar) and q.to is not None else ""
            return f"{q.ask} {q.object}{' from' * bool(end)}{end} at {until if q.at is None else q.at:.4g} s"
        stated = " or ".join(_worded(s) for s in self.statements)
        interval = getattr(q, "interval", None)
        if interval is None:
            return f"{q.ask} {stated}"
        when = (
            f"at {interval[0]:.4g} s" if interval[0] == interval[1] else f"in {interval[0]:.4g} to {interval[1]:.4g} s"
        )
        return f"{q.ask} {stated} {when}"

    def enters(self, world: World) -> tuple[str, float] | None:
        """Return the object that enters last, and when [s], where the time asked about begins before that."""
        interval, starts = getattr(self.question, "interval", None), start_times(world)
        late = max(self.names, key=lambda name: starts.get(name, 0.0))
        if interval is None or not interval[0] < starts.get(late, 0.0) < interval[1]:
            return None
        return late, starts[late]


def answered(asked: Asked, ensemble: Ensemble, best: Rollout, world: World) -> dict[str, Any]:
    """Return what the members say to a question, and the best fit alone: fields of `AnswerToOne` that its kind has."""
    if isinstance(asked.question, WhichFirst):
        return _which_first(asked, ensemble, best, world)
    if isinstance(asked.question, _Stated):
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
    return [f"{i}. {_worded(s)}" for i, s in enumerate(statements, start=1)]


def _worded(statement: Predicate) -> str:
    """Return a statement in words: its name, its objects, and what else was given."""
    given = statement.model_dump(exclude_defaults=True, exclude={"predicate", "object", "a", "b"})
    return " ".join([statement.predicate, *names_in(statement), *(f"{k}={v}" for k, v in given.items())])


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
