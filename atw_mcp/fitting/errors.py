"""Errors of a fitted world in pixels and metres, beside the size of each body and the noise of its track."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from atw_mcp.calls.app import App
from atw_mcp.calls.jobs import Progress
from atw_mcp.fitting.verdict import SETTINGS, is_far_off
from atw_mcp.observation.track_records import TrackRecord, at_rate
from atw_mcp.worlds.rollouts import compute_rollout
from polyworld.data.tracks import without_spread
from polyworld.probing.compare import positions_at
from polyworld.world import World
from polyworld.world.geometry import equivalent_radius, plane_axes


@dataclass(frozen=True)
class ObjectError:
    """Root mean square distance of an object's simulated from its observed centre over `frames` frames.

    radius [m]: of the ball of the object's volume. noise [m]: the median standard deviation stated for its track.
    pixels: None without a camera. unexplained [m]: the error without what the noise along the line of sight explains;
    across [m]: the median standard deviation across it.
    """

    object: str
    metres: float
    pixels: float | None
    radius: float
    noise: float
    frames: int
    unexplained: float
    across: float

    @property
    def follows(self) -> bool:
        """Whether the error is small beside the body, or no larger than measurement explains."""
        return not is_far_off(self.unexplained, float(np.sqrt(3.0)) * self.across, self.radius)

    @property
    def vague(self) -> bool:
        """Whether the body's places are known worse than what contacts hang on."""
        return self.distance_noise > SETTINGS.large * self.radius

    @property
    def distance_noise(self) -> float:
        """Root mean square distance that the noise of its track makes [m], in space."""
        return float(np.sqrt(3.0)) * self.noise

    def to_dict(self) -> dict[str, Any]:
        """Return JSON-ready values."""
        return {
            "object": self.object,
            "error_m": self.metres,
            "error_px": self.pixels,
            "error_over_radius": self.metres / self.radius,
            "error_over_noise": self.metres / self.noise if self.noise > 0.0 else None,
            "frames": self.frames,
        }


def object_errors(
    app: App, world: World, record: TrackRecord, frames: tuple[int, int], progress: Progress
) -> tuple[ObjectError, ...]:
    """Compare a rollout of the world with the tracks in a range of frames; largest error beside the body's size first.

    Planar worlds are compared in their plane, as fits are. Raises ValueError where the rollout ends early.
    """
    step = world.time.seconds_per_frame
    tracks = at_rate(record.tracks, step).window(*frames)
    horizon = step * max(float(np.ceil(tracks.moments[-1] - 1e-9)), 1.0)
    _, result = compute_rollout(app, world, horizon, lambda _: progress.report(progress.done, 1.0))
    if result.status != "completed":
        raise ValueError(f"the world's run {result.why_ended()}")
    trajectory = result.trajectory
    times = np.minimum(tracks.times, trajectory.times[-1])
    rows = np.searchsorted(trajectory.times, times + 1e-9, side="right") - 1
    normal = plane_axes(world.environment.motion_plane)[2]
    found = []
    for item in world.objects:
        if item.name not in tracks.names:
            continue
        column, theirs = trajectory.index(item.name), tracks.index(item.name)
        simulated, observed = positions_at(trajectory, column, times), tracks.positions[:, theirs]
        apart = simulated - observed
        if world.planar:
            apart = apart - np.outer(apart @ normal, normal)
        beyond = apart
        if tracks.position_spread is not None:
            beyond = without_spread(apart, tracks.position_spread[:, theirs])
        known = (tracks.confidence[:, theirs] > 0.0) & trajectory.active[rows, column]
        known &= np.isfinite(apart).all(axis=1)
        if not known.any():
            continue
        pixels = None
        if world.camera is not None:
            shift = world.camera.project(simulated[known]) - world.camera.project(simulated[known] - apart[known])
            pixels = _rms(np.linalg.norm(shift, axis=1))
        found.append(
            ObjectError(
                item.name,
                _rms(np.linalg.norm(apart[known], axis=1)),
                pixels,
                equivalent_radius(item.shape),
                float(np.median(tracks.coordinate_sigma[known, theirs])),
                int(known.sum()),
                _rms(np.linalg.norm(beyond[known], axis=1)),
                float(np.median(tracks.position_sigma[known, theirs])),
            )
        )
    return tuple(sorted(found, key=lambda error: -error.metres / error.radius))


def _rms(distances: np.ndarray[Any, Any]) -> float:
    return float(np.sqrt(np.mean(np.square(distances))))
