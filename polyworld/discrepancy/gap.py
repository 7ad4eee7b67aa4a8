"""From a world and a recording to the missing effect: the whole procedure in one call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.discrepancy.candidate import Candidate, Unknown
from polyworld.discrepancy.catalogue import catalogue
from polyworld.discrepancy.cautions import cautions
from polyworld.discrepancy.criteria import extended_bic
from polyworld.discrepancy.described import described, law_ebic
from polyworld.discrepancy.design import Design, design
from polyworld.discrepancy.examine import LEFT, fitted_base, refitted
from polyworld.discrepancy.experiment import Contender, propose_experiment
from polyworld.discrepancy.intervals import intervals95
from polyworld.discrepancy.noise import Noise, refined_noise
from polyworld.discrepancy.one_course import BESIDE, follows_one_course, rivals
from polyworld.discrepancy.parents import nearest
from polyworld.discrepancy.parts import halved, in_parts, of_whole_runs
from polyworld.discrepancy.report import GapReport
from polyworld.discrepancy.rivals import fit_rivals
from polyworld.discrepancy.seal import NullControl, SealedGap, sealed_gap, simulated_recording
from polyworld.discrepancy.search import Search, SearchSettings
from polyworld.discrepancy.simpler import put_simpler
from polyworld.discrepancy.stepping import coarsened
from polyworld.discrepancy.trial import FINEST, Bench, Trial, refined
from polyworld.discrepancy.twins import fit_twins
from polyworld.discrepancy.unexplained import MAX_TERMS, Near, ResidualForce
from polyworld.discrepancy.verdict import Verdict, beside_fewer, decide
from polyworld.recording import Recording
from polyworld.world import World

Array = NDArray[np.float64]

LEVEL_CHANGED = 0.1  # relative change of a noise level that calls for further fits
CORRELATION_CHANGED = 0.05  # the same of the correlation from sample to sample
STEPS_BLAMED = 1.5  # chi2 per measurement, up to which long steps may be why a base fails
PLAINLY = 2  # effects beyond which a further one is sought only where one comes near to the data (`Search.foreseen`)
AGAIN = 3  # effects that better a base that passes, from whose initial states it is fitted again
SIMPLER = 2.0  # by how much BIC has to prefer one law outside the catalogue to several effects of it
KEPT_CHANGED = 0.002  # the same of the share of outliers


@dataclass(frozen=True)
class GapSettings:
    """How the gap is looked for.

    search: how widely. alarm: by how much an effect must lower EBIC to be looked into although the base passes the
    gate. null_control: whether the procedure is repeated on data made from the base world. experiment: whether the
    experiment that would decide is sought where the verdict is ambiguous. residual_force: whether a law is sought for
    what stays unexplained. seed: of the null control.
    """

    search: SearchSettings = field(default_factory=SearchSettings)
    alarm: float = 10.0
    null_control: bool = True
    experiment: bool = True
    residual_force: bool = True
    seed: int = 0


def find_gap(
    world: World,
    recording: Recording,
    *,
    sealed: Recording | None = None,
    base: Sequence[Unknown] = (),
    candidates: Sequence[Candidate] | None = None,
    settings: GapSettings | None = None,
    progress: Callable[[float, str], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> GapReport:
    """Find what a world lacks to explain a recording.

    base: unknowns that are fitted in every hypothesis. candidates: effects to choose from, default the whole
    catalogue. sealed: data that no step sees before the end. progress: told the share done (0 to 1) and the step.
    cancelled: asked between batches; where it says so `InterruptedError` is raised. Raises ValueError where the
    recording does not fit the world.
    """
    settings = settings or GapSettings()
    cut = in_parts(recording, world)
    chosen = tuple(catalogue().values()) if candidates is None else tuple(candidates)
    story = _Story(progress)
    plan = design(coarsened(world, cut), cut)
    search = _searched(plan, world.time.substep, tuple(base), chosen, settings, story, cancelled)
    plan = search.bench.design
    cut = plan.recording
    verdict, bench, ground = search.verdict, search.bench, search.ground
    best = verdict.best
    intervals = intervals95(bench, best if best is not None else ground)
    story.tell(0.8, "verdict", {"verdict": verdict.kind, "best": best.hypothesis.title if best else "base"})
    child = of_whole_runs(_told_world(best, world), recording, cut) if best is not None else None
    force: ResidualForce | None = None
    several = best is not None and len(best.hypothesis.parts) > 1 and not follows_one_course(plan)
    if settings.residual_force and (verdict.kind == "unexplained" or several):
        # Beside several effects only one law that says it all is of interest.
        terms = 1 if verdict.kind != "unexplained" else MAX_TERMS
        nearest = best if verdict.kind == "unexplained" else None
        force = described(ground, nearest, search.near, most_terms=terms, cancelled=cancelled)
        if best is not None and verdict.kind != "unexplained":
            if _simpler(force, ground, best):
                verdict = Verdict("unexplained", best, (), verdict.runner_up)
            else:
                force = None
    if force is not None:
        if force.explains and force.world is not None:
            child = force.world.with_substep(world.time.substep)
        story.tell(0.82, "residual force", {"found": force.expression, "explains": force.explains})
    gap: SealedGap | None = None
    if sealed is not None:
        before = _told_world(ground, world)
        gap = sealed_gap(before, child if child is not None else before, sealed)
        story.tell(0.85, "sealed data", gap.to_dict())
    null: NullControl | None = None
    if settings.null_control:
        null = _null_control(search, world.time.substep, chosen, settings, cancelled)
        story.tell(0.95, "null control", null.to_dict())
    experiment = None
    of_runs = any(u.run is not None for t in verdict.credible for u in t.hypothesis.unknowns)
    if settings.experiment and verdict.kind == "ambiguous" and not of_runs:  # what is a run's own foretells no other
        found = propose_experiment(plan, bench.noise, [_contender(t) for t in verdict.credible])
        experiment = found.to_dict() if found is not None else None
        story.tell(0.98, "experiment", {"found": found is not None})
    story.tell(1.0, "done", {"rollouts": bench.rollouts})
    return GapReport(
        verdict=verdict,
        bench=bench,
        base=ground,
        intervals=intervals,
        world=child,
        sealed=gap,
        null=null,
        experiment=experiment,
        residual_force=force.to_json() if force is not None else None,
        near_misses=search.near_misses,
        cautions=(*cautions(plan), *_contradicted(verdict, gap)),
        history=tuple(story.steps),
    )


def _contradicted(verdict: Verdict, gap: SealedGap | None) -> tuple[str, ...]:
    """What sealed data say against a verdict that the fitted ones allow."""
    said = gap.contradicts if gap is not None and verdict.kind != "unexplained" else None
    return () if said is None else (said,)


def _simpler(force: ResidualForce, ground: Trial, best: Trial) -> bool:
    """Whether one law outside the catalogue explains the data better for its unknowns than several effects together.

    Effects of the catalogue added up can mimic a law that is not in it; their sum is then no name for it.
    """
    if not force.explains or force.world is None:
        return False
    effects = extended_bic(best.chi2, best.hypothesis.extra, best.bench.observations, 0, 1)
    return law_ebic(force, ground) < effects - SIMPLER


def _told_world(trial: Trial, world: World) -> World:
    """The fitted world, stepped as the world that was given, or finer where only that explained the data."""
    steps = min(world.time.substep, trial.hypothesis.world.time.substep)
    return trial.hypothesis.fitted_world(trial.values).with_substep(steps)


class _Story:
    """The steps so far, each told as it happens."""

    def __init__(self, progress: Callable[[float, str], None] | None) -> None:
        self.steps: list[dict[str, Any]] = []
        self.share = 0.0
        self._progress = progress

    def tell(self, share: float, step: str, figures: dict[str, Any]) -> None:
        self.share = max(self.share, share)
        self.steps.append({"step": step, **figures})
        if self._progress is not None:
            self._progress(self.share, step)


@dataclass(frozen=True)
class _Searched:
    verdict: Verdict
    bench: Bench
    ground: Trial
    near_misses: tuple[dict[str, Any], ...] = ()
    near: Near | None = None


def _searched(
    plan: Design,
    substep: float,
    base: tuple[Unknown, ...],
    candidates: tuple[Candidate, ...],
    settings: GapSettings,
    story: _Story,
    cancelled: Callable[[], bool] | None,
) -> _Searched:
    """The search on whole runs, or where a few of these cannot be followed, once more with those in parts."""
    ground = _finer(fitted_base(plan, base, len(candidates), cancelled), substep)
    story.tell(
        0.1,
        "base fit",
        {"chi2": ground.chi2, "measurements": ground.bench.observations, "passes": ground.passes}
        | {"goodness": ground.goodness.to_json(), "noise": ground.bench.noise.to_json()},
    )

    def tell(step: str, figures: dict[str, Any]) -> None:
        story.tell(min(story.share + 0.02, 0.75), step, figures | {"rollouts": ground.bench.rollouts})

    search = Search(ground.bench, candidates, settings.search, tell, ground, substep)
    near_misses: tuple[dict[str, Any], ...] = ()
    if ground.passes:
        ground, explained, near_misses = _explained(search, ground, settings.alarm)
        if explained:
            return _Searched(Verdict("nothing_missing", None), ground.bench, ground, near_misses)
    effects = 0
    parents = [ground]
    while effects < settings.search.max_effects:
        if effects >= PLAINLY and not search.foreseen(parents):
            break  # a sum of so many mimics much
        effects += 1
        search.add_effect(parents)
        _renoise(search, effects)
        search.finely(effects, 1.0)
        if effects == 1 and (lost := search.astray(effects)):
            parts = halved(plan.recording, lost)
            if any(run.part_of is not None for run in parts.runs):  # they could be cut, and are only once
                story.tell(story.share, "runs in parts", {"runs": list(lost)})
                cut = design(plan.world, parts)
                return _searched(cut, substep, base, candidates, settings, story, cancelled)
        if not _passed(search, effects) and not search.hopeless(effects):
            search.restart(effects)
            _renoise(search, effects)
            search.finely(effects)
        if effects > 1 and not _passed(search, effects) and not search.hopeless(effects):
            search.swap(effects)
            _renoise(search, effects)
            search.finely(effects)
        if _passed(search, effects):
            break
        parents = nearest(search.ranked(effects), search.on_windows, settings.search.parents)
    effects = search.fewest(effects)  # on the way back from two, one may have come to explain all
    while effects > 1 and search.best(effects) is None:
        effects -= 1  # nothing promised to better those
    best = search.best(effects)
    if best is not None and effects > 1 and best.passes:
        effects = len(search.backward(best).hypothesis.parts)
    if _passed(search, effects) or not search.hopeless(effects):
        fit_rivals(search, effects)
        search.settle(effects)
        search.beyond(effects)
        fit_twins(search, effects)
        put_simpler(search, effects)
        search.finely(effects)
        search.settled(effects)
    verdict = _decided(search, effects, parents)
    if verdict.kind == "identified" and verdict.best is not None and follows_one_course(plan):
        told = [*search.ranked(effects), *rivals(search, ground, verdict.best)]
        verdict = decide(told, max(settings.search.credible, BESIDE))
    bench = verdict.best.bench if verdict.best is not None else search.bench
    if bench is not ground.bench:
        ground = refitted(ground, bench)
    if verdict.best is not None:
        if ground.passes:
            stepped = ground.hypothesis.stepped(verdict.best.hypothesis.world.time.substep)
            ground = bench.fit(stepped, ground.values, ground.fit.states)
        again = _from_states_of(verdict.best, ground)
        if again.chi2 < ground.chi2:
            ground = again
        if ground.passes and ground.ebic - verdict.best.ebic <= settings.alarm:
            return _Searched(Verdict("nothing_missing", None), bench, ground, near_misses)
    return _Searched(verdict, bench, ground, near_misses, _near(search))


def _decided(search: Search, effects: int, parents: Sequence[Trial]) -> Verdict:
    """The verdict on hypotheses of so many effects, held against those of fewer that they were made of."""
    found = decide(search.ranked(effects), search.settings.credible)
    if found.best is None or found.kind == "unexplained":
        return found
    fewer = [p for p in parents if 0 < len(p.hypothesis.parts) < len(found.best.hypothesis.parts)]
    return beside_fewer(found, [found.best.bench.refit(p) for p in fewer], search.settings.credible)


def _finer(ground: Trial, substep: float) -> Trial:
    """A base that is near the data, fitted with shorter steps, where that is why it fails."""
    if ground.passes or ground.chi2 > STEPS_BLAMED * ground.bench.observations:
        return ground
    fine = refined(ground, substep, substep / FINEST)
    return fine if fine.passes else ground


def _near(search: Search) -> Near | None:
    """The base on windows, where the search had to begin there."""
    if search.on_windows is None:
        return None
    trial = search.on_windows.trials.get(())
    return None if trial is None else Near(search.on_windows.cut, trial.bench.noise, trial.fit)


def _explained(search: Search, ground: Trial, alarm: float) -> tuple[Trial, bool, tuple[dict[str, Any], ...]]:
    """The base, whether no effect betters it by more than `alarm`, and those that better it at all."""
    promising = search.promising(ground, 0.5 * alarm)
    near = [t for t in promising if t.ebic < ground.ebic]
    for trial in near[:AGAIN]:
        again = _from_states_of(trial, ground)
        if again.chi2 < ground.chi2 and again.passes:
            ground = again
    near = [t for t in near if t.ebic < ground.ebic]
    told = tuple({"effects": list(t.hypothesis.names), "ebic_gain": ground.ebic - t.ebic} for t in near)
    return ground, not near or ground.ebic - near[0].ebic <= alarm, told


def _from_states_of(trial: Trial, ground: Trial) -> Trial:
    """The base fitted from where a richer hypothesis ended: it may only have shown the way to better initial states."""
    values = trial.values[: len(ground.values)]
    begun = trial.bench.fit(ground.hypothesis, values, trial.fit.states, iterations=LEFT)
    return refitted(begun, trial.bench)


def _renoise(search: Search, effects: int) -> None:
    """Estimate the noise from the best hypothesis' residuals, and judge all under it."""
    best = search.best(effects)
    if best is None:
        return
    noise = refined_noise(search.bench.design, search.bench.noise, search.bench.raw_residuals(best))
    if _differs(noise, search.bench.noise):
        search.under(search.bench.with_noise(noise), effects)


