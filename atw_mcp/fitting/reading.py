"""Interpretation of a fit for an agent: doubts about its minimum, better drafts, what the data left open, in brief."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from atw_mcp.fitting.verdict import cure
from evidence_store import Evidence
from polyworld.estimation.world_fit import WideningSettings
from polyworld.estimation.world_fit.objective import gyration_radius
from polyworld.world import World

NEAR = 1.2  # losses within this factor of the lowest are taken for the same basin
TURNED = 0.1  # [rad]; smaller rotation errors are never doubted
OVERSTATED = 3.0  # times the error of a fit from which the stated noise is doubted; chance explains no such factor
UNMET = "meets no other body"
ROWS = 8  # rows of `undetermined` shown
STILL = "never moves in the observed frames"
TRY = (
    "probably a local minimum; try method='prefixes', another seed or more restarts, and commit what has the lowest "
    "loss; else the world lacks something (torsional_radius, an effect)"
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
    found += _off(document) + _bounds(document) + _open(document) + _overstated(document)
    for item in document["outlying"]:
        frames = ", ".join(str(frame) for frame in item["frames"][:8])
        found.append(
            f"{item['object']} in frame{'s' * (len(item['frames']) > 1)} {frames} is off by up to {item['worst']:.2g} "
            "standard deviations and weighs less: InspectFrames shows whether it was seen rightly"
        )
    if document["method"] == "refine" and document["loss"] >= (1.0 - 1e-4) * document["loss_start"]:
        found.append("refine found nothing better than the world it started from")
    return found


def verdict_in_words(document: dict[str, Any]) -> str:
    """The first words of a fit's summary."""
    verdict = document["verdict"]
    if verdict["verdict"] == "good":
        return "good fit:"
    bounds = "; ".join(
        f"{value['name']} {value['bounds'][0]:.3g} to {value['bounds'][1]:.3g}" for value in _physical(document)[:12]
    )
    return f"{verdict['verdict'].upper()} fit ({verdict['why']}; searched {bounds or 'initial states alone'}):"


def next_step(case: str, world: str, document: dict[str, Any]) -> str:
    """Which call to make after a fit."""
    look = f"InspectRollout(case={case!r}, world={world!r})"
    verdict = document["verdict"]["verdict"]
    if verdict == "failed":
        return cure(case, world)
    if verdict == "good":
        return f"{look}, then CommitWorld(case={case!r}, world={world!r})"
    tested = ", ".join(row["name"] for row in document["resistance"])
    without = f" ({tested} tested)" if tested else ""
    return (
        f"{look}; FitWorld by another method or seed and compare the losses; free what may differ, e.g. "
        "each=['friction', 'restitution', 'mass', 'torsional_radius'], or let "
        f"FindDiscrepancy(case={case!r}, world={world!r}) and ProposeEffects find what the world lacks{without}; "
        f"CommitWorld(case={case!r}, world={world!r}) if it will do"
    )


def _overstated(document: dict[str, Any]) -> list[str]:
    """Bodies whose positions scatter much less than the noise that their tracks state, or that was assumed."""
    calm = [body for body in document["verdict"]["bodies"] if OVERSTATED * body["error_m"] < body["noise_m"]]
    if not calm:
        return []
    said = ", ".join(f"{body['object']} {body['noise_m']:.2g} m (off by {body['error_m']:.2g} m)" for body in calm)
    return [
        f"the noise of positions is overstated: {said}; intervals and probabilities are wider than the data allow "
        "(ImportObservation takes position_sigma)"
    ]


def _physical(document: dict[str, Any]) -> list[dict[str, Any]]:
    """Fitted values that are no initial states."""
    states = (".position.", ".velocity.", ".rotation.", ".angular_velocity.", ".shift.")
    return [value for value in document["values"] if not any(key in path for path in value["paths"] for key in states)]


def _off(document: dict[str, Any]) -> list[str]:
    """Bodies whose error exceeds their measurement."""
    off = [body for body in document["verdict"]["bodies"] if body["verdict"] != "good"]
    if not off:
        return []
    said = ", ".join(
        f"{body['object']} by {body['error_m']:.2g} m ({body['of_radius']:.0%} of its radius)" for body in off
    )
    return [f"off beyond measurement: {said}: InspectRollout shows from when on"]


def _bounds(document: dict[str, Any]) -> list[str]:
    """Bounds that were widened, and values that lie on one."""
    found = [
        f"the bounds of {name} excluded the best value and were widened to {lower:.3g} to {upper:.3g}"
        for name, (lower, upper) in document["widened"].items()
    ]
    on = []
    for value in _physical(document):
        lower, upper = value["bounds"]
        near = WideningSettings().near * (upper - lower)
        if min(value["value"] - lower, upper - value["value"]) < near:
            on.append(f"{value['name']} = {value['value']:.3g} (searched {lower:.3g} to {upper:.3g})")
    if on:
        found.append(f"on a bound: {', '.join(on)}: FitWorld(parameters=[{{paths, lower, upper}}]) searches wider")
    return found


def _open(document: dict[str, Any]) -> list[str]:
    """Masses that nothing in the frames shows, of bodies that may meet later."""
    alone = [
        item["parameters"][0].removeprefix("objects.").removesuffix(".mass")
        for item in document["undetermined"]
        if len(item["parameters"]) == 1 and item["parameters"][0].endswith(".mass") and UNMET in item["reason"]
    ]
    if len(alone) < 2:
        return []
    return [
        f"the masses of {', '.join(alone)} do not show before they meet another body, and are those of the density "
        "assumed: BuildWorld(objects=[{name, mass}]) if they are known; an ensemble varies them"
    ]


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
