"""Masks, depth, cameras and meshes made by other programs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import trimesh
from numpy.typing import NDArray
from pydantic import ValidationError

from atw_mcp.perception.calibration import CalibrationError, calibrate_from_homography
from atw_mcp.perception.describing import describe
from atw_mcp.perception.import_files import ImportDataError, read_arrays, read_json
from atw_mcp.perception.masks import Mask, MaskError, RunLengthMask
from atw_mcp.perception.naming import slug, unique
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import Frames, existing_file, load
from polyworld.world.camera import Camera

Floats = NDArray[np.float64]
LARGEST_DEPTH_BYTES = LARGEST_MASK_BYTES = 1_500_000_000  # as much as a video may have decoded
MOST_PIXELS = 8192 * 8192  # of an image
MESH_FORMATS = ("obj", "stl", "ply", "glb")


def import_masks(path: str | Path, video_path: str | Path) -> ImageObservation:
    """Return an observation of a video from masks that another program made.

    A folder of PNGs: one label image a frame (0 is background, each other value an object), or one folder an
    object with a mask a frame; files are numbered by the last number in their names. A JSON file: a list of
    {"frame", "object", "segmentation": {"size", "counts"}}, counts as a list or as COCO's compressed text, or
    {"objects": {name: [mask or null, ...]}}. Raises ImportDataError, or VideoError for the video.
    """
    info, frames = load(video_path)
    source = Path(path).expanduser()
    if source.is_dir():
        found = _masks_of_folder(source, frames.shape[:3])
    elif source.suffix.lower() == ".json":
        found = _masks_of_json(existing_file(source), frames.shape[:3])
    else:
        raise ImportDataError(f"{source.name}: masks come as a folder of PNGs or as a JSON file of run-length masks")
    if not found:
        raise ImportDataError(f"{source.name}: no mask found")
    return observation_of_masks(found, frames, ImageObservation(info, tuple(range(len(frames))), ()))


def observation_of_masks(masks: dict[str, list[Mask]], frames: Frames, base: ImageObservation) -> ImageObservation:
    """`base` with the objects that masks (name: T masks) describe in place of its own."""
    objects = describe(masks, frames)
    names = unique([slug(name) for name in objects])
    return replace(base, objects=tuple(replace(o, name=n) for n, o in zip(names, objects.values(), strict=True)))


def _masks_of_folder(folder: Path, shape: tuple[int, ...]) -> dict[str, list[Mask]]:
    count, height, width = shape
    parts = sorted(p for p in folder.iterdir() if p.is_dir())
    found: dict[str, list[Mask]] = {}
    if parts:
        for part in parts:
            own = _add_object(found, part.name, shape, folder.name)
            for number, image in _numbered_images(part, count, LARGEST_MASK_BYTES):
                _check_size(image, height, width, part)
                own[number] = (image if image.ndim == 2 else image.max(axis=2)) > 0
        return found
    for number, image in _numbered_images(folder, count, LARGEST_MASK_BYTES):
        _check_size(image, height, width, folder)
        values = _flat_labels(image)
        for value in np.unique(values):
            if value:
                name = f"object_{value}"
                _add_object(found, name, shape, folder.name)[number] = values == value
    return dict(sorted(found.items(), key=lambda item: int(item[0].split("_")[-1])))


def _flat_labels(image: NDArray[Any]) -> NDArray[np.int64]:
    flat: NDArray[np.int64] = image.astype(np.int64)
    if flat.ndim == 3:  # a palette written as colours: each colour is a label
        flat = (flat[..., 2] << 16) | (flat[..., 1] << 8) | flat[..., 0]
    return flat


def _numbered_images(folder: Path, count: int, most: int) -> list[tuple[int, NDArray[Any]]]:
    files = sorted(p for p in folder.iterdir() if p.suffix.lower() == ".png")
    if not files:
        raise ImportDataError(f"{folder.name}: no PNG files in it")
    result, size = [], 0
    for file in files:
        digits = "".join(c if c.isdigit() else " " for c in file.stem).split()
        if not digits:
            raise ImportDataError(f"{file.name}: no frame number in its name")
        number = int(digits[-1])
        if number >= count:
            raise ImportDataError(f"{file.name}: frame {number} is outside the video (0..{count - 1})")
        _check_png(file)
        image = cv2.imread(str(file), cv2.IMREAD_UNCHANGED)
        if image is None:
            raise ImportDataError(f"{file.name}: not a PNG that can be read")
        result.append((number, np.asarray(image)))
        size += image.nbytes
        if size > most:
            raise ImportDataError(f"{folder.name}: more than {most / 1e9:g} GB of images")
    return result


def _check_png(file: Path) -> None:
    """Refuse, by its header, what is no PNG or has more pixels than any video here: a small file may hold gigabytes."""
    with file.open("rb") as content:
        head = content.read(24)
    if len(head) < 24 or head[:8] != b"\x89PNG\r\n\x1a\n":
        raise ImportDataError(f"{file.name}: not a PNG")
    width, height = int.from_bytes(head[16:20], "big"), int.from_bytes(head[20:24], "big")
    if width * height > MOST_PIXELS:
        raise ImportDataError(f"{file.name}: {width} x {height} pixels, more than the limit of {MOST_PIXELS}")


def _add_object(found: dict[str, list[Mask]], name: str, shape: tuple[int, ...], source: str) -> list[Mask]:
    """Return the masks of an object, empty at first; raises ImportDataError for more than memory should hold."""
    if name not in found:
        count, height, width = shape
        if (len(found) + 1) * count * height * width > LARGEST_MASK_BYTES:
            raise ImportDataError(
                f"{source}: masks of more than {len(found)} objects in {count} frames of {width} x {height} pixels are "
                "above the limit of 1.5 GB"
            )
        found[name] = _empty(count, height, width)
    return found[name]


def _masks_of_json(file: Path, shape: tuple[int, ...]) -> dict[str, list[Mask]]:
    count, height, width = shape
    data = read_json(file)
    found: dict[str, list[Mask]] = {}
    try:
        if isinstance(data, dict) and isinstance(data.get("objects"), dict):
            for name, series in data["objects"].items():
                if len(series) > count:
                    raise ImportDataError(f"{file.name}: object {name!r} has {len(series)} masks for {count} frames")
                own = _add_object(found, str(name), shape, file.name)
                for t, record in enumerate(series):
                    if record is not None:
                        own[t] = _decoded(record, height, width, file)
            return found
        records = data.get("annotations") if isinstance(data, dict) else data
        if not isinstance(records, list):
            raise ImportDataError(f'{file.name}: expected a list of masks, or "objects": {{name: [...]}}')
        for k, record in enumerate(records):
            frame = _first(record, ("frame", "frame_id", "image_id"), file, k)
            name = str(_first(record, ("object", "name", "object_id", "track_id", "category_id"), file, k))
            number = int(frame)
            if not 0 <= number < count:
                raise ImportDataError(f"{file.name}: record {k}: frame {number} is outside the video (0..{count - 1})")
            mask = _decoded(_first(record, ("segmentation", "mask", "rle"), file, k), height, width, file)
            _add_object(found, name, shape, file.name)[number] |= mask
    except MaskError as error:
        raise ImportDataError(f"{file.name}: {error}") from error
    return found


def _first(record: Any, keys: Sequence[str], file: Path, number: int) -> Any:
    for key in keys:
        if isinstance(record, dict) and key in record:
            return record[key]
    raise ImportDataError(f"{file.name}: record {number} has none of the keys {list(keys)}")


def _decoded(record: Any, height: int, width: int, file: Path) -> Mask:
    mask = RunLengthMask.from_dict(record)
    if (mask.height, mask.width) != (height, width):
        raise ImportDataError(
            f"{file.name}: masks are {mask.width} x {mask.height}, the video is {width} x {height}: they must agree"
        )
    return mask.decode()


def _empty(count: int, height: int, width: int) -> list[Mask]:
    return [np.zeros((height, width), dtype=bool) for _ in range(count)]


def _check_size(image: NDArray[Any], height: int, width: int, folder: Path) -> None:
    if image.shape[:2] != (height, width):
        raise ImportDataError(
            f"{folder.name}: images are {image.shape[1]} x {image.shape[0]}, the video is {width} x {height}"
        )


@dataclass(frozen=True)
class DepthMaps:
    """Distance along the camera's axis: depth (T, H, W) [m], NaN where unknown, of frames (T,)."""

    depth: NDArray[np.float32]
    frames: tuple[int, ...]


