"""The gap workflow on one page: find where a world disagrees with measurements, name what is missing, and prove it.

noise is measured before any model                                 estimation.noise
the base is fitted, plain laws alone and in pairs, then others     search, propose, fitting
every hypothesis is judged by what it predicts of runs left out    cross_validation, choose
runs that no candidate predicts are set aside and named            set_aside
the verdict: what bootstraps keep, what competes, what is closed   verdict
laws outside the catalogue that predict better contradict it       residual_force
sealed runs, which no step has seen, can only lower it             sealed
what is left open: the run that would decide, the force left       experiment, residual_force
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from polyworld.data.recording import Recording
from polyworld.estimation.unknown import Unknown
from polyworld.gap.candidate import Candidate
from polyworld.gap.catalogue import catalogue
from polyworld.gap.cautions import cautions
from polyworld.gap.choose import credible
from polyworld.gap.experiment import propose_experiment
from polyworld.gap.fitting import Fitted
from polyworld.gap.ground import Ground, ground_of
from polyworld.gap.hypothesis import Hypothesis
from polyworld.gap.report import GapReport
from polyworld.gap.residual_force import ResidualForce, better_term, residual_force
from polyworld.gap.sealed import SealedGap, sealed_gap
from polyworld.gap.search import Search
from polyworld.gap.set_aside import Aside, outlying, without_runs
from polyworld.gap.settings import GapSettings
from polyworld.gap.verdict import Verdict, decide
from polyworld.screening import Screening, screen
from polyworld.world import World

COARSE = 32  # samples of a run on which its turning points are counted
TURNS = 3  # from which on a motion passes places again


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
    fitted: Callable[[Fitted], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> GapReport:
    """Find what a world lacks to explain a recording.

    base: unknowns that every hypothesis fits. candidates: effects to choose from; default: the whole catalogue.
    held_out: data that no step sees before the verdict, which they can only lower. held_out_world: gives a world as it
    is where these begin, if that is later than where the fitted runs do. progress: called with the share done (0 to 1)
    and the step. fitted: called with each hypothesis that was fitted to the end. cancelled: asked between fits; where
    it is true `InterruptedError` is raised. Raises ValueError where the recording does not fit the world.
    """
    settings = settings or GapSettings()
    library = tuple(catalogue().values()) if candidates is None else tuple(candidates)
    began = time.monotonic()
    history: list[dict[str, object]] = []

    def stopped() -> bool:
        if cancelled is not None and cancelled():
            raise InterruptedError("cancelled")
        return settings.time_limit is not None and time.monotonic() - began > settings.time_limit

    def report(step: str, figures: dict[str, object]) -> None:
        stopped()
        history.append({"step": step, "seconds": time.monotonic() - began, **figures})
        if progress is not None:
            progress(min(0.1 * len(history), 0.9), step)

    screening = screen(world, recording)
    ground = ground_of(world, recording, settings)
    search, aside = _search(ground, library, Hypothesis(ground.world, tuple(base)), report, stopped, fitted)
    verdict = _by_expression(search, decide(search.pool, search.null, search.share, _one_course(screening, recording)))
    sealed: SealedGap | None = None
    if held_out is not None:
        sealed = sealed_gap(search.null, verdict.best, held_out, held_out_world)
        verdict = _lowered(verdict, sealed, settings)
    contenders = (verdict.best, *verdict.competitors)
    experiment = propose_experiment(contenders, settings) if verdict.kind == "ambiguous" else None
    force: ResidualForce | None = None
    if verdict.kind == "unexplained" and world.deformables:
        unsought = "no law of what is left is sought where bodies deform, whose runs take long"
        verdict = replace(verdict, reasons=(*verdict.reasons, unsought))
    elif verdict.kind == "unexplained" and not search.limited:
        report("residual force", {})
        force = residual_force(search.ground, verdict.best, search.null, settings, stopped)
    report("verdict", {"verdict": verdict.kind, "best": verdict.best.hypothesis.title})
    if progress is not None:
        progress(1.0, "done")
    return GapReport(
        verdict,
        search.null,
        tuple(search.pool),
        sealed,
        aside,
        (*cautions(world, recording), *(f.message for f in screening.findings)),
        tuple(history),
        world.time.substep,
        settings.time_limit if search.limited else None,
        experiment,
        force,
    )


def _search(
    ground: Ground,
    library: Sequence[Candidate],
    base: Hypothesis,
    report: Callable[[str, dict[str, object]], None],
    stopped: Callable[[], bool],
    fitted: Callable[[Fitted], None] | None,
) -> tuple[Search, tuple[Aside, ...]]:
    """Search; again without what stands out. A single such run is set aside at once: no law of a place shows in one.

    A further search that the time ended gives way to the one before, whose whole library was tried.
    """
    aside: tuple[Aside, ...] = ()
    before: tuple[Search, tuple[Aside, ...]] | None = None
    for turn in range(ground.settings.passes):
        search = Search(ground, library, base, report, stopped, fitted)
        search.plain()
        last = turn == ground.settings.passes - 1
        bad = [] if last else outlying(credible(search.pool, search.null)[0])
        if len(bad) == 1:
            search.places()
            bad = outlying(credible(search.pool, search.null)[0])
        if len(bad) != 1:
            search.forward()
            bad = [] if last else outlying(credible(search.pool, search.null)[0])
        if search.limited and before is not None:
            before[0].limited = True
            return before
        if not bad or search.limited:
            break
        if len(bad) != 1:
            before = search, aside
        ground, more = without_runs(credible(search.pool, search.null)[0], bad)
        aside += more
        report("set aside", {"runs": [a.run for a in more]})
    return search, aside


def _by_expression(search: Search, verdict: Verdict) -> Verdict:
    """Return the verdict as far as no expression outside the catalogue predicts better than what it names."""
    if verdict.kind in ("unexplained", "nothing_missing") or search.limited:
        return verdict
    term = better_term(search, verdict.best)
    if term is None:
        return verdict
    gain, law = search.pool[0].total - term.total, term.hypothesis.parts[-1].candidate
    reason = f"{law.name}, a law outside the catalogue ({law.law}), predicts better by {gain:.0f} nats"
    return replace(verdict, kind="unexplained", reasons=(*verdict.reasons, reason))


def _lowered(verdict: Verdict, sealed: SealedGap, settings: GapSettings) -> Verdict:
    """Return the verdict as far as sealed runs bear it out."""
    if verdict.best.hypothesis.parts and verdict.kind in ("identified", "identified_with_remainder"):
        if sealed.after > 1.0 and sealed.share > settings.closed:
            reason = f"{100.0 * sealed.share:.0f}% of the gap in the sealed runs is left"
            return replace(verdict, kind="unexplained", reasons=(*verdict.reasons, reason))
        if verdict.kind == "identified" and sealed.after > settings.near_noise:
            reason = f"the sealed runs are {sealed.after:.1f} standard deviations of the noise off"
            return replace(verdict, kind="identified_with_remainder", reasons=(*verdict.reasons, reason))
    if verdict.kind == "nothing_missing" and sealed.before > settings.near_noise * max(verdict.before, 1.0):
        reason = f"the sealed runs are {sealed.before:.1f} standard deviations of the noise off"
        return replace(verdict, kind="unexplained", reasons=(*verdict.reasons, reason))
    return verdict


def _one_course(screening: Screening, recording: Recording) -> bool:
    """Return whether all runs repeat one motion, and it passes no place twice."""
    if screening.distinct_courses > 1:
        return False
    for run in recording.runs:
        places = run.positions.reshape(len(run.times), -1)
        places = places[:, np.isfinite(places).all(axis=0)]
        if not places.shape[1]:
            return False
        along = places[:, int(np.argmax(np.ptp(places, axis=0)))]
        coarse = along[:: max(1, len(along) // COARSE)]
        if np.sum(np.diff(np.sign(np.diff(coarse))) != 0) >= TURNS:
            return False
    return True
