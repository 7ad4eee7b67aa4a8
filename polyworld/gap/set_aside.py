"""Search for effects on the runs that behave alike: those that do not are set aside and reported.

What they show may be an effect after all, which the search on the others finds, or one that acts at one place.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from polyworld.data.recording import Recording
from polyworld.estimation.candidate import Candidate
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.run_segments import in_segments
from polyworld.estimation.unknown import Unknown
from polyworld.gap.clock import Clock, TimeLimitReached
from polyworld.gap.decide import Kind, Verdict
from polyworld.gap.outlying import (
    OutlyingRun,
    event_runs,
    explained_runs,
    misfitting_runs,
    supporting_run,
    without_runs,
)
from polyworld.gap.search_loop import Searched, Story, search_effects
from polyworld.gap.settings import DecisionSettings, OutlierSettings, SearchSettings
from polyworld.gap.stepping import coarsened
from polyworld.world import World


@dataclass(frozen=True)
class Work:
    """Hold what all searches of one recording share. alarm: as in `GapSettings`."""

    world: World
    base: tuple[Unknown, ...]
    candidates: tuple[Candidate, ...]
    widely: SearchSettings
    outliers: OutlierSettings
    decision: DecisionSettings
    alarm: float
    story: Story
    clock: Clock

    def search(
        self, recording: Recording, candidates: tuple[Candidate, ...], spare: int = 0, most: int | None = None
    ) -> Searched:
        """Search a recording for up to so many effects; it ends early where up to `spare` runs are to be set aside."""
        cut = in_segments(recording, self.world)
        plan = design(coarsened(self.world, cut), cut)

        def outliers(trials: Sequence[FittedHypothesis]) -> tuple[OutlyingRun, ...]:
            return misfitting_runs(trials, spare, self.outliers) if spare > 0 else ()

        return search_effects(
            plan,
            self.world.time.substep,
            self.base,
            candidates,
            self.widely if most is None else replace(self.widely, max_effects=most),
            self.alarm,
            self.story,
            self.clock,
            outliers,
        )


def search_without_outliers(work: Work, recording: Recording) -> tuple[tuple[OutlyingRun, ...], Searched]:
    """Return the runs set aside, and the search on the others."""
    room = int(work.outliers.most * len(recording.runs))
    aside: tuple[OutlyingRun, ...] = ()
    found: Searched | None = None
    influential: set[str] = set()
    try:
        aside = event_runs(work.world, recording, work.outliers, work.clock) if room else ()
        while True:
            if aside:
                work.story.report(work.story.share, "outlying runs", {"runs": [o.to_json() for o in aside]})
            kept = without_runs(recording, [o.run for o in aside])
            found = work.search(kept, work.candidates, room - len(aside))
            further = found.outlying
            if not further and len(aside) < room:
                further = _supporting(work, found)
                influential |= {o.run for o in further}
            if not further:
                break
            aside = (*aside, *further)
        found = _without_unsupported(work, found)
        best, kind = found.verdict.best, found.verdict.kind
        if aside and best is not None and kind != "unexplained" and not found.limited:
            others = tuple(o.run for o in aside if o.run not in influential)
            explained = explained_runs(best, recording.select(others), work.outliers) if others else ()
            if explained:  # what they show is the effect that was found
                aside = tuple(o for o in aside if o.run not in explained)
                found = work.search(without_runs(recording, [o.run for o in aside]), work.candidates)
        if aside and found.verdict.kind in ("nothing_missing", "unexplained") and not found.limited:
            local = tuple(c for c in work.candidates if c.local)
            whole = work.search(recording, local, most=1) if local else None
            if whole is not None and (whole.verdict.kind != "unexplained" or _explains_more(whole, found)):
                return (), whole
    except TimeLimitReached:
        work.clock.lift()
        if found is None:
            return (), _only_base(work, recording)
        kept_names = {r.run.part_of or r.run.name for r in found.context.design.runs}
        return tuple(o for o in aside if o.run not in kept_names), replace(found, limited=True)
    return aside, found


def _explains_more(whole: Searched, found: Searched) -> bool:
    """Return whether one local effect fits all runs at least as well as all effects together fit those kept."""
    one, several = whole.verdict.best, found.verdict.best
    if one is None or several is None or one.chi2 >= whole.ground.chi2:
        return False
    return one.chi2 / one.context.observations <= several.chi2 / several.context.observations


def _only_base(work: Work, recording: Recording) -> Searched:
    """Fit the world as it is, where time was over before: no effect has been tried, so none is named or ruled out."""
    found = work.search(recording, (), most=1)
    return replace(found, verdict=Verdict("unexplained", None), limited=True, competitors_fitted=False)


def _supporting(work: Work, found: Searched) -> tuple[OutlyingRun, ...]:
    """Return the run that alone supports the effects that were found, or one of them beside the others."""
    named = found.verdict.best
    if found.limited or found.verdict.kind not in ("identified", "ambiguous") or named is None:
        return ()
    for fewer in (found.ground, *_one_effect_less(named, found.pool)):
        alone = _alone(work, fewer, named)
        # Beside other effects, one that a single run supports may as well be a chance of that run.
        if alone is not None and (fewer is found.ground or _is_outlier(work, fewer, alone)):
            return (alone,)
    return ()


def _alone(work: Work, fewer: FittedHypothesis, named: FittedHypothesis) -> OutlyingRun | None:
    """Return the run that alone supports what effects add to fewer, where none of these is local."""
    further = [p for p in named.hypothesis.parts if p.candidate.name not in fewer.hypothesis.names]
    if any(p.candidate.local for p in further):
        return None
    return supporting_run(fewer, named, work.outliers, work.decision.decisive)


def _is_outlier(work: Work, trial: FittedHypothesis, run: OutlyingRun) -> bool:
    """Return whether a hypothesis explains a run far worse than the others."""
    misfits = dict(zip((r.run.part_of or r.run.name for r in trial.context.design.runs), trial.misfits, strict=True))
    others = [m for name, m in misfits.items() if name != run.run]
    return bool(misfits[run.run] > work.outliers.excess * max(float(np.median(others)), 1.0))


def _without_unsupported(work: Work, found: Searched) -> Searched:
    """Take back an effect that a single run supports beside others: one run is no evidence of a law."""
    named = found.verdict.best
    if found.limited or found.verdict.kind != "identified" or named is None:
        return found
    for fewer in _one_effect_less(named, found.pool):
        if _alone(work, fewer, named) is not None:
            kind: Kind = "identified" if fewer.passes else "unexplained"
            return replace(found, verdict=Verdict(kind, fewer, (fewer,) if fewer.passes else ()))
    return found


def _one_effect_less(named: FittedHypothesis, pool: Sequence[FittedHypothesis]) -> list[FittedHypothesis]:
    """Return the best fit of each set of effects that lacks one of several."""
    effects = named.hypothesis.names
    found = []
    for left_out in effects if len(effects) > 1 else ():
        rest = sorted(n for n in effects if n != left_out)
        own = [t for t in pool if sorted(t.hypothesis.names) == rest and t.context is named.context]
        if own:
            found.append(min(own, key=lambda t: t.chi2))
    return found
