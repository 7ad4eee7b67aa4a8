"""A study: runs that share constants, each with a world, initial states and measurements of its own."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from polyworld.data.initial_states import first_value
from polyworld.data.recording import Recording
from polyworld.data.tracks import ObservedTracks
from polyworld.world import World


@dataclass(frozen=True)
class StudyRun:
    """One run: a clip, or a recording. world: what moves in it, at the run's time base; tracks: what was measured."""

    name: str
    world: World
    tracks: ObservedTracks


@dataclass(frozen=True)
class Study:
    """Runs whose constants are tied: by material where `Appearance.material` states one, else by object."""

    runs: tuple[StudyRun, ...]

    def __post_init__(self) -> None:
        if not self.runs:
            raise ValueError("a study needs at least one run")
        names = [run.name for run in self.runs]
        repeated = sorted({n for n in names if names.count(n) > 1})
        if repeated:
            raise ValueError(f"names of runs must be unique; repeated: {repeated}")
        if len({run.world.planar for run in self.runs}) > 1:
            raise ValueError(
                "runs of a study must be all planar or all spatial: BuildWorld(representation=...) builds them alike"
            )

    @classmethod
    def of(cls, world: World, recording: Recording) -> Self:
        """Return the runs of a recording, in each of which the same world moves from a start of its own.

        Along axes of which nothing was measured bodies are where the world has them. They start with the first of the
        spins that were measured. An angle moves two coordinates, which count half each.
        """
        runs = []
        for run in recording.runs:
            positions, objects = run.positions.copy(), []
            for item in world.objects:
                if item.name in run.names:
                    column = run.names.index(item.name)
                    known = np.isfinite(positions[:, column])
                    never = known.any(axis=1, keepdims=True) & ~known.any(axis=0, keepdims=True)
                    positions[:, column] = np.where(never, item.position, positions[:, column])
                    spin = np.array([first_value(run.times, v) for v in run.angular_velocities[:, column].T])
                    spin = np.where(np.isfinite(spin), spin, item.angular_velocity)
                    item = item.model_copy(update={"angular_velocity": tuple(spin.tolist())})
                objects.append(item)
            tracks = replace(run, positions=positions).to_tracks()
            tracks = replace(tracks, confidence=tracks.confidence * np.where(np.isfinite(run.arms), 0.5, 1.0))
            time = {"seconds_per_frame": tracks.seconds_per_frame, "frame_count": int(tracks.frames[-1]) + 1}
            timed = {"objects": tuple(objects), "time": world.time.model_copy(update=time)}
            runs.append(StudyRun(run.name, world.model_copy(update=timed), tracks))
        return cls(tuple(runs))
