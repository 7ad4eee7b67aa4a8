"""How a number in a world is known: fitted, set by an edit, or as it was built."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from atw_mcp.calls.app import App
from evidence_store import Case, UnknownRecord
from polyworld.data.tracks import ObservedTracks
from polyworld.world import World
from polyworld.world.parameter_tables import STATE_PARAMETERS
from polyworld.world.parameters import read_parameter

SAMPLE = "posterior"  # kind of record that holds the sample of a fitted world
Origin = Literal["fitted", "edited", "observed", "assumed", "given or default"]


@dataclass(frozen=True)
class Knowledge:
    """origin: fitted to the observation; edited in a branch; observed, that is read off the tracks when the world was
    built; assumed, of the spin of an object that no frame shows to turn; or given by the agent or left at its default
    then. detail: what else is known, e.g. a standard error."""

    origin: Origin
    detail: dict[str, Any] = field(default_factory=dict)


def knowledge(app: App, case: Case, world: World, path: str) -> Knowledge:
    """Where the value at a parameter path of a world comes from, followed back through the worlds it descends from."""
    seen: set[str] = set()
    while world.id not in seen:
        seen.add(world.id)
        ancestry = app.store.worlds.parents(world.id)
        if not ancestry:
            break
        descent = ancestry[-1]
        parent = World.model_validate_json(app.store.worlds.document(descent.parent))
        if descent.how == "fitted":
            found = _fitted(app, world.id, descent.detail, path)
            if found is not None:
                return Knowledge("assumed" if _as_built(app, case, world, path) == "assumed" else "fitted", found)
        elif _value(parent, path) != _value(world, path):
            return Knowledge("edited", {"edits": descent.detail.get("edits"), "before": _value(parent, path)})
        world = parent
    return Knowledge(_as_built(app, case, world, path))


def _as_built(app: App, case: Case, world: World, path: str) -> Origin:
    """Return how a value of a world that no fit found is known: by the tracks of the record that it models, or not."""
    parts = path.split(".", 2)
    record = app.store.cases.modelled_observation(case.id, world.id)
    if record is None or parts[0] != "objects" or len(parts) != 3 or parts[2] not in STATE_PARAMETERS:
        return "given or default"
    tracks = ObservedTracks.from_dict(app.store.observations.get(record).document["tracks"])
    if parts[1] not in tracks.names:
        return "given or default"
    turns = parts[2].startswith(("angular_velocity", "rotation"))
    return "assumed" if turns and not tracks.shows_turning(parts[1]) else "observed"


def lineage(app: App, case: Case, world: World) -> list[dict[str, Any]]:
    """How a world came to be, from itself back to the first: world id, and how it was made from the next."""
    known, steps = dict(app.store.cases.worlds(case.id)), []
    identifier, seen = world.id, set[str]()
    while identifier not in seen:
        seen.add(identifier)
        ancestry = app.store.worlds.parents(identifier)
        step = {"world": identifier, "how": ancestry[-1].how if ancestry else known.get(identifier, "unknown")}
        if ancestry and "edits" in ancestry[-1].detail:
            step["edits"] = ancestry[-1].detail["edits"]
        steps.append(step)
        if not ancestry:
            break
        identifier = ancestry[-1].parent
    return steps


def _fitted(app: App, world: str, detail: dict[str, Any], path: str) -> dict[str, Any] | None:
    """Return what a fit says about a path; None where it was not among the fitted ones."""
    try:
        document = app.store.fits.get(str(detail.get("fit"))).document
    except UnknownRecord:  # a fit that was cancelled keeps its world, but not its account
        return None
    value = next((item for item in document["values"] if path in item["paths"]), None)
    sample = app.store.fits.find(SAMPLE, {"world": world})
    rows = [] if sample is None else sample.document["unknowns"]
    if value is None and not any(path in row["paths"] for row in rows):
        return None
    found: dict[str, Any] = {"standard_error": None}
    if value is not None:
        found |= {"from_prior": value["from_prior"], "at_bound": value["at_bound"]}
    for i, row in enumerate(rows):
        if sample is not None and path in row["paths"]:
            draws = sample.arrays["values"][:, i]
            low, high = np.quantile(draws, [0.1, 0.9])
            found |= {"standard_error": float(draws.std()), "interval80": [float(low), float(high)]}
            if len(row["paths"]) > 1:
                found["shared_with"] = [other for other in row["paths"] if other != path]
    name = None if value is None else value["name"]
    reasons = [item["reason"] for item in document["undetermined"] if name in item["parameters"]]
    if reasons:
        found["undetermined"] = reasons
    return found


def _value(world: World, path: str) -> float | None:
    try:
        return read_parameter(world, path)
    except KeyError:  # the object or effect is not in that world
        return None
