"""Report on a world that was modelled from a video: verdict, doubts, steps, and how to correct them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from atw_mcp.calls.app import App
from atw_mcp.calls.results import Answer
from atw_mcp.calls.steps import Step, StepFailed, Steps
from atw_mcp.fitting.errors import ObjectError
from atw_mcp.fitting.reading import CONTACTS, ROLLING, draft_in_words, sharing
from atw_mcp.observation.matching import Matching
from atw_mcp.observation.observing import chosen_image_observation, track_record
from atw_mcp.perception.known_scene import OFF_PLANE
from evidence_store import Case

UNSURE = 0.5  # mean confidence below which a track is doubted
CLOSE = 2.0  # ratio of errors up to which the world that was passed over is worth asking too
MATCHING = "matching"
VALUE = ("name", "value", "unit", "interval80", "prior80", "from_prior", "at_bound")
VERDICTS = {
    "good": "follows the video",
    "doubtful": "follows the video, with doubts",
    "poor": "does not follow the video",
}


@dataclass
class VideoModel:
    """State reached so far: matches, tracks that no known object explains, errors, or why there are none.

    doubts: about how objects were looked for and placed. other: the world in the other representation, which was passed
    over, and its error over that of the one kept.
    """

    matching: Matching | None = None
    tracks: list[dict[str, Any]] = field(default_factory=list)
    errors: tuple[ObjectError, ...] = ()
    diverged: str | None = None
    doubts: list[str] = field(default_factory=list)
    other: tuple[str, float] | None = None


def fit_report(app: App, case: Case, fitted: Step, steps: Steps, model: VideoModel, kept: str) -> Answer:
    """Judge the fitted world: errors beside body and noise, matches, values, predictions, doubts."""
    world = fitted.evidence.world
    doubts = [*_doubts(steps, fitted, model), *_off_plane(app, case, fitted.evidence.observation)]
    verdict = "poor" if model.diverged else fitted.data["verdict"]
    verdict = "doubtful" if verdict == "good" and doubts else verdict
    pooled = sharing(app, case, world, fitted.data["values"])
    worst = model.errors[0] if model.errors else None
    size = "" if worst is None else f"; worst {worst.object}: {_error(worst)}"
    data = {
        "world": world,
        "verdict": verdict,
        "doubts": doubts,
        "next": _next(app, case, steps, model, world, verdict, pooled),
        "kept": kept or None,
        **_matching(model),
        "errors": [error.to_dict() for error in model.errors],
        "representation": _kind(app, case, world),
        "other": _other(app, case, model),
        "rolling": ROLLING[fitted.data["rolling"]],
        "values": [{name: value[name] for name in VALUE} for value in fitted.data["values"]],
        "contacts": CONTACTS,
        "prediction": fitted.data["prediction"],
    }
    return Answer(
        summary=f"fitted world {world} {VERDICTS[verdict]}{size}" + "".join(f". DOUBT: {doubt}" for doubt in doubts),
        data={**data, "steps": _steps(case, steps)},
        shown={**_without_empty(data), "steps": _short_steps(steps)},
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


def _other(app: App, case: Case, model: VideoModel) -> dict[str, Any] | None:
    if model.other is None:
        return None
    world, ratio = model.other
    return {"world": world, "representation": _kind(app, case, world), "error_over_this": ratio}


def _kind(app: App, case: Case, world: str | None) -> str:
    return "planar" if app.world(case, world).planar else "spatial"


def _next(app: App, case: Case, steps: Steps, model: VideoModel, world: str | None, verdict: str, pooled: str) -> str:
    """Return the call that helps most: to find what was not found, to see what is off, or to go on."""
    unseen = () if model.matching is None else model.matching.unseen
    again = f"ModelVideo(case={case.id!r}, ...) again"
    if unseen:
        seed = f"{{kind: 'add', object: {unseen[0]!r}, frame: ..., outline: [[u, v], ...]}}"
        return f"InspectFrames(case={case.id!r}), ObserveObjects(case={case.id!r}, corrections=[{seed}]), then {again}"
    look = f"InspectRollout(case={case.id!r}, world={world!r})"
    if verdict == "poor":
        return f"{look} to look; {_correction(case, steps, 'FitWorld')}"
    both = ""
    if model.other and model.other[1] <= CLOSE and _kind(app, case, world) == "planar":  # a plane is left for a reason
        both = f" of both: worlds=[{world!r}, {model.other[0]!r}]"
    return f"{look} to look, then {pooled}CommitWorld(case={case.id!r}, world={world!r}) and Ask{both}"


def _doubts(steps: Steps, fitted: Step, model: VideoModel) -> list[str]:
    """Doubts about the result as a whole; those of single steps that do not bear on it stay with the steps."""
    found = [*([] if model.matching is None else model.matching.doubts), *model.doubts]
    if model.diverged is not None:
        found.append(model.diverged)
    found += [f"{error.object} is off by {_error(error)}" for error in model.errors if not error.follows]
    found += [
        f"the places of {error.object} are known to {error.distance_noise:.2g} m only, and contacts hang on less"
        for error in model.errors
        if error.vague
    ]
    found += fitted.data["warnings"]
    better, own = fitted.data["best_draft"], {step.evidence.world for step in steps.done}
    if better is not None and better["world"] not in own:  # one of its own was passed over on purpose
        found.append(draft_in_words(better))
    for step in steps.done:
        if step.tool == "CalibrateCamera":
            found += [text for text in step.data.get("warnings", []) if "were assumed" not in text]
        found += step.data.get("left_out", []) if step.tool == "BuildWorld" else []
    return found


def _off_plane(app: App, case: Case, observation: str | None) -> list[str]:
    """Return notes of the observation that is modelled on bodies that may be on another surface than was taken."""
    source = track_record(app, case, observation).source.get("objects")
    seen = None if source is None else chosen_image_observation(app, case, source)[1]
    return [] if seen is None else [text for text in seen.notes if OFF_PLANE in text]


def _error(error: ObjectError) -> str:
    pixels = "" if error.pixels is None else f"{error.pixels:.2g} px, "
    noise = f", {error.metres / error.noise:.2g} times the noise" if error.noise > 0.0 else ""
    share = error.metres / error.radius
    return f"{pixels}{error.metres:.2g} m rms ({share:.{0 if share >= 0.1 else 1}%} of its radius{noise})"


def _matching(model: VideoModel) -> dict[str, Any]:
    if model.matching is None:
        return {}
    return {
        "matches": [match.to_dict() for match in model.matching.matches],
        **({"found_by_colour_and_size": list(found)} if (found := model.matching.looked_for) else {}),
        "unseen_objects": list(model.matching.unseen),
        "unlisted_tracks": model.tracks,
    }


def _short_steps(steps: Steps) -> list[dict[str, Any]]:
    """Return the steps without arguments, which their own records have, and with doubts where there are any."""
    found = []
    for step in steps.done:
        doubts = _step_doubts(step)
        found.append({"tool": step.tool, "evidence": step.evidence.id} | ({"doubts": doubts} if doubts else {}))
    return found


def _without_empty(data: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in data.items() if value not in ([], None) or name == "doubts"}


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
