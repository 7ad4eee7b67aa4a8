"""The gap workflow on one page: find where a world disagrees with measurements, name what is missing, and prove it.

runs that behave unlike the rest are set aside and reported        outlying
the base is fitted, effects are searched for                       searching
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

from polyworld.estimation.candidate import Candidate
from polyworld.estimation.criteria import extended_bic
from polyworld.estimation.design import design
from polyworld.estimation.intervals import intervals95
from polyworld.estimation.parts import in_parts, of_whole_runs
from polyworld.estimation.trial import FittedHypothesis
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue import catalogue
from polyworld.gap.cautions import cautions
from polyworld.gap.clock import Clock, TimeLimitReached
from polyworld.gap.decide import Check, Graded, Kind, grade, lowered, names_of, widened
from polyworld.gap.experiment import Contender, propose_experiment
from polyworld.gap.held_out import HeldOutGap, held_out_gap
from polyworld.gap.null_control import NullControl, simulated_recording
from polyworld.gap.outlying import (
    OutlyingRun,
    bearing_run,
    event_runs,
    explained_runs,
    misfitting_runs,
    without_runs,
)
from polyworld.gap.remainder import Remainder, remainder_of
from polyworld.gap.report import GapReport
from polyworld.gap.searching import Searched, Story, search_effects
from polyworld.gap.settings import DecisionSettings, OutlierSettings, SearchSettings, SymbolicSettings
from polyworld.gap.single_coordinate import follows_one_course
from polyworld.gap.stability import gain_with_error
from polyworld.gap.stepping import coarsened
from polyworld.gap.symbolic import ResidualForce, describe_unexplained, law_ebic
from polyworld.gap.verdict import Verdict
from polyworld.recording import Recording
from polyworld.screening import Screening, screen
from polyworld.world import World

Array = NDArray[np.float64]

# What happens at one place or in one run and may be an effect of the catalogue rather than an outlying run.
LOCAL = ("hidden_wall", "hidden_body", "dropped_frames")
SIMPLER = 2.0  # by how much BIC has to prefer one law outside the catalogue to several effects of it


@dataclass(frozen=True)
class GapSettings:
    """How the gap is looked for.

    search: how widely. decision, outliers: when a name is given, and a run set aside. symbolic: how the law of an
    unexplained force is sought. alarm: by how much an effect must lower the extended BIC to be looked into although the
    base explains the data. null_control: whether the procedure is repeated on data simulated from the base world.
    experiment: whether the experiment that would decide is sought where the verdict is ambiguous. residual_force:
    whether a law is sought for what stays unexplained. time_limit [s]: after which the search ends with the best
    verdict so far. refuse: whether recordings whose units, axes or time base are all but certainly not what they are
    taken for are refused with ValueError. seed: of the null control, of resampling.
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
    cancelled: Callable[[], bool] | None = None,
) -> GapReport:
    """Find what a world lacks to explain a recording.

    base: unknowns that are fitted in every hypothesis. candidates: effects to choose from, default the whole
    catalogue. held_out: data that no step sees before the verdict, which they can only lower. held_out_world: gives a
    world as it is where these begin, if that is later than where the fitted runs do. progress: called with the share
    done (0 to 1) and the step. cancelled: asked between batches; where it is true `InterruptedError` is raised. Raises
    ValueError where the recording does not fit the world.
    """
    settings = settings or GapSettings()
    chosen = tuple(catalogue().values()) if candidates is None else tuple(candidates)
    clock, story = Clock(settings.time_limit, cancelled), Story(progress)
    work = _Work(world, tuple(base), chosen, settings, story, clock)

    screening = screen(world, recording)
    if settings.refuse and screening.refused:
        raise ValueError(" ".join(f.message for f in screening.findings if f.severity == "refuse"))
    aside, found = _search_without_outliers(work, recording)
    if clock.over:
        found = replace(found, limited=True)
    clock.lift()  # the judgement of what was fitted is not cut short
    verdict, graded = _decide(work, found, _courses(screening, recording, found))
    best = verdict.best
    bench, ground = found.bench, found.ground
    intervals = intervals95(bench, best if best is not None else ground)
    if graded is not None and verdict.kind == "identified_with_remainder" and best is not None:
        intervals = widened(best.hypothesis.unknowns, intervals, graded, best)
    kept = bench.design.recording
    child = of_whole_runs(_fitted_world(best, world), without_runs(recording, [o.run for o in aside]), kept)
    child_or_none = child if best is not None else None
    story.tell(0.8, "verdict", {"verdict": verdict.kind, "best": best.hypothesis.title if best else "base"})

    remainder = _remainder(found, verdict, graded)
    verdict, force, child_or_none = _residual_force(work, found, verdict, remainder, child_or_none)
    gap = _proof(work, found, child_or_none, held_out, held_out_world or _as_it_is)
    null = _null_control(work, found, best) if settings.null_control and not found.limited else None
    checks = _checks(found, verdict, graded, gap, null, held_out, settings.decision)
    verdict = replace(verdict, kind=lowered(verdict.kind, checks))
    experiment = _experiment(work, found, verdict)
    story.tell(1.0, "done", {"rollouts": bench.rollouts})
    return GapReport(
        verdict=verdict,
        bench=bench,
        base=ground,
        intervals=intervals,
        world=child_or_none,
        held_out=gap,
        null=null,
        experiment=experiment,
        residual_force=force.to_json() if force is not None else None,
        near_misses=found.near_misses,
        cautions=(
            *(f.message for f in screening.findings),
            *cautions(bench.design),
            *_unsupported(verdict, gap),
        ),
        history=tuple(story.steps),
        set_aside=aside,
        checks=tuple(checks),
        graded=graded,
        plain=found.plain,
        remainder=remainder,
        limited=settings.time_limit if found.limited else None,
    )


