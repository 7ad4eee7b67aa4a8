"""Folders laid out like CLEVRER's and ContPhy's downloads: which scenes are there, and what is asked of each.

CLEVRER: `annotation_NNNNN.json`, `video_NNNNN.mp4` and JSON files of questions (a list of scenes, or scenes by
number), anywhere under the folder. ContPhy's rope and pulley group: a folder per video with `output_Full.mp4` and
`outputs.json`, and `questions/NUMBER.json` or `output/pulley/NUMBER.json` as its question engine writes them.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

Source = Literal["video", "annotation"]
"""What worlds are made from."""

CAMERA = "camera_homography_z0.2.json"


@dataclass(frozen=True)
class Asked:
    """A scene of CLEVRER's layout with its questions; annotation or video is None where the folder lacks it."""

    number: str
    annotation: Path | None
    video: Path | None
    camera: Path
    questions: tuple[dict[str, Any], ...]


def clevrer_scenes(folder: Path, camera: Path) -> list[Asked]:
    """Return the scenes that have questions; `camera` is used where the folder holds no map of its own."""
    own = folder / CAMERA
    files = {p.name: p for p in folder.rglob("*") if p.suffix in (".mp4", ".json")}
    questions: dict[str, list[dict[str, Any]]] = {}
    for path in files.values():
        if path.name.startswith(("validation", "train", "test", "questions")):
            for number, asked in _entries(json.loads(path.read_text())):
                questions.setdefault(number, []).extend(asked)
    return [
        Asked(
            number,
            files.get(f"annotation_{number}.json"),
            files.get(f"video_{number}.mp4"),
            own if own.exists() else camera,
            tuple(asked),
        )
        for number, asked in sorted(questions.items())
        if f"annotation_{number}.json" in files or f"video_{number}.mp4" in files
    ]


def _entries(content: Any) -> list[tuple[str, list[dict[str, Any]]]]:
    if isinstance(content, list):
        return [(f"{int(scene['scene_index']):05d}", scene["questions"]) for scene in content]
    return [(f"{int(number):05d}", scene["questions"]) for number, scene in content.items()]


@dataclass(frozen=True)
class AskedPulleys:
    """A video of ContPhy's rope and pulley group: its folder's `outputs.json`, and questions by family."""

    number: str
    video: Path | None
    outputs: Path
    questions: dict[str, list[dict[str, Any]]]


def pulley_scenes(folder: Path) -> list[AskedPulleys]:
    """Return the videos that have questions, in order of their numbers."""
    found = []
    for outputs in folder.rglob("outputs.json"):
        number = outputs.parent.name
        asked = next((p for p in folder.rglob(f"{number}.json") if p.parent.name in ("questions", "pulley")), None)
        if asked is None:
            continue
        video = outputs.parent / "output_Full.mp4"
        families = json.loads(asked.read_text())["question_dict"]
        found.append(AskedPulleys(number, video if video.exists() else None, outputs, families))
    return sorted(found, key=lambda scene: (len(scene.number), scene.number))
