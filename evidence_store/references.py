"""What refers to what: the worlds and the results that a case, or every case, rests on."""

from __future__ import annotations

import re
import sqlite3
from dataclasses import dataclass

CONTENTS = ("observations", "rollouts", "fits")
IDENTIFIER = re.compile(r"(?:obs|rollout|fit|world)-[0-9a-z]+")
EVIDENCE = re.compile(r"\bev-[0-9]+\b")


@dataclass(frozen=True)
class Referred:
    """Ids of worlds, and of observations, rollouts and fits, that are referred to."""

    worlds: frozenset[str]
    contents: frozenset[str]


def referred(database: sqlite3.Connection, case: str | None = None) -> Referred:
    """Return what one case refers to, or all cases together and evidence without a case.

    A world counts with its ancestors. A record is referred to by its id in a relation of the case, in evidence (ids,
    arguments, summary, payload), in an answer, in the origin of a world that counts or in a record that counts; a fit
    also by naming a world that counts.
    """
    named = set[str]()
    for query in (
        "SELECT observation_id FROM case_observations",
        "SELECT world_id || ' ' || coalesce(observation_id, '') FROM case_worlds",
        "SELECT evidence || ' ' || coalesce(answer, '') FROM answers",
        "SELECT arguments || ' ' || coalesce(world_id, '') || ' ' || coalesce(rollout_id, '') || ' ' || "
        "coalesce(observation_id, '') || ' ' || summary || ' ' || payload FROM evidence",
    ):
        rows = database.execute(f"{query} WHERE ? IS NULL OR case_id = ?", [case, case])
        named |= {name for (text,) in rows for name in IDENTIFIER.findall(text)}
    worlds = _with_ancestors(database, named)
    for child, detail in database.execute("SELECT child, detail FROM world_parents"):
        if child in worlds:
            named |= set(IDENTIFIER.findall(detail))
    stored = {
        identifier: set(IDENTIFIER.findall(f"{inputs} {document}"))
        for table in CONTENTS
        for identifier, inputs, document in database.execute(f"SELECT id, inputs, document FROM {table}")
    }
    named |= {name for name, naming in stored.items() if name.startswith("fit-") and naming & worlds}
    contents = set[str]()
    named &= stored.keys()
    while named:
        contents |= named
        named = (set[str]().union(*(stored[name] for name in named)) & stored.keys()) - contents
    return Referred(frozenset(worlds), frozenset(contents))


def _with_ancestors(database: sqlite3.Connection, named: set[str]) -> set[str]:
    """The worlds among the ids, and all that they were made from."""
    worlds = named & {world for (world,) in database.execute("SELECT id FROM worlds")}
    parents = database.execute("SELECT child, parent FROM world_parents").fetchall()
    while more := {parent for child, parent in parents if child in worlds} - worlds:
        worlds |= more
    return worlds
