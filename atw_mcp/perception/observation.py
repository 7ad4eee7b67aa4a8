"""Observation of a video: every object's mask, place, status and confidence in every frame."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any, Literal, Self

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception import constraints as said
from atw_mcp.perception.camera_motion import filmed, steadied
from atw_mcp.perception.constraints import Constraint
from atw_mcp.perception.known_scene import KnownScene
from atw_mcp.perception.masks import Mask, RunLengthMask
from atw_mcp.perception.places import Places
from atw_mcp.perception.video import VideoInfo
from polyworld.world.camera import Camera

Floats = NDArray[np.float64]
Status = Literal["visible", "occluded", "truncated", "hidden", "absent"]


class ObservationError(ValueError):
    """A question to an observation, or a correction of it, that cannot be met; the message names the valid choices."""


@dataclass(frozen=True)
class Cue:
    """A reading of an object's look: its name, how sure (0..1), and the measured numbers behind it."""

    name: str
    confidence: float
    measured: dict[str, float]


@dataclass(frozen=True)
class ObservedObject:
    """One object through T frames.

    colour, material, shape: cues (colour's measured r, g, b are 0..255). status (T,): visible; occluded, partly
    behind another object; truncated by the image border; hidden behind another object; absent. confidence (T,)
    in 0..1, 0 where nothing of it is seen. centroid (T, 2) x, y and box (T, 4) left, top, width, height [px],
    NaN where not seen; area (T,) [px]. masks (T,), None where not seen. entry_frame, exit_frame: first and last
    frame in which it is seen; enters, exits: whether it comes in or leaves through the image border. places: in the
    world, of a solid of known shape.
    """

    name: str
    colour: Cue
    material: Cue
    shape: Cue
    status: tuple[Status, ...]
    confidence: Floats
    centroid: Floats
    box: Floats
    area: NDArray[np.int64]
    masks: tuple[RunLengthMask | None, ...]
    entry_frame: int
    exit_frame: int
    enters: bool
    exits: bool
    places: Places | None = None

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values; places and areas follow from the masks and are not repeated."""
        return {
            "name": self.name,
            "colour": asdict(self.colour),
            "material": asdict(self.material),
            "shape": asdict(self.shape),
            "status": _runs(self.status),
            "confidence": [round(float(c), 4) for c in self.confidence],
            "masks": [None if m is None else m.to_dict()["counts"] for m in self.masks],
            "entry_frame": self.entry_frame,
            "exit_frame": self.exit_frame,
            "enters": self.enters,
            "exits": self.exits,
            **({} if self.places is None else {"places": self.places.to_dict()}),
        }

    @classmethod
    def from_dict(cls, data: dict[str, Any], height: int, width: int) -> Self:
        """Return the inverse of `to_dict` for an image of the given size."""
        masks = tuple(
            None if m is None else RunLengthMask.from_dict({"size": [height, width], "counts": m})
            for m in data["masks"]
        )
        centroid, box, area = measure(masks)
        status: tuple[Status, ...] = tuple(s for s, count in data["status"] for _ in range(count))
        return cls(
            name=data["name"],
            colour=Cue(**data["colour"]),
            material=Cue(**data["material"]),
            shape=Cue(**data["shape"]),
            status=status,
            confidence=np.asarray(data["confidence"], dtype=float),
            centroid=centroid,
            box=box,
            area=area,
            masks=masks,
            entry_frame=int(data["entry_frame"]),
            exit_frame=int(data["exit_frame"]),
            enters=bool(data["enters"]),
            exits=bool(data["exits"]),
            places=Places.from_dict(data["places"]) if "places" in data else None,
        )

    def summary(self) -> dict[str, Any]:
        """Return the object in a few JSON-ready values, without masks and series."""
        counts = {s: self.status.count(s) for s in ("visible", "occluded", "truncated", "hidden", "absent")}
        seen = self.confidence > 0
        return {
            "name": self.name,
            "colour": self.colour.name,
            "material": self.material.name,
            "shape": self.shape.name,
            "cue_confidence": {
                "colour": round(self.colour.confidence, 3),
                "material": round(self.material.confidence, 3),
                "shape": round(self.shape.confidence, 3),
            },
            "rgb": [round(self.colour.measured.get(k, 0.0)) for k in ("r", "g", "b")],
            "entry_frame": self.entry_frame,
            "exit_frame": self.exit_frame,
            "enters": self.enters,
            "exits": self.exits,
            "frames": {k: v for k, v in counts.items() if v},
            "mean_confidence": round(float(self.confidence[seen].mean()), 3) if seen.any() else 0.0,
        }


@dataclass(frozen=True)
class ImageObservation:
    """Everything seen in a video, in pixels.

    Row i of every series is frame `frames[i]` of the file (equal to i unless frames were skipped). constraints: what
    was said of it by whoever looked; scene: what was known of the scene, with which bodies were followed; notes: where
    they are unsure. camera_motion (T, 2, 3): maps from pixels of the first frame to those of each frame, None where the
    camera stands still.
    """

    video: VideoInfo
    frames: tuple[int, ...]
    objects: tuple[ObservedObject, ...]
    warnings: tuple[str, ...] = ()
    constraints: tuple[Constraint, ...] = ()
    scene: KnownScene | None = None
    notes: tuple[str, ...] = ()
    camera_motion: Floats | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the objects."""
        return tuple(o.name for o in self.objects)

    def object(self, name: str) -> ObservedObject:
        """Return the object called `name`; raises ObservationError naming the valid choices."""
        for candidate in self.objects:
            if candidate.name == name:
                return candidate
        raise ObservationError(f"unknown object {name!r}; objects: {list(self.names)}")

    def row(self, frame: int) -> int:
        """Row of a frame number of the file; raises ObservationError naming the valid range."""
        try:
            return self.frames.index(frame)
        except ValueError:
            step = "" if len(self.frames) < 2 or self.frames[1] == 1 + self.frames[0] else ", not all of them"
            raise ObservationError(
                f"frame {frame} was not observed; frames {self.frames[0]}..{self.frames[-1]}{step}"
            ) from None

    def mask(self, name: str, frame: int) -> Mask:
        """Mask (height, width) of an object at a frame; empty where it is not seen."""
        stored = self.object(name).masks[self.row(frame)]
        return np.zeros((self.video.height, self.video.width), dtype=bool) if stored is None else stored.decode()

    def steadied(self, points: Floats, row: int) -> Floats:
        """Return points (..., 2) [px] of a row's frame as the first frame's camera would have seen them."""
        return steadied(points, self.camera_motion, row)

    def filmed(self, points: Floats, row: int) -> Floats:
        """Return the inverse of `steadied`."""
        return filmed(points, self.camera_motion, row)

    def contours(self, name: str, frame: int) -> list[Floats]:
        """Outer outlines (k, 2) x, y [px] of an object's parts at a frame, largest first."""
        found, _ = cv2.findContours(self.mask(name, frame).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        return [c[:, 0, :].astype(float) for c in sorted(found, key=lambda c: -len(c))]

    def label_image(self, frame: int) -> NDArray[np.uint8]:
        """Image (height, width) of object numbers, from 1 in the order of `names`; 0 where there is none."""
        labels = np.zeros((self.video.height, self.video.width), dtype=np.uint8)
        row = self.row(frame)
        for number, observed in enumerate(self.objects, start=1):
            stored = observed.masks[row]
            if stored is not None:
                labels[stored.decode()] = number
        return labels

    def summary(self) -> dict[str, Any]:
        """JSON-ready overview without masks and series."""
        return {
            "video": self.video.facts(),
            "frames": len(self.frames),
            "objects": [o.summary() for o in self.objects],
            "warnings": [*self.warnings, *self.notes],
        }

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values; `from_dict` reads them back."""
        frames: Any = list(self.frames)
        values: dict[str, Any] = {
            "video": self.video.to_dict(),
            "frames": frames,
            "objects": [o.to_dict() for o in self.objects],
            "warnings": list(self.warnings),
        }
        if self.constraints:
            values["constraints"] = [said.to_dict(c) for c in self.constraints]
            values["notes"] = list(self.notes)
        if self.scene is not None:
            values["scene"] = self.scene.to_dict()
        if self.camera_motion is not None:
            values["camera_motion"] = np.round(self.camera_motion, 6).tolist()
        return values

    @classmethod
    def from_dict(cls, data: dict[str, Any]) -> Self:
        """Return the inverse of `to_dict`."""
        video = VideoInfo.from_dict(data["video"])
        return cls(
            video=video,
            frames=tuple(int(f) for f in data["frames"]),
            objects=tuple(ObservedObject.from_dict(o, video.height, video.width) for o in data["objects"]),
            warnings=tuple(data["warnings"]),
            constraints=tuple(said.from_dict(c) for c in data.get("constraints", [])),
            scene=KnownScene.from_dict(data["scene"]) if "scene" in data else None,
            notes=tuple(data.get("notes", [])),
            camera_motion=np.array(data["camera_motion"]) if "camera_motion" in data else None,
        )


def check_camera(camera: Camera, video: VideoInfo) -> None:
    """Raise ObservationError for a camera of images of another size."""
    if (camera.width, camera.height) != (video.width, video.height):
        raise ObservationError(
            f"the camera is for images of {camera.width} x {camera.height}, the video has {video.width} x "
            f"{video.height}: calibrate with the video's own size"
        )


def measure(masks: tuple[RunLengthMask | None, ...]) -> tuple[Floats, Floats, NDArray[np.int64]]:
    """Centroids (T, 2), boxes (T, 4), NaN where there is no mask, and areas (T,) of masks [px]."""
    count = len(masks)
    centroid, box = np.full((count, 2), np.nan), np.full((count, 4), np.nan)
    area = np.zeros(count, dtype=np.int64)
    for t, stored in enumerate(masks):
        if stored is None or stored.area == 0:
            continue
        y, x = stored.pixels()
        centroid[t] = x.mean(), y.mean()
        box[t] = x.min(), y.min(), x.max() - x.min() + 1, y.max() - y.min() + 1
        area[t] = len(x)
    return centroid, box, area


def _runs(values: tuple[str, ...]) -> list[list[Any]]:
    """Values with the number of times each is repeated in a row."""
    runs: list[list[Any]] = []
    for value in values:
        if runs and runs[-1][0] == value:
            runs[-1][1] += 1
        else:
            runs.append([value, 1])
    return runs
