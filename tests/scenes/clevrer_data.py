"""CLEVRER scenes as this project's words: annotated tracks, annotated collisions, and a planar world.

What is known beforehand of every CLEVRER scene: the shapes and their size (half edge, radius and half height
0.2 m), the ground plane, and the time of 0.028 s between frames. Everything else is read from the tracks.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from polyworld.data.initial_states import with_initial_states
from polyworld.data.tracks import ObservedTracks
from polyworld.world import Effect, TimeBase, World
from polyworld.world.description import Appearance
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder, Sphere

SECONDS_PER_FRAME = 0.028
HALF_SIZE = 0.2
# Four steps a frame: contacts are found between steps, so that finer ones change the path by millimetres.
SUBSTEP = SECONDS_PER_FRAME / 4
SHAPES: dict[str, Box | Cylinder | Sphere] = {
    "cube": Box(half_extents=(HALF_SIZE,) * 3),
    "cylinder": Cylinder(radius=HALF_SIZE, half_height=HALF_SIZE),
    "sphere": Sphere(radius=HALF_SIZE),
}
# An annotation follows every turn of a cube; of round objects no rotation about the vertical is compared.
SYMMETRY = {"cube": 1, "cylinder": 0, "sphere": 0}


@dataclass(frozen=True)
class Collision:
    """An annotated collision: names in alphabetical order and the frame it is noted at."""

    pair: tuple[str, str]
    frame: int


@dataclass(frozen=True)
class Scene:
    """One annotated scene. visible (T, n): inside the camera's view. kinds: name -> colour, material, shape."""

    number: str
    tracks: ObservedTracks
    visible: NDArray[np.bool_]
    kinds: dict[str, tuple[str, str, str]]
    collisions: tuple[Collision, ...]
    video: Path | None


def default_folder() -> Path:
    """`../shared/data/clevrer` beside the repository."""
    return Path(__file__).resolve().parents[2].parent / "shared" / "data" / "clevrer"


def available_scenes(folder: Path) -> list[str]:
    """Numbers of the scenes of which the folder holds annotations."""
    return sorted(p.stem.removeprefix("annotation_") for p in folder.glob("annotation_*.json"))


def read_scene(folder: Path, number: str) -> Scene:
    """Read an annotation file; raises FileNotFoundError naming the scenes that are there."""
    path = folder / f"annotation_{number}.json"
    if not path.exists():
        raise FileNotFoundError(f"no {path.name} in {folder}; scenes there: {available_scenes(folder)}")
    data = json.loads(path.read_text())
    properties = sorted(data["object_property"], key=lambda item: item["object_id"])
    names = tuple(f"{o['color']}_{o['material']}_{o['shape']}" for o in properties)
    frames = sorted(data["motion_trajectory"], key=lambda item: item["frame_id"])
    rows = [{o["object_id"]: o for o in f["objects"]} for f in frames]
    by_id = {o["object_id"]: name for o, name in zip(properties, names, strict=True)}

    def column(key: str) -> Any:
        return np.array([[row[o["object_id"]][key] for o in properties] for row in rows])

    positions = column("location").astype(float)
    angles = column("orientation").astype(float)
    shape = positions.shape[:2]
    quaternions = Rotation.from_euler("xyz", angles.reshape(-1, 3)).as_quat(scalar_first=True).reshape(*shape, 4)
    turning = np.array([SYMMETRY[o["shape"]] != 0 for o in properties])
    video = folder / f"video_{number}.mp4"
    return Scene(
        number=number,
        tracks=ObservedTracks(
            names=names,
            frames=np.array([f["frame_id"] for f in frames], dtype=np.int64),
            seconds_per_frame=SECONDS_PER_FRAME,
            positions=positions,
            position_sigma=np.full(shape, 1e-4),
            orientations=quaternions,
            confidence=np.ones(shape),
            orientation_confidence=np.broadcast_to(turning.astype(float), shape).copy(),
            symmetry=tuple(SYMMETRY[o["shape"]] for o in properties),
        ),
        visible=column("inside_camera_view").astype(bool),
        kinds={n: (o["color"], o["material"], o["shape"]) for n, o in zip(names, properties, strict=True)},
        collisions=tuple(
            Collision((first, second), int(c["frame_id"]))
            for c in data["collision"]
            for first, second in [sorted(by_id[i] for i in c["object_ids"])]
        ),
        video=video if video.exists() else None,
    )


def default_world(tracks: ObservedTracks, kinds: dict[str, tuple[str, str, str]], *, air: bool = True) -> World:
    """A planar world of the tracked objects with default parameters and initial states read from the tracks.

    Balls roll: on the plane they are given no sliding friction. air: a quadratic drag that acts on everything,
    its coefficient 0 until fitted.
    """
    objects = tuple(
        RigidObject(
            name=name,
            representation="rigid_planar",
            shape=SHAPES[shape],
            appearance=Appearance(color=color, material=material),
            mass=1.0,
            friction=0.0 if shape == "sphere" else 0.5,
            position=(0.0, 0.0, HALF_SIZE),
        )
        for name, (color, material, shape) in kinds.items()
        if name in tracks.names
    )
    world = World(
        objects=objects,
        effects=(Effect(name="air", kind="quadratic_damping", parameters={"rate": 0.0}),) if air else (),
        time=TimeBase(seconds_per_frame=SECONDS_PER_FRAME, frame_count=len(tracks.frames), substep=SUBSTEP),
    )
    return with_initial_states(world, tracks)