def import_depth(path: str | Path, *, metres_per_unit: float | None = None) -> DepthMaps:
    """Depth maps from an npz file (array depth (T, H, W), optionally frames) or a folder of 16-bit PNGs.

    PNGs hold whole numbers: `metres_per_unit` says what one is (0.001 for millimetres) and is not guessed. In
    both, 0 and non-finite values mean unknown.
    """
    source = Path(path).expanduser()
    if source.is_dir():
        if metres_per_unit is None:
            raise ImportDataError(
                f"{source.name}: say what one unit of the PNGs is with metres_per_unit (millimetres: 0.001)"
            )
        images = _numbered_images(source, 1_000_000, LARGEST_DEPTH_BYTES)
        wrong = [n for n, i in images if i.dtype != np.uint16 or i.ndim != 2]
        if wrong:
            raise ImportDataError(f"{source.name}: depth is in 16-bit PNGs of one channel; not so: frames {wrong[:5]}")
        if len({i.shape for _, i in images}) > 1:
            raise ImportDataError(f"{source.name}: depth images must all have one size")
        images.sort(key=lambda item: item[0])
        depth = np.stack([i for _, i in images]).astype(np.float32) * metres_per_unit
        frames = tuple(n for n, _ in images)
    elif source.suffix.lower() == ".npz":
        file = existing_file(source)
        arrays = read_arrays(file)
        if "depth" not in arrays:
            raise ImportDataError(f"{file.name}: no array depth (T, H, W); it holds {sorted(arrays)}")
        depth = arrays["depth"].astype(np.float32) * (1.0 if metres_per_unit is None else metres_per_unit)
        frames = tuple(int(f) for f in arrays.get("frames", range(len(depth))))
    else:
        raise ImportDataError(f"{source.name}: depth comes as an npz file or a folder of 16-bit PNGs")
    if depth.ndim != 3 or len(frames) != len(depth):
        raise ImportDataError(
            f"{source.name}: depth must have shape (T, H, W) with one frame number each, got {depth.shape}"
        )
    if depth.nbytes > LARGEST_DEPTH_BYTES:
        raise ImportDataError(f"{source.name}: {depth.nbytes / 1e9:.1f} GB of depth is above the limit of 1.5 GB")
    if np.nanmin(depth) < 0:
        raise ImportDataError(f"{source.name}: depth must not be negative")
    return DepthMaps(np.where(np.isfinite(depth) & (depth > 0), depth, np.nan).astype(np.float32), frames)


