"""Pictures for people and agents: masks and names over frames, contact sheets, bytes to send."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import Frames

# Colours (BGR) told apart on grey floors; objects take them in turn.
PALETTE = (
    (60, 60, 255),
    (80, 220, 80),
    (255, 140, 40),
    (0, 215, 255),
    (255, 80, 255),
    (255, 255, 60),
    (0, 140, 255),
    (200, 120, 160),
)
LARGEST_IMAGE = 700_000  # bytes: below the size of a message that clients refuse


def draw_observation(
    frame: Frames,
    observation: ImageObservation,
    frame_number: int,
    *,
    names: Sequence[str] | None = None,
    fill: float = 0.0,
    scale: int = 2,
) -> Frames:
    """A frame (H, W, 3) enlarged, with the objects outlined and named (all by default), and tinted by `fill`."""
    labels = observation.label_image(frame_number)
    wanted = observation.names if names is None else tuple(names)
    for name in wanted:
        observation.object(name)
    colours = {i + 1: n for i, n in enumerate(observation.names) if n in wanted}
    picture = overlay_labels(frame, labels, colours, fill=fill, scale=scale)
    return stamped(picture, f"frame {frame_number}")


def overlay_labels(
    frame: Frames,
    label_image: NDArray[np.integer],
    names: Mapping[int, str] | Sequence[str],
    *,
    fill: float = 0.0,
    scale: int = 2,
) -> Frames:
    """Outlines and names of the objects of a label image (H, W) drawn over a frame (H, W, 3).

    names: by label, or in the order of labels 1, 2, ... fill in 0..1 tints the inside. The result is `scale`
    times as large as the frame.
    """
    if label_image.shape != frame.shape[:2]:
        raise ValueError(f"label image {label_image.shape} and frame {frame.shape[:2]} must have the same size")
    by_label = dict(names) if isinstance(names, Mapping) else {i + 1: n for i, n in enumerate(names)}
    height, width = frame.shape[:2]
    picture = cv2.resize(frame, (scale * width, scale * height), interpolation=cv2.INTER_LINEAR)
    captions = []
    for label, name in by_label.items():
        mask = (label_image == label).astype(np.uint8)
        if not mask.any():
            continue
        large = cv2.resize(mask, (scale * width, scale * height), interpolation=cv2.INTER_NEAREST)
        colour = PALETTE[(label - 1) % len(PALETTE)]
        if fill > 0:
            inside = large > 0
            picture[inside] = ((1 - fill) * picture[inside] + fill * np.array(colour)).astype(np.uint8)
        outlines, _ = cv2.findContours(large, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
        cv2.drawContours(picture, outlines, -1, colour, 1, cv2.LINE_AA)
        left, top, wide, tall = cv2.boundingRect(large)
        captions.append((name, left + wide // 2, top, top + tall, colour))
    _write_captions(picture, captions)
    return np.asarray(picture, dtype=np.uint8)


def _write_captions(picture: NDArray[Any], captions: list[tuple[str, int, int, int, tuple[int, int, int]]]) -> None:
    """Names above their objects, moved down the picture where they would cover each other."""
    height, width = picture.shape[:2]
    taken: list[tuple[int, int, int, int]] = []
    for name, middle, top, bottom, colour in sorted(captions, key=lambda c: c[2]):
        (wide, tall), _ = cv2.getTextSize(name, cv2.FONT_HERSHEY_SIMPLEX, 0.42, 1)
        x = int(np.clip(middle - wide // 2, 2, max(width - wide - 2, 2)))
        y = top - 4 if top - 4 - tall > 0 else min(bottom + tall + 4, height - 3)
        while any(x < r and x + wide > a and y - tall < b and y > t for a, t, r, b in taken) and y < height - 3:
            y += tall + 4
        taken.append((x, y - tall, x + wide, y))
        cv2.putText(picture, name, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.42, (0, 0, 0), 3, cv2.LINE_AA)
        cv2.putText(picture, name, (x, y), cv2.FONT_HERSHEY_SIMPLEX, 0.42, colour, 1, cv2.LINE_AA)


def stamped(picture: Frames, text: str) -> Frames:
    """The picture with a line of text in its upper left corner."""
    result = picture.copy()
    cv2.putText(result, text, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (0, 0, 0), 3, cv2.LINE_AA)
    cv2.putText(result, text, (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (255, 255, 255), 1, cv2.LINE_AA)
    return result


def contact_sheet(pictures: Sequence[Frames], columns: int = 3) -> Frames:
    """Pictures of one size side by side, row by row."""
    if not pictures or columns < 1:
        raise ValueError("a contact sheet needs at least one picture and one column")
    shapes = {p.shape for p in pictures}
    if len(shapes) > 1:
        raise ValueError(f"pictures of a contact sheet must have one size, got {sorted(shapes)}")
    columns = min(columns, len(pictures))
    height, width = pictures[0].shape[:2]
    rows = -(-len(pictures) // columns)
    sheet = np.zeros((rows * height, columns * width, 3), dtype=np.uint8)
    for k, picture in enumerate(pictures):
        y, x = divmod(k, columns)
        sheet[y * height : (y + 1) * height, x * width : (x + 1) * width] = picture
    return sheet


def encode_image(picture: Frames, *, kind: str = "jpeg", largest: int = LARGEST_IMAGE) -> tuple[bytes, str]:
    """The picture as JPEG or PNG bytes of at most `largest`, and their MIME type.

    To fit, a JPEG's quality is lowered first, then the picture is halved.
    """
    if kind not in ("jpeg", "png"):
        raise ValueError(f'kind must be "jpeg" or "png", got {kind!r}')
    current = picture
    while True:
        for quality in (90, 75, 60) if kind == "jpeg" else (9,):
            option = cv2.IMWRITE_JPEG_QUALITY if kind == "jpeg" else cv2.IMWRITE_PNG_COMPRESSION
            written, data = cv2.imencode(f".{kind}", current, [option, quality])
            if written and len(data) <= largest:
                return data.tobytes(), f"image/{kind}"
        if min(current.shape[:2]) < 16:
            raise ValueError(f"no picture fits into {largest} bytes")
        current = np.asarray(
            cv2.resize(current, (current.shape[1] // 2, current.shape[0] // 2), interpolation=cv2.INTER_AREA),
            dtype=np.uint8,
        )
