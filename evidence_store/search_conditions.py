"""Conditions of a search over evidence that SQLite itself can check, so that few rows are read in Python.

They let every record through that matches and may let others through: the caller checks again.
"""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import dataclass, field

TEXTS = ("summary", "arguments", "payload")
NOT_ASCII = "length({0}) != length(CAST({0} AS BLOB))"
"""SQLite knows upper and lower case of ASCII alone: texts that have other characters pass."""


@dataclass
class Conditions:
    """Terms of a WHERE clause, all of which must hold, and the values of their question marks."""

    terms: list[str] = field(default_factory=list)
    values: list[str | int | float] = field(default_factory=list)

    @classmethod
    def of(cls, case: str) -> Conditions:
        """The condition that a record belongs to a case."""
        conditions = cls()
        conditions.add("case_id = ?", case)
        return conditions

    @property
    def text(self) -> str:
        """The clause."""
        return " AND ".join(self.terms)

    def add(self, term: str, *values: str | int | float) -> None:
        """Add a term and the values of its question marks."""
        self.terms.append(term)
        self.values.extend(values)

    def mention(self, object: str) -> None:
        """One of the record's objects is this one: the list has its name in quotes."""
        self.add("instr(objects, ?)", json.dumps(object, ensure_ascii=False))

    def overlap(self, interval: tuple[float, float]) -> None:
        """The record's interval overlaps this one [s]; a text that is no JSON passes, to be found damaged."""
        self.add(
            "CASE WHEN json_valid(interval) THEN json_extract(interval, '$[0]') <= ? "
            "AND json_extract(interval, '$[1]') >= ? ELSE interval IS NOT NULL END",
            interval[1],
            interval[0],
        )

    def contain(self, words: Iterable[str]) -> None:
        """Every word, in lower case, occurs in one of the record's texts, as it is or as JSON writes it."""
        for word in words:
            if word.isascii():
                forms = dict.fromkeys((word, json.dumps(word)[1:-1].lower()))
                found = [f"instr(lower({text}), ?)" for text in TEXTS for _ in forms]
                other = [NOT_ASCII.format(text) for text in TEXTS]
                self.add(f"({' OR '.join((*found, *other))})", *(list(forms) * len(TEXTS)))