def _differs(one: Noise, other: Noise) -> bool:
    """Whether two estimates of the noise are so far apart that fits would weigh the data otherwise."""
    levels = max(float(np.max(np.abs(a / b - 1.0))) for a, b in zip(one.sigma, other.sigma, strict=True))
    linked = max(float(np.max(np.abs(a - b))) for a, b in zip(one.rho, other.rho, strict=True))
    kept = sum(int(np.sum(a != b)) for a, b in zip(one.kept, other.kept, strict=True))
    return levels > LEVEL_CHANGED or linked > CORRELATION_CHANGED or kept > KEPT_CHANGED * one.count


def _passed(search: Search, effects: int) -> bool:
    best = search.best(effects)
    return best is not None and best.passes


def _contender(trial: Trial) -> Contender:
    h = trial.hypothesis
    return Contender(h.names, h.world, h.unknowns, trial.values, trial.fit.covariance)


def _null_control(
    found: _Searched,
    substep: float,
    candidates: tuple[Candidate, ...],
    settings: GapSettings,
    cancelled: Callable[[], bool] | None,
) -> NullControl:
    ground, best = found.ground, found.verdict.best
    states = best.fit.states if best is not None else ground.fit.states
    bench = found.bench
    made = simulated_recording(bench.forward(ground.hypothesis), ground.values, states, bench.noise, settings.seed)
    plan = design(bench.design.world, made)
    again = _searched(plan, substep, ground.hypothesis.base, candidates, settings, _Story(None), cancelled)
    after: float | None = None
    if best is not None:
        values = np.concatenate(
            [again.ground.values, [u.start for u in best.hypothesis.unknowns[len(ground.values) :]]]
        )
        # Places and frequencies stay as found: where the strength is nothing, they could not be told.
        after = again.bench.fit(best.hypothesis, values, again.ground.fit.states).chi2
    return NullControl(again.verdict.kind, again.ground.chi2, after, int(again.bench.observations), settings.seed)
