"""Small manifests: a described world of two discs, whose motion is known, and tracks of a puck that friction stops."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from atw_mcp.batch.manifest import read_manifest
from atw_mcp.batch.run import Batch

DISC = {"kind": "cylinder", "radius": 0.1, "half_height": 0.05}
MEETING = 0.8  # [s]: 1 m between the centres, less two radii, at 1 m/s without friction
FRICTION = 0.1
HIT = {"predicate": "collides", "a": "striker", "b": "target"}
QUICK = {"method": "least_squares"}


def discs(name: str = "discs", **more: Any) -> dict[str, Any]:
    """A described world in which `striker` meets `target` at MEETING, with three questions."""
    still = {"shape": DISC, "friction": 0.0}
    return {
        "id": name,
        "objects": [
            {"name": "striker", "position": [0, 0, 0.05], "velocity": [1, 0, 0], **still},
            {"name": "target", "position": [1, 0, 0.05], **still},
        ],
        "questions": [
            {"id": "hit", "text": "Does it hit?", "predicate": HIT, "horizon_seconds": 1.5},
            {"id": "when", "text": "When?", "predicate": HIT, "aggregation": "first", "horizon_seconds": 1.5},
            {
                "id": "slower",
                "text": "Would it hit in time at half the speed?",
                "predicate": HIT,
                "edits": [{"action": "set_velocity", "object": "striker", "velocity": [0.5, 0, 0]}],
                "horizon_seconds": 1.5,
            },
        ],
        **more,
    }


def puck(folder: Path) -> dict[str, Any]:
    """A case of tracks, written into the folder: a puck that starts at 1 m/s; it slides 0.51 m."""
    times = np.arange(0.0, 0.6, 0.02)
    places = times - 0.5 * FRICTION * 9.81 * times**2
    rows = [f"{t:.4f},puck,{x:.5f},0.0,0.05" for t, x in zip(times, places, strict=True)]
    (folder / "slide.csv").write_text("t,object,x,y,z\n" + "\n".join(rows) + "\n")
    far = {"predicate": "moved_by_more_than", "object": "puck", "distance": 0.45}
    return {
        "id": "slide",
        "tracks": "slide.csv",
        "objects": [{"name": "puck", "shape": DISC}],
        "fit": QUICK,
        "questions": [
            {
                "id": "far",
                "text": "Does it get beyond 0.45 m?",
                "predicate": far,
                "horizon_seconds": 1.5,
                "how_sure": True,
            }
        ],
    }


def write(folder: Path, *entries: dict[str, Any] | str) -> Path:
    """Write a manifest; texts are lines as they are."""
    path = folder / "cases.jsonl"
    path.write_text("".join((e if isinstance(e, str) else json.dumps(e)) + "\n" for e in entries))
    return path


def batch_of(folder: Path, *entries: dict[str, Any], out: str = "results") -> Batch:
    """The batch of a manifest in a folder, whose files may be read; its results go into the folder `out` there."""
    (folder / out).mkdir(exist_ok=True)
    return Batch(read_manifest(write(folder, *entries)), folder / out, (folder,))


def rows(path: Path) -> list[dict[str, Any]]:
    """Rows of a file of JSON lines."""
    return [json.loads(line) for line in path.read_text().splitlines()]