@dataclass(frozen=True)
class Decided(Verdict):
    """The verdict, once."""

    kind: Kind  # type: ignore[assignment]


@dataclass(frozen=True)
class _Work:
    """What all steps of one search share."""

    world: World
    base: tuple[Unknown, ...]
    candidates: tuple[Candidate, ...]
    settings: GapSettings
    story: Story
    clock: Clock

    def search(self, recording: Recording, candidates: tuple[Candidate, ...], most: int, spare: int = 0) -> Searched:
        """Search a recording for up to so many effects; it ends early where up to `spare` runs are to be set aside."""
        cut = in_parts(recording, self.world)
        plan = design(coarsened(self.world, cut), cut)
        wide = replace(self.settings.search, max_effects=min(most, self.settings.search.max_effects))

        def outliers(trials: Sequence[FittedHypothesis]) -> tuple[OutlyingRun, ...]:
            return misfitting_runs(trials, spare, self.settings.outliers) if spare > 0 else ()

        return search_effects(
            plan,
            self.world.time.substep,
            self.base,
            candidates,
            wide,
            self.settings.alarm,
            self.story,
            self.clock,
            outliers,
        )


def _courses(screening: Screening, recording: Recording, found: Searched) -> int:
    """Number of distinct courses among the runs that are fitted; parts of one long run differ as courses do."""
    kept = {r.run.part_of or r.run.name for r in found.bench.design.runs}
    if len(kept) == 1:
        return len(found.bench.design.runs)
    of_kept = {c for c, run in zip(screening.course_of, recording.runs, strict=True) if run.name in kept}
    return len(of_kept)


def _search_without_outliers(work: _Work, recording: Recording) -> tuple[tuple[OutlyingRun, ...], Searched]:
    """Search for effects, runs that behave unlike the rest set aside; what they show may be an effect after all."""
    most = work.settings.search.max_effects
    room = int(work.settings.outliers.most * len(recording.runs))
    aside: tuple[OutlyingRun, ...] = ()
    found: Searched | None = None
    try:
        aside = event_runs(work.world, recording, work.settings.outliers, work.clock) if room else ()
        while True:
            if aside:
                work.story.tell(work.story.share, "outlying runs", {"runs": [o.to_json() for o in aside]})
            kept = without_runs(recording, [o.run for o in aside])
            found = work.search(kept, work.candidates, most, room - len(aside))
            further = found.outlying or (_bearing(work, found) if len(aside) < room else ())
            if not further:
                break
            aside = (*aside, *further)
        best = found.verdict.best
        if aside and best is not None and found.verdict.kind != "unexplained" and not found.limited:
            explained = explained_runs(best, recording.select(tuple(o.run for o in aside)), work.settings.outliers)
            if explained:  # what they show is the effect that was found
                left = tuple(o for o in aside if o.run not in explained)
                found = work.search(without_runs(recording, [o.run for o in left]), work.candidates, most)
                aside = left
        if aside and found.verdict.kind == "nothing_missing" and not found.limited:
            local = tuple(c for c in work.candidates if c.name in LOCAL)
            whole = work.search(recording, local, 1) if local else None
            if whole is not None and whole.verdict.kind in ("identified", "ambiguous", "nothing_missing"):
                return (), whole
    except TimeLimitReached:
        work.clock.lift()
        if found is None:
            raise InterruptedError(
                f"the time limit of {work.settings.time_limit:g} s passed before the world was fitted: allow more"
            ) from None
        kept_names = {r.run.part_of or r.run.name for r in found.bench.design.runs}
        return tuple(o for o in aside if o.run not in kept_names), replace(found, limited=True)
    return aside, found


