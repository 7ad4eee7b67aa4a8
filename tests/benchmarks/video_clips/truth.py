"""Collect the hidden truth of a clip: motion, physics, visibility, continuation, edits and questions."""

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.random import Generator

from .bodies import HORIZON, POSE_RATE, Array, Scene
from .clip import Clip
from .edits import WANTED as CHANGES
from .edits import apply, draw_edits
from .physics import REST_SPEED, Run, simulate
from .questions import Outcome, draw_questions
from .render import Film

LEAST_PIXELS = 4


def _list(values: Array | None, digits: int) -> Any:
    return None if values is None else (np.round(values, digits) + 0.0).tolist()


def intervals(flags: np.ndarray) -> list[list[int]]:
    """Return the first and last index of each run of true values."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(int), [0]])))
    return [[int(a), int(b) - 1] for a, b in edges.reshape(-1, 2)]


def outcome_record(run: Run) -> dict[str, Any]:
    """Return a run's poses at POSE_RATE, touches and times of rest."""
    return {
        "names": run.names,
        "end": round(run.end, 4),
        "poses": {n: _list(run.poses[:, i], 5) for i, n in enumerate(run.names)},
        "points": _list(run.points, 4),
        "touches": [list(t) for t in run.touches],
        "rest_from": run.rest,
    }


def _physics(scene: Scene) -> dict[str, Any]:
    keep = ("mass", "friction", "restitution", "rolling", "damping", "resistance", "joint")
    return {
        "gravity": scene.gravity,
        "mutual_friction": scene.mutual_friction,
        "mutual_restitution": scene.mutual_restitution,
        "bodies": {b.name: {k: getattr(b, k) for k in keep} for b in scene.bodies},
        "rope": asdict(scene.rope) if scene.rope else None,
        "cloth": asdict(scene.cloth) if scene.cloth else None,
        "rest_speed": REST_SPEED,
    }


def _camera(clip: Clip) -> dict[str, Any]:
    cameras = clip.cameras if clip.look.shake > 0 else clip.cameras[:1]
    first = cameras[0]
    return {
        "focal_pixels": first.focal,
        "principal_point": [first.width / 2 - 0.5, first.height / 2 - 0.5],
        "poses": [{"position": c.pos, "right": c.right, "up": c.up} for c in cameras],
    }


def _visibility(film: Film) -> tuple[dict[str, Any], dict[str, Any]]:
    area = np.stack([(film.labels == i + 1).sum(axis=(1, 2)) for i in range(len(film.names))])
    shown = {n: intervals(area[i] >= LEAST_PIXELS) for i, n in enumerate(film.names)}
    return shown, {n: area[i].tolist() for i, n in enumerate(film.names)}


def truth(clip: Clip, film: Film, rng: Generator, wanted: int, changes: int = CHANGES) -> dict[str, Any]:
    """Simulate the edits, draw the questions and return all that the private file holds."""
    scene, look, run = clip.scene, clip.look, clip.run
    edits: list[dict[str, Any]] = []
    outcomes = [Outcome(run, None, "", (look.frames - 1) / look.fps)]
    for edit in draw_edits(rng, scene, run, changes):
        try:
            changed = simulate(apply(scene, edit), look.seconds, look.fps)
        except FloatingPointError:
            continue
        outcomes.append(Outcome(changed, len(edits), edit.text, 0.0))
        edits.append({**edit.record(), "outcome": outcome_record(changed)})
    shown, area = _visibility(film)
    return {
        "kind": scene.kind,
        "style": look.style,
        "look": asdict(look),
        "light_gain": film.gains,
        "frames": {
            "count": look.frames,
            "rate": look.fps,
            "poses": {n: _list(run.frame_poses[:, i], 6) for i, n in enumerate(run.names)},
            "velocities": {n: _list(run.frame_velocities[:, i], 5) for i, n in enumerate(run.names)},
            "points": _list(run.frame_points, 5),
        },
        "camera": _camera(clip),
        "visible_frames": shown,
        "visible_pixels": area,
        "mask_names": film.names,
        "physics": _physics(scene),
        "fixtures": [asdict(f) for f in scene.fixtures],
        "pose_rate": POSE_RATE,
        "horizon": HORIZON,
        "continuation": outcome_record(run),
        "edits": edits,
        "questions": draw_questions(rng, scene, outcomes, wanted),
    }
