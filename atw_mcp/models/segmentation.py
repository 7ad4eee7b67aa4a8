"""Prompted objects followed through a video by SAM 2 or SAM 3 (the tracker) through transformers."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.models.folders import ModelError, ModelFolder
from atw_mcp.models.images import HALF, IMAGENET, Preparation, mean_and_std, stated
from atw_mcp.models.running import Limits, Provenance, bounded, check_memory, chosen_device, extra, pretrained
from atw_mcp.perception.import_images import observation_of_masks
from atw_mcp.perception.masks import Mask
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress, VideoInfo

Point = tuple[float, float]
Box = tuple[float, float, float, float]
# sam3_video holds a detector for words beside the tracker; prompts here are boxes and points, which the tracker takes.
_CLASSES = {"sam2_video": "Sam2Video", "sam3_video": "Sam3TrackerVideo", "sam3_tracker_video": "Sam3TrackerVideo"}
LEAST_PIXELS = 8  # of a mask that becomes a prompt


@dataclass(frozen=True)
class Prompt:
    """Location of an object in one frame (its row): box (left, top, width, height) [px], points on it and beside it."""

    object: str
    row: int
    box: Box | None = None
    positive: tuple[Point, ...] = ()
    negative: tuple[Point, ...] = ()


@dataclass(frozen=True)
class PredictedMasks:
    """masks: (T, H, W) by object; scores: (T,) probability that it is seen, by object."""

    masks: dict[str, NDArray[np.bool_]]
    scores: dict[str, NDArray[np.float64]]
    provenance: Provenance

    def observation(self, info: VideoInfo, frames: Frames, numbers: tuple[int, ...]) -> ImageObservation:
        """Return what imported masks would give, with confidences times the model's own scores."""
        lists: dict[str, list[Mask]] = {name: list(masks) for name, masks in self.masks.items()}
        seen = observation_of_masks(lists, frames, ImageObservation(info, numbers, ()))
        kept = [name for name, masks in self.masks.items() if (masks.sum(axis=(1, 2)) >= LEAST_PIXELS).any()]
        objects = tuple(
            replace(item, name=name, confidence=np.round(item.confidence * self.scores[name], 4))
            for item, name in zip(seen.objects, kept, strict=True)
        )
        missing = [f"{name}: nothing was found of it" for name in self.masks if name not in kept]
        return replace(seen, objects=objects, warnings=(*info.warnings, *missing))