def _bearing(work: _Work, found: Searched) -> tuple[OutlyingRun, ...]:
    """The run on which alone the effects that were found rest."""
    named = found.verdict.best
    if found.limited or found.verdict.kind not in ("identified", "ambiguous") or named is None:
        return ()
    if set(named.hypothesis.names) & set(LOCAL):
        return ()
    alone = bearing_run(found.ground, named, work.settings.outliers, work.settings.decision.decisive)
    return () if alone is None else (alone,)


def _decide(work: _Work, found: Searched, courses: int) -> tuple[Decided, Graded | None]:
    """Decide names: of hypotheses that leave only noise, else with model error admitted."""
    v = found.verdict
    verdict = Decided(v.kind, v.best, v.credible, v.runner_up, v.forms)
    if v.kind != "unexplained" or not found.pool:
        return verdict, None
    graded = grade(found.ground, found.pool, courses, work.settings.decision, work.settings.seed)
    if graded.leader is not None:
        return replace(verdict, kind="identified_with_remainder", best=graded.leader, credible=(graded.leader,)), graded
    if graded.alternatives:
        return replace(verdict, kind="ambiguous", best=graded.alternatives[0], credible=graded.alternatives), graded
    return verdict, graded


def _residual_force(
    work: _Work, found: Searched, verdict: Decided, remainder: Remainder | None, child: World | None
) -> tuple[Decided, ResidualForce | None, World | None]:
    """Seek the law of what no effect explains, and of a remainder larger than the noise; a single law may also be
    simpler than several effects."""
    best = verdict.best
    several = (
        verdict.kind in ("identified", "ambiguous")
        and best is not None
        and len(best.hypothesis.parts) > 1
        and not follows_one_course(found.bench.design)
    )
    large = verdict.kind == "identified_with_remainder" and remainder is not None
    large = large and remainder is not None and remainder.beyond_noise > remainder.noise
    unexplained = verdict.kind == "unexplained" or large
    if found.limited or not work.settings.residual_force or not (unexplained or several):
        return verdict, None, child
    symbolic = work.settings.symbolic if unexplained else replace(work.settings.symbolic, max_terms=1)
    force = describe_unexplained(found.ground, best if unexplained else None, found.near, symbolic)
    if not unexplained:
        assert best is not None
        if not _simpler(force, found.ground, best):
            return verdict, None, child
        verdict = replace(verdict, kind="unexplained", credible=(), forms=())
    if force.explains and force.world is not None:
        child = force.world.with_substep(work.world.time.substep)
    work.story.tell(0.82, "residual force", {"found": force.expression, "explains": force.explains})
    return verdict, force, child


def _simpler(force: ResidualForce, ground: FittedHypothesis, best: FittedHypothesis) -> bool:
    """Whether one law outside the catalogue explains the data better for its unknowns than several effects together.

    Effects of the catalogue added up can mimic a law that is not in it; their sum is then no name for it.
    """
    if not force.explains or force.world is None:
        return False
    effects = extended_bic(best.chi2, best.hypothesis.extra, best.bench.observations, 0, 1)
    return law_ebic(force, ground) < effects - SIMPLER


def _as_it_is(world: World) -> World:
    return world


def _proof(
    work: _Work, found: Searched, child: World | None, held_out: Recording | None, begins: Callable[[World], World]
) -> HeldOutGap | None:
    """Hold the decision against the held-out data."""
    if held_out is None:
        return None
    before = _fitted_world(found.ground, work.world)
    after = child if child is not None else before
    gap = held_out_gap(begins(before), begins(after), held_out, found.bench.noise)
    work.story.tell(0.85, "sealed data", gap.to_dict())
    return gap


def _null_control(work: _Work, found: Searched, best: FittedHypothesis | None) -> NullControl:
    """Repeat the search on data simulated from the base world, with its noise: nothing is missing there."""
    ground, bench = found.ground, found.bench
    states = best.fit.states if best is not None else ground.fit.states
    made = simulated_recording(bench.forward(ground.hypothesis), ground.values, states, bench.noise, work.settings.seed)
    quiet = replace(work, story=Story(None), base=ground.hypothesis.base, world=bench.design.world)
    again = quiet.search(made, work.candidates, work.settings.search.max_effects)
    after: float | None = None
    if best is not None:
        added = [u.start for u in best.hypothesis.unknowns[len(ground.values) :]]
        values = np.concatenate([again.ground.values, added])
        # Places and frequencies stay as found: where the strength is nothing, they could not be determined.
        after = again.bench.fit(best.hypothesis, values, again.ground.fit.states).chi2
    control = NullControl(
        again.verdict.kind, again.ground.chi2, after, int(again.bench.observations), work.settings.seed
    )
    work.story.tell(0.95, "null control", control.to_dict())
    return control


