"""A study: runs that share constants, each with a world, initial states and measurements of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

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
        """Return the runs of a recording, in each of which the same world moves from a start of its own."""
        runs = []
        for run in recording.runs:
            tracks = run.to_tracks()
            time = {"seconds_per_frame": tracks.seconds_per_frame, "frame_count": int(tracks.frames[-1]) + 1}
            timed = world.model_copy(update={"time": world.time.model_copy(update=time)})
            runs.append(StudyRun(run.name, timed, tracks))
        return cls(tuple(runs))
