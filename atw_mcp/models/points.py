"""Points followed through a video by an exported PyTorch program (CoTracker and the like).

transformers has no class for point tracks, and the trackers' own code is no package; `torch.export` turns such a
network with its weights into one file that runs without that code. A model's folder holds

    model.json   {"task": "points", "program": "tracker.pt2", "license": "..."}
    tracker.pt2  torch.export.save(torch.export.export(network, (video, queries)), "tracker.pt2")

with network(video, queries) -> tracks, visibility, CoTracker's own order:

    video (1, T, 3, H, W) float32   red, green, blue in 0..255
    queries (1, N, 3) float32       frame within the video, x, y [px]; (0, 0) is the centre of the first pixel
    tracks (1, T, N, 2) float32     x, y [px]; they need hold only from a point's own frame on
    visibility (1, T, N)            bool, or a probability

Sizes that were exported as fixed numbers are met: frames are resized to H, W, longer videos go through in windows of
T frames that share one, points in groups of N. Sizes exported as dynamic are taken as they come.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from atw_mcp.models.folders import MANIFEST, ModelError, ModelFolder
from atw_mcp.models.running import Limits, Provenance, bounded, check_memory, chosen_device, extra
from atw_mcp.perception.observation import ImageObservation
from atw_mcp.perception.video import Cancelled, Frames, PerceptionCancelled, Progress

Floats = NDArray[np.float64]
POINTS_EACH, SEED_ROWS, SEED_SPACING = 16, 8, 10  # of an object: points a seeding, seedings at most, frames between
VISIBLE = 0.5  # probability from which a point counts as seen


@dataclass(frozen=True)
class Query:
    """A point to follow: on which object, in which row, where [px]."""

    object: str
    row: int
    x: float
    y: float


@dataclass(frozen=True)
class PredictedPoints:
    """pixels (T, N, 2), visible (T, N) of queries (N,)."""

    queries: tuple[Query, ...]
    pixels: Floats
    visible: NDArray[np.bool_]
    provenance: Provenance


@dataclass(frozen=True)
class _Program:
    run: Any
    frames: int | None
    size: tuple[int, int] | None
    points: int | None


def follow_points(
    model: ModelFolder,
    frames: Frames,
    queries: Sequence[Query],
    limits: Limits,
    *,
    progress: Progress | None = None,
    cancelled: Cancelled | None = None,
) -> PredictedPoints:
    """Places of the queried points in all frames (T, H, W, 3): before a point's own frame with time reversed."""
    if not queries:
        raise ModelError("no point to follow: observe the video first, so that points can be put on its objects")
    device = chosen_device(limits)
    program = _load(model, device)
    count, height, width = frames.shape[:3]
    high, wide = program.size or (height, width)
    check_memory(model, limits, min(program.frames or count, count) * high * wide)
    scaled = frames if (high, wide) == (height, width) else _resized(frames, high, wide)
    scale = np.array([wide / width, high / height])
    start = np.array([[q.x, q.y] for q in queries])
    rows = np.array([q.row for q in queries])
    pixels, visible = np.full((count, len(queries), 2), np.nan), np.zeros((count, len(queries)), dtype=bool)
    group = program.points or len(queries)
    with bounded(limits, device):
        for begin in range(0, len(queries), group):
            own = slice(begin, begin + group)
            if progress is not None:
                progress(begin / len(queries), f"following points {begin + 1} to {min(begin + group, len(queries))}")
            for back in (False, True):
                turned = count - 1 - rows[own] if back else rows[own]
                found, seen = _chained(
                    program,
                    scaled[::-1] if back else scaled,
                    turned,
                    (start[own] + 0.5) * scale - 0.5,
                    device,
                    cancelled,
                )
                found, seen = (found[::-1], seen[::-1]) if back else (found, seen)
                later = np.arange(count)[:, None] >= rows[own][None]
                fresh = ~later if back else later
                pixels[:, own][fresh] = ((found + 0.5) / scale - 0.5)[fresh]
                visible[:, own][fresh] = seen[fresh]
    visible &= np.isfinite(pixels).all(axis=2)
    return PredictedPoints(tuple(queries), pixels, visible, Provenance(model, device, limits.batch))


def queries_on(observation: ImageObservation, frames: Frames, only: Sequence[str] | None = None) -> tuple[Query, ...]:
    """Points on the objects where their image has corners, placed again every few frames, since bodies turn away."""
    queries: list[Query] = []
    for name in observation.names if only is None else only:
        item = observation.object(name)
        clear = [t for t, m in enumerate(item.masks) if m is not None and item.status[t] == "visible"]
        seeds = sorted({clear[round(k)] for k in np.linspace(0, len(clear) - 1, min(SEED_ROWS, len(clear)))})
        last = -SEED_SPACING
        for row in seeds:
            stored = item.masks[row]
            if row - last < SEED_SPACING or stored is None:
                continue
            last = row
            inner = cv2.erode(stored.decode().astype(np.uint8), np.ones((3, 3), np.uint8), borderValue=0)
            grey = cv2.cvtColor(frames[row], cv2.COLOR_BGR2GRAY)
            found = cv2.goodFeaturesToTrack(grey, POINTS_EACH, 0.01, 3.0, mask=inner)
            places = [] if found is None else np.asarray(found).reshape(-1, 2)
            queries += [Query(name, row, float(x), float(y)) for x, y in places]
    return tuple(queries)


