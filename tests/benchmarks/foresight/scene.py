"""A rendered clip as arguments of the tools: what a user knows of it, and its true tracks as a file to import."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.data.tracks import ObservedTracks

Floats = NDArray[np.float64]

NOISE = 0.005  # m, of the positions of true tracks
DEFORMABLE = ("rope", "cloth")


@dataclass(frozen=True)
class Clip:
    """One clip: `known` is what a user knows, `hidden` what only the simulator does."""

    name: str
    folder: Path
    known: dict[str, Any]
    hidden: dict[str, Any]

    @property
    def kind(self) -> str:
        """Kind of motion, as `tests.benchmarks.video_clips.kinds` names it."""
        return str(self.hidden["kind"])

    @property
    def video(self) -> Path | None:
        """The rendered file, None where the clip was drawn without one."""
        path = self.folder / str(self.known["video"])
        return path if path.is_file() else None

    @property
    def bodies(self) -> list[dict[str, Any]]:
        """Rigid things that can move."""
        return [o for o in self.known["objects"] if not o.get("fixed") and o["shape"] not in DEFORMABLE]

    @property
    def end(self) -> float:
        """Time of the last frame [s]."""
        return float((self.hidden["frames"]["count"] - 1) / self.hidden["frames"]["rate"])

    @property
    def inexpressible(self) -> str | None:
        """Why the short path cannot describe the scene, None where it can."""
        soft = [o["shape"] for o in self.known["objects"] if o["shape"] in DEFORMABLE]
        return f"a {soft[0]}: ModelVideo takes rigid objects alone" if soft else None


def read_clips(folder: Path) -> list[Clip]:
    """Return all clips of a folder that `tests.benchmarks.video_clips` wrote, by name."""
    found = []
    for public in sorted((folder / "public").iterdir()):
        known = json.loads((public / "known.json").read_text())
        hidden = json.loads((folder / "private" / f"{public.name}.json").read_text())
        found.append(Clip(public.name, public, known, hidden))
    return found


def shape_of(thing: dict[str, Any]) -> dict[str, Any]:
    """Return a thing's shape as the tools take it."""
    if thing["shape"] == "sphere":
        return {"kind": "sphere", "radius": thing["diameter"] / 2}
    if thing["shape"] == "cylinder":
        return {"kind": "cylinder", "radius": thing["diameter"] / 2, "half_height": thing["length"] / 2}
    return {"kind": "box", "half_extents": [c / 2 for c in thing["size"]]}


def tool_name(name: str) -> str:
    """Return a thing's name in the tools, which take no spaces."""
    return name.replace(" ", "_")


def obstacles_of(known: dict[str, Any]) -> list[dict[str, Any]]:
    """Fixed things of a scene, of which `known` is what a user knows, as obstacles of BuildWorld."""
    obstacles = []
    for thing in known["objects"]:
        if thing.get("fixed"):
            turn = {"orientation": thing["rotation_wxyz"]} if "rotation_wxyz" in thing else {}
            place = {"name": tool_name(thing["name"]), "shape": shape_of(thing), "position": thing["position"]}
            obstacles.append({**place, **turn})
    return obstacles


def surroundings(clip: Clip) -> dict[str, Any]:
    """Fixed things and guides as arguments of BuildWorld."""
    obstacles = obstacles_of(clip.known)
    parts = []
    for body in clip.bodies:
        if "pivot" in body:
            hinge = {"part": "hinge", "name": f"pivot_{body['name']}", "object": body["name"]}
            parts.append({**hinge, "anchor": body["pivot"], "axis": [0.0, -1.0, 0.0]})
        elif "track" in body.get("guided", ""):
            along = {"anchor": [0.0, 0.0, body["size"][2]], "axis": [1.0, 0.0, 0.0]}
            parts.append({"part": "slider", "name": f"track_{body['name']}", "object": body["name"], **along})
    return {**({"obstacles": obstacles} if obstacles else {}), **({"parts": parts} if parts else {})}


def radius_of_gyration(thing: dict[str, Any]) -> float:
    """Return the root mean square distance of a thing's substance from its centre over an axis, about [m]."""
    size = thing.get("size") or [thing["diameter"], thing["diameter"], thing.get("length", thing["diameter"])]
    return float(np.linalg.norm(size) / np.sqrt(18.0))


def reach(thing: dict[str, Any]) -> float:
    """Half the first side or the diameter of a thing [m], whose speed by rotation the simulator's rest is judged on."""
    return float(thing["size"][0] if "size" in thing else thing["diameter"]) / 2


def true_tracks(clip: Clip, rng: np.random.Generator, noise: float = NOISE) -> ObservedTracks:
    """Tracks of the bodies where the clip shows them: true centres with noise [m], and how boxes and cylinders lie.

    What cannot be seen is left out: how balls are turned, and that of cylinders about their axis. Angles carry the
    noise over the radius of gyration.
    """
    frames, bodies = clip.hidden["frames"], clip.bodies
    poses = np.array([frames["poses"][b["name"]] for b in bodies]).swapaxes(0, 1)
    shown = np.zeros(poses.shape[:2], dtype=bool)
    for k, body in enumerate(bodies):
        for first, last in clip.hidden["visible_frames"][body["name"]]:
            shown[first : last + 1, k] = True
    positions = poses[..., :3] + rng.normal(0.0, noise, (*poses.shape[:2], 3))
    orientations = np.full((*poses.shape[:2], 4), np.nan)
    for k, body in enumerate(bodies):
        if body["shape"] != "sphere":
            angles = rng.normal(0.0, noise / radius_of_gyration(body), (len(poses), 3))
            orientations[:, k] = _turned(poses[:, k, 3:], angles)
    seen = shown.astype(float)
    return ObservedTracks(
        names=tuple(b["name"] for b in bodies),
        frames=np.arange(len(poses)),
        seconds_per_frame=1.0 / frames["rate"],
        positions=np.where(shown[..., None], positions, np.nan),
        position_sigma=np.where(shown, noise, np.nan),
        orientations=np.where(shown[..., None], orientations, np.nan),
        confidence=seen,
        orientation_confidence=np.where(np.isfinite(orientations).all(axis=2), seen, 0.0),
        symmetry=tuple(2 if b["shape"] == "box" else 0 for b in bodies),
    )


def _turned(quaternions: Floats, angles: Floats) -> Floats:
    """Quaternions (T, 4) turned by small rotation vectors (T, 3) about world axes."""
    w, x, y, z = quaternions.T
    a, b, c = angles.T / 2
    turned = np.stack([w - a * x - b * y - c * z, x + a * w + b * z - c * y, y + b * w + c * x - a * z,
                       z + c * w + a * y - b * x], axis=1)  # fmt: skip
    unit: Floats = turned / np.linalg.norm(turned, axis=1, keepdims=True)
    return unit


def video_arguments(clip: Clip) -> dict[str, Any]:
    """Arguments of ModelVideo: objects with shapes, colours and where they were pointed at, points, time, fixtures."""
    objects = []
    for body in clip.bodies:
        pointed = body.get("pointed_at")
        hint = {} if pointed is None else {"pixel": pointed["pixel"], "frame": pointed["frame"]}
        objects.append({"name": body["name"], "shape": shape_of(body), "color": body["color"], **hint})
    points = [{"world": p["position"], "pixel": p["pixel"]} for p in clip.known["camera_points"]["points"]]
    return {
        "video": str(clip.video),
        "seconds_per_frame": clip.known["seconds_per_frame"],
        "objects": objects,
        "points": points,
        **({"build": around} if (around := surroundings(clip)) else {}),
    }
