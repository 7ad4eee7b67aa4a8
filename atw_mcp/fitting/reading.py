"""Interpretation of a fit for an agent: what it predicts, doubts, better drafts, what the data left open, in brief."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from atw_mcp.calls.app import App
from atw_mcp.fitting.verdict import cure, predicted_errors
from evidence_store import Case, Evidence
from polyworld.edits.removal import MET
from polyworld.estimation.readout import gyration_radius
from polyworld.world import World

TURNED = 0.1  # [rad]; smaller rotation errors are never doubted
OVERSTATED = 3.0  # times the error of a fit from which the stated noise is doubted; chance explains no such factor
SLACK = 2.0  # standard deviations of a link beyond which a collision is not what its bodies' restitution says
BETTER = 0.8  # of a fit's errors below which an earlier one is named: less is not worth a second look
ROWS = 8  # rows of `undetermined` shown
LATEST = 20  # cases of a store that are considered for a common study: each is read, however large the store grows
CONTACTS = (
    "a contact's friction and restitution are the geometric mean of the two objects' values; 'friction of NAME' is "
    "that against the surface, and a pair of bodies has the product of theirs over the friction of the surface"
)
ROLLING = {
    "slides": "bodies start without rolling",
    "rolls": "what can roll rolls from the start",
    "skids": "what can roll slides and never rolls up",
}


def doubts(world: World, document: dict[str, Any]) -> list[str]:
    """Signs that a fit's document (see `digest`) does not hold what the video shows, in sentences; none if none."""
    found: list[str] = []
    accuracy = document["accuracy"]
    turn, shift = (accuracy["rotation_rmse"], accuracy["position_rmse"]) if accuracy else (None, None)
    if turn is not None and shift is not None and world.objects:
        radius = float(np.median([gyration_radius(world, item.name, None) for item in world.objects]))
        if turn > TURNED and turn * radius > 1.5 * shift:
            found.append(
                f"rotation_rmse {turn:.2g} rad is large beside position_rmse (it moves an object's substance by "
                f"{turn * radius:.2g} m): the world may lack something (torsional_radius, an effect)"
            )
    found += _off(document)
    strained = [_collision(world, i) for i, slack in enumerate(document["slack"], start=1) if slack > SLACK]
    if strained:
        found.append(
            f"{'; '.join(strained)}: bodies leave it otherwise than restitution and friction allow, and its pulses "
            "(effects slack_*) carry the rest, and any bounce off something else at that time"
        )
    on = [
        f"{v['name']} = {v['value']:.3g} ({v['bounds'][0]:.3g} to {v['bounds'][1]:.3g})"
        for v in document["values"]
        if v["at_bound"]
    ]
    if on:
        found.append(f"on a bound: {', '.join(on)}: FitWorld(parameters=[{{paths, lower, upper}}]) searches wider")
    return found


def _collision(world: World, number: int) -> str:
    """Return who takes part in a collision of a fitted world, and when, by its pulses."""
    pulses = [e for e in world.effects if e.name.startswith(f"{MET}{number}_") and not e.name.endswith("_after")]
    bodies = " and ".join(name for e in pulses for name in e.objects or ())
    return f"collision of {bodies} at {pulses[0].parameters['time']:.3g} s" if pulses else f"collision {number}"


def verdict_in_words(document: dict[str, Any]) -> str:
    """The first words of a fit's summary."""
    verdict = document["verdict"]
    if verdict["verdict"] == "good":
        return "good fit:"
    return f"{verdict['verdict'].upper()} fit ({verdict['why']}):"


def prediction_in_words(document: dict[str, Any]) -> str:
    """How well the fit predicts what it left out, and how far ahead; empty where nothing was left out."""
    prediction = document["prediction"]
    if prediction is None:
        return ""
    errors = [
        body["error"] for body in prediction["bodies"] if body["error"] is not None and np.isfinite(body["error"])
    ]
    spread = np.max([list(body["half_width80"].values()) for body in prediction["bodies"]], axis=0)
    said = (
        f"predicts the frames from {prediction['first_frame_left_out']} on, left out at first, to {max(errors):.2g} m"
        if errors
        else ""
    )
    ahead = f"80% intervals of +-{spread[1]:.2g} m 0.5 s and +-{spread[2]:.2g} m 1 s after the last frame"
    return "; ".join(filter(None, (said, ahead if np.isfinite(spread).all() else "")))