def follow(
    model: ModelFolder,
    frames: Frames,
    prompts: Sequence[Prompt],
    limits: Limits,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> PredictedMasks:
    """Masks of the prompted objects in all frames (T, H, W, 3), forwards and backwards from their prompts.

    Objects that are prompted in the same frames are followed together, at most `limits.batch` at once; a pixel goes
    to the object with the greatest logit. Memory of frames the model no longer looks at is freed. Raises ModelError.
    """
    _check(prompts, frames)
    device = chosen_device(limits)
    network, session_class = _load(model, device)
    size = _input_size(network)
    check_memory(model, limits, size * size)
    record = stated(model.path)
    mean, std = mean_and_std(record, IMAGENET if model.family == "sam2_video" else HALF)
    preparation = Preparation(size, size, mean, std)
    names = list(dict.fromkeys(p.object for p in prompts))
    best = np.zeros(frames.shape[:3], np.float32)  # greatest logit so far; 0 is background
    owner = np.full(frames.shape[:3], -1, np.int16)
    scores = {name: np.zeros(len(frames)) for name in names}
    groups = list(_groups(prompts, limits.batch))
    done = 0
    with bounded(limits, device):
        for group in groups:
            session = _session(session_class, preparation, frames, device)
            for row, objects, logits, seen in _followed(network, session, group, frames, size):
                if cancelled is not None and cancelled():
                    raise PerceptionCancelled("cancelled")
                if progress is not None:
                    progress(min(done / (len(groups) * (len(frames) + 1)), 1.0), f"following in frame {row}")
                done += 1
                for name, logit, score in zip(objects, logits, seen, strict=True):
                    scores[name][row] = score
                    wins = logit > best[row]
                    best[row][wins] = logit[wins]
                    owner[row][wins] = names.index(name)
    masks = {name: owner == k for k, name in enumerate(names)}
    return PredictedMasks(masks, scores, Provenance(model, device, limits.batch))


def prompts_from(observation: ImageObservation, only: Sequence[str] | None = None) -> tuple[Prompt, ...]:
    """Return a box and its innermost point for each object, in as few frames as show all of them well.

    Masks themselves are no prompts: a model that is given a wrong outline would keep it.
    """
    wanted = {name: observation.object(name) for name in (observation.names if only is None else only)}
    good = {}
    for name, item in wanted.items():
        clear = [t for t, m in enumerate(item.masks) if m is not None and item.confidence[t] > 0]
        most = max((item.confidence[t] for t in clear), default=0.0)
        good[name] = {t for t in clear if item.confidence[t] >= 0.9 * most}
    prompts = []
    while any(good.values()):
        row = max(range(len(observation.frames)), key=lambda t: sum(t in rows for rows in good.values()))
        for name in [n for n, rows in good.items() if row in rows]:
            stored = wanted[name].masks[row]
            assert stored is not None
            prompts.append(_prompt_of(name, row, stored.decode()))
            del good[name]
    return tuple(sorted(prompts, key=lambda p: list(wanted).index(p.object)))


def _prompt_of(name: str, row: int, mask: Mask) -> Prompt:
    y, x = np.nonzero(mask)
    depth = cv2.distanceTransform(np.pad(mask.astype(np.uint8), 1), cv2.DIST_L2, 3)[1:-1, 1:-1]
    v, u = np.unravel_index(int(np.argmax(depth)), mask.shape)
    box = (float(x.min()), float(y.min()), float(np.ptp(x) + 1), float(np.ptp(y) + 1))
    return Prompt(name, row, box, ((float(u), float(v)),))


# --- the model ---


class _OnDemand(Mapping[int, Any]):
    """Frames made ready when they are asked for, in place of a session's store of all of them."""

    def __init__(self, preparation: Preparation, frames: Frames, device: str) -> None:
        self._preparation, self._frames, self._device = preparation, frames, device

    def __getitem__(self, row: int) -> Any:
        return self._preparation.tensor(self._frames[row : row + 1], self._device)[0]

    def __iter__(self) -> Iterator[int]:
        return iter(range(len(self._frames)))

    def __len__(self) -> int:
        return len(self._frames)


def _load(model: ModelFolder, device: str) -> tuple[Any, Any]:
    name = _CLASSES[model.family]
    network = pretrained(model, f"{name}Model", device)
    return network, getattr(extra("transformers"), f"{name}InferenceSession")


def _input_size(network: Any) -> int:
    size = network.config.prompt_encoder_config.image_size
    return int(size if isinstance(size, int) else size[0])


def _session(session_class: Any, preparation: Preparation, frames: Frames, device: str) -> Any:
    session = session_class(
        video_height=frames.shape[1],
        video_width=frames.shape[2],
        inference_device=device,
        inference_state_device="cpu",  # memories of all frames would fill a GPU
        video_storage_device=device,
        dtype=extra("torch").float32,
    )
    session.processed_frames = _OnDemand(preparation, frames, device)
    return session


def _followed(
    network: Any, session: Any, group: dict[str, list[Prompt]], frames: Frames, size: int
) -> Iterator[tuple[int, list[str], NDArray[np.float32], NDArray[np.float64]]]:
    """Row, objects, logits (n, H, W) and scores (n,), for every row once."""
    torch = extra("torch")
    objects = list(group)
    rows = sorted({p.row for prompts in group.values() for p in prompts})
    for k, prompts in enumerate(group.values()):
        session.obj_id_to_idx(k)
        for prompt in prompts:
            session.add_point_inputs(k, prompt.row, _point_inputs(torch, prompt, frames, size))
    for row in rows:
        session.obj_with_new_inputs = list(range(len(objects)))
        network(session, frame_idx=row)
    reach = max(network.config.num_maskmem, network.config.max_object_pointers_in_encoder) + 1
    for order, reverse in ((range(rows[0], len(frames)), False), (range(rows[0] - 1, -1, -1), True)):
        for row in order:
            output = network(session, frame_idx=row, reverse=reverse)
            resized = torch.nn.functional.interpolate(
                output.pred_masks.float(), tuple(frames.shape[1:3]), mode="bilinear", align_corners=False
            )
            seen = torch.sigmoid(output.object_score_logits.float()).reshape(-1)
            yield row, objects, resized[:, 0].cpu().numpy(), seen.cpu().numpy().astype(np.float64)
            for kept in session.output_dict_per_obj.values():
                kept["non_cond_frame_outputs"].pop(row + reach if reverse else row - reach, None)


def _point_inputs(torch: Any, prompt: Prompt, frames: Frames, size: int) -> dict[str, Any]:
    """Points and labels as SAM's prompt encoder takes them: 2 and 3 are a box's corners, 1 and 0 on and beside it."""
    points: list[Point] = []
    labels: list[int] = []
    if prompt.box is not None:
        left, top, width, height = prompt.box
        points += [(left, top), (left + width, top + height)]
        labels += [2, 3]
    points += [*prompt.positive, *prompt.negative]
    labels += [1] * len(prompt.positive) + [0] * len(prompt.negative)
    scale = np.array([size / frames.shape[2], size / frames.shape[1]])
    coordinates = torch.tensor(np.asarray(points) * scale, dtype=torch.float32)
    return {
        "point_coords": coordinates[None, None],
        "point_labels": torch.tensor(labels, dtype=torch.int32)[None, None],
    }


def _groups(prompts: Sequence[Prompt], batch: int) -> Iterator[dict[str, list[Prompt]]]:
    by_object: dict[str, list[Prompt]] = defaultdict(list)
    for prompt in prompts:
        by_object[prompt.object].append(prompt)
    by_rows: dict[tuple[int, ...], list[str]] = defaultdict(list)
    for name, own in by_object.items():
        by_rows[tuple(sorted(p.row for p in own))].append(name)
    for names in by_rows.values():
        for begin in range(0, len(names), batch):
            yield {name: by_object[name] for name in names[begin : begin + batch]}


def _check(prompts: Sequence[Prompt], frames: Frames) -> None:
    if not prompts:
        raise ModelError("nothing to follow: give a box or points of each object, or observe the video first")
    count, height, width = frames.shape[:3]
    taken = set()
    for prompt in prompts:
        if prompt.box is None and not prompt.positive:
            raise ModelError(f"{prompt.object}: a prompt needs a box or positive points")
        if not 0 <= prompt.row < count:
            raise ModelError(f"{prompt.object}: there is no frame {prompt.row} among {count}")
        if (prompt.object, prompt.row) in taken:
            raise ModelError(f"{prompt.object}: two prompts in one frame: put box and points into one")
        taken.add((prompt.object, prompt.row))
        for x, y in (*prompt.positive, *prompt.negative):
            if not (0 <= x < width and 0 <= y < height):
                raise ModelError(f"{prompt.object}: point ({x:g}, {y:g}) is outside the image of {width} x {height}")
        if prompt.box is not None:
            left, top, wide, tall = prompt.box
            if wide < 1 or tall < 1 or left >= width or top >= height or left + wide <= 0 or top + tall <= 0:
                raise ModelError(f"{prompt.object}: the box {prompt.box} lies outside the image of {width} x {height}")
