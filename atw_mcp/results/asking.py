"""Results of Ask."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from atw_mcp.results.base import Result
from atw_mcp.results.documents import Edit
from atw_mcp.results.querying import Relation, Split
from atw_mcp.results.values import Interval

Triple = Annotated[list[float], Field(min_length=3, max_length=3)]


class Likely(Result):
    """A number over the members: its median and the intervals that hold it in 80 and 95% of cases."""

    median: float
    i80: Interval = Field(alias="80%")
    i95: Interval | None = Field(default=None, alias="95%", description="in the record of each answer")


class AnswerToOne(Result):
    """The answer to one question; of the fields those that its kind has."""

    question: str = Field(description="in words")
    answer: str = Field(description="in words")
    evidence: str = Field(description="id of its own record, with the whole answer; cite it in Finish")
    rollout: str = Field(description="of the best fit, with these edits")
    edits: list[Edit] | None = Field(default=None, description="missing: none")
    members: int | None = Field(default=None, description="that decide it; this and what follows: in its own record")
    unknown: int | None = Field(default=None, description="members that do not")
    best_fit: bool | int | float | Triple | str | None = Field(default=None, description="what the best fit alone says")
    probability: float | None = Field(default=None, description="of whether")
    probabilities: dict[str, float] | None = Field(default=None, description="of which_first: by statement, or none")
    never: float | None = Field(default=None, description="of when: probability that it never holds")
    unit: str | None = Field(default=None, description="of value, or of x, y, z")
    value: Likely | None = Field(default=None, description="of when, how_often, how_fast, how_far")
    place: dict[str, Likely] | None = Field(
        default=None, description="of where: by axis; in its own record also by pixel u, v"
    )
    by_world: dict[str, str] | None = Field(default=None, description="of several worlds: what each answers, in words")
    disagree: bool | None = Field(default=None, description="true where by_world is apart; then there is no one answer")
    decided_by: Split | None = Field(default=None, description="the parameter that decides it, where one does")
    goes_with: list[Relation] | None = Field(default=None, description="parameters that it rises or falls with")
    from_prior: list[str] | None = Field(default=None, description="of these parameters, those that no frame shows")
    less_sure_because: str | None = None


class AnswersToAll(Result):
    """Data of Ask."""

    answers: list[AnswerToOne] = Field(description="one for each question, or number of a list, in order")
    members: int = Field(description="worlds that the data allow, each asked everything")
    weights: dict[str, float] | None = Field(default=None, description="of the candidate worlds named, by id")
    until: float = Field(description="time to which they were run [s]")
    observed_until: float = Field(description="last observed frame [s]")
