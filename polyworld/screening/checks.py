"""Check a recording against its world before anything is fitted: what would make every later result worthless."""

from __future__ import annotations

from dataclasses import dataclass

from polyworld.data.recording import Recording
from polyworld.screening.clearance import penetration_findings
from polyworld.screening.courses import course_findings, courses
from polyworld.screening.finding import Finding
from polyworld.screening.free_fall import common_fall, fall_findings
from polyworld.screening.grid import at_rest, constant_findings, grid_findings, grid_steps
from polyworld.screening.samples import sample_findings
from polyworld.screening.settings import DEFAULT, ScreenSettings
from polyworld.screening.time_stamps import counts_frames, repeat_findings, time_findings
from polyworld.screening.tracks import tracks_of, with_noise
from polyworld.world import World


@dataclass(frozen=True)
class Screening:
    """Findings of the screening of a recording.

    findings: refusals before cautions. course_of: number of each run's course, in the order of the recording's runs;
    runs of one course repeat each other.
    """

    findings: tuple[Finding, ...]
    course_of: tuple[int, ...]

    @property
    def distinct_courses(self) -> int:
        """Number of distinct courses."""
        return len(set(self.course_of))

    @property
    def refused(self) -> bool:
        """Whether going on is all but certainly a waste of time."""
        return any(f.severity == "refuse" for f in self.findings)


def screen(world: World, recording: Recording, settings: ScreenSettings = DEFAULT) -> Screening:
    """Check units, axes, time base, sampling, distinct courses and statics of a recording, without any fit.

    Kinds of findings: units, axes, frame_numbers, milliseconds, rounded_times, irregular_times, few_samples,
    single_run, noisy, coarse_sampling, one_course, quantised, repeated_rows, constant, at_rest, penetration. Only
    positions are checked; markers of deformable objects as far as that needs no shape.
    """
    runs = tuple(r.name for r in recording.runs)
    raw = tracks_of(recording)
    if not raw:
        return Screening((), tuple(range(len(runs))))
    tracks = with_noise(raw, recording, grid_steps(raw, settings))
    fall = common_fall(world, tracks, settings)
    found = fall_findings(world, tracks, fall, settings) if fall is not None else []
    scaled = not found and not counts_frames(tracks, settings)
    if not found:
        found += time_findings(tracks, settings)
    found += sample_findings(world, recording, tracks, settings, scaled=scaled)
    if scaled and world.observer is None:
        found += penetration_findings(world, tracks, settings)
    found += [
        *repeat_findings(tracks, settings),
        *grid_findings(tracks, settings),
        *constant_findings(tracks, settings),
    ]
    if not found and not any(t.moves(settings.moved) for t in tracks):
        found.append(at_rest())
    course_of = courses(runs, tracks, settings)
    found += course_findings(runs, course_of)
    found.sort(key=lambda f: f.severity != "refuse")
    return Screening(tuple(found), course_of)
