"""Decide what may be named: the core that bootstraps keep, competitors, intervals away from zero, what is closed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t

from polyworld.gap.choose import choose, credible, distinct, helped, helped_folds, winners
from polyworld.gap.cross_validation import reduced
from polyworld.gap.fitting import Fitted, correlation_evidence, independent_share, share_left
from polyworld.gap.hypothesis import Part

Array = NDArray[np.float64]

Kind = Literal["identified", "identified_with_remainder", "ambiguous", "unexplained", "nothing_missing"]


@dataclass(frozen=True)
class Verdict:
    """A verdict. best: the hypothesis that is named, or the nearest one. competitors: others that are as near.

    frequencies: share of resamplings that hold an effect; stable: of those that hold all of the best's.
    before, after: held-out errors in standard deviations of the noise. reasons: what kept it from being more.
    equivalent: hypotheses that predict the same motion as the best one, so that no data of this design separate them.
    """

    kind: Kind
    best: Fitted
    competitors: tuple[Fitted, ...]
    frequencies: dict[str, float]
    stable: float
    before: float
    after: float
    share: float
    reasons: tuple[str, ...] = ()
    equivalent: tuple[Fitted, ...] = ()


def decide(pool: Sequence[Fitted], null: Fitted, share: float, one_course: bool = False) -> Verdict:
    """Decide on a pool of hypotheses that are scored alike.

    one_course: whether all runs repeat one motion that passes no place twice. Place, time and speed are one variable
    then: no law of a place or a clock can be named, and all plain laws compete that close most of the gap.
    """
    settings = null.ground.settings
    trusted = credible(pool, null)
    if one_course:
        trusted = [f for f in trusted if not any(p.stands_in for p in f.hypothesis.parts)]
    if null not in trusted:
        trusted.append(null)
    trusted, same = distinct(trusted, null)
    kept = helped_folds(min(trusted, key=lambda f: f.total), trusted, null)
    choice = choose(trusted, settings, share, kept=kept)
    named = choice.chosen
    drawn = winners(trusted, settings, share, kept)
    names = {n for f in drawn for n in f.hypothesis.names}
    frequency = {n: float(np.mean([n in f.hypothesis.names for f in drawn])) for n in sorted(names)}
    if not any(_competes(f, named) for f in choice.near):
        named = _needed(named, trusted, frequency)
    competitors = [f for f in choice.near if _competes(f, named)]
    if one_course and named is not null:
        enough = max(named.error / settings.halved, settings.closed * null.error)
        likely = [f for f in trusted if f.error < enough and len(f.hypothesis.parts) == 1]
        likely = [f for f in likely if all(p.candidate.plain for p in f.hypothesis.parts) and f is not null]
        competitors += [f for f in likely if _competes(f, named) and not any(f is g for g in competitors)]
    before, after = null.error, named.error
    lost = [f for f in drawn if not named.hypothesis.names <= f.hypothesis.names]
    stable = 1.0 - len(lost) / len(drawn)
    if share == 1.0:  # of other laws the difference decides, whose noise is known: that fewer do is left to ask
        lost = [f for f in lost if f.hypothesis.names < named.hypothesis.names]
    if not competitors and len(lost) > settings.share * len(drawn):
        others = sorted({id(f): f for f in lost}.values(), key=lambda f: f.total)
        competitors = [f for f in others if not _richer(f, named) or _matters(f, named)][:4]
    kind, reasons = _kind(named, null, competitors, _weak(named, pool, share))
    alone = [p.candidate.name for p in named.hypothesis.parts if _in_one_run(p, named, trusted, null)]
    if kind in ("identified", "identified_with_remainder") and alone:
        kind, reasons = "unexplained", (f"only one run shows {', '.join(alone)}: any sudden push does the same there",)
    best = min(pool, key=lambda f: f.total)
    odd = not best.hypothesis.possible(best.values, settings) and not named.hypothesis.names <= best.hypothesis.names
    if (kind == "nothing_missing" or odd) and named.total - best.total > settings.excluded:
        kind, reasons = "unexplained", (f"{best.hypothesis.title} predicts better, {_distrusted(best, one_course)}",)
    equivalents = tuple(same.get(id(named), ()))
    return Verdict(kind, named, tuple(competitors), frequency, stable, before, after, share, reasons, equivalents)


def _distrusted(best: Fitted, one_course: bool) -> str:
    """Say why a hypothesis that predicts best is not named."""
    if not best.hypothesis.possible(best.values, best.ground.settings):
        return "with values that are not plausible"
    if one_course and any(p.stands_in for p in best.hypothesis.parts):
        return "but runs that repeat one course cannot show a law of a place or a clock"
    return "but bends to whatever is left, and leaves much of it"


def _in_one_run(part: Part, named: Fitted, trusted: Sequence[Fitted], null: Fitted) -> bool:
    """Return whether a law that acts on all runs at one place shows in a single one."""
    ground = null.ground
    runs = ground.recording.runs
    if part.candidate.group != "structure" or not len(named.errors) == len(runs) >= ground.settings.fewest_runs:
        return False
    without = named.hypothesis.key - {(part.candidate.name, part.variant.label)}
    less = next((f for f in trusted if f.hypothesis.key == without), null)
    return int(np.sum(helped(named, less))) == 1


def _needed(named: Fitted, trusted: Sequence[Fitted], frequency: dict[str, float]) -> Fitted:
    """Return the hypothesis without the laws that bootstraps do not keep, or that matter less than model error does.

    Where a remainder is left, what lowers it by little may be a part of it.
    """
    settings = named.ground.settings
    while len(named.hypothesis.parts) > 1:
        fewer = [f for f in trusted if f.hypothesis.names < named.hypothesis.names]
        fewer = [f for f in fewer if len(f.hypothesis.parts) == len(named.hypothesis.parts) - 1]
        error = named.error
        for f in sorted(fewer, key=lambda f: f.total):
            (dropped,) = named.hypothesis.names - f.hypothesis.names
            small = settings.matters * f.error < error
            if small and (error > settings.near_noise or frequency.get(dropped, 0.0) < settings.core):
                named = f
                break
        else:
            break
    return named


def _weak(named: Fitted, pool: Sequence[Fitted], share: float) -> list[str]:
    """Return laws whose strengths do not differ from zero. Where noise alone is left, prediction shows that they do,
    though a strength and a place that trade off have wide intervals."""
    found = not_zero(named)
    if share < 1.0:
        return found
    most = named.total + named.ground.settings.excluded
    fewer = [f.hypothesis.names for f in pool if f.hypothesis.names < named.hypothesis.names and f.total < most]
    return [name for name in found if any(name not in names for names in fewer)]


def _competes(other: Fitted, named: Fitted) -> bool:
    """Return whether a near hypothesis is another answer: as simple, or one that matters beside what is named."""
    if other is named or named.hypothesis.names <= other.hypothesis.names:
        return False
    return _distinguished(other) != _distinguished(named) and (not _richer(other, named) or _matters(other, named))


def _richer(other: Fitted, named: Fitted) -> bool:
    """Return whether a hypothesis has more to bend than what is named."""
    return other.simplicity > named.simplicity + 1e-6


def _matters(richer: Fitted, named: Fitted) -> bool:
    """Return whether a richer hypothesis is more than a part of what another leaves.

    Near the noise it is where it predicts better. Of a remainder, whose errors are alike, it has to close much.
    """
    settings = named.ground.settings
    if named.error < settings.near_noise:
        return richer.total < named.total
    return share_left(named.error, richer.error) < settings.matters


def _distinguished(fitted: Fitted) -> frozenset[str]:
    """Return the names of effects, one for those that the design cannot distinguish by construction."""
    return frozenset(min([p.candidate.name, *p.variant.same_as]) for p in fitted.hypothesis.parts)


def _kind(
    named: Fitted, null: Fitted, competitors: Sequence[Fitted], weak: Sequence[str]
) -> tuple[Kind, tuple[str, ...]]:
    settings = null.ground.settings
    before, after = null.error, named.error
    if named is null:
        if competitors:
            return "ambiguous", ()
        return ("nothing_missing", ()) if named.quiet else ("unexplained", ("no effect predicts what is left",))
    left = share_left(before, after)
    if after >= settings.near_noise and left > settings.closed:
        return "unexplained", (f"the best law found leaves {100.0 * left:.0f}% of the held-out gap",)
    if competitors:
        return "ambiguous", ()
    if weak:
        return "unexplained", (f"the interval of {', '.join(weak)} contains zero",)
    if after < settings.near_noise:
        correlated = _correlated(named)
        if not correlated:
            return "identified", ()
        return "unexplained", (
            f"what is left of run {correlated} is no noise: errors that follow each other are alike",
        )
    bending = [p.candidate.name for p in named.hypothesis.parts if p.placed and not p.candidate.local]
    if bending:
        return "unexplained", (f"{', '.join(bending)} bends to whatever is left, and leaves much of it",)
    return "identified_with_remainder", ()


def _correlated(named: Fitted) -> str:
    """Return the run whose held-out residuals are least like white noise, "" where all are like it.

    Of few runs stretches are predicted, whose errors share those of the parameters.
    """
    runs, settings = named.ground.recording.runs, named.ground.settings
    if len(runs) < settings.fewest_runs:
        return ""
    evidence = correlation_evidence(named)
    return runs[int(evidence.argmax())].name if evidence.max() > settings.excluded else ""


def intervals(fitted: Fitted, level: float = 0.95) -> Array:
    """Return intervals (S, 2) of shared unknowns, robust to what runs have of their own.

    Sandwich over runs (Liang & Zeger 1986, Biometrika 73, 13) with t of R - 1 degrees, and no narrower than the
    information with the scale of the residuals says, its correlation counted. Of few runs the latter alone.
    """
    found = reduced(fitted)
    s, runs = len(fitted.values), len(fitted.slopes)
    if not s:
        return np.zeros((0, 2))
    typical = fitted.problem.typical
    total = found.information.sum(axis=0) * typical[:, None] * typical
    inverse = np.linalg.pinv(total + 1e-12 * np.diag(np.diag(total) + 1e-12), rcond=1e-13, hermitian=True)
    share = independent_share(fitted)
    variance = np.diag(inverse) * fitted.scale**2 / share
    half = float(norm.ppf(0.5 + 0.5 * level)) * np.sqrt(variance)
    if runs >= fitted.ground.settings.fewest_runs:
        scores = found.pull * typical
        spread = np.diag(inverse @ (scores.T @ scores) @ inverse) * runs / (runs - 1.0)
        half = np.maximum(half, float(t.ppf(0.5 + 0.5 * level, runs - 1)) * np.sqrt(np.maximum(spread, 0.0)))
    half = half * typical
    return np.stack([fitted.values - half, fitted.values + half], axis=1)


def not_zero(fitted: Fitted) -> list[str]:
    """Return effects none of whose strengths differs from neutral: their intervals contain it."""
    found = []
    ends = intervals(fitted)
    for i, part in enumerate(fitted.hypothesis.parts):
        own = ends[fitted.hypothesis.of_part(i)]
        acting = [k for k, u in enumerate(part.shared) if u.name not in part.variant.idle]
        if part.candidate.local or not acting:
            continue
        starts = np.array([part.shared[k].start for k in acting])
        if not np.any((own[acting, 0] > starts) | (own[acting, 1] < starts)):
            found.append(part.candidate.name)
    return found