def _load(model: ModelFolder, device: str) -> _Program:
    torch = extra("torch")
    file = model.path / str(model.manifest().get("program", "model.pt2"))
    if not file.is_file():
        raise ModelError(f"{model.name}: no file {file.name} in {model.path}; {MANIFEST} names it as program")
    try:
        exported = torch.export.load(Path(file))
    except Exception as error:  # whatever its readers of archives, JSON and tensors raise
        raise ModelError(f"{file.name}: not a program saved by torch.export.save: {error}") from error
    if device != "cpu":
        exported = extra("torch.export.passes").move_to_device_pass(exported, device)
    names = exported.graph_signature.user_inputs
    nodes = [n for n in exported.graph.nodes if n.op == "placeholder" and n.name in names]
    shapes = [tuple(d if isinstance(d, int) else None for d in n.meta["val"].shape) for n in nodes]
    if [len(s) for s in shapes] != [5, 3] or shapes[0][2] not in (3, None) or shapes[1][2] not in (3, None):
        raise ModelError(
            f"{file.name}: a program for points takes video (1, T, 3, H, W) and queries (1, N, 3); this one takes "
            f"{' and '.join(str(s) for s in shapes) or 'nothing'}"
        )
    (_, frames, _, high, wide), points = shapes[0], shapes[1][1]
    if (high is None) != (wide is None):
        raise ModelError(f"{file.name}: height and width must both be fixed or both be dynamic, got {high}, {wide}")
    if frames is not None and frames < 2:
        raise ModelError(f"{file.name}: a window of {frames} frame cannot follow anything")
    return _Program(exported.module(), frames, None if high is None or wide is None else (high, wide), points)


def _chained(
    program: _Program, frames: Frames, rows: NDArray[np.int64], places: Floats, device: str, cancelled: Cancelled | None
) -> tuple[Floats, NDArray[np.bool_]]:
    """Places (T, n, 2) and visibility (T, n) from each point's row on, in windows that share their end frames."""
    count, n = len(frames), len(rows)
    pixels, visible = np.full((count, n, 2), np.nan), np.zeros((count, n), dtype=bool)
    pixels[rows, np.arange(n)], visible[rows, np.arange(n)] = places, True
    window = min(program.frames or count, count)
    begin = 0
    while True:
        if cancelled is not None and cancelled():
            raise PerceptionCancelled("cancelled")
        end = min(begin + window, count)
        alive = np.flatnonzero(rows < end)
        if len(alive):
            first = np.maximum(rows[alive], begin)
            queries = np.column_stack([first - begin, pixels[first, alive]])
            found, seen = _run(program, frames[begin:end], queries, device)
            after = np.arange(begin, end)[:, None] > first[None]
            t, k = np.nonzero(after)
            pixels[begin + t, alive[k]], visible[begin + t, alive[k]] = found[t, k], seen[t, k]
        if end == count:
            return pixels, visible
        begin = end - 1


def _run(program: _Program, frames: Frames, queries: Floats, device: str) -> tuple[Floats, NDArray[np.bool_]]:
    torch = extra("torch")
    count, n = len(frames), len(queries)
    padding = 0 if program.frames is None else program.frames - count
    more = 0 if program.points is None else program.points - n
    video = np.concatenate([frames, np.repeat(frames[-1:], padding, axis=0)])[..., ::-1]
    asked = np.concatenate([queries, np.repeat(queries[:1], more, axis=0)])
    outcome = program.run(
        torch.from_numpy(np.ascontiguousarray(video)).to(device).permute(0, 3, 1, 2).float()[None],
        torch.tensor(asked, dtype=torch.float32, device=device)[None],
    )
    shape = (1, len(video), len(asked))
    got = [tuple(o.shape) for o in outcome] if isinstance(outcome, tuple | list) else [type(outcome).__name__]
    if got != [(*shape, 2), shape]:
        raise ModelError(f"the program must give tracks {(*shape, 2)} and visibility {shape}; it gave {got}")
    tracks, seen = (o[0, :count, :n].float().cpu().numpy().astype(np.float64) for o in outcome)
    return tracks, seen >= VISIBLE


def _resized(frames: Frames, height: int, width: int) -> Frames:
    return np.stack(
        [np.asarray(cv2.resize(f, (width, height), interpolation=cv2.INTER_AREA), dtype=np.uint8) for f in frames]
    )
