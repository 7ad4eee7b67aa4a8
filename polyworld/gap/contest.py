"""Rank the hypotheses that one more effect makes of others, on whole runs or on segments of them, and fit the best.

Over a whole run a missing effect adds up, and behind a few impacts slopes predict nothing; over a segment it does not.
So where the parents are far from the data, effects compete on segments fitted with initial states of their own.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import zip_longest
from typing import Any

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation import profile
from polyworld.estimation.fit_context import FitContext, FittedHypothesis, Start
from polyworld.estimation.hypothesis import Hypothesis
from polyworld.estimation.refitting import refit_ill_runs
from polyworld.estimation.score_test import ScoreTestStart, score_test_starts
from polyworld.estimation.variable_projection import profiled
from polyworld.gap import ebic
from polyworld.gap.refined_starts import closer
from polyworld.gap.segment_context import SegmentContext
from polyworld.gap.settings import SearchSettings
from polyworld.gap.strength_map import mapped

Array = NDArray[np.float64]
Key = tuple[str, ...]

ReportStep = Callable[[str, dict[str, Any]], None]
More = Callable[[FittedHypothesis], list[Hypothesis]]

HALFWAY = (0.3, 1.0)  # shares of the predicted step that are tried as starts: slopes often ask for too much


def labels(hypothesis: Hypothesis) -> list[str]:
    """Return its effects and their variants, in the order in which they were added."""
    return [f"{p.candidate.name}|{p.variant.label}" for p in hypothesis.parts]


def identity(hypothesis: Hypothesis) -> Key:
    """Return what makes two hypotheses the same, in whatever order their effects were added."""
    return tuple(sorted(labels(hypothesis)))


@dataclass(frozen=True)
class Prediction:
    """Starts of one hypothesis on top of one parent, best first, and the share of the best predicted gain."""

    parent: FittedHypothesis
    starts: tuple[ScoreTestStart, ...]
    share: float

    @property
    def hypothesis(self) -> Hypothesis:
        """The hypothesis."""
        return self.starts[0].hypothesis


@dataclass
class Contest:
    """Hypotheses fitted to one layout of the data: `context`. segments: those of the runs, None for whole runs.

    fitted: the best fit of each hypothesis so far. predicted: of each hypothesis, the best prediction so far.
    """

    context: FitContext
    segments: SegmentContext | None
    settings: SearchSettings
    report: ReportStep
    fitted: dict[Key, FittedHypothesis] = field(default_factory=dict)
    predicted: dict[Key, Prediction] = field(default_factory=dict)

    @property
    def observations(self) -> float:
        """Number of measurements."""
        return self.context.observations

    def take(self, trial: FittedHypothesis) -> FittedHypothesis:
        """Keep a fit if it is the best of its hypothesis so far; return the best."""
        key = identity(trial.hypothesis)
        known = self.fitted.get(key)
        if np.isfinite(trial.chi2) and (known is None or trial.chi2 < known.chi2):
            self.fitted[key] = trial
        return self.fitted.get(key, trial)

    def ranked(self, effects: int | None = None) -> list[FittedHypothesis]:
        """Return the fits (of hypotheses with so many effects), lowest extended BIC first."""
        chosen = [t for t in self.fitted.values() if effects is None or len(t.hypothesis.parts) == effects]
        return ebic.ranked_by_title(chosen)

    def best(self, effects: int) -> FittedHypothesis | None:
        """Return the fit with so many effects that has the lowest extended BIC."""
        ranked = self.ranked(effects)
        return ranked[0] if ranked else None

    def explained(self, trial: FittedHypothesis) -> bool:
        """Return whether a fit leaves no more than noise would, but for twice how much that varies."""
        noise = self.observations
        return trial.chi2 < noise + 2.0 * float(np.sqrt(2.0 * noise))

    def holds(self, hypothesis: Hypothesis) -> bool:
        """Return whether a hypothesis can be fitted to this layout."""
        return self.segments is None or self.segments.holds(hypothesis)

    # -- predictions ---------------------------------------------------------------------------------------------

    def predict(self, parents: Sequence[FittedHypothesis], more: More) -> list[Prediction]:
        """Return what the score test predicts of the hypotheses that one more effect makes of parents fitted here.

        The best of every parent, then the second best of every one, and so on: the best parent need not be half of the
        truth. Effects that may act at an impact are judged by chi2 itself at their starts.
        """
        found: list[tuple[FittedHypothesis, tuple[ScoreTestStart, ...]]] = []
        for parent in parents:
            own: dict[Key, list[ScoreTestStart]] = {}
            held = [h for h in more(parent) if self.holds(h)]
            for tested in score_test_starts(
                self.context, parent, [h for h in held if not self._steep(h)], self.settings.few
            ):
                own.setdefault(identity(tested.hypothesis), []).append(tested)
            for hypothesis in held:
                if self._steep(hypothesis):
                    tried = score_test_starts(self.context, parent, [hypothesis], self.settings.impacts)
                    seen = sorted((self._evaluated(parent, x) for x in tried), key=lambda x: x.chi2)
                    own.setdefault(identity(hypothesis), []).extend(seen[: self.settings.few])
            found += [(parent, tuple(sorted(x, key=lambda tested: tested.chi2))) for x in own.values() if x]
        gains = [ebic.predicted_gain(p, starts[0], self.context) for p, starts in found]
        best = max(max(gains, default=0.0), 1e-9)
        ranked = sorted(
            (Prediction(p, starts, gain / best) for (p, starts), gain in zip(found, gains, strict=True)),
            key=lambda x: -x.share,
        )
        for prediction in reversed(ranked):
            self.predicted[identity(prediction.hypothesis)] = prediction
        self.report(
            "score test",
            {
                "on": [p.hypothesis.title for p in parents],
                "segments": self.segments is not None,
                "predicted": [{"effect": x.hypothesis.title, "chi2": x.starts[0].chi2} for x in ranked[:12]],
            },
        )
        columns = [[x for x in ranked if x.parent is parent] for parent in parents]
        rows = zip_longest(*columns)
        return [x for row in rows for x in row if x is not None]

    def _steep(self, hypothesis: Hypothesis) -> bool:
        """Return whether chi2 of the last effect is no smooth function of it: what acts where bodies touch."""
        return self.segments is not None and at_contacts(hypothesis)

    def _evaluated(self, parent: FittedHypothesis, tested: ScoreTestStart) -> ScoreTestStart:
        chi2, _ = self._nearest(tested.hypothesis, self._options(parent, tested))
        return ScoreTestStart(tested.hypothesis, tested.values, min(tested.chi2, chi2), tested.before, tested.states)

    def _options(self, parent: FittedHypothesis, tested: ScoreTestStart) -> list[Start]:
        """Return starts of a fit: as predicted, halfway, the effect still off, and with the data's own initial
        states."""
        data = profile.start_states(self.context.design)
        options = [Start(tested.values, parent.fit.states), Start(tested.values, data)]
        if tested.before is not None:
            options.append(Start(tested.before, parent.fit.states))
            if tested.states is not None and self.segments is None:
                for share in HALFWAY:
                    pairs = zip(parent.fit.states, tested.states, strict=True)
                    middle = tuple((1.0 - share) * a + share * b for a, b in pairs)
                    options.append(Start((1.0 - share) * tested.before + share * tested.values, middle))
        return options

    def _nearest(self, hypothesis: Hypothesis, options: Sequence[Start]) -> tuple[float, Start]:
        """Return the option nearest to the data; on segments, which share nothing but values, segment by segment."""
        costs = self.context.run_costs(hypothesis, options)
        if self.segments is None:
            k = int(np.argmin(costs.sum(axis=1)))
            return float(costs[k].sum()), options[k]
        best: tuple[float, Start] | None = None
        for values in {o.values.tobytes(): o.values for o in options}.values():
            same = [k for k, o in enumerate(options) if np.array_equal(o.values, values)]
            choice = np.argmin(costs[same], axis=0)
            states = tuple(options[same[k]].states[r] for r, k in enumerate(choice))
            chi2 = float(np.min(costs[same], axis=0).sum())
            if best is None or chi2 < best[0]:
                best = (chi2, Start(values, states))
        assert best is not None
        return best

    # -- fits ----------------------------------------------------------------------------------------------------

    def fit(self, predictions: Sequence[Prediction], most: int, level: float) -> list[FittedHypothesis]:
        """Fit the hypotheses that predict most, and those to the end that may still win; best first.

        most: how many, besides those that no slope predicts. level: chi2 that they are to improve on.
        """
        ways: dict[Key, list[Prediction]] = {}
        for p in predictions:
            ways.setdefault(identity(p.hypothesis), []).append(p)
        keys = list(ways)
        unpredictable = [k for k in keys[most:] if unpredicted(ways[k][0].hypothesis)]
        fits: list[FittedHypothesis] = []
        done = False
        for key in (*keys[:most], *unpredictable):
            if done and max(p.share for p in ways[key]) < self.settings.half:
                continue
            fits.append(self._first_fit(ways[key], all(t.chi2 >= level for t in fits)))
            done = done or self._nearly_all(fits[-1], level)
        if not any(self.explained(t) for t in fits):
            for i, trial in enumerate(self._worth(fits, level)):
                fits.append(self._better_place(trial, ways[identity(trial.hypothesis)]))
                if self.explained(fits[-1]) or i >= self.settings.few:
                    break
        wanted = self._worth(list({identity(t.hypothesis): self.take(t) for t in fits}.values()), level)
        wanted = [self.take(self._robust(self.context.refit(t, iterations=self.settings.rough))) for t in wanted]
        return self.finish(wanted, level)

    def finish(self, trials: Sequence[FittedHypothesis], level: float) -> list[FittedHypothesis]:
        """Fit to the end those that may still win; best first. level: chi2 that they are to improve on."""
        return self._to_the_end(self._worth(trials, level))

    def _first_fit(self, ways: Sequence[Prediction], leads_so_far: bool) -> FittedHypothesis:
        """First iterations from the nearest start; from the data's own states too where the parent's mislead."""
        context, rough = self.context, self.settings.rough
        found: list[tuple[float, Start, Hypothesis]] = []
        for order in dict.fromkeys(tuple(labels(p.hypothesis)) for p in ways):  # in which unknowns come
            own = [p for p in ways if tuple(labels(p.hypothesis)) == order]
            options = [o for p in own for tested in p.starts for o in self._options(p.parent, tested)]
            found.append((*self._nearest(own[0].hypothesis, options), own[0].hypothesis))
        _, start, hypothesis = min(found, key=lambda f: f[0])
        ways = [p for p in ways if labels(p.hypothesis) == labels(hypothesis)]
        trial = context.fit(hypothesis, start.values, start.states, iterations=rough)
        far = self.segments is not None or ways[0].parent.chi2 > self.settings.far * self.observations
        mislead = (far and profile.collide(context.design)) or unpredicted(hypothesis)
        if mislead and not self.explained(trial):
            data, horizons = profile.start_states(context.design), profile.horizons_for(context.design)
            off = [x.before for p in ways for x in p.starts if x.before is not None] or [start.values]
            for values in (off if unpredicted(hypothesis) else [start.values])[: self.settings.few]:
                other = context.fit(hypothesis, values, data, horizons=horizons, iterations=rough)
                trial = min([trial, other], key=lambda t: t.chi2)
        return self.take(self._robust(trial) if leads_so_far else trial)

    def _better_place(self, trial: FittedHypothesis, ways: Sequence[Prediction]) -> FittedHypothesis:
        """Fit an effect with a place, an edge or a rhythm from closer starts; return the best."""
        part = trial.hypothesis.parts[-1]
        if not part.variant.idle:
            return trial
        same = [p for p in ways if labels(p.hypothesis) == labels(trial.hypothesis)]
        if not same:
            return trial
        parent, own = same[0].parent, list(same[0].starts)
        starts = mapped(parent, trial.hypothesis) if part.variant.everywhere is not None else []
        starts += closer(self.context, parent, trial.hypothesis, own)[: self.settings.few]
        for x in starts:
            tried = self.context.fit(x.hypothesis, x.values, parent.fit.states, iterations=2 * self.settings.rough)
            trial = min([trial, self._robust(tried)], key=lambda t: t.chi2)
            if self.explained(trial):
                break
        return trial

    def _robust(self, trial: FittedHypothesis) -> FittedHypothesis:
        return refit_ill_runs(trial) if self.segments is not None else trial

    def _to_the_end(self, ranked: Sequence[FittedHypothesis]) -> list[FittedHypothesis]:
        """Fit the leader to convergence; where it fails, also those behind it, which may only be slower."""
        done: list[FittedHypothesis] = []
        for trial in ranked:
            if len(done) == self.settings.few or any(self.explained(t) for t in done):
                break
            done.append(self.take(self._converged(trial)))
        return ebic.ranked([*done, *ranked[len(done) :]])

    def _converged(self, trial: FittedHypothesis) -> FittedHypothesis:
        for _ in range(self.settings.rounds):
            before = trial
            trial = self.context.refit(trial)
            if trial.fit.converged or before.chi2 - trial.chi2 < self.settings.onward * trial.chi2:
                break
        if self.segments is not None and profile.collide(self.context.design):
            trial = refit_ill_runs(trial)
            trial = trial if self.explained(trial) else profiled(trial)
        self.report("fit", trial.figures() | {"segments": self.segments is not None})
        return trial

    def _nearly_all(self, trial: FittedHypothesis, level: float) -> bool:
        """Return whether hardly more is left of what a fit to the data lacked than noise."""
        return trial.chi2 - self.observations < 0.1 * (level - self.observations) or self.explained(trial)

    def _worth(self, trials: Sequence[FittedHypothesis], level: float) -> list[FittedHypothesis]:
        """Select the first few fits, all that gain half of what the best does, and all within reach; best first."""
        ranked = ebic.ranked(trials)
        few = 1 if any(self._nearly_all(t, level) for t in ranked) else self.settings.few
        return [
            t
            for i, t in enumerate(ranked)
            if i < few
            or level - t.ebic >= self.settings.half * (level - ranked[0].ebic)
            or ebic.competes(t, ranked[0], self.settings.credible)
        ]


def at_contacts(hypothesis: Hypothesis) -> bool:
    """Return whether the last effect acts where bodies touch: an obstacle, another law of contact, or friction."""
    candidate = hypothesis.parts[-1].candidate
    return candidate.group in ("structure", "contact") or candidate.name == "friction_error"


def unpredicted(hypothesis: Hypothesis) -> bool:
    """Return whether no slope predicts the last effect, nor chi2 before initial states have followed: it cannot be
    switched off, or what it does ends where bodies stick."""
    part = hypothesis.parts[-1]
    jumps = part.variant.strength is None and len(part.variant.starts) > 1
    return at_contacts(hypothesis) and (jumps or part.candidate.further is not None)
