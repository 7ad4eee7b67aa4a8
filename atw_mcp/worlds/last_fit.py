"""The fit that a world came from, by its lineage in the store."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from atw_mcp.calls.app import App
from polyworld.world import World


@dataclass(frozen=True)
class LastFit:
    """A fit that FitWorld made: every unknown with its bounds and what came out, and the first frame not used."""

    values: list[dict[str, Any]]
    unseen_from: int | None


def last_fit(app: App, world: World) -> LastFit | None:
    """Return the fit that a world, or the nearest of its ancestors, came from; None where nothing was fitted."""
    identifier, seen = world.id, set[str]()
    while identifier not in seen:
        seen.add(identifier)
        ancestry = app.store.worlds.parents(identifier)
        if not ancestry:
            return None
        descent = ancestry[-1]
        if descent.how == "fitted" and "fit" in descent.detail:
            held, last = descent.detail.get("holdout_from"), descent.detail.get("last_frame")
            unseen = held if held is not None else None if last is None else last + 1
            kept = app.store.fits.get(descent.detail["fit"])
            values = [
                {**value, "lower": value["bounds"][0], "upper": value["bounds"][1]} for value in kept.document["values"]
            ]
            return LastFit(values, unseen)
        identifier = descent.parent
    return None
