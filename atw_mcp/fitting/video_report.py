"""Report on a world that was modelled from a video: verdict, doubts, steps, and how to correct them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from atw_mcp.calls.results import Answer
from atw_mcp.calls.steps import Step, StepFailed, Steps
from atw_mcp.fitting.errors import ObjectError
from atw_mcp.fitting.reading import open_questions
from atw_mcp.observation.matching import Matching
from evidence_store import Case

UNSURE = 0.5  # mean confidence below which a track is doubted
MATCHING = "matching"
VERDICTS = {
    "follows": "follows the video",
    "follows_with_doubts": "follows the video, with doubts",
    "does_not_follow": "does not follow the video",
}


@dataclass
class VideoModel:
    """State reached so far: matches, tracks that no known object explains, errors, or why there are none.

    notes: doubts about how known objects were looked for. looked_for: those found by colour and size, not by matching.
    """

    matching: Matching | None = None
    tracks: list[dict[str, Any]] = field(default_factory=list)
    errors: tuple[ObjectError, ...] = ()
    diverged: str | None = None
    notes: list[str] = field(default_factory=list)
    looked_for: list[str] = field(default_factory=list)


def fit_report(case: Case, fitted: Step, steps: Steps, model: VideoModel) -> Answer:
    """Judge the fitted world: errors beside body and noise, matches, bounds, what is undetermined, doubts."""
    world = fitted.evidence.world
    bounds = [
        {key: value[key] for key in ("name", "value", "unit")} for value in fitted.data["values"] if value["at_bound"]
    ]
    fixed = {path for item in fitted.arguments.get("parameters", []) if item.get("fixed") for path in item["paths"]}
    undetermined = [item for item in fitted.data["undetermined"] if not set(item["parameters"]) <= fixed]
    rows, count = open_questions({**fitted.data, "undetermined": undetermined})
    doubts = _doubts(steps, fitted, model, bounds)
    off = [error for error in model.errors if not error.follows]
    verdict = "does_not_follow" if off or model.diverged else "follows_with_doubts" if doubts else "follows"
    worst = model.errors[0] if model.errors else None
    size = "" if worst is None else f"; worst {worst.object}: {_error(worst)}"
    look = f"InspectRollout(case={case.id!r}, world={world!r})"
    commit = f"CommitWorld(case={case.id!r}, world={world!r})"
    cure = _correction(case, steps, "FitWorld")
    return Answer(
        summary=f"fitted world {world} {VERDICTS[verdict]}{size}" + "".join(f". DOUBT: {doubt}" for doubt in doubts),
        data={
            "world": world,
            "verdict": verdict,
            "doubts": doubts,
            **_matching(model),
            "errors": [error.to_dict() for error in model.errors],
            "at_bounds": bounds,
            "undetermined": rows,
            "undetermined_rows": count,
            "steps": _steps(case, steps),
            "next": f"{look} to look, then {commit}" if verdict != "does_not_follow" else f"{look} to look; {cure}",
        },
        case=case.id,
        world=world,
        observation=fitted.evidence.observation,
        objects=fitted.evidence.objects,
        interval=fitted.evidence.interval,
    )


def failure_report(case: Case, error: StepFailed, steps: Steps, model: VideoModel) -> Answer:
    """Name the step that failed, why, what is kept, and the cure."""
    done = ", ".join(f"{step.tool} {step.evidence.id}" for step in steps.done) or "nothing"
    cure = _correction(case, steps, error.tool)
    return Answer(
        summary=f"stopped at {error.tool}: {error.reason.rstrip('.')}. Done and kept: {done}. Then: {cure}",
        data={
            "failed_step": error.tool,
            "reason": error.reason,
            "failed_evidence": error.evidence,
            **_matching(model),
            "steps": _steps(case, steps),
            "next": cure,
        },
        case=case.id,
        status="failed",
    )


def _doubts(steps: Steps, fitted: Step, model: VideoModel, bounds: list[dict[str, Any]]) -> list[str]:
    """Doubts about the result as a whole; those of single steps that do not bear on it stay with the steps."""
    found = [*([] if model.matching is None else model.matching.doubts), *model.notes]
    if model.diverged is not None:
        found.append(model.diverged)
    found += [f"{error.object} is off by {_error(error)}" for error in model.errors if not error.follows]
    found += [
        f"the places of {error.object} are known to {error.distance_noise:.2g} m only, and contacts hang on less"
        for error in model.errors
        if error.vague
    ]
    if bounds:
        listed = ", ".join(
            f"{v['name']} = {v['value']:.3g}" + (f" {v['unit']}" if v["unit"] != "1" else "") for v in bounds
        )
        found.append(f"fitted values at their bounds: {listed}")
    for step in steps.done:
        if step.tool == "CalibrateCamera" or step is fitted:
            found += [text for text in step.data.get("warnings", []) if "were assumed" not in text]
        found += step.data.get("left_out", []) if step.tool == "BuildWorld" else []
    return found


def _error(error: ObjectError) -> str:
    pixels = "" if error.pixels is None else f"{error.pixels:.2g} px, "
    noise = f", {error.metres / error.noise:.2g} times the noise" if error.noise > 0.0 else ""
    return f"{pixels}{error.metres:.2g} m rms ({100 * error.metres / error.radius:.2g}% of its radius{noise})"


def _matching(model: VideoModel) -> dict[str, Any]:
    if model.matching is None:
        return {}
    return {
        "matches": [match.to_dict() for match in model.matching.matches],
        **({"found_by_colour_and_size": model.looked_for} if model.looked_for else {}),
        "unseen_objects": list(model.matching.unseen),
        "unlisted_tracks": model.tracks,
    }


def _steps(case: Case, steps: Steps) -> list[dict[str, Any]]:
    return [
        {
            "tool": step.tool,
            "evidence": step.evidence.id,
            "arguments": step.arguments,
            "doubts": _step_doubts(step),
            "assumed": step.data.get("assumed", []),
            "to_correct": _correction(case, steps, step.tool),
        }
        for step in steps.done
    ]


def _step_doubts(step: Step) -> list[str]:
    found = [*step.data.get("warnings", []), *step.data.get("left_out", [])]
    if step.tool == "ObserveObjects":
        for item in step.data.get("objects", []):
            if item["mean_confidence"] < UNSURE:
                found.append(f"{item['name']} is seen with confidence {item['mean_confidence']:.2f} on average")
        found += [f"{item['object']} may be deformable" for item in step.data.get("deforming", [])]
    return found


def _correction(case: Case, steps: Steps, tool: str) -> str:
    """Which calls to make after a step that failed or is doubted."""
    again = f"ModelVideo(case={case.id!r}, ...) again, which goes on from there"
    worlds = [step.evidence.world for step in steps.done if step.tool == "BuildWorld"]
    return {
        "ObserveObjects": f"InspectFrames(case={case.id!r}), ObserveObjects(case={case.id!r}, corrections=[...]), then "
        + again,
        "CalibrateCamera": f"{again}, with other points",
        MATCHING: f"InspectFrames(case={case.id!r}) shows the tracks; give color, shape or pixel of the objects to "
        + again,
        "BuildWorld": f"BuildWorld(case={case.id!r}, ...) as the step's arguments say but corrected, then FitWorld; or "
        + again,
        "FitWorld": f"FitWorld(case={case.id!r}{f', world={worlds[-1]!r}' if worlds else ''}, ...) with other "
        "parameters; FindDiscrepancy where the world lacks something",
    }[tool]
