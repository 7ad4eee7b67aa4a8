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
from atw_mcp.tools.known_objects import bodies_of, corners_of
from atw_mcp.tools.world_arguments import ObstacleArgument, ShapeArgument
from tests.benchmarks.videos.seeds import Labels

DEFORMABLE = ("rope", "cloth")


def obstacles_of(known: dict[str, Any]) -> list[dict[str, Any]]:
    """Fixed boxes of a scene, of which `known` is what a user knows, as obstacles of BuildWorld."""
    obstacles = []
    for thing in known["fixed"]:
        if thing["kind"] == "box":
            half = thing["slope_about_y"] / 2
            turn = {"orientation": [float(np.cos(half)), 0.0, float(np.sin(half)), 0.0]}
            shape = {"kind": "box", "half_extents": thing["half_extents"]}
            obstacles.append({"name": thing["name"], "shape": shape, "position": thing["position"], **turn})
    return obstacles


def observe_as_known(file: Path, _labels: Labels, _bodies: list[str]) -> ImageObservation:
    """Observe a clip with what scene.json beside it says is known."""
    known = json.loads((file.parent / "scene.json").read_text())["known"]
    points = known["calibration"]
    places = np.array([p["world"] for p in points])
    pixels = np.array([p["pixel"] for p in points]) - 0.5  # here the centre of the first pixel is (0, 0)
    width, height = known["picture_size"]
    camera = calibrate_from_points(places, pixels, (width, height)).camera
    things = [
        Known(o["name"], ShapeArgument.model_validate(o["shape"]).to_shape(_no_meshes), o["color"])
        for o in known["objects"]
    ]
    obstacles = [ObstacleArgument.model_validate(item) for item in obstacles_of(known)]
    fixtures = corners_of([static for item in obstacles for static in item.to_statics(_no_meshes)])
    bodies, solids = bodies_of(things)
    return observe_known(file, bodies, KnownScene(camera, solids=solids, fixtures=fixtures))


def _no_meshes(name: str) -> tuple[np.ndarray, np.ndarray]:
    raise KeyError(name)
