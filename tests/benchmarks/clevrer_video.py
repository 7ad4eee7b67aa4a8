"""Tracks from a CLEVRER video, made by the project's own perception, against the annotation."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from atw_mcp.perception.import_images import import_camera
from atw_mcp.perception.observe import observe
from atw_mcp.perception.tracks import world_tracks
from atw_mcp.worlds.building import from_trusted_start
from polyworld.data.tracks import ObservedTracks
from tests.scenes.clevrer_data import SECONDS_PER_FRAME, SHAPES, Collision, Scene

Array = NDArray[np.float64]

IMAGE_SIZE = (480, 320)
SAME = 0.5  # [m]; a track farther than this from every object is nobody's in that frame
LASTING = 3  # frames a track must follow another object to count as a swap of identities


@dataclass(frozen=True)
class TrackScore:
    """Tracks of one video against its annotation.

    median_error [m]: over all samples of matched tracks in which the annotation says the object is in view;
    worst_object [m]: the largest median of one object. swaps: times a track goes over to another object.
    median_error_own_sizes: the same where perception is not given the objects' sizes but estimates them.
    objects: annotated objects ever in view; found: those with a track; extra: tracks that are nobody's.
    colours, shapes, materials: how many of the found objects' cues are right.
    """

    scene: str
    median_error: float
    worst_object: float
    swaps: int
    objects: int
    found: int
    extra: int
    colours: int
    shapes: int
    materials: int
    coverage: float
    seconds: float
    median_error_own_sizes: float = float("nan")


@dataclass(frozen=True)
class VideoScene:
    """Return tracks of the video alone, and the annotation renamed to match them."""

    tracks: ObservedTracks
    kinds: dict[str, tuple[str, str, str]]
    truth: ObservedTracks
    collisions: tuple[Collision, ...]


def observe_scene(scene: Scene, folder: Path, say: Callable[[str], None]) -> tuple[VideoScene, TrackScore]:
    """Run perception on the scene's video and compare."""
    if scene.video is None:
        raise FileNotFoundError(f"scene {scene.number} has no video")
    started = time.perf_counter()
    observation = observe(scene.video)
    camera = import_camera(folder / "camera_homography_z0.2.json", IMAGE_SIZE)
    kinds = {o.name: (o.colour.name, o.material.name, o.shape.name) for o in observation.objects}
    solids = {name: SHAPES[shape] for name, (_, _, shape) in kinds.items() if shape in SHAPES}
    tracks = world_tracks(observation, camera, solids, seconds_per_frame=SECONDS_PER_FRAME)
    seconds = time.perf_counter() - started
    say(f"{scene.number} video: {len(tracks.names)} tracks in {seconds:.1f} s")
    made, score = _compare(scene, from_trusted_start(tracks), tracks, kinds, seconds)
    own = world_tracks(observation, camera, seconds_per_frame=SECONDS_PER_FRAME)
    _, without_sizes = _compare(scene, from_trusted_start(own), own, kinds, seconds)
    return made, replace(score, median_error_own_sizes=without_sizes.median_error)


def _compare(
    scene: Scene,
    trusted: ObservedTracks,
    tracks: ObservedTracks,
    kinds: dict[str, tuple[str, str, str]],
    seconds: float,
) -> tuple[VideoScene, TrackScore]:
    rows = np.searchsorted(scene.tracks.frames, tracks.frames)
    visible = scene.visible[rows]
    seen = tracks.confidence > 0.0
    # (T, tracks, objects): distances in the plane
    gap = np.linalg.norm(tracks.positions[:, :, None, :2] - scene.tracks.positions[rows][:, None, :, :2], axis=-1)
    both = seen[:, :, None] & visible[:, None, :]
    cost = np.where(both.any(axis=0), _median(gap, both), 1e3)
    own, matched = linear_sum_assignment(cost)
    pairs = {int(t): int(o) for t, o in zip(own, matched, strict=True) if cost[t, o] < SAME}
    errors = {o: gap[both[:, t, o], t, o] for t, o in pairs.items()}
    every = np.concatenate(list(errors.values())) if errors else np.zeros(0)
    in_view = visible.any(axis=0)
    right = np.zeros(3, dtype=int)
    for t, o in pairs.items():
        truth = scene.kinds[scene.tracks.names[o]]
        right += [mine == real for mine, real in zip(kinds[tracks.names[t]], truth, strict=True)]
    covered = sum(int((seen[:, t] & visible[:, o]).sum()) for t, o in pairs.items())
    score = TrackScore(
        scene=scene.number,
        median_error=float(np.median(every)) if len(every) else float("nan"),
        worst_object=max((float(np.median(e)) for e in errors.values()), default=float("nan")),
        swaps=sum(_swaps(gap[:, t], both[:, t], o) for t, o in pairs.items()),
        objects=int(in_view.sum()),
        found=len(pairs),
        extra=len(tracks.names) - len(pairs),
        colours=int(right[0]),
        shapes=int(right[2]),
        materials=int(right[1]),
        coverage=covered / max(int(visible.sum()), 1),
        seconds=seconds,
    )
    columns = list(pairs.values())
    names = tuple(tracks.names[t] for t in pairs)
    renamed = {scene.tracks.names[o]: tracks.names[t] for t, o in pairs.items()}
    truth_tracks = ObservedTracks(
        names=names,
        frames=scene.tracks.frames,
        seconds_per_frame=scene.tracks.seconds_per_frame,
        positions=scene.tracks.positions[:, columns],
        position_sigma=scene.tracks.position_sigma[:, columns],
        orientations=scene.tracks.orientations[:, columns],
        # A world made from the video is judged where the camera sees.
        confidence=np.where(scene.visible[:, columns], 1.0, 0.0),
        orientation_confidence=np.where(scene.visible, scene.tracks.orientation_confidence, 0.0)[:, columns],
        symmetry=tuple(scene.tracks.symmetry[o] for o in columns),
    )
    collisions = tuple(
        Collision((first, second), c.frame)
        for c in scene.collisions
        for first, second in [sorted(renamed.get(n, n) for n in c.pair)]
    )
    return VideoScene(trusted.select(names), {n: kinds[n] for n in names}, truth_tracks, collisions), score


def _median(gap: Array, both: NDArray[np.bool_]) -> Array:
    values = np.where(both, gap, np.nan)
    result = np.full(gap.shape[1:], 1e3)
    for t, o in zip(*np.nonzero(both.any(axis=0)), strict=True):
        result[t, o] = np.nanmedian(values[:, t, o])
    return result


def _swaps(gap: Array, both: NDArray[np.bool_], own: int) -> int:
    """Runs of at least `LASTING` frames in which another object is nearer than the track's own, by half a body."""
    strays = 0
    length = 0
    for row, known in zip(gap, both, strict=True):
        others = [row[o] for o in np.flatnonzero(known) if o != own]
        stray = bool(known[own] and others and min(others) + 0.2 < row[own])
        length = length + 1 if stray else 0
        strays += length == LASTING
    return strays
