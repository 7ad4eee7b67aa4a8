"""Check a recording against its world before anything is fitted: what would make every later result worthless."""

from __future__ import annotations

from dataclasses import dataclass

from polyworld.data.recording import Recording
from polyworld.screening.courses import courses, one_course
from polyworld.screening.finding import Finding
from polyworld.screening.free_fall import fall_findings
from polyworld.screening.grid import constant, quantised
from polyworld.screening.samples import sample_findings
from polyworld.screening.settings import DEFAULT, ScreenSettings
from polyworld.screening.statics import penetrating
from polyworld.screening.time_stamps import repeated, time_findings
from polyworld.screening.tracks import subject
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
    data = subject(world, recording, settings)
    if not data.tracks:
        return Screening((), tuple(range(len(recording.runs))))
    found = [*fall_findings(data)]
    scaled = not found and not data.counts_frames
    found = (found or time_findings(data)) + sample_findings(data, scaled=scaled)
    if scaled and world.observer is None:
        found += penetrating(data)
    found += [*repeated(data), *quantised(data), *constant(data)]
    if not found and not any(t.moves(settings.moved) for t in data.tracks):
        still = "No object moves by more than the noise of its track in any run, so that there is no motion to explain"
        found.append(Finding("at_rest", f"{still}: check the tracks, or add runs with motion."))
    course_of = courses(data)
    found += one_course(course_of)
    return Screening(tuple(sorted(found, key=lambda f: f.severity != "refuse")), course_of)
