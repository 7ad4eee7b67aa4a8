"""What an agent should make of a fit: doubts about its minimum, better drafts, what the data left open, in brief."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from evidence_store import Evidence
from polyworld.estimation.world_fit.objective import gyration_radius
from polyworld.world import World

NEAR = 1.2  # losses within this factor of the lowest are taken for the same basin
TURNED = 0.1  # [rad]; smaller rotation errors are never doubted
ROWS = 8  # rows of `undetermined` shown
STILL = "never moves in the observed frames"
TRY = (
    "probably a local minimum; try another seed or more restarts, or fit a prefix with last_frame and then "
    "method='refine' on all frames; else the world lacks something (torsional_radius, an effect)"
)
CONTACTS = (
    "a contact's friction and restitution are the geometric mean of the two objects' values, so a single object's "
    "value may be known in combination only"
)


def doubts(world: World, document: dict[str, Any]) -> list[str]:
    """Signs that a fit's document (see `digest`) does not hold the best there is, in sentences; none if none."""
    found: list[str] = []
    losses = [start["loss"] for start in document["starts"]]
    reached = sum(loss <= NEAR * losses[0] for loss in losses)
    if len(losses) > 1 and reached == 1:
        found.append(
            f"only one of {len(losses)} searches came to this loss, {losses[0]:.3g}; the next best to {losses[1]:.3g}"
        )
    accuracy = document["accuracy"]
    turn, shift = (accuracy["rotation_rmse"], accuracy["position_rmse"]) if accuracy else (None, None)
    if turn is not None and shift is not None and world.objects:
        radius = float(np.median([gyration_radius(world, item.name, None) for item in world.objects]))
        if turn > TURNED and turn * radius > 1.5 * shift:
            found.append(
                f"rotation_rmse {turn:.2g} rad is large beside position_rmse (it moves an object's substance by "
                f"{turn * radius:.2g} m)"
            )
    if found:
        found = [f"{'; '.join(found)}: {TRY}"]
    if document["method"] == "refine" and document["loss"] >= (1.0 - 1e-4) * document["loss_start"]:
        found.append("refine found nothing better than the world it started from")
    return found


def lower_draft(earlier: Sequence[Evidence], document: dict[str, Any], observation: str) -> dict[str, Any] | None:
    """The draft of lowest loss among a case's earlier fits of the same frames, if lower than this one's."""
    same = ("fitted_frames", "position_tolerance")
    comparable = [
        (data["loss"], data["world"])
        for record in earlier
        if record.observation == observation
        for data in [record.payload.get("data", {})]
        if data.get("loss") is not None and all(data.get(key) == document[key] for key in same)
    ]
    loss, world = min(comparable, default=(np.inf, ""))
    return {"world": world, "loss": loss} if loss < document["loss"] else None


def open_questions(document: dict[str, Any]) -> tuple[list[dict[str, str]], int]:
    """`undetermined` by object, at most `ROWS` rows, and how many rows there would be.

    An object that never moves is said to be so once; combinations of such objects' values alone are left out.
    """
    owners = {value["name"]: {_object(path) for path in value["paths"]} for value in document["values"]}
    rows: dict[tuple[str, str], list[str]] = {}
    still: list[str] = []
    for item in document["undetermined"]:
        if item["reason"].endswith(STILL):
            for name in item["parameters"]:
                still += sorted(owners.get(name, {_object(name)}) - set(still))
    for item in document["undetermined"]:
        whose = sorted({owner for name in item["parameters"] for owner in owners.get(name, {_object(name)})})
        if set(whose) <= set(still):
            continue
        own = ", ".join(whose) if len(whose) <= 3 else f"{len(whose)} objects"
        names = [name.removeprefix("objects.") for name in item["parameters"]]
        if len(names) > 1:  # a combination is one statement
            rows[own, f"{item['reason']}: {' + '.join(names)}"] = []
        else:
            rows.setdefault((own, item["reason"]), []).extend(names)
    listed = [{"object": name, "reason": f"{name} does not move: its state is as observed"} for name in still]
    for (own, reason), names in rows.items():
        listed.append({"object": own, "reason": f"{', '.join(names)}: {reason}" if names else reason})
    return listed[:ROWS], len(listed)


def _object(path: str) -> str:
    parts = path.split(".")
    return parts[1] if parts[0] == "objects" and len(parts) > 2 else path
