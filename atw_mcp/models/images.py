"""Frames as a model wants them: size, range and mean as its own `preprocessor_config.json` states."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from atw_mcp.models.folders import ModelError, read_json
from atw_mcp.models.running import extra

IMAGENET = ((0.485, 0.456, 0.406), (0.229, 0.224, 0.225))
HALF = ((0.5, 0.5, 0.5), (0.5, 0.5, 0.5))
_FILES = ("video_preprocessor_config.json", "preprocessor_config.json", "processor_config.json")


@dataclass(frozen=True)
class Preparation:
    """Preparation of frames for a model's input.

    height, width [px] of the input, a multiple of `multiple` and, with keep_aspect, only one of them met. mean, std of
    red, green, blue in 0..1. normalise_first: before resizing, as Depth Pro does.
    """

    height: int
    width: int
    mean: tuple[float, ...]
    std: tuple[float, ...]
    keep_aspect: bool = False
    multiple: int = 1
    bicubic: bool = False
    antialias: bool = True
    normalise_first: bool = False

    def size_for(self, height: int, width: int) -> tuple[int, int]:
        """Height and width of the input for frames of a size, scaled as little as possible (as DPT's processor)."""
        tall, wide = self.height / height, self.width / width
        if self.keep_aspect:
            tall = wide = wide if abs(1 - wide) < abs(1 - tall) else tall
        return (
            max(round(tall * height / self.multiple), 1) * self.multiple,
            max(round(wide * width / self.multiple), 1) * self.multiple,
        )

    def tensor(self, frames: NDArray[np.uint8], device: str) -> Any:
        """Frames (N, H, W, 3), BGR bytes, as a float tensor (N, 3, height, width)."""
        torch = extra("torch")
        rgb = torch.from_numpy(np.ascontiguousarray(frames[..., ::-1])).to(device).permute(0, 3, 1, 2).float() / 255.0
        mean = torch.tensor(self.mean, device=device).view(1, 3, 1, 1)
        std = torch.tensor(self.std, device=device).view(1, 3, 1, 1)
        if self.normalise_first:
            rgb = (rgb - mean) / std
        resized = torch.nn.functional.interpolate(
            rgb,
            self.size_for(*frames.shape[1:3]),
            mode="bicubic" if self.bicubic else "bilinear",
            align_corners=False,
            antialias=self.antialias,
        )
        return resized if self.normalise_first else (resized.clamp(0.0, 1.0) - mean) / std


def stated(path: Path) -> dict[str, Any]:
    """Read a model folder's preprocessing; empty where it states nothing."""
    for name in _FILES:
        if (path / name).is_file():
            record = read_json(path / name)
            inner = record.get("video_processor") or record.get("image_processor")
            return inner if isinstance(inner, dict) else record
    return {}


def size_of(record: dict[str, Any], default: tuple[int, int]) -> tuple[int, int]:
    """Height and width that a preprocessor's record states."""
    size = record.get("size", default)
    if isinstance(size, dict) and {"height", "width"} <= size.keys():
        return int(size["height"]), int(size["width"])
    if isinstance(size, int):
        return size, size
    if isinstance(size, list | tuple) and len(size) == 2:
        return int(size[0]), int(size[1])
    raise ModelError(f"preprocessor: size must have height and width, got {size!r}")


def mean_and_std(
    record: dict[str, Any], default: tuple[tuple[float, ...], tuple[float, ...]]
) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Mean and standard deviation of red, green, blue that a preprocessor's record states."""
    return tuple(record.get("image_mean") or default[0]), tuple(record.get("image_std") or default[1])
