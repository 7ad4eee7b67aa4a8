"""Run the search over effects on one recording: base fit, one to three effects, the candidates' contest of fits.

Steps: fit the base; where it fails, add the effect of largest predicted gain, then a second and a third one
while none explains the data; fit what comes near with all care.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from polyworld.estimation import profile
from polyworld.estimation.candidate import Candidate
from polyworld.estimation.design import Design, design
from polyworld.estimation.fit_context import FINEST, FitContext, Fitted, FittedHypothesis, refined
from polyworld.estimation.hypothesis import extended
from polyworld.estimation.noise import refined_noise
from polyworld.estimation.run_segments import split_runs
from polyworld.estimation.unknown import Unknown
from polyworld.gap import ebic
from polyworld.gap.clock import Clock, TimeLimitReached
from polyworld.gap.contest import identity
from polyworld.gap.decide import Verdict, beside_fewer, leave_noise
from polyworld.gap.examine import BASE, differs, fitted_base, refitted
from polyworld.gap.outlying import OutlyingRun
from polyworld.gap.search import Search
from polyworld.gap.settings import SearchSettings
from polyworld.gap.single_coordinate import competitors, is_single_coordinate
from polyworld.gap.stability import far_fetched
from polyworld.gap.symbolic import Near

PLAINLY = 2  # effects that are added without asking what they are predicted to explain (`Search.worth_a_third`)


class Story:
    """Collect the steps of a search and report each as it happens; fitted: is called with each fit."""

    def __init__(self, progress: Callable[[float, str], None] | None, fitted: Fitted | None = None) -> None:
        self.steps: list[dict[str, Any]] = []
        self.share = 0.0
        self.fitted = fitted
        self._progress = progress

    def report(self, share: float, step: str, figures: dict[str, Any]) -> None:
        """Record a step, and report it with the share done (0 to 1)."""
        self.share = max(self.share, share)
        self.steps.append({"step": step, **figures})
        if self._progress is not None:
            self._progress(self.share, step)


@dataclass(frozen=True)
class Searched:
    """Result of a search.

    verdict: on hypotheses that leave only noise. context: fits and noise that it rests on. ground: the base, fitted.
    near_misses: effects that would lower the misfit of a base that explains the data. pool: hypotheses fitted under
    one noise, to be compared. plain: those of them that add one plain law. limited: whether time ran out before;
    competitors_fitted: whether every single effect in question had been fitted by then. outlying: runs to be set aside.
    """

    verdict: Verdict
    context: FitContext
    ground: FittedHypothesis
    near_misses: tuple[dict[str, Any], ...] = ()
    near: Near | None = None
    pool: tuple[FittedHypothesis, ...] = ()
    plain: tuple[FittedHypothesis, ...] = ()
    limited: bool = False
    competitors_fitted: bool = True
    outlying: tuple[OutlyingRun, ...] = ()


FindOutliers = Callable[[Sequence[FittedHypothesis]], tuple[OutlyingRun, ...]]


def search_effects(
    plan: Design,
    substep: float,
    base: tuple[Unknown, ...],
    candidates: tuple[Candidate, ...],
    settings: SearchSettings,
    alarm: float,
    story: Story,
    clock: Clock,
    outliers: FindOutliers,
) -> Searched:
    """Search on whole runs, or where a few of these cannot be followed, once more with those in segments.

    alarm: by how much an effect must lower the extended BIC to be looked into although the base explains the data.
    outliers: asked, where plain laws and then single effects were fitted and none explains the data, which runs behave
    unlike the rest under the best of them; where there are any, the search ends there, and is to be repeated without.
    """
    ground = _finer(fitted_base(plan, base, len(candidates), clock, story.fitted), substep, settings.near)
    story.report(
        0.1,
        "base fit",
        {"chi2": ground.chi2, "measurements": ground.context.observations, "passes": ground.passes}
        | {"goodness": ground.goodness.to_json(), "noise": ground.context.noise.to_json()},
    )

    def report(step: str, figures: dict[str, Any]) -> None:
        story.report(min(story.share + 0.02, 0.75), step, figures | {"rollouts": ground.context.rollouts})

    search = Search.begin(ground, candidates, settings, report, substep)
    near_misses: tuple[dict[str, Any], ...] = ()
    limited, competitors_fitted = False, False
    effects, parents = 1, [ground]
    try:
        if ground.passes:
            ground, explained, near_misses = _explained(search, ground, alarm)
            if explained:
                return Searched(Verdict("nothing_missing", None), ground.context, ground, near_misses)
        if not profile.collide(plan):  # with several bodies each law takes seconds, and comes later
            _laws_everywhere(search, ground)
            if found := _outlying(search, ground, outliers):
                return found
        effects, parents, sensitive = _add_effects(search, ground, most=1)
        competitors_fitted = True
        if not sensitive and (found := _outlying(search, ground, outliers)):
            return found
        if sensitive:
            parts = split_runs(plan.recording, sensitive)
            if any(run.part_of is not None for run in parts.runs):  # they could be cut, and are only once
                story.report(story.share, "runs in parts", {"runs": list(sensitive)})
                cut = design(plan.world, parts)
                return search_effects(cut, substep, base, candidates, settings, alarm, story, clock, outliers)
        effects, parents, _ = _add_effects(search, ground, effects, whole=True)
        effects = _with_care(search, effects)
    except TimeLimitReached:
        limited = True
        clock.lift()
        story.report(story.share, "time limit", {})
        while effects > 1 and search.best(effects) is None:
            effects -= 1
        if search.best(effects) is None:
            effects = max((len(t.hypothesis.parts) for t in search.whole.fitted.values()), default=1)
    verdict = _decided(search, effects, parents)
    if not limited and verdict.kind == "identified" and verdict.best is not None and is_single_coordinate(plan):
        beside = [*search.ranked(effects), *competitors(search, ground, verdict.best)]
        verdict = leave_noise(beside, max(settings.credible, settings.single_coordinate))
    context = verdict.best.context if verdict.best is not None else search.context
    if context is not ground.context:
        ground = refitted(ground, context)
    if verdict.best is not None:
        if ground.passes:
            stepped = ground.hypothesis.stepped(verdict.best.hypothesis.world.time.substep)
            ground = context.fit(stepped, ground.values, ground.fit.states)
        again = _from_states_of(verdict.best, ground)
        if again.chi2 < ground.chi2:
            ground = again
        if ground.passes and ebic.competes(ground, verdict.best, alarm):
            return Searched(Verdict("nothing_missing", None), context, ground, near_misses, limited=limited)
    plain = tuple(t for t in search.ranked(1) if _is_plain(t)) if limited else _plain_laws(search, ground, context)
    doubtful = verdict.kind == "identified" and verdict.best is not None and far_fetched(verdict.best) > 0
    paired = not limited and (doubtful or verdict.kind == "unexplained")
    pairs = _plain_pairs(plain, context, settings) if paired else ()
    pool = _pool(search, context, (*plain, *pairs), limited)
    return Searched(
        verdict, context, ground, near_misses, _near(search), pool, plain, limited, competitors_fitted or not limited
    )


def _outlying(search: Search, ground: FittedHypothesis, outliers: FindOutliers) -> Searched | None:
    """Return the end of a search in which runs behave unlike the rest; None where none does, or the data are
    explained."""
    fitted = [t for t in search.whole.fitted.values() if t.context is search.context]
    if search.passes(1) or not fitted:
        return None
    found = outliers([*fitted, search.context.refit(ground, iterations=2)])
    if not found:
        return None
    return Searched(Verdict("unexplained", search.best(1)), search.context, ground, outlying=found)


def _add_effects(
    search: Search, ground: FittedHypothesis, effects: int = 0, whole: bool = False, most: int = 3
) -> tuple[int, list[FittedHypothesis], tuple[str, ...]]:
    """Add effects until the best explains the data: their number, the hypotheses they were added to, and runs that no
    fit follows although their segments are explained, with which nothing further is tried (unless `whole`)."""
    parents = [ground] if effects == 0 else search.parents(effects)
    while effects < min(search.settings.max_effects, most) and not (effects and search.passes(effects)):
        if effects >= PLAINLY and not search.worth_a_third(parents):
            break  # a sum of so many mimics much
        effects += 1
        search.add(parents)
        _care(search, effects)
        if effects == 1 and not whole and (sensitive := search.sensitive_runs(effects)):
            return effects, parents, sensitive
        if not search.passes(effects) and not search.hopeless(effects):
            search.restart(effects)
            _care(search, effects)
        if effects > 1 and not search.passes(effects) and not search.hopeless(effects):
            search.swap(effects)
            _care(search, effects)
        if search.passes(effects):
            break
        parents = search.parents(effects)
    return effects, parents, ()


def _care(search: Search, effects: int) -> None:
    """Judge all under the noise that the best leaves, with steps as fine as they need be."""
    _renoise(search, effects)
    search.refine_steps(effects, 1.0)


def _with_care(search: Search, effects: int) -> int:
    """Drop what is not needed and fit what comes near to the best with all care; the number of effects then."""
    effects = next((k for k in range(1, effects) if search.passes(k)), effects)
    while effects > 1 and search.best(effects) is None:
        effects -= 1
    if search.passes(effects) or not search.hopeless(effects):
        effects = search.drop(effects)
        search.improve(effects)
        search.settle(effects)
        search.refine_steps(effects)
        search.converge(effects)
    return effects


def _laws_everywhere(search: Search, ground: FittedHypothesis) -> None:
    """Fit roughly the laws that act everywhere alike: under the right one, runs that behave unlike the rest show."""
    context = search.context
    horizons, states = profile.horizons_for(context.design), profile.start_states(context.design)
    for candidate in (c for c in search.candidates if c.plain or c.uniform):
        for hypothesis in extended(ground.hypothesis, candidate, context.design.recording):
            if hypothesis.extra <= search.settings.unknowns:
                start = hypothesis.starts(ground.values)[0]
                fit = context.fit(hypothesis, start, states, horizons=horizons, iterations=search.settings.care // 3)
                search.whole.take(fit)


def _plain_laws(search: Search, ground: FittedHypothesis, context: FitContext) -> tuple[FittedHypothesis, ...]:
    """Fit the plain laws, each by itself: they are reported beside any richer answer. Those that come near the best are
    fitted to the end."""
    found = []
    plan, settings = context.design, search.settings
    horizons, states = profile.horizons_for(plan), profile.start_states(plan)
    least = min((t.chi2 for t in search.whole.fitted.values()), default=np.inf)
    for candidate in (c for c in search.candidates if c.plain):
        ways = []
        for hypothesis in extended(ground.hypothesis, candidate, plan.recording):
            if hypothesis.extra > settings.unknowns:
                continue
            known = search.whole.fitted.get(identity(hypothesis))
            if known is None:
                start = hypothesis.starts(ground.values)[0]
                known = context.fit(hypothesis, start, states, horizons=horizons, iterations=settings.care // 3)
            near = known.chi2 < settings.aside * least
            ways.append(context.refit(known, iterations=settings.care if near else BASE.barely))
        ways = [w for w in ways if np.isfinite(w.chi2)]
        if ways:
            found.append(ebic.ranked(ways)[0])
    return tuple(ebic.ranked(found))


def _plain_pairs(
    plain: Sequence[FittedHypothesis], context: FitContext, settings: SearchSettings
) -> tuple[FittedHypothesis, ...]:
    """Fit pairs of the plain laws that come nearest: real losses are often two of them together."""
    found = []
    first = plain[: settings.paired]
    for i, one in enumerate(first):
        for other in first[i + 1 :]:
            part = other.hypothesis.parts[0]
            for both in extended(one.hypothesis, part.candidate, context.design.recording):
                if both.parts[-1].variant.label != part.variant.label:
                    continue
                starts = (
                    both.starts(one.values)[0],
                    np.concatenate([one.values, other.values[len(other.hypothesis.base) :]]),
                )
                ways = [context.fit(both, start, one.fit.states, iterations=settings.care) for start in starts]
                found.append(min(ways, key=lambda t: t.chi2))
    return tuple(t for t in found if np.isfinite(t.chi2))


def _is_plain(trial: FittedHypothesis) -> bool:
    return trial.hypothesis.parts[0].candidate.plain


def _pool(
    search: Search, context: FitContext, plain: Sequence[FittedHypothesis], limited: bool
) -> tuple[FittedHypothesis, ...]:
    """Return the hypotheses that came nearest, with each number of effects, and the plain laws, all fitted under one
    noise."""
    found: dict[tuple[str, ...], FittedHypothesis] = {identity(t.hypothesis): t for t in plain}
    iterations = 4 if limited else search.settings.care // 2
    for effects in range(1, search.settings.max_effects + 1):
        for trial in search.ranked(effects)[: search.settings.compared]:
            key = identity(trial.hypothesis)
            if key not in found or trial.chi2 < found[key].chi2:
                same = trial.context is context and (trial.fit.converged or limited)
                found[key] = trial if same else context.refit(trial, iterations=iterations)
    return tuple(t for t in found.values() if np.isfinite(t.chi2))


def _decided(search: Search, effects: int, parents: Sequence[FittedHypothesis]) -> Verdict:
    """Return the verdict on hypotheses of so many effects, held against those of fewer that they were made of."""
    found = leave_noise(search.ranked(effects), search.settings.credible)
    if found.best is None or found.kind == "unexplained":
        return found
    fewer = [p for p in parents if 0 < len(p.hypothesis.parts) < len(found.best.hypothesis.parts)]
    return beside_fewer(found, [found.best.context.refit(p) for p in fewer], search.settings.credible)


def _finer(ground: FittedHypothesis, substep: float, near: float) -> FittedHypothesis:
    """Return a base that is near the data, fitted with shorter steps, where that is why it fails."""
    if ground.passes or ground.chi2 > near * ground.context.observations:
        return ground
    fine = refined(ground, substep, substep / FINEST)
    return fine if fine.passes else ground


def _near(search: Search) -> Near | None:
    """Return the base on segments, where the search had to begin there."""
    used = search.used
    if used is None or used.segments is None:
        return None
    trial = used.fitted.get(())
    return None if trial is None else Near(used.segments, trial.context.noise, trial.fit)


def _explained(
    search: Search, ground: FittedHypothesis, alarm: float
) -> tuple[FittedHypothesis, bool, tuple[dict[str, Any], ...]]:
    """Return the base, whether no effect betters it by more than `alarm`, and those that better it at all."""
    likely = search.with_predicted_gain(0.5 * alarm)
    near = [t for t in likely if ebic.behind(ground, t) > 0.0]
    for trial in near[: search.settings.few]:
        again = _from_states_of(trial, ground)
        if again.chi2 < ground.chi2 and again.passes:
            ground = again
    near = [t for t in near if ebic.behind(ground, t) > 0.0]
    misses = tuple({"effects": list(t.hypothesis.names), "ebic_gain": ebic.behind(ground, t)} for t in near)
    return ground, not near or ebic.competes(ground, near[0], alarm), misses


def _from_states_of(trial: FittedHypothesis, ground: FittedHypothesis) -> FittedHypothesis:
    """Return the base fitted from where a richer hypothesis ended: it may only have shown the way to better initial
    states."""
    values = trial.values[: len(ground.values)]
    fitted = trial.context.fit(ground.hypothesis, values, trial.fit.states, iterations=BASE.barely)
    return refitted(fitted, trial.context)


def _renoise(search: Search, effects: int) -> None:
    """Estimate the noise from the best hypothesis' residuals, and judge all under it."""
    best = search.best(effects)
    if best is None:
        return
    noise = refined_noise(search.context.design, search.context.noise, search.context.raw_residuals(best))
    if differs(noise, search.context.noise):
        search.under(search.context.with_noise(noise), effects)
