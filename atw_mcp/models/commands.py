"""Models that are programs of their own: a folder of inputs goes in, a folder of results comes out.

Pose estimators such as FoundationPose and image-to-mesh models such as SAM 3D cannot be exported as one PyTorch
program: they rasterise, search and use kernels compiled for a CUDA version of their own. So each stays in its own
environment and is called as a command. A model's folder holds its weights and

    model.json  {"task": "pose" or "mesh", "command": ["path/to/python", "run.py"], "license": "...",
                 "timeout_seconds": 3600}

The command runs in that folder with two more arguments, INPUT and OUTPUT, both folders. It must end with 0. INPUT holds

    request.json               task, device, batch, memory_gb (or null), width, height, seconds_per_frame,
                               frames [numbers], intrinsics (3 x 3, or null), objects [names];
                               mesh also: best_frames {name: number}, the frame that shows an object best
    frames/000012.png          frames by number
    masks/NAME/000012.png      255 where the object is seen
    meshes/NAME.ply            pose only: its shape in metres, about its body origin

What OUTPUT must hold is said in `pose.py` and `mesh.py`. Only whoever runs the server can add such a folder: an agent
names a model, never a command.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh

from atw_mcp.models.folders import MANIFEST, ModelError, ModelFolder
from atw_mcp.models.running import Limits
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress

TIMEOUT = 3600.0  # [s] where the manifest states none
POLL = 0.1  # [s]
QUOTED = 600  # characters of a failed command's last words in the message


@dataclass(frozen=True)
class Request:
    """Request to a command: frames (T, H, W, 3) of `observation`, its objects by name, meshes by name."""

    observation: ImageObservation
    frames: Frames
    objects: Sequence[str]
    seconds_per_frame: float
    intrinsics: list[list[float]] | None = None
    meshes: dict[str, trimesh.Trimesh] = field(default_factory=dict)
    more: dict[str, Any] = field(default_factory=dict)


@contextmanager
def outcome_of(
    model: ModelFolder,
    request: Request,
    limits: Limits,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> Iterator[Path]:
    """Run a model's command; the folder of its results is there within the context. Raises ModelError."""
    manifest = model.manifest()
    command = manifest.get("command")
    if not isinstance(command, list) or not command or not all(isinstance(part, str) for part in command):
        raise ModelError(f"{model.name}: {MANIFEST} needs command, a list of texts, got {command!r}")
    timeout = float(manifest.get("timeout_seconds", TIMEOUT))
    with tempfile.TemporaryDirectory(prefix="atw-model-") as made:
        source, target = Path(made) / "input", Path(made) / "output"
        target.mkdir()
        _write(source, model, request, limits)
        _run(model, [*command, str(source), str(target)], timeout, progress, cancelled)
        yield target


def read_outcome(folder: Path, name: str, model: ModelFolder) -> dict[str, Any]:
    """Return the entries by object of a JSON file a command wrote; raises ModelError where it does not hold them."""
    file = folder / name
    if not file.is_file():
        raise ModelError(f"{model.name} wrote no {name}; it wrote {sorted(p.name for p in folder.iterdir())}")
    try:
        record = json.loads(file.read_text(encoding="utf-8"))
    except (UnicodeDecodeError, json.JSONDecodeError) as error:
        raise ModelError(f"{model.name}: {name} is not JSON: {error}") from error
    found = record.get("objects") if isinstance(record, dict) else None
    if not isinstance(found, dict):
        raise ModelError(f'{model.name}: {name} must be {{"objects": {{NAME: ...}}}}')
    return found


def _write(folder: Path, model: ModelFolder, request: Request, limits: Limits) -> None:
    seen = request.observation
    (folder / "frames").mkdir(parents=True)
    for number, frame in zip(seen.frames, request.frames, strict=True):
        cv2.imwrite(str(folder / "frames" / f"{number:06d}.png"), frame)
    for name in request.objects:
        own = folder / "masks" / name
        own.mkdir(parents=True)
        for number, stored in zip(seen.frames, seen.object(name).masks, strict=True):
            if stored is not None:
                cv2.imwrite(str(own / f"{number:06d}.png"), np.where(stored.decode(), 255, 0).astype(np.uint8))
    if request.meshes:
        (folder / "meshes").mkdir()
    for name, mesh in request.meshes.items():
        mesh.export(folder / "meshes" / f"{name}.ply")
    document = {
        "task": model.task,
        "device": limits.device,
        "batch": limits.batch,
        "memory_gb": limits.memory_gb,
        "width": seen.video.width,
        "height": seen.video.height,
        "seconds_per_frame": request.seconds_per_frame,
        "frames": list(seen.frames),
        "intrinsics": request.intrinsics,
        "objects": list(request.objects),
        **request.more,
    }
    (folder / "request.json").write_text(json.dumps(document), encoding="utf-8")


def _run(
    model: ModelFolder, command: list[str], timeout: float, progress: Progress | None, cancelled: Cancelled | None
) -> None:
    begin = time.monotonic()
    with tempfile.TemporaryFile() as words:
        try:
            process = subprocess.Popen(
                command,
                cwd=model.path,
                stdin=subprocess.DEVNULL,
                stdout=words,  # the server's own stdout is the wire
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        except OSError as error:
            raise ModelError(f"{model.name}: its command {command[0]!r} cannot be started: {error}") from error
        try:
            while process.poll() is None:
                spent = time.monotonic() - begin
                if cancelled is not None and cancelled():
                    raise PerceptionCancelled("cancelled")
                if spent > timeout:
                    raise ModelError(f"{model.name}: its command took longer than {timeout:g} s")
                if progress is not None:
                    progress(min(spent / timeout, 0.99), f"{model.name} runs")
                time.sleep(POLL)
        finally:
            if process.poll() is None:
                _stop(process)
        if process.returncode != 0:
            words.seek(0)
            last = words.read().decode("utf-8", "replace").strip()[-QUOTED:]
            raise ModelError(f"{model.name}: its command ended with {process.returncode}: {last or 'it said nothing'}")


def _stop(process: subprocess.Popen[bytes]) -> None:
    """End a command with everything it started."""
    if os.name == "posix":
        os.killpg(process.pid, signal.SIGKILL)
    else:
        process.kill()
    process.wait()
