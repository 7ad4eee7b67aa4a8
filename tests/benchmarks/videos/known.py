"""Observations of rendered clips of which a user's knowledge is given: bodies, their colours and sizes, the camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from atw_mcp.observation.matching import Known
from atw_mcp.perception.calibration import calibrate_from_points
from atw_mcp.perception.known_bodies import observe_known
from atw_mcp.perception.known_scene import KnownScene
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import load
from atw_mcp.tools.known_objects import bodies_of, corners_of
from atw_mcp.tools.world_arguments import ObstacleArgument, ShapeArgument
from tests.benchmarks.videos.seeds import Labels

DEFORMABLE = ("rope", "cloth")


def shape_of(thing: dict[str, Any]) -> dict[str, Any]:
    """Return a thing's shape as the tools take it."""
    if thing["shape"] == "sphere":
        return {"kind": "sphere", "radius": thing["diameter"] / 2}
    if thing["shape"] == "cylinder":
        return {"kind": "cylinder", "radius": thing["diameter"] / 2, "half_height": thing["length"] / 2}
    return {"kind": "box", "half_extents": [c / 2 for c in thing["size"]]}


def obstacles_of(known: dict[str, Any]) -> list[dict[str, Any]]:
    """Fixed things of a scene, of which `known` is what a user knows, as obstacles of BuildWorld."""
    obstacles = []
    for thing in known["objects"]:
        if thing.get("fixed"):
            turn = {"orientation": thing["rotation_wxyz"]} if "rotation_wxyz" in thing else {}
            place = {"name": thing["name"].replace(" ", "_"), "shape": shape_of(thing), "position": thing["position"]}
            obstacles.append({**place, **turn})
    return obstacles


def observe_as_known(file: Path, _labels: Labels, _bodies: list[str]) -> ImageObservation:
    """Observe a clip with what known.json beside it says."""
    known = json.loads((file.parent / "known.json").read_text())
    points = known["camera_points"]["points"]
    places = np.array([p["position"] for p in points])
    width, height = known["frame_size"]
    camera = calibrate_from_points(places, np.array([p["pixel"] for p in points]), (width, height)).camera
    things = []
    for thing in known["objects"]:
        if thing.get("fixed") or thing["shape"] in DEFORMABLE:
            continue
        shape = ShapeArgument.model_validate(shape_of(thing)).to_shape(_no_meshes)
        said = thing.get("pointed_at")
        pixel, frame = (None, None) if said is None else ((said["pixel"][0], said["pixel"][1]), said["frame"])
        things.append(Known(thing["name"], shape, thing["color"], pixel=pixel, frame=frame))
    if not things:
        info, frames = load(file)
        return ImageObservation(info, tuple(range(len(frames))), ())  # cloth and rope are not looked for
    obstacles = [ObstacleArgument.model_validate(item) for item in obstacles_of(known)]
    fixtures = corners_of([static for item in obstacles for static in item.to_statics(_no_meshes)])
    bodies, solids = bodies_of(things)
    return observe_known(file, bodies, KnownScene(camera, solids=solids, fixtures=fixtures))


def _no_meshes(name: str) -> tuple[np.ndarray, np.ndarray]:
    raise KeyError(name)