_CAMERA_KEYS = {"width", "height", "intrinsics", "rotation", "translation", "distortion", "plane", "plane_z"}


def import_camera(path: str | Path, image_size: tuple[int, int] | None = None) -> Camera:
    """Return a camera from JSON: the fields of `Camera`, or a homography {"H": 3 x 3, "plane": "z=..." or "plane_z"}.

    A homography needs the image size (width, height) unless the file gives "width" and "height".
    """
    file = existing_file(path)
    data = read_json(file)
    if not isinstance(data, dict):
        raise ImportDataError(f"{file.name}: a camera is a JSON object, got {type(data).__name__}")
    if "camera" in data and isinstance(data["camera"], dict):
        data = data["camera"]
    if {"intrinsics", "rotation", "translation"} <= data.keys():
        size = image_size or (0, 0)
        fields = {"width": size[0], "height": size[1]} | data
        try:
            return Camera.model_validate(fields)
        except ValidationError as error:
            raise ImportDataError(f"{file.name}: not a valid camera: {_wrong_fields(error)}") from error
    key = next((k for k in ("H", "homography") if k in data), None)
    if key is None:
        raise ImportDataError(
            f"{file.name}: neither a camera (width, height, intrinsics, rotation, translation) nor a homography (H); "
            f"of these keys it has {sorted(_CAMERA_KEYS & data.keys())}"
        )
    size = image_size or (int(data.get("width", 0)), int(data.get("height", 0)))
    if min(size) <= 0:
        raise ImportDataError(f"{file.name}: a homography alone does not say the image size: give (width, height)")
    height_of_plane = data.get("plane_z", _plane_height(data.get("plane")))
    if height_of_plane is None:
        raise ImportDataError(f'{file.name}: say which plane the homography maps: "plane_z": height in metres')
    try:
        return calibrate_from_homography(data[key], size, plane_z=float(height_of_plane)).camera
    except CalibrationError as error:
        raise ImportDataError(f"{file.name}: {error}") from error


def _wrong_fields(error: ValidationError) -> str:
    return "; ".join(f"{'.'.join(map(str, e['loc']))}: {e['msg']}" for e in error.errors(include_input=False))


def _plane_height(text: Any) -> float | None:
    """Return the number after "z=" in a description of a plane."""
    if not isinstance(text, str) or "z=" not in text.replace(" ", ""):
        return None
    digits = text.replace(" ", "").split("z=", 1)[1]
    length = 0
    while length < len(digits) and (digits[length].isdigit() or digits[length] in "+-.e"):
        length += 1
    try:
        return float(digits[:length])
    except ValueError:
        return None


@dataclass(frozen=True)
class ImportedMesh:
    """A triangle mesh: vertices (k, 3), in the file's own unit, and faces (m, 3)."""

    vertices: Floats
    faces: NDArray[np.int64]
    watertight: bool


def import_mesh(path: str | Path, *, scale: float = 1.0) -> ImportedMesh:
    """Vertices (times `scale`, to give metres) and faces of an OBJ, STL, PLY or GLB file, which names no other file."""
    file = existing_file(path)
    kind = file.suffix.lower().removeprefix(".")
    if kind not in MESH_FORMATS:
        raise ImportDataError(f"{file.name}: meshes come as {', '.join(f'.{name}' for name in MESH_FORMATS)} files")
    try:
        with file.open("rb") as content:  # without its folder, so that nothing that it names is read
            mesh = trimesh.load_mesh(content, file_type=kind)
    except Exception as error:  # trimesh raises whatever its parsers do, with parts of the content
        raise ImportDataError(f"{file.name}: not a mesh that can be read as {kind.upper()}") from error
    if isinstance(mesh, trimesh.Scene):
        mesh = mesh.to_geometry()
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise ImportDataError(f"{file.name}: holds no triangles")
    if not np.isfinite(scale) or scale <= 0:
        raise ImportDataError(f"scale must be positive, got {scale}")
    vertices = np.asarray(mesh.vertices, dtype=float) * scale
    if not np.all(np.isfinite(vertices)):
        raise ImportDataError(f"{file.name}: vertices must be finite")
    return ImportedMesh(vertices, np.asarray(mesh.faces, dtype=np.int64), bool(mesh.is_watertight))
