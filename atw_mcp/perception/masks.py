"""Masks as run lengths, in the COCO convention: column by column, runs of background and object in turn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Self

import cv2
import numpy as np
from numpy.typing import NDArray

Mask = NDArray[np.bool_]


class MaskError(ValueError):
    """A mask record that cannot be decoded; the message says why."""


@dataclass(frozen=True)
class RunLengthMask:
    """A mask of an image of the given height and width.

    counts are lengths of runs in column-major order, beginning with a (possibly empty) run of background.
    """

    height: int
    width: int
    counts: tuple[int, ...]

    @classmethod
    def encode(cls, mask: Mask) -> Self:
        """Run lengths of a mask (height, width)."""
        height, width = (int(n) for n in mask.shape)
        columns = window(mask)[1]
        flat = np.asarray(mask[:, columns], dtype=bool).ravel(order="F")
        changes = np.flatnonzero(np.diff(flat, prepend=False, append=False)) + height * columns.start
        edges = np.concatenate([[0], changes, [height * width]])
        counts = np.diff(edges).tolist()
        return cls(height, width, tuple(counts if counts[-1] or len(counts) == 1 else counts[:-1]))

    def decode(self) -> Mask:
        """Return the mask (height, width)."""
        runs = np.asarray(self.counts, dtype=np.int64)
        flat = np.repeat(np.arange(len(runs)) % 2 == 1, runs)
        return flat.reshape(self.width, self.height).T

    def pixels(self) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
        """Rows and columns (N,) of the object's pixels."""
        runs = np.asarray(self.counts, dtype=np.int64)
        ends, lengths = np.cumsum(runs)[1::2], runs[1::2]
        places = np.arange(lengths.sum()) + np.repeat(ends - np.cumsum(lengths), lengths)
        return places % self.height, places // self.height

    @property
    def area(self) -> int:
        """Number of object pixels."""
        return int(sum(self.counts[1::2]))

    def to_dict(self) -> dict[str, Any]:
        """COCO record with compressed counts: {"size": [height, width], "counts": text}."""
        return {"size": [self.height, self.width], "counts": compress_counts(self.counts)}

    @classmethod
    def from_dict(cls, data: Any) -> Self:
        """Return a COCO record, with counts as a list of integers or as compressed text.

        Raises MaskError for a missing key, a size that is not two positive integers, and counts that do not
        add up to the size.
        """
        if not isinstance(data, dict) or "size" not in data or "counts" not in data:
            keys = sorted(data) if isinstance(data, dict) else type(data).__name__
            raise MaskError(f'a run-length mask needs the keys "size" [height, width] and "counts"; got {keys}')
        size = data["size"]
        if not isinstance(size, list | tuple) or len(size) != 2 or not all(isinstance(s, int) and s > 0 for s in size):
            raise MaskError(f'"size" must be [height, width] in pixels, got {size!r}')
        counts = data["counts"]
        if isinstance(counts, str | bytes):
            text = counts.decode("ascii", "replace") if isinstance(counts, bytes) else counts
            runs = expand_counts(text)
        elif isinstance(counts, list | tuple) and all(isinstance(c, int) and c >= 0 for c in counts):
            runs = tuple(counts)
        else:
            raise MaskError('"counts" must be a list of run lengths >= 0 or compressed text')
        if sum(runs) != size[0] * size[1]:
            raise MaskError(f"counts cover {sum(runs)} pixels, but size {list(size)} has {size[0] * size[1]}")
        return cls(int(size[0]), int(size[1]), runs)


def compress_counts(counts: tuple[int, ...]) -> str:
    """COCO's compressed text: from the fourth run on differences to the run two before, in base-32 digits."""
    characters: list[str] = []
    for i, count in enumerate(counts):
        value = count - counts[i - 2] if i > 2 else count
        more = True
        while more:
            digit = value & 0x1F
            value >>= 5  # arithmetic shift: the sign travels with the last digit's fifth bit
            more = value != -1 if digit & 0x10 else value != 0
            characters.append(chr((digit | (0x20 if more else 0)) + 48))
    return "".join(characters)


def expand_counts(text: str) -> tuple[int, ...]:
    """Invert `compress_counts`; raises MaskError where the text breaks off or holds a foreign character."""
    counts: list[int] = []
    position = 0
    while position < len(text):
        value, shift, more = 0, 0, True
        while more:
            if position >= len(text):
                raise MaskError("compressed counts break off in the middle of a run")
            digit = ord(text[position]) - 48
            if not 0 <= digit < 64:
                raise MaskError(f"compressed counts hold the character {text[position]!r} at {position}")
            value |= (digit & 0x1F) << shift
            shift += 5
            more = bool(digit & 0x20)
            position += 1
            if not more and digit & 0x10:
                value |= -1 << shift
        if len(counts) > 2:
            value += counts[-2]
        if value < 0:
            raise MaskError(f"compressed counts hold a negative run at character {position}")
        counts.append(value)
    return tuple(counts)


def window(mask: Mask, margin: int = 0) -> tuple[slice, slice]:
    """Rows and columns around a mask, with a margin [px] as far as the image has one; empty of an empty mask."""
    left, top, width, height = cv2.boundingRect(np.ascontiguousarray(mask, dtype=np.uint8))
    if not width:
        return slice(0, 0), slice(0, 0)
    return (
        slice(max(top - margin, 0), min(top + height + margin, mask.shape[0])),
        slice(max(left - margin, 0), min(left + width + margin, mask.shape[1])),
    )


def touches_border(mask: Mask) -> bool:
    """Check whether a mask of the whole image reaches the image's border."""
    return bool(mask[0].any() or mask[-1].any() or mask[:, 0].any() or mask[:, -1].any())


def solidity(mask: Mask) -> float:
    """Area of a mask's largest part over that of its convex hull."""
    contours, _ = cv2.findContours(np.pad(mask, 1).astype(np.uint8), cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    largest = max(contours, key=cv2.contourArea)
    hull = cv2.contourArea(cv2.convexHull(largest))
    return float(cv2.contourArea(largest) / hull) if hull > 0 else 1.0
