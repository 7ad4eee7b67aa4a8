"""Write scenes of solids as folders laid out like CLEVRER's validation download."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from .ask import FUTURE, Asker, events_of
from .camera import homography
from .film import render, write_video
from .solids import HALF, Run, Solid, draw, simulate

LONGEST = 128  # frames of a clip, as in CLEVRER
SHORTEST = 80
LEAD = (4, 30)  # frames from the clip's end to the first collision asked about
BRANCHES = 3  # counterfactual questions a scene has at least
SHOWN = 12  # frames in which every object has to be visible


def make_scene(seed: int, folder: Path) -> dict[str, Any]:
    """Draw the scene of a seed, write its video and annotation, and return its entry of validation.json."""
    rng = np.random.default_rng([seed, 30])
    while True:
        solids, restitution = draw(rng)
        run = simulate(solids, restitution, LONGEST + FUTURE)
        frames = cut(rng, run)
        if frames is None:
            continue
        collisions = [e for e in events_of(run, frames) if e.kind == "collision"]
        questions = Asker(rng, solids, restitution, run, frames).ask()
        kinds = [q["question_type"] for q in questions]
        if len(collisions) >= 2 and "predictive" in kinds and kinds.count("counterfactual") >= BRANCHES:
            break
    low = seed // 1000 * 1000
    part = f"{low:05d}-{low + 1000:05d}"
    video = folder / "video_validation" / f"video_{part}" / f"video_{seed:05d}.mp4"
    write_video(video, render(solids, restitution, run, frames))
    annotation = folder / "annotation_validation" / f"annotation_{part}" / f"annotation_{seed:05d}.json"
    annotation.parent.mkdir(parents=True, exist_ok=True)
    annotation.write_text(json.dumps(annotation_of(seed, solids, run, frames)))
    return {"scene_index": seed, "video_filename": video.name, "questions": questions}


def make_all(seeds: list[int], folder: Path) -> None:
    """Write the scenes of the seeds with their questions and the camera's map."""
    folder.mkdir(parents=True, exist_ok=True)
    asked = folder / "validation.json"
    entries = {e["scene_index"]: e for e in json.loads(asked.read_text())} if asked.exists() else {}
    for seed in seeds:
        if seed not in entries:
            entries[seed] = make_scene(seed, folder)
            asked.write_text(json.dumps([entries[k] for k in sorted(entries)], indent=1))
    plane = {"plane": f"z={HALF}", "H": homography(HALF).tolist()}
    (folder / "camera_homography_z0.2.json").write_text(json.dumps(plane))


def cut(rng: np.random.Generator, run: Run) -> int | None:
    """Return the length of a clip that ends before some collision, None where there is none.

    Within a clip all collisions are in view, as in CLEVRER's annotations.
    """
    later = [c.frame for c in run.collisions if SHORTEST + LEAD[0] <= c.frame < LONGEST + LEAD[1]]
    if not later:
        return None
    frames = int(np.clip(rng.choice(later) - rng.integers(*LEAD), SHORTEST, LONGEST))
    seen = run.visible[:frames].sum(axis=0)
    shown = all(run.visible[c.frame, list(c.pair)].all() for c in run.collisions if c.frame < frames)
    return frames if shown and (seen >= SHOWN).all() else None


def annotation_of(seed: int, solids: list[Solid], run: Run, frames: int) -> dict[str, Any]:
    """Return the annotation of a clip of so many frames, in CLEVRER's form."""
    angles = Rotation.from_quat(run.quaternions[:frames].reshape(-1, 4), scalar_first=True).as_euler("xyz")
    angles = angles.reshape(frames, len(solids), 3)
    return {
        "scene_index": seed,
        "video_filename": f"video_{seed:05d}.mp4",
        "object_property": [
            {"object_id": k, "color": s.color, "material": s.material, "shape": s.shape} for k, s in enumerate(solids)
        ],
        "motion_trajectory": [
            {
                "frame_id": f,
                "objects": [
                    {
                        "object_id": k,
                        "location": run.places[f, k].round(4).tolist(),
                        "orientation": angles[f, k].round(4).tolist(),
                        "velocity": run.velocities[f, k].round(4).tolist(),
                        "angular_velocity": run.spins[f, k].round(4).tolist(),
                        "inside_camera_view": bool(run.visible[f, k]),
                    }
                    for k in range(len(solids))
                ],
            }
            for f in range(frames)
        ],
        "collision": [
            {
                "object_ids": list(c.pair),
                "frame_id": c.frame,
                "location": run.places[c.frame, list(c.pair)].mean(0).tolist(),
            }
            for c in run.collisions
            if c.frame < frames
        ],
    }
