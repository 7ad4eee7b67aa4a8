"""The search for missing effects: rank by the score test, fit the contenders, add a further effect where one fails.

Forward, swap and backward steps over hypotheses, each fitted on trajectories together with the base's unknowns and all
initial states. Every step is told with its figures.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.candidate import Candidate
from polyworld.estimation.hypothesis import Hypothesis, Part, extended, without_part
from polyworld.estimation.mending import IN_DOUBT, UNLIKELY, anew, begun, looked_through, refused, searched
from polyworld.estimation.profiled import profiled, touchy
from polyworld.estimation.score_test import ScoreTestStart, leads
from polyworld.estimation.trial import FINEST, FitContext, FittedHypothesis, Start, refined
from polyworld.gap import window_search
from polyworld.gap.astray import astray
from polyworld.gap.parents import unlike
from polyworld.gap.predicted_gains import PredictedGain, first_of_each, identity, promise, shares
from polyworld.gap.window_search import HOPELESS, ONWARD, WindowSearch
from polyworld.gap.windows import windows

Array = NDArray[np.float64]

FAR = 3.0  # chi2 per measurement beyond which a fit is no place to start from
ASTRAY = 1.06  # the same where bodies collide: slopes foretell little of what comes behind collisions
FARTHER = 10.0  # the same beyond which windows are short ones
SHORT, LONG = 4, 2  # windows of a run
FIRST_ITERATIONS = 4  # of every contender, at each horizon, after which the hopeless are left
ROUGH_ITERATIONS = 8
OF_ONE_RUN = 0.75  # share of what is missing that what happens to one run has to promise
THIRD = 0.5  # share of what is lacking that an effect beyond the second has to promise
WORTH = 0.2  # share of the best gain promised below which a further effect is not tried
RESTARTED = 2  # hypotheses fitted anew where none passes the gate
NEARLY = 5.0  # chi2 per measurement beyond which that is not what is wrong
CLOSE = 50.0  # EBIC behind the best within which hypotheses are fitted with finer steps
PARTS = (0.3, 1.0)  # of the way to what the score test foretells that are tried as starts
EXPLAINED = 1.5  # chi2 per measurement below which a far hypothesis is no rival any more
LEADERS = 2  # contenders that are fitted as long as they gain, where the first does not explain the data
ROUNDS = 5  # of iterations that a leader is given at most
MOVED = 0.5  # fall of chi2 for which the best is fitted on
BEHIND = 1.2  # times the leader's chi2 on windows of one body, beyond which whole runs that it explains are not asked
MARGIN = 100.0  # chi2 above the leader's at which a fit is still of interest
CONTESTED = 3  # that are fitted with all care where they are near to one another
DOUBT = 0.25  # chi2 per measurement behind the best, within which a fit may only be stuck before a collision
GREATER = (1.1, 2.0)  # times a friction, from where it is fitted again
ALIKE_FIT = 1.0  # chi2 within which their fits then are as good


@dataclass(frozen=True)
class SearchSettings:
    """How widely to search.

    contenders: hypotheses of one effect that are fitted; further: of several, at each step. starts: of each hypothesis
    that are tried where the first fails. parents: hypotheses that a further effect is added to. finalists: fitted to
    convergence. credible: difference of EBIC within which hypotheses stand side by side. max_effects: added at most.
    """

    contenders: int = 10
    further: int = 9
    starts: int = 3
    parents: int = 3
    finalists: int = 5
    credible: float = 10.0
    max_effects: int = 3


@dataclass
class Search:
    """All trials so far, the best of each hypothesis, and the story of how they came about.

    ground: the base, fitted. substep [s]: of the world that was given, which the design's may exceed; the best are
    judged with it. on_windows: the search on windows, once it was begun. foretold: least chi2 that the score test on
    whole runs foretold of each hypothesis, of the effects tried last. run_by_run: hypotheses of which every run was
    looked for by itself.
    """

    bench: FitContext
    candidates: tuple[Candidate, ...]
    settings: SearchSettings
    tell: Callable[[str, dict[str, Any]], None]
    ground: FittedHypothesis
    substep: float
    trials: dict[tuple[str, ...], FittedHypothesis] = field(default_factory=dict)
    promised: dict[tuple[str, ...], tuple[float, ScoreTestStart]] = field(default_factory=dict)
    on_windows: WindowSearch | None = None
    foretold: dict[tuple[str, ...], float] = field(default_factory=dict)
    run_by_run: set[tuple[str, ...]] = field(default_factory=set)

    def ranked(self, effects: int | None = None) -> list[FittedHypothesis]:
        """The best trial of every hypothesis (with so many effects), lowest EBIC first."""
        chosen = [t for t in self.trials.values() if effects is None or len(t.hypothesis.parts) == effects]
        return sorted(chosen, key=lambda t: (t.ebic, t.hypothesis.title))

    def take(self, trial: FittedHypothesis) -> FittedHypothesis:
        """Keep a trial if it is the best of its hypothesis so far; returns the best."""
        key = identity(trial.hypothesis)
        if np.isfinite(trial.chi2) and (key not in self.trials or trial.chi2 < self.trials[key].chi2):
            self.trials[key] = trial
        return self.trials.get(key, trial)

    def foreseen(self, parents: Sequence[FittedHypothesis]) -> bool:
        """Whether what the score test foretells most of, on top of these, comes near to the data when fitted."""
        found = [(p, lead) for p in parents for lead in leads(self.bench, p, self._more(p), 1)]
        if not found:
            return False
        parent, lead = min(found, key=lambda f: promise(f[1], self.bench.observations))
        if parent.chi2 - promise(lead, self.bench.observations) < THIRD * (parent.chi2 - self.bench.observations):
            return False
        start = self.bench.nearest(lead.hypothesis, self._options(parent, lead))
        trial = self._to_the_end(self.take(self.bench.fit(lead.hypothesis, start.values, start.states)))
        self.tell("further effect", trial.figures())
        return trial.chi2 < FAR * self.bench.observations

    def fewest(self, effects: int) -> int:
        """The least number of effects, up to so many, whose best passes the gate; all of them where none does."""
        best = ((k, self.best(k)) for k in range(1, effects))
        return next((k for k, trial in best if trial is not None and trial.passes), effects)

    def under(self, bench: FitContext, effects: int) -> None:
        """Go on under other noise: trials near the best are refitted, the others dropped."""
        before = self.ranked(effects)
        self.bench = bench
        self.trials, self.foretold = {}, {}
        for trial in before[: self.settings.finalists]:
            self.take(bench.refit(trial))

    def add_effect(self, parents: Sequence[FittedHypothesis]) -> None:
        """Forward: fit the hypotheses that one more effect makes of the parents."""
        parents = unlike(parents)
        if not parents:
            return
        level = min(p.chi2 for p in parents)
        self.foretold = {}
        effects = len(parents[0].hypothesis.parts) + 1
        further = effects > 1
        most = self.settings.further if further else self.settings.contenders
        far = level > (ASTRAY if profile.collide(self.bench.design) else FAR) * self.bench.observations
        if far and not further and self._of_few_runs(parents[0]):
            return
        on_windows = self._windows if far else None
        cut = on_windows.cut if on_windows is not None else None
        if on_windows is not None:
            self.on_windows = on_windows
            self._through_windows(on_windows, parents, most, level)
            best = self.best(effects)
            unclear = best is None or not self._explains(best, level)
            # An effect with an edge may be at a wrong place, which gets near to the data and not there.
            unclear = unclear or (best is not None and _edged(best.hypothesis.parts[-1]) and not best.passes)
            if unclear and not further and self._longer is not None and self._longer is not on_windows:
                self.on_windows, cut = self._longer, self._longer.cut
                self._through_windows(self._longer, parents, most, level)
                best = self.best(effects)
            if best is not None and self._explains(best, level):
                return
        found: list[tuple[FittedHypothesis, ScoreTestStart]] = []
        for parent in parents:
            more = self._more(parent)
            left = [h for h in more if cut is None or not cut.holds(parent.hypothesis) or not cut.holds(h)]
            own = self._scored(parent, parent, left, 1.0)
            self._promised(parent, own)
            found += [(parent, lead) for lead in own]
            for lead in own:
                key = identity(lead.hypothesis)
                self.foretold[key] = min(lead.chi2, self.foretold.get(key, np.inf))
        promises = shares(found, level, self.bench.observations)
        if cut is None and far and not further:
            early = [
                (parents[0], x) for x in self._scored(self.early, parents[0], self._more(parents[0]), self.horizon)
            ]
            promises += shares(early, self.early.chi2, self.bench.observations)
        promises.sort(key=lambda p: -p.share)
        firsts = first_of_each(promises, most, WORTH if further else 0.0)
        self._fit_leads(firsts, level)
        best = self.best(effects)
        if best is None or not (best.passes or self.hopeless(effects)):
            chosen = {identity(p.lead.hypothesis) for p in firsts}
            others = [p for p in promises if identity(p.lead.hypothesis) in chosen and all(p is not f for f in firsts)]
            self._fit_leads([p for p in others if p.share >= HOPELESS][:most], level)
            self._nested(parents)

    def _of_few_runs(self, parent: FittedHypothesis) -> bool:
        """Whether most runs are explained, and the others by what happens to one run alone."""
        if np.median(parent.misfits) > EXPLAINED:
            return False
        local = [h for h in self._more(parent) if h.parts[-1].candidate.leads is not None]
        own = self._scored(parent, parent, local, 1.0) if local else []
        self._promised(parent, own)
        missing = parent.chi2 - self.bench.observations
        telling = [(parent, x) for x in own if parent.chi2 - x.chi2 > OF_ONE_RUN * missing]
        found = shares(telling, parent.chi2, self.bench.observations)
        self._fit_leads(first_of_each(found, 1, 0.0), parent.chi2)
        best = self.best(len(parent.hypothesis.parts) + 1)
        return best is not None and best.passes

    def _more(self, parent: FittedHypothesis) -> list[Hypothesis]:
        """What one more effect makes of a hypothesis, stepped as the design's world is."""
        own = parent.hypothesis.stepped(self.bench.design.world.time.substep)
        return [h for c in self.candidates for h in extended(own, c, self.bench.design.recording)]

    def finely(self, effects: int, times: float = FINEST) -> None:
        """Fit the best, and what is near to it, with steps so short that longer ones leave nothing undone: that is no
        effect, and decides between some. times: how much shorter than those of the world that was given they may be."""
        best = self.best(effects)
        if best is None or best.chi2 > NEARLY * self.bench.observations:
            return
        near = [t for i, t in enumerate(self.ranked(effects)) if i == 0 or t.ebic < best.ebic + CLOSE]
        for trial in near[: self.settings.finalists]:
            fine = refined(trial, self.substep, self.substep / times)
            if fine is not trial:
                self.trials[identity(trial.hypothesis)] = fine
                self.tell("finer steps", fine.figures())

    def settled(self, effects: int) -> None:
        """Fit the best on for as long as that moves it: what passes the gate may still be off what the data tell."""
        best = self.best(effects)
        for _ in range(ROUNDS):
            if best is None or best.fit.converged or best.chi2 > NEARLY * self.bench.observations:
                return
            before, best = best.chi2, self.take(self.bench.refit(best))
            self.tell("fit", best.figures())
            if before - best.chi2 < MOVED:
                return

    def _promised(self, parent: FittedHypothesis, found: Sequence[ScoreTestStart]) -> None:
        for lead in reversed(found):  # the best last, so that it stays
            self.promised[identity(lead.hypothesis)] = (parent.chi2, lead)

    @cached_property
    def early(self) -> FittedHypothesis:
        """The base fitted to the first part, `horizon`, of every run, where what is missing has not yet done much."""
        if self.ground.passes:
            return self.ground
        plan = self.bench.design
        horizons = tuple(h for h in profile.horizons_for(plan) if h <= profile.HORIZONS[0])
        states = profile.start_states(plan)
        return self.ground.bench.fit(self.ground.hypothesis, self.ground.values, states, horizons=horizons)

    @property
    def horizon(self) -> float:
        """Part of every run that the early fit is to."""
        if self.ground.passes:
            return 1.0
        return max(h for h in profile.horizons_for(self.bench.design) if h <= profile.HORIZONS[0])

    @cached_property
    def _windows(self) -> WindowSearch | None:
        """The search on windows: on long ones, or where these are no place to start from either, on short ones; but not
        on such short ones that the base explains them. None where the runs cannot be cut."""
        if self.ground.chi2 > FARTHER * self.bench.observations:
            short = windows(self.bench, SHORT)
            if short is None:
                return None
            ground = short.ground(self.ground.hypothesis, self.ground.values)
            if ground.chi2 > EXPLAINED * short.bench.observations:
                known = {identity(ground.hypothesis): ground}
                return WindowSearch(short, self.settings.starts, self.tell, known)
        return self._longer

    @cached_property
    def _longer(self) -> WindowSearch | None:
        """The search on long windows, which tell more where slopes still lead anywhere."""
        cut = windows(self.bench, LONG)
        return None if cut is None else WindowSearch(cut, self.settings.starts, self.tell)

    def _through_windows(
        self, search: WindowSearch, parents: Sequence[FittedHypothesis], most: int, level: float
    ) -> None:
        """Rank and fit one more effect on windows of the runs, then fit the whole runs from there where that gained."""
        found: list[tuple[FittedHypothesis, ScoreTestStart]] = []
        for parent in parents:
            own = search.leads(parent, self._more)
            if own:
                self._promised(own[0][0], [lead for _, lead in own])
            found += own
        known = self.trials if parents[0].hypothesis.parts else ()
        ranked = search.fitted(found, most, known) if found else []
        if not ranked:
            return
        hopeless = self.hopeless(len(ranked[0].hypothesis.parts))
        others = self._longer is not None and self._longer is not search and not parents[0].hypothesis.parts
        if hopeless and others and touchy(self.bench.design):
            return  # longer windows tell more of what is so far off, and whole runs cost more
        chosen: list[FittedHypothesis] = []
        for trial in ranked[: window_search.FEW if hopeless else None]:
            explained = any(self._explains(t, level) for t in chosen)
            if explained and self._behind(trial, ranked[0]):
                break
            chosen.append(self._whole(search, trial))
        if not hopeless:
            self.finish(chosen, level)

    def _explains(self, trial: FittedHypothesis, level: float) -> bool:
        """Whether a trial explains what fits with chi2 `level` do not: nearly, or where these already do so, as the
        gate has it."""
        near = EXPLAINED * self.bench.observations
        return trial.passes if level < near else trial.chi2 < near

    def _behind(self, trial: FittedHypothesis, leader: FittedHypothesis) -> bool:
        """Whether a trial on windows is so far behind the leader there that whole runs need not be asked: where bodies
        collide, these decide between those hardly apart."""
        if profile.collide(self.bench.design):
            return trial.ebic > leader.ebic + CLOSE
        return trial.chi2 > BEHIND * leader.chi2

    def _whole(self, search: WindowSearch, trial: FittedHypothesis) -> FittedHypothesis:
        """The best fit to whole runs of a hypothesis fitted on windows.

        Where bodies collide, every run finds its states by itself first, at the windows' shared values.
        """
        start = search.cut.start(trial.fit)
        if touchy(self.bench.design):
            starts = [start.states, profile.start_states(self.bench.design)]
            best = self.best(len(trial.hypothesis.parts))
            explained = best is not None and best.chi2 < EXPLAINED * self.bench.observations
            like = None
            if best is not None and explained:
                like = self.bench.fit(trial.hypothesis, start.values, best.fit.states)
                if best.passes and refused(like, best):
                    self.tell("first fit", like.figures())
                    return self.take(like)
            whole = begun(self.bench, trial.hypothesis, start.values, starts, like)
            if like is None:
                self.run_by_run.add(identity(trial.hypothesis))
        else:
            horizons = profile.FINE_HORIZONS if profile.collide(self.bench.design) else (1.0,)
            whole = self.bench.fit(
                trial.hypothesis, start.values, start.states, horizons=horizons, iterations=FIRST_ITERATIONS
            )
        self.tell("first fit", whole.figures())
        return self.take(searched(whole))

    def astray(self, effects: int) -> tuple[str, ...]:
        """Runs that the best with so many effects, or the base, does not follow although it explains their windows."""
        search = self.on_windows
        for whole in (self.ground, self.best(effects)):
            on_windows = None if search is None or whole is None else search.trials.get(identity(whole.hypothesis))
            if search is not None and whole is not None and on_windows is not None:
                lost = astray(whole, search.cut, on_windows)
                if lost:
                    return lost
        return ()

    def hopeless(self, effects: int) -> bool:
        """Whether so many effects do not even explain windows, with the best of them fitted to the end there."""
        return self.on_windows is not None and self.on_windows.hopeless(effects)

    def _scored(
        self, trial: FittedHypothesis, parent: FittedHypothesis, hypotheses: Sequence[Hypothesis], horizon: float
    ) -> list[ScoreTestStart]:
        own = leads(self.bench, trial, hypotheses, self.settings.starts, horizon)
        self.tell(
            "score test",
            {
                "on": parent.hypothesis.title,
                "horizon": horizon,
                "chi2": trial.chi2,
                "promised": [{"effect": x.hypothesis.title, "chi2": x.chi2} for x in own[:12]],
            },
        )
        return own

    def promising(self, ground: FittedHypothesis, gain: float) -> list[FittedHypothesis]:
        """Fits of one effect on top of a hypothesis, where the score test foretells that EBIC falls by more than
        `gain`; best first."""
        choice = 2.0 * float(np.log(max(self.bench.candidates, 1)))
        own = [
            lead
            for lead in leads(self.bench, ground, self._more(ground), 1)
            if promise(lead, self.bench.observations) + choice < ground.ebic - gain
        ]
        chosen = own[: self.settings.contenders]
        if touchy(self.bench.design):
            starts = [self.bench.nearest(x.hypothesis, self._options(ground, x)) for x in chosen]
        else:
            starts = [Start(x.values, ground.fit.states) for x in chosen]
        fits = [self.bench.fit(x.hypothesis, s.values, s.states) for x, s in zip(chosen, starts, strict=True)]
        return sorted((profiled(t) for t in fits), key=lambda t: t.ebic)

    def best(self, effects: int) -> FittedHypothesis | None:
        """The hypothesis with so many effects that has the lowest EBIC."""
        ranked = self.ranked(effects)
        return ranked[0] if ranked else None

    def _fit_leads(self, chosen: Sequence[PredictedGain], level: float) -> None:
        """First iterations of every lead, then to convergence where it may still win."""
        self.finish([self.take(self._first_fit(p.parent, p.lead)) for p in chosen], level)

    def _first_fit(self, parent: FittedHypothesis, lead: ScoreTestStart) -> FittedHypothesis:
        """Where the parent is far from the data, over growing horizons from early states: its own states are bent to
        its law, and the slopes there foretell little. Else from the best of several starts nearby."""
        if parent.chi2 > FAR * self.bench.observations:
            return self.bench.fit(
                lead.hypothesis,
                lead.values,
                self.early.fit.states,
                horizons=profile.horizons_for(self.bench.design),
                iterations=FIRST_ITERATIONS,
            )
        start = self.bench.nearest(lead.hypothesis, self._options(parent, lead))
        return self.bench.fit(lead.hypothesis, start.values, start.states, iterations=FIRST_ITERATIONS)

    def _options(self, parent: FittedHypothesis, lead: ScoreTestStart) -> list[Start]:
        """Starts of a lead: the effect on with early states; off, with the parent's; and on the way to what the score
        test foretells."""
        options = [Start(lead.values, self.early.fit.states)]
        if lead.before is not None:
            options.append(Start(lead.before, parent.fit.states))
        if lead.states is not None and lead.before is not None:
            for share in PARTS:
                middle = tuple(
                    (1.0 - share) * a + share * b for a, b in zip(parent.fit.states, lead.states, strict=True)
                )
                options.append(Start((1.0 - share) * lead.before + share * lead.values, middle))
        return options

    def finish(self, trials: Iterable[FittedHypothesis], level: float) -> None:
        """Fit to convergence those trials that may still win. level: chi2 of what they are to improve on."""
        distinct = {identity(t.hypothesis): self.take(t) for t in trials}
        ranked = sorted(distinct.values(), key=lambda t: t.ebic)
        explained = False
        for rank, trial in enumerate(ranked[: self.settings.finalists]):
            least = min(t.chi2 for t in self.trials.values() if len(t.hypothesis.parts) == len(trial.hypothesis.parts))
            hopeless = level - trial.chi2 <= HOPELESS * (level - least) and not self._was_to_lead(trial, level, least)
            if trial.fit.converged or hopeless:
                continue
            if rank == 0 or (rank < LEADERS and not explained):
                trial = self._to_the_end(trial)
                explained = explained or trial.passes
                self.tell("fit", trial.figures())
            else:
                self.tell("fit", self.take(self.bench.refit(trial, target=least + MARGIN)).figures())

    def _was_to_lead(self, trial: FittedHypothesis, level: float, least: float) -> bool:
        """Whether a trial that began near the data, at chi2 `level`, was to become better than the least there is."""
        foretold = self.foretold.get(identity(trial.hypothesis), np.inf)
        return level < FAR * self.bench.observations and foretold < least

    def _to_the_end(self, trial: FittedHypothesis) -> FittedHypothesis:
        """A leader fitted as long as chi2 falls: with strongly coupled unknowns the way is long, in small steps."""
        for _ in range(ROUNDS):
            before = trial.chi2
            trial = self.take(self.bench.refit(trial))
            if trial.fit.converged or before - trial.chi2 < ONWARD * trial.chi2:
                break
        return trial

    def _nested(self, parents: Sequence[FittedHypothesis]) -> None:
        """Start richer laws from simpler ones fitted already: those whose unknowns they have, by name and unit."""
        effects = len(parents[0].hypothesis.parts) + 1
        simple = self.ranked(effects)[: self.settings.finalists]
        started: list[FittedHypothesis] = []
        for trial in self.ranked(effects):
            own = trial.hypothesis.parts[-1].variant.unknowns
            for other in simple:
                theirs = other.hypothesis.parts[-1].variant.unknowns
                inner = {(u.name, u.unit) for u in theirs}
                if other.hypothesis.parts[:-1] != trial.hypothesis.parts[:-1]:
                    continue
                if not inner < {(u.name, u.unit) for u in own}:
                    continue
                told = other.hypothesis.of_part(effects - 1, other.values)
                kept = other.values[: len(other.values) - len(theirs)]
                values = np.concatenate([kept, [told.get(u.name, u.start) for u in own]])
                started.append(
                    self.take(self.bench.fit(trial.hypothesis, values, other.fit.states, iterations=ROUGH_ITERATIONS))
                )
        self.finish(started, min(p.chi2 for p in parents))

    def restart(self, effects: int) -> None:
        """Fit the leaders anew from the data's own starts, a little more of each run at a time: out of minima behind a
        bounce, and of rolling that is turns ahead."""
        for trial in self.ranked(effects)[:RESTARTED]:
            self._anew("restart", trial.hypothesis.stepped(self.bench.design.world.time.substep), trial)

    def settle(self, effects: int) -> None:
        """Fit what may be told anew, a little more of each run at a time, or where bodies collide, run by run.

        A fit can pass the gate in a minimum next to the right one, with values that are several standard errors off;
        and where bodies collide, one that is far behind may only be stuck, unless windows have told.
        """
        best = self.best(effects)
        if best is None or not (profile.collide(self.bench.design) or any(_edged(p) for p in best.hypothesis.parts)):
            return
        windows_told = self.on_windows is not None and any(
            len(t.hypothesis.parts) == effects for t in self.on_windows.trials.values()
        )
        untold = profile.collide(self.bench.design) and not windows_told
        doubt = max(self.settings.credible, DOUBT * self.bench.observations if untold else 0.0)
        near = [t for t in self.ranked(effects) if t.ebic <= best.ebic + doubt]
        for trial in near[: self.settings.finalists]:
            if not touchy(self.bench.design):
                self._anew("settled", trial.hypothesis, trial, IN_DOUBT)
                continue
            self._bettered("settled", trial, profiled(searched(trial, doubt=IN_DOUBT)))
        if touchy(self.bench.design):
            self._contest(effects)

    def _contest(self, effects: int) -> None:
        """Where hypotheses are so near that one run which is stuck would decide: look all runs of the best through."""
        near = [t for t in self.ranked(effects) if t.ebic <= self.ranked(effects)[0].ebic + CLOSE]
        if any(t.chi2 > near[0].chi2 + ALIKE_FIT for t in near):
            for trial in near[:CONTESTED]:
                self._bettered("contested", trial, profiled(looked_through(trial)))

    def beyond(self, effects: int) -> None:
        """Fit the best from greater friction: where a grip suffices more of it changes nothing, and a fit that stopped
        short of that feels no slope towards it."""
        best = self.best(effects)
        if best is None or "friction" not in (u.name for u in best.hypothesis.unknowns):
            return
        place = next(i for i, u in enumerate(best.hypothesis.unknowns) if u.name == "friction")
        for times in GREATER:
            values = best.values.copy()
            values[place] = min(times * values[place], best.hypothesis.unknowns[place].upper)
            further = self.bench.fit(best.hypothesis, values, best.fit.states)
            if further.chi2 < best.chi2 - ALIKE_FIT:
                self.tell("beyond", further.figures())
            self.take(further)

    def _anew(self, step: str, hypothesis: Hypothesis, trial: FittedHypothesis, doubt: float = UNLIKELY) -> None:
        """Fit a hypothesis from a trial's values and the data's own starts, a little more of each run at a time."""
        self._bettered(step, trial, searched(anew(trial, hypothesis), doubt=doubt))

    def _bettered(self, step: str, trial: FittedHypothesis, again: FittedHypothesis) -> None:
        """Keep another fit of a trial's hypothesis where it is better, and tell of it."""
        if again.chi2 < trial.chi2 - ALIKE_FIT:
            self.tell(step, again.figures())
        self.take(again)

    def swap(self, effects: int) -> None:
        """Replace each effect of the best hypothesis by every other that promises more."""
        best = self.best(effects)
        if best is None or effects < 2:
            return
        base = Hypothesis(self.bench.design.world, best.hypothesis.base)
        parents = []
        for index in range(effects):
            smaller = without_part(base, best.hypothesis, index, best.values, self.bench.design.recording)
            if smaller is None:
                continue
            known = self.trials.get(identity(smaller[0]))
            parents.append(known or self.take(self.bench.fit(smaller[0], smaller[1], best.fit.states)))
        self.tell("swap", {"of": best.hypothesis.title, "kept": [p.hypothesis.title for p in parents]})
        if parents:
            self.add_effect(parents)

    def backward(self, trial: FittedHypothesis) -> FittedHypothesis:
        """Drop effects that the gate and EBIC do not miss."""
        while len(trial.hypothesis.parts) > 1:
            base = Hypothesis(self.bench.design.world, trial.hypothesis.base)
            smaller = []
            for index in range(len(trial.hypothesis.parts)):
                less = without_part(base, trial.hypothesis, index, trial.values, self.bench.design.recording)
                if less is None:
                    continue
                fewer = self.take(self.bench.fit(less[0], less[1], trial.fit.states))
                if not fewer.passes:  # the states may have followed the effect that is left out
                    horizons = profile.horizons_for(self.bench.design)
                    states = profile.start_states(self.bench.design)
                    again = self.bench.fit(less[0], less[1], states, horizons=horizons)
                    fewer = self.take(searched(again, trial.ebic + self.settings.credible))
                smaller.append(fewer)
            good = [t for t in smaller if t.passes and t.ebic <= trial.ebic + self.settings.credible]
            if not good:
                return trial
            trial = min(good, key=lambda t: t.ebic)
            self.tell("backward", trial.figures())
        return trial


def _edged(part: Part) -> bool:
    """Whether an effect is one of contacts within a place: with an edge that paths cross."""
    return part.candidate.group == "contact" and bool(part.variant.idle)
