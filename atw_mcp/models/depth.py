"""Metric depth of every pixel, and the focal length, by Depth Anything (metric) or Depth Pro through transformers."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.models.folders import ModelError, ModelFolder
from atw_mcp.models.images import HALF, IMAGENET, Preparation, mean_and_std, size_of, stated
from atw_mcp.models.running import Limits, Provenance, bounded, check_memory, chosen_device, extra, pretrained
from atw_mcp.perception.import_images import LARGEST_DEPTH_BYTES, DepthMaps
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress

INVERSE_LIMITS = (1e-4, 1e4)  # [1/m], as Depth Pro's own post-processing clamps
_CLASSES = {"depth_anything": "DepthAnythingForDepthEstimation", "depth_pro": "DepthProForDepthEstimation"}


@dataclass(frozen=True)
class PredictedDepth:
    """depth: maps in the video's size. focal (T,) [px]: focal length of each frame, None where the model gives none."""

    depth: DepthMaps
    focal: NDArray[np.float64] | None
    provenance: Provenance


def predict_depth(
    model: ModelFolder,
    frames: Frames,
    numbers: Sequence[int],
    limits: Limits,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> PredictedDepth:
    """Depth of frames (T, H, W, 3) of the given frame numbers (T,).

    Depth Pro (Bochkovskii et al. 2024) predicts inverse depth for a unit focal length and the horizontal field of
    view: depth = f / (W c), f = W / (2 tan(fov / 2)). Raises ModelError where the extra, the weights or the memory
    are missing.
    """
    if 4.0 * np.prod(frames.shape[:3]) > LARGEST_DEPTH_BYTES:
        raise ModelError(f"depth of {len(frames)} frames would take more than 1.5 GB: give a larger stride")
    device = chosen_device(limits)
    torch = extra("torch")
    preparation = _preparation(model)
    check_memory(model, limits, limits.batch * preparation.height * preparation.width)
    network = pretrained(model, _CLASSES[model.family], device)
    maps, focals = [], []
    size = (int(frames.shape[1]), int(frames.shape[2]))
    with bounded(limits, device):
        for begin in range(0, len(frames), limits.batch):
            if cancelled is not None and cancelled():
                raise PerceptionCancelled("cancelled")
            if progress is not None:
                progress(begin / len(frames), f"depth of frame {numbers[begin]}")
            outputs = network(preparation.tensor(frames[begin : begin + limits.batch], device))
            found, focal = _in_metres(torch, model.family, outputs, size)
            maps.append(found.float().cpu().numpy())
            focals.append(None if focal is None else focal.float().cpu().numpy())
    depth = np.concatenate(maps).astype(np.float32)
    depth = np.where(np.isfinite(depth) & (depth > 0), depth, np.nan).astype(np.float32)
    known = [f for f in focals if f is not None]
    return PredictedDepth(
        DepthMaps(depth, tuple(int(n) for n in numbers)),
        np.concatenate(known).astype(np.float64) if known else None,
        Provenance(model, device, limits.batch),
    )


def _preparation(model: ModelFolder) -> Preparation:
    record = stated(model.path)
    if model.family == "depth_pro":
        height, width = size_of(record, (1536, 1536))
        mean, std = mean_and_std(record, HALF)
        return Preparation(height, width, mean, std, antialias=False, normalise_first=True)
    height, width = size_of(record, (518, 518))
    mean, std = mean_and_std(record, IMAGENET)
    return Preparation(
        height,
        width,
        mean,
        std,
        keep_aspect=bool(record.get("keep_aspect_ratio", True)),
        multiple=int(record.get("ensure_multiple_of", 14)),
        bicubic=True,
    )


def _in_metres(torch: Any, family: str, outputs: Any, size: tuple[int, int]) -> tuple[Any, Any]:
    raw = outputs.predicted_depth
    if family == "depth_anything":
        resized = torch.nn.functional.interpolate(raw[:, None], size, mode="bicubic", align_corners=False)
        return resized[:, 0], None
    focal = None
    if outputs.field_of_view is not None:
        focal = 0.5 * size[1] / torch.tan(0.5 * torch.deg2rad(outputs.field_of_view.reshape(-1)))
        raw = raw * (size[1] / focal)[:, None, None]
    resized = torch.nn.functional.interpolate(raw[:, None], size, mode="bilinear", align_corners=False)[:, 0]
    return 1.0 / resized.clamp(*INVERSE_LIMITS), focal
