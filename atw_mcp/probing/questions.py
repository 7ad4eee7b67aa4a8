"""Questions that may be asked of a world, or of a changed copy of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Any, Literal, Self

from mcp.server.mcpserver.exceptions import ToolError
from pydantic import BaseModel, ConfigDict, Field, model_validator

from polyworld.probing.predicates import Predicate, names_in
from polyworld.probing.query import Aggregation, start_times
from polyworld.world import World

AGGREGATIONS: dict[str, Aggregation] = {"whether": "any", "when": "first", "how_often": "count"}
SCANNED = ("factor", "value", "gravity_factor", "plane_friction")  # numbers of edits


class _Asked(BaseModel):
    """What every question may have."""

    model_config = ConfigDict(extra="forbid")
    ask: str
    edits: list[dict[str, Any]] = Field(
        default=[],
        max_length=32,
        description="as edits of Rollout, made before the start; a list as factor or value: an answer for each number",
    )


class Stated(_Asked):
    predicate: dict[str, Any] = Field(description="a statement as predicate of QueryWorld")
    interval: list[float] | None = Field(
        default=None, min_length=2, max_length=2, description="start, end [s]; default: all that is run"
    )


class Whether(Stated):
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


class When(Stated):
    """When the statement holds first."""

    ask: Literal["when"] = "when"


class HowOften(Stated):
    """How many times the statement begins to hold."""

    ask: Literal["how_often"] = "how_often"


class WhichFirst(_Asked):
    """Which of the statements holds first."""

    ask: Literal["which_first"] = "which_first"
    predicates: list[dict[str, Any]] = Field(
        min_length=2, max_length=8, description="statements as predicate of QueryWorld"
    )


class Of(_Asked):
    object: str = Field(min_length=1, description="name")
    at: float | None = Field(default=None, ge=0.0, description="time [s]; default: the end of what is run")


class Where(Of):
    """Where the object's centre is at a time."""

    ask: Literal["where"] = "where"


class HowFast(Of):
    """How fast the object's centre moves at a time."""

    ask: Literal["how_fast"] = "how_fast"


class HowFar(Of):
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
        if isinstance(self.question, Of):
            return self.question.at or 0.0
        interval = getattr(self.question, "interval", None)
        return 0.0 if interval is None else float(interval[1])

    @property
    def names(self) -> tuple[str, ...]:
        """Objects that it is about."""
        q = self.question
        if isinstance(q, Of):
            return (q.object, q.to) if isinstance(q, HowFar) and q.to is not None else (q.object,)
        return tuple(dict.fromkeys(name for s in self.statements for name in names_in(s)))

    def in_words(self, until: float) -> str:
        """Return the question in words."""
        q = self.question
        if isinstance(q, Of):
            end = f" {q.to}" if isinstance(q, HowFar) and q.to is not None else ""
            return f"{q.ask} {q.object}{' from' * bool(end)}{end} at {until if q.at is None else q.at:.4g} s"
        stated = " or ".join(worded(s) for s in self.statements)
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
        late = max(self.names, key=lambda name: starts.get(name, 0.0), default="")  # none of a container
        if interval is None or not interval[0] < starts.get(late, 0.0) < interval[1]:
            return None
        return late, starts[late]


def worded(statement: Predicate) -> str:
    """Return a statement in words: its name, its objects, and what else was given."""
    given = statement.model_dump(exclude_defaults=True, exclude={"predicate", "object", "a", "b"})
    return " ".join([statement.predicate, *names_in(statement), *(f"{k}={v}" for k, v in given.items())])


def scanned(given: Any, what: str) -> list[Any]:
    """Return a question once for each number of an edit that has a list of them."""
    edits = given.get("edits") if isinstance(given, dict) else None
    edits = edits if isinstance(edits, list) and all(isinstance(edit, dict) for edit in edits) else []
    lists = [(i, name) for i, edit in enumerate(edits) for name in SCANNED if isinstance(edit.get(name), list)]
    if len(lists) > 1:
        raise ToolError(f"{what}: {' and '.join(name for _, name in lists)} are lists: scan one number at a time")
    if not lists:
        return [given]
    ((which, name),) = lists
    return [
        given | {"edits": [*edits[:which], edits[which] | {name: value}, *edits[which + 1 :]]}
        for value in edits[which][name]
    ]