def _checks(
    found: Searched,
    verdict: Decided,
    graded: Graded | None,
    gap: HeldOutGap | None,
    null: NullControl | None,
    held_out: Recording | None,
    settings: DecisionSettings,
) -> list[Check]:
    """Collect what the program itself holds against a name."""
    if verdict.kind not in ("identified", "identified_with_remainder"):
        return []
    checks = []
    if not found.rivals_fitted:
        checks.append(Check("time_limit", "the time ran out before every effect in question was fitted"))
    if null is not None and null.verdict not in ("nothing_missing",):
        checks.append(Check("null_control", f"the same search names effects ({null.verdict}) where none is missing"))
    if verdict.best is not None and "dropped_frames" in verdict.best.hypothesis.names:
        return checks  # no other run can bear out what happened in one
    if gap is not None and gap.gap_after**2 > gap.gap_before**2 + gap.noise_floor**2:  # by more than the noise
        checks.append(
            Check("held_out", f"sealed data get worse: {gap.gap_before:.3g} -> {gap.gap_after:.3g} {gap.unit}")
        )
    elif gap is not None and verdict.kind == "identified" and gap.contradicts is not None:
        checks.append(Check("held_out_remainder", gap.contradicts))
    other = verdict.runner_up
    if verdict.kind == "identified" and other is not None and verdict.best is not None:
        further = not set(names_of(verdict.best)) <= set(names_of(other.trial))
        if further and other.ebic_behind < settings.reach:
            names = " + ".join(names_of(other.trial))
            checks.append(Check("runner_up", f"{names} is only {other.ebic_behind:.2g} behind in the extended BIC"))
    if held_out is None and graded is None and not _predicted(found, verdict, settings):
        runs = len(found.bench.design.runs)
        parts = "later parts" if runs == 1 else "the other runs"
        checks.append(
            Check("nothing_held_out", f"nothing was held out, and {parts} are not predicted decisively better")
        )
    return checks


def _predicted(found: Searched, verdict: Decided, settings: DecisionSettings) -> bool:
    """Whether the effects named predict each run from the others, or later parts of the only run from earlier ones."""
    if verdict.best is None:
        return False
    gain, error = gain_with_error(verdict.best.held_out, found.ground.held_out)
    folds = len(verdict.best.held_out)
    return folds > 1 and gain * folds > settings.decisive and gain > settings.clearly * error


def _unsupported(verdict: Decided, gap: HeldOutGap | None) -> tuple[str, ...]:
    """What held-out data say against a world in which nothing is missing."""
    found = gap.contradicts if gap is not None and verdict.kind == "nothing_missing" else None
    return () if found is None else (found,)


def _experiment(work: _Work, found: Searched, verdict: Decided) -> dict[str, object] | None:
    """Seek the experiment that would decide between what stands side by side."""
    # What is a run's own predicts no other run.
    of_runs = any(u.run is not None for t in verdict.credible for u in t.hypothesis.unknowns)
    if not work.settings.experiment or found.limited or verdict.kind != "ambiguous" or of_runs:
        return None
    if len(verdict.credible) < 2:
        return None
    contenders = [
        Contender(t.hypothesis.names, t.hypothesis.world, t.hypothesis.unknowns, t.values, t.fit.covariance)
        for t in verdict.credible
    ]
    sought = propose_experiment(found.bench.design, found.bench.noise, contenders)
    work.story.tell(0.98, "experiment", {"found": sought is not None})
    return sought.to_dict() if sought is not None else None


def _remainder(found: Searched, verdict: Decided, graded: Graded | None) -> Remainder | None:
    """Describe what the answer leaves undone, where it leaves more than noise."""
    if graded is None:
        return None
    trial = verdict.best if verdict.best is not None else found.ground
    return remainder_of(trial, found.ground)


def _fitted_world(trial: FittedHypothesis | None, world: World) -> World:
    """The fitted world, stepped as the world that was given, or finer where only that explained the data."""
    if trial is None:
        return world
    steps = min(world.time.substep, trial.hypothesis.world.time.substep)
    return trial.hypothesis.fitted_world(trial.values).with_substep(steps)
