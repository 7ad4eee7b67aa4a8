"""Observations of rendered clips of which a user's knowledge is given: bodies, their colours and sizes, the camera."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from atw_mcp.matching import apparent_radius
from atw_mcp.perception.calibration import calibrate_from_points
from atw_mcp.perception.known.bodies import KnownBody
from atw_mcp.perception.known.observe import observe_known
from atw_mcp.perception.observation import ImageObservation
from polyworld.shapes import BodyShape, Box, Cylinder, Sphere
from tests.benchmarks.video_seeds import Labels


def shape_of(thing: dict[str, Any]) -> BodyShape | None:
    """Return the shape of a thing in known.json, None for what is no rigid body."""
    if thing["shape"] == "sphere":
        return Sphere(radius=thing["diameter"] / 2)
    if thing["shape"] == "cylinder":
        return Cylinder(radius=thing["diameter"] / 2, half_height=thing["length"] / 2)
    if thing["shape"] == "box":
        a, b, c = (edge / 2 for edge in thing["size"])
        return Box(half_extents=(a, b, c))
    return None


def observe_as_known(file: Path, _labels: Labels, _bodies: list[str]) -> ImageObservation:
    """Observe a clip with what known.json beside it says."""
    known = json.loads((file.parent / "known.json").read_text())
    points = known["camera_points"]["points"]
    places = np.array([p["position"] for p in points])
    width, height = known["frame_size"]
    camera = calibrate_from_points(places, np.array([p["pixel"] for p in points]), (width, height)).camera
    elevation = float(np.arcsin(np.clip(-np.asarray(camera.rotation)[2, 2], -1.0, 1.0)))
    bodies = []
    for thing in known["objects"]:
        shape = shape_of(thing)
        if thing.get("fixed") or shape is None:
            continue
        said = thing.get("pointed_at")
        pixels = () if said is None else ((said["frame"], *(float(v) for v in said["pixel"])),)
        lift = shape.half_extents[2] if isinstance(shape, Box) else 0.0
        lift = shape.half_height if isinstance(shape, Cylinder) else lift
        lift = shape.radius if isinstance(shape, Sphere) else lift
        bodies.append(KnownBody(thing["name"], thing["color"], apparent_radius(shape, elevation), lift, pixels))
    return observe_known(file, bodies, camera, places)
