"""The gap workflow on one page: find where a world disagrees with measurements, name what is missing, and prove it.

runs that behave unlike the rest are set aside and reported        outlying
the base is fitted, effects are searched for                       search_loop
names are decided: evidence, stability over runs, model error      decide
the decision is held against data that no step has seen            prove
the program's own checks lower what they contradict                decide
what remains is described                                          remainder
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from polyworld.data.recording import Recording
from polyworld.estimation.candidate import Candidate
from polyworld.estimation.fit_context import Fitted, FittedHypothesis
from polyworld.estimation.intervals import intervals95
from polyworld.estimation.run_segments import of_whole_runs
from polyworld.estimation.unknown import Unknown
from polyworld.gap import ebic
from polyworld.gap.catalogue import catalogue
from polyworld.gap.cautions import cautions
from polyworld.gap.checks import contradictions, lowered
from polyworld.gap.clock import Clock
from polyworld.gap.decide import Verdict, decide
from polyworld.gap.experiment import Contender, propose_experiment
from polyworld.gap.held_out import HeldOutGap, held_out_gap
from polyworld.gap.null_control import NullControl, simulated_recording
from polyworld.gap.outlying import without_runs
from polyworld.gap.remainder import Remainder, remainder_of
from polyworld.gap.report import GapReport
from polyworld.gap.search_loop import Searched, Story
from polyworld.gap.set_aside import Work, search_without_outliers
from polyworld.gap.settings import DecisionSettings, OutlierSettings, SearchSettings, SymbolicSettings
from polyworld.gap.single_coordinate import is_single_coordinate
from polyworld.gap.stability import widened
from polyworld.gap.symbolic import ResidualForce, describe_unexplained, law_bic
from polyworld.screening import Screening, screen
from polyworld.world import World

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GapSettings:
    """Settings of the search for the gap.

    search: how widely. decision, outliers: when a name is given, and a run set aside. symbolic: how a residual force is
    sought. alarm: by how much an effect must lower the extended BIC to be looked into although the base explains the
    data. null_control: whether the procedure is repeated on data simulated from the base world. experiment: whether the
    experiment that would decide is sought where the verdict is ambiguous. residual_force: whether a law is sought for
    what stays unexplained. time_limit [s]: after which the search ends with the best verdict so far. refuse: whether
    recordings whose units, axes or time base are all but certainly not what they are taken for are refused with
    ValueError. seed: of the null control, of resampling.
    """

    search: SearchSettings = field(default_factory=SearchSettings)
    decision: DecisionSettings = field(default_factory=DecisionSettings)
    outliers: OutlierSettings = field(default_factory=OutlierSettings)
    symbolic: SymbolicSettings = field(default_factory=SymbolicSettings)
    alarm: float = 10.0
    null_control: bool = True
    experiment: bool = True
    residual_force: bool = True
    time_limit: float | None = None
    refuse: bool = False
    seed: int = 0


def find_gap(
    world: World,
    recording: Recording,
    *,
    held_out: Recording | None = None,
    held_out_world: Callable[[World], World] | None = None,
    base: Sequence[Unknown] = (),
    candidates: Sequence[Candidate] | None = None,
    settings: GapSettings | None = None,
    progress: Callable[[float, str], None] | None = None,
    fitted: Fitted | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> GapReport:
    """Find what a world lacks to explain a recording.

    base: unknowns that are fitted in every hypothesis. candidates: effects to choose from, default the whole
    catalogue. held_out: data that no step sees before the verdict, which they can only lower. held_out_world: gives a
    world as it is where these begin, if that is later than where the fitted runs do. progress: called with the share
    done (0 to 1) and the step. fitted: called with each fit to these data. cancelled: asked between batches; where it
    is true `InterruptedError` is raised. Raises ValueError where the recording does not fit the world.
    """
    settings = settings or GapSettings()
    clock, story = Clock(settings.time_limit, cancelled), Story(progress, fitted)
    work = Work(
        world,
        tuple(base),
        tuple(catalogue().values()) if candidates is None else tuple(candidates),
        settings.search,
        settings.outliers,
        settings.decision,
        settings.alarm,
        story,
        clock,
    )
    screening = screen(world, recording)
    if settings.refuse and screening.refused:
        raise ValueError(" ".join(f.message for f in screening.findings if f.severity == "refuse"))
    aside, found = search_without_outliers(work, recording)
    if clock.over:
        found = replace(found, limited=True)
    clock.lift()  # the judgement of what was fitted is not cut short

    motions = _distinct_motions(screening, recording, found)
    verdict = decide(found.verdict, found.ground, found.pool, motions, settings.decision, settings.seed)
    best, context, ground = verdict.best, found.context, found.ground
    intervals = intervals95(context, best or ground)
    if verdict.kind == "identified_with_remainder" and verdict.stability is not None and best is not None:
        intervals = widened(intervals, best, verdict.stability.error)
    child: World | None = None
    if best is not None:
        whole = without_runs(recording, [o.run for o in aside])
        child = of_whole_runs(_fitted_world(best, world), whole, context.design.recording)
    story.report(0.8, "verdict", {"verdict": verdict.kind, "best": best.hypothesis.title if best else "base"})

    remainder = None if verdict.stability is None else remainder_of(best or ground, ground)
    force: ResidualForce | None = None
    if settings.residual_force and not found.limited:
        verdict, force, child = _residual_force(work, settings.symbolic, found, verdict, remainder, child)
    gap = _check_held_out(work, found, child, held_out, held_out_world or _as_it_is)
    null = _null_control(work, found, best, settings.seed) if settings.null_control and not found.limited else None
    checks = contradictions(found, verdict, gap, null, settings.decision)
    verdict = replace(verdict, kind=lowered(verdict.kind, checks))
    experiment = _experiment(story, found, verdict) if settings.experiment and not found.limited else None
    story.report(1.0, "done", {"rollouts": context.rollouts})
    return GapReport(
        verdict=verdict,
        context=context,
        base=ground,
        intervals=intervals,
        world=child,
        held_out=gap,
        null=null,
        experiment=experiment,
        residual_force=force.to_json() if force is not None else None,
        near_misses=found.near_misses,
        cautions=(*(f.message for f in screening.findings), *cautions(context.design)),
        history=tuple(story.steps),
        set_aside=aside,
        checks=tuple(checks),
        plain=found.plain,
        remainder=remainder,
        limited=settings.time_limit if found.limited else None,
    )


def _distinct_motions(screening: Screening, recording: Recording, found: Searched) -> int:
    """Count distinct motions among the fitted runs; segments of one long run count as distinct."""
    kept = {r.run.part_of or r.run.name for r in found.context.design.runs}
    if len(kept) == 1:
        return len(found.context.design.runs)
    of_kept = {c for c, run in zip(screening.course_of, recording.runs, strict=True) if run.name in kept}
    return len(of_kept)


def _residual_force(
    work: Work,
    settings: SymbolicSettings,
    found: Searched,
    verdict: Verdict,
    remainder: Remainder | None,
    child: World | None,
) -> tuple[Verdict, ResidualForce | None, World | None]:
    """Seek the law of what no effect explains, and of a remainder larger than the noise; a single law may also be
    simpler than several effects."""
    best = verdict.best
    several = (
        verdict.kind in ("identified", "ambiguous")
        and best is not None
        and all(len(t.hypothesis.parts) > 1 for t in verdict.credible)
        and not is_single_coordinate(found.context.design)
    )
    large = verdict.kind == "identified_with_remainder" and remainder is not None
    large = large and remainder is not None and remainder.beyond_noise > remainder.noise
    unexplained = verdict.kind == "unexplained" or large
    if not (unexplained or several):
        return verdict, None, child
    symbolic = settings if unexplained else replace(settings, max_terms=1)
    force = describe_unexplained(found.ground, best if unexplained else None, found.near, symbolic)
    if not unexplained:
        assert best is not None
        if not _single_law_preferred(force, found.ground, best, work.decision.reach):
            return verdict, None, child
        if all(p.candidate.plain for p in best.hypothesis.parts):  # both are laws one would expect
            verdict = replace(verdict, kind="ambiguous", credible=(best,), forms=())
        else:
            verdict = replace(verdict, kind="unexplained", credible=(), forms=())
    if force.explains and force.world is not None:
        child = force.world.with_substep(work.world.time.substep)
    work.story.report(0.82, "residual force", {"found": force.expression, "explains": force.explains})
    return verdict, force, child


def _single_law_preferred(force: ResidualForce, ground: FittedHypothesis, best: FittedHypothesis, by: float) -> bool:
    """Return whether one law outside the catalogue explains the data better for its unknowns than several effects
    together.

    Effects of the catalogue added up can mimic a law that is not in it; their sum is then no name for it.
    """
    if not force.explains or force.world is None:
        return False
    return law_bic(force, ground) < ebic.bic(best.chi2, best.hypothesis.extra, best.context) - by


def _as_it_is(world: World) -> World:
    return world


def _check_held_out(
    work: Work, found: Searched, child: World | None, held_out: Recording | None, begins: Callable[[World], World]
) -> HeldOutGap | None:
    """Test the decision on the held-out data."""
    if held_out is None:
        return None
    before = _fitted_world(found.ground, work.world)
    after = child if child is not None else before
    gap = held_out_gap(begins(before), begins(after), held_out, found.context.noise)
    work.story.report(0.85, "sealed data", gap.to_dict())
    return gap


def _null_control(work: Work, found: Searched, best: FittedHypothesis | None, seed: int) -> NullControl:
    """Repeat the search on data simulated from the base world, with its noise: nothing is missing there."""
    ground, context = found.ground, found.context
    states = best.fit.states if best is not None else ground.fit.states
    made = simulated_recording(context.forward(ground.hypothesis), ground.values, states, context.noise, seed)
    quiet = replace(work, story=Story(None), base=ground.hypothesis.base, world=context.design.world)
    again = quiet.search(made, work.candidates)
    after: float | None = None
    if best is not None:
        added = [u.start for u in best.hypothesis.unknowns[len(ground.values) :]]
        values = np.concatenate([again.ground.values, added])
        # Places and frequencies stay as found: where the strength is nothing, they could not be determined.
        after = again.context.fit(best.hypothesis, values, again.ground.fit.states).chi2
    control = NullControl(again.verdict.kind, again.ground.chi2, after, int(again.context.observations), seed)
    work.story.report(0.95, "null control", control.to_dict())
    return control


def _experiment(story: Story, found: Searched, verdict: Verdict) -> dict[str, object] | None:
    """Seek the experiment that would decide between what stands side by side."""
    # What is a run's own predicts no other run.
    of_runs = any(u.run is not None for t in verdict.credible for u in t.hypothesis.unknowns)
    if verdict.kind != "ambiguous" or len(verdict.credible) < 2 or of_runs:
        return None
    contenders = [
        Contender(t.hypothesis.names, t.hypothesis.world, t.hypothesis.unknowns, t.values, t.fit.covariance)
        for t in verdict.credible
    ]
    sought = propose_experiment(found.context.design, found.context.noise, contenders)
    story.report(0.98, "experiment", {"found": sought is not None})
    return sought.to_dict() if sought is not None else None


def _fitted_world(trial: FittedHypothesis | None, world: World) -> World:
    """Return the fitted world, stepped as the world that was given, or finer where only that explained the data."""
    if trial is None:
        return world
    steps = min(world.time.substep, trial.hypothesis.world.time.substep)
    return trial.hypothesis.fitted_world(trial.values).with_substep(steps)
