"""Folders with the weights of learned models: where they lie, what they are for, their licence and content."""

from __future__ import annotations

import json
import os
import re
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any, Literal

import platformdirs

from atw_mcp.cases.cases import path_hash

FOLDER = "ATW_MODELS"
MANIFEST = "model.json"
Task = Literal["segmentation", "points", "depth", "pose", "mesh"]

# What `config.json` of a transformers folder calls itself, and what it is used for here.
FAMILIES: dict[str, Task] = {
    "sam2_video": "segmentation",
    "sam3_video": "segmentation",
    "sam3_tracker_video": "segmentation",
    "depth_anything": "depth",
    "depth_pro": "depth",
}
GIVES: dict[Task, str] = {
    "segmentation": "masks of prompted objects through the video",
    "points": "points followed on objects, and from them rotations",
    "depth": "metric depth of every pixel, with depth_pro the focal length, and from them a camera over the floor",
    "pose": "position and orientation of objects of known shape",
    "mesh": "a triangle mesh of each object",
}
PROGRAM_TASKS: dict[Task, str] = {"points": "program", "pose": "command", "mesh": "command"}
_LICENCE = re.compile(r"^licen[sc]e\s*:\s*(.+?)\s*$", re.MULTILINE)


class ModelError(ValueError):
    """A model that cannot be used as asked; the message says what to install, or where to put what."""


@dataclass(frozen=True)
class ModelFolder:
    """A folder with a model.

    family: a transformers model type, "program" (an exported PyTorch program) or "command" (a program of its own).
    licence: as its card, manifest, config or licence file states it, else "unknown". size: of all files [bytes].
    """

    name: str
    path: Path
    task: Task
    family: str
    licence: str
    size: int

    def sha256(self) -> str:
        """Hash of the names and contents of all files."""
        files = sorted(p for p in self.path.rglob("*") if p.is_file())
        return _hashed(self.path, tuple((str(p), p.stat().st_size, p.stat().st_mtime_ns) for p in files))

    def manifest(self) -> dict[str, Any]:
        """Read `model.json`; empty for a transformers folder."""
        file = self.path / MANIFEST
        return read_json(file) if file.is_file() else {}

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values for whoever chooses a model."""
        return {
            "model": self.name,
            "task": self.task,
            "gives": GIVES[self.task],
            "family": self.family,
            "licence": self.licence,
            "megabytes": round(self.size / 1e6, 1),
        }


@lru_cache(maxsize=32)
def _hashed(path: Path, files: tuple[tuple[str, int, int], ...]) -> str:
    del files  # only there so that changed files are read again
    return path_hash(path)


def models_folder() -> Path:
    """Return where models are looked for: the variable ATW_MODELS, else `models` in the user's data folder."""
    said = os.environ.get(FOLDER)
    if said:
        return Path(said).expanduser().absolute()
    return Path(platformdirs.user_data_dir("atw-mcp", appauthor=False)) / "models"


def how_to_add() -> str:
    """Say where to put which models, for messages."""
    return (
        f"put one folder a model under {models_folder()} (or set {FOLDER}): a transformers model with config.json and "
        f"its weights ({', '.join(FAMILIES)}), or a folder with {MANIFEST} for {', '.join(PROGRAM_TASKS)}. Nothing is "
        "downloaded"
    )


def available() -> tuple[tuple[ModelFolder, ...], tuple[str, ...]]:
    """Return the models there are, by name, and why other folders beside them are none."""
    root = models_folder()
    found, refused = [], []
    for folder in sorted(p for p in root.iterdir() if p.is_dir()) if root.is_dir() else []:
        try:
            found.append(open_folder(folder))
        except ModelError as error:
            refused.append(str(error))
    return tuple(found), tuple(refused)


def find_model(name: str) -> ModelFolder:
    """Return the model of a name; raises ModelError naming those there are."""
    found, refused = available()
    for model in found:
        if model.name == name:
            return model
    listed = f"models: {[m.name for m in found]}" if found else "there is none"
    more = f"; not usable: {'; '.join(refused)}" if refused else ""
    raise ModelError(f"no model {name!r}; {listed}{more}. To add one, {how_to_add()}")


def open_folder(path: Path) -> ModelFolder:
    """Open a folder's model; raises ModelError where it is no model that can be used here."""
    if not path.is_dir():
        raise ModelError(f"no folder {path}: {how_to_add()}")
    task, family = _kind(path)
    files = [p for p in path.rglob("*") if p.is_file()]
    return ModelFolder(path.name, path, task, family, licence_of(path), sum(p.stat().st_size for p in files))


def _kind(path: Path) -> tuple[Task, str]:
    if (path / MANIFEST).is_file():
        said = read_json(path / MANIFEST).get("task")
        for task, family in PROGRAM_TASKS.items():
            if said == task:
                return task, family
        raise ModelError(f"{path.name}: {MANIFEST} has task {said!r}; tasks: {list(PROGRAM_TASKS)}")
    if not (path / "config.json").is_file():
        raise ModelError(f"{path.name}: neither config.json nor {MANIFEST} in it")
    config = read_json(path / "config.json")
    family = str(config.get("model_type"))
    if family not in FAMILIES:
        raise ModelError(f"{path.name}: models of type {family!r} are not used here; types: {list(FAMILIES)}")
    if family == "depth_anything" and config.get("depth_estimation_type", "relative") != "metric":
        raise ModelError(
            f"{path.name}: this Depth Anything gives depth up to an unknown scale and shift; take a metric one "
            "(depth_estimation_type metric in config.json)"
        )
    if not [p for p in path.iterdir() if p.suffix in (".safetensors", ".bin")]:
        raise ModelError(f"{path.name}: no weights in it: model.safetensors belongs beside config.json")
    return FAMILIES[family], family


def licence_of(path: Path) -> str:
    """Return the licence that a model's folder states: its manifest, card, config or licence file; else "unknown"."""
    for name in (MANIFEST, "config.json"):
        if (path / name).is_file():
            record = read_json(path / name)
            said = record.get("license") or record.get("licence")
            if isinstance(said, str) and said.strip():
                return said.strip()
    card = path / "README.md"
    if card.is_file():
        text = card.read_text(encoding="utf-8", errors="replace")
        head = text.split("---", 2)[1] if text.startswith("---") and text.count("---") >= 2 else ""
        if stated := _LICENCE.search(head):
            return stated.group(1).strip("'\"")
    for file in sorted(path.glob("LICEN[SC]E*")):
        lines = [line.strip() for line in file.read_text(encoding="utf-8", errors="replace").splitlines()]
        if first := next((line for line in lines if line), None):
            return f"{first[:80]} ({file.name})"
    return "unknown"


def read_json(file: Path) -> dict[str, Any]:
    """Return the object in a JSON file; raises ModelError with what is wrong with it."""
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ModelError(f"{file}: not JSON that can be read: {error}") from error
    if not isinstance(record, dict):
        raise ModelError(f"{file}: must hold an object, got {type(record).__name__}")
    return record