def sharing(app: App, case: Case, world: str | None, values: Sequence[dict[str, Any]]) -> str:
    """Name the fit that shares constants with the store's latest cases, where data leave some open; else nothing."""
    materials = {item.appearance.material for item in app.world(case, world).objects} - {None}
    if not materials or not any(value["from_prior"] for value in values):
        return ""
    fitted = [
        other
        for other in app.store.cases.all()[-LATEST:]
        if other.content != case.content and any(origin == "fitted" for _, origin in app.store.cases.worlds(other.id))
    ]
    found = [o.id for o in fitted if materials & {item.appearance.material for item in app.draft(o).objects}]
    return f"if these are of one laboratory, FitWorld(case={case.id!r}, cases={found}), " if found else ""


def next_step(case: str, world: str, document: dict[str, Any], pooled: str = "") -> str:
    """Which call to make after a fit. pooled: before a commit."""
    look = f"InspectRollout(case={case!r}, world={world!r})"
    verdict = document["verdict"]["verdict"]
    if verdict == "poor":
        return cure(case, world)
    if verdict == "good":
        return f"{look}, then {pooled}CommitWorld(case={case!r}, world={world!r})"
    return (
        f"{look}; correct tracks or shapes that are off; FitWorld(parameters=[...]) frees what may differ, such as "
        f"torsional_radius; FindDiscrepancy(case={case!r}, world={world!r}) and ProposeEffects find what the world "
        f"lacks; CommitWorld(case={case!r}, world={world!r}) if it will do"
    )


def notes(document: dict[str, Any]) -> list[str]:
    """What was made of the data, in sentences: bodies that scatter much less than their tracks state or was assumed."""
    calm = [body for body in document["verdict"]["bodies"] if OVERSTATED * body["error_m"] < body["noise_m"]]
    if not calm:
        return []
    said = ", ".join(f"{body['object']} {body['noise_m']:.2g} m (off by {body['error_m']:.2g} m)" for body in calm)
    return [
        f"the noise of positions is overstated: {said}; what the tracks scatter is used instead (ImportObservation "
        "takes position_sigma)"
    ]


def _off(document: dict[str, Any]) -> list[str]:
    """Bodies whose error exceeds their measurement."""
    off = [body for body in document["verdict"]["bodies"] if body["verdict"] != "good"]
    if not off:
        return []
    said = ", ".join(
        f"{body['object']} by {body['error_m']:.2g} m ({body['of_radius']:.0%} of its radius)"
        + ("" if body["predicted_m"] is None else f" and {body['predicted_m']:.2g} m where it was predicted")
        for body in off
    )
    return [f"off beyond measurement: {said}: InspectRollout shows from when on"]


def better_draft(earlier: Sequence[Evidence], document: dict[str, Any], observation: str) -> dict[str, Any] | None:
    """Name the draft, among a case's earlier fits of the same frames, whose errors are least, if less than this one's.

    Errors are those on the frames left out, as geometric mean over the bodies that both fits predict; fits without any
    are compared by their loss on the frames fitted.
    """
    best: dict[str, Any] | None = None
    own = predicted_errors(document["verdict"]["bodies"])
    for record in earlier:
        data = record.payload.get("data", {})
        if record.observation != observation or data.get("fitted_frames") != document["fitted_frames"]:
            continue
        ratio = _error_ratio(predicted_errors(data.get("bodies") or []), own)
        on = "predicted"
        if ratio is None and data.get("loss") is not None:
            ratio, on = data["loss"] / max(document["loss"], 1e-300), "fitted"
        if ratio is not None and ratio < (BETTER if best is None else best["error_over_this"]):
            best = {"world": data["world"], "error_over_this": ratio, "on": on}
    return best


def draft_in_words(better: dict[str, Any]) -> str:
    """Name a better draft and by how much it is better."""
    what = "predicted the frames left out" if better["on"] == "predicted" else "fits the same frames"
    return f"draft {better['world']} {what} better: {better['error_over_this']:.2g} times the error"


def _error_ratio(one: dict[str, float], other: dict[str, float]) -> float | None:
    """Return the geometric mean of errors over others, of the bodies of both; None where these are none."""
    common = one.keys() & other.keys()
    return float(np.exp(np.mean([np.log(one[n] / other[n]) for n in common]))) if common else None


def open_questions(document: dict[str, Any]) -> tuple[list[dict[str, str]], int]:
    """`undetermined` as rows, at most `ROWS`, and how many there would be."""
    names = [name for item in document["undetermined"] for name in item["parameters"]]
    ahead = (document["prediction"] or {"bodies": []})["bodies"]
    rows = []
    for name in names:
        decides = [body["object"] for body in ahead if any(row["constant"] == name for row in body["decided_by"])]
        why = "the data say little about it: its value is the prior's"
        rows.append(
            {"object": name, "reason": why + (f", and it decides where {', '.join(decides)} goes" if decides else "")}
        )
    rows.sort(key=lambda row: "decides" not in row["reason"])
    return rows[:ROWS], len(rows)
