"""Choose among hypotheses by held-out prediction: the simplest of those that are near the best."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from polyworld.gap.fitting import Fitted, independent_share, share_left
from polyworld.gap.settings import GapSettings

Array = NDArray[np.float64]

FLOOR = 0.3  # of the noise, below which no error is believed


@dataclass(frozen=True)
class Choice:
    """chosen: the simplest of `near`. share: of values that count as independent."""

    chosen: Fitted
    near: tuple[Fitted, ...]
    share: float


def score(pool: Sequence[Fitted], counts: Array) -> float:
    """Score all hypotheses of a pool alike: n_eff log(error / sigma) by fold, n_eff by what the best one leaves.

    Return the share of values that count.
    """
    for f in pool:
        rate(f, counts)
    best = min(pool, key=lambda f: f.total)
    share = independent_share(best)
    for f in pool:
        rate(f, share * counts)
    return share


def rate(fitted: Fitted, counts: Array) -> None:
    """Fill in the scores of a hypothesis, of folds with so many independent values (F,)."""
    fitted.scores = counts * np.log(np.maximum(fitted.errors, FLOOR))
    fitted.total = float(fitted.scores.sum()) + fitted.price


def equivalent(a: Fitted, b: Fitted, null: Fitted) -> bool:
    """Return whether two hypotheses predict one motion, which is not that of the base: damping in a joint and drag of
    the one body that hangs on it. No data of this design separate them, so that they are one answer."""
    if len(a.hypothesis.parts) != len(b.hypothesis.parts) or abs(a.objective - b.objective) > 1.0:
        return False
    apart = effect = 0.0
    for one, other, without in zip(a.slopes, b.slopes, null.slopes, strict=True):
        apart += float(((one.residuals - other.residuals) ** 2).sum())
        effect += float(((one.residuals - without.residuals) ** 2).sum())
    settings = null.ground.settings
    more = abs(a.simplicity - b.simplicity) > 1e-6  # the richer one follows the noise by a little, too
    return apart < min((2.0 * settings.nats if more else 1.0) * a.scale**2, settings.alike * effect)


def distinct(pool: Sequence[Fitted], null: Fitted) -> tuple[list[Fitted], dict[int, list[Fitted]]]:
    """Return a pool with one of each set of equivalent hypotheses, the simplest, and by its `id` the others."""
    order = sorted(pool, key=lambda f: (f.simplicity, sum(not p.candidate.plain for p in f.hypothesis.parts), f.total))
    kept: list[Fitted] = []
    others: dict[int, list[Fitted]] = {}
    for f in order:
        same = next((k for k in kept if f is not null and k is not null and equivalent(f, k, null)), None)
        if same is None:
            kept.append(f)
        else:
            others.setdefault(id(same), []).append(f)
    return sorted(kept, key=lambda f: f.total), others


def choose(
    pool: Sequence[Fitted], settings: GapSettings, share: float, totals: Array | None = None, kept: Sequence[int] = ()
) -> Choice:
    """Choose from a scored pool. totals (H,): as resampled; default: as scored. kept: folds in every resampling.

    Near the best is what is within `nats` of it: noise moves a difference of D nats by sqrt(2 D). Where model error is
    left, also what is better in a `share` of resamplings: gains that some runs have and others have not, such as those
    of a wall, make no standard error. Else, what is better without one of the folds: no single run decides. Also what
    is as simple as the chosen one and within `nats` of that: a richer one that is better still rules out neither.
    """
    again = None
    if totals is None:
        totals = np.array([f.total for f in pool])
        scores = np.array([f.scores for f in pool]).T
        if len(scores) > 2:
            alone = totals - np.delete(scores, list(kept), axis=0)
            again = resampled(pool, settings, share, kept) if share < 1.0 else alone
    best = int(totals.argmin())
    near = totals - totals[best] <= settings.nats
    if again is not None and len(again):
        near |= (again <= again[:, [best]]).mean(axis=0) >= (settings.share if share < 1.0 else 1.0 / len(again))
    cost = np.array([f.simplicity for f in pool])
    least = cost[near].min()
    simple = [i for i in np.flatnonzero(near).tolist() if cost[i] <= least + 1e-6]
    winner = min(simple, key=lambda i: float(totals[i]))
    near |= (cost <= least + 1e-6) & (totals - totals[winner] <= settings.nats)
    return Choice(pool[winner], tuple(pool[i] for i in np.flatnonzero(near).tolist()), share)


def resampled(pool: Sequence[Fitted], settings: GapSettings, share: float, kept: Sequence[int] = ()) -> Array:
    """Return totals (B, H) as other data would give them: model error belongs to a run as a whole, so that folds are
    drawn again; what noise leaves is independent from row to row, and is drawn again."""
    rng = np.random.default_rng(settings.seed)
    price = np.array([f.price for f in pool])
    scores = np.array([f.scores for f in pool])
    count = scores.shape[1]
    if share < 1.0:
        times = rng.multinomial(count, np.ones(count) / count, settings.bootstraps)
        times[:, list(kept)] = np.maximum(times[:, list(kept)], 1)
        found: Array = times @ scores.T + price
        return found
    slopes = np.array([np.concatenate([(g / np.nanmean(g**2)).ravel() for g in f.grids]) for f in pool])
    noise = rng.normal(size=(settings.bootstraps, slopes.shape[1]))
    drawn: Array = scores.sum(axis=1) + price + noise @ np.nan_to_num(slopes).T
    return drawn


def winners(pool: Sequence[Fitted], settings: GapSettings, share: float, kept: Sequence[int] = ()) -> list[Fitted]:
    """Return the choice in each resampling. kept: folds in every one."""
    return [choose(pool, settings, share, totals).chosen for totals in resampled(pool, settings, share, kept)]


def helped_folds(fitted: Fitted, pool: Sequence[Fitted], null: Fitted) -> list[int]:
    """Return the folds that show a law that acts at one place: resampling may not lose the only run that meets it."""
    known = {f.hypothesis.key: f for f in pool}
    found: set[int] = set()
    for part in fitted.hypothesis.parts:
        if part.candidate.local:
            less = known.get(fitted.hypothesis.key - {(part.candidate.name, part.variant.label)}, null)
            found |= set(np.flatnonzero(helped(fitted, less)).tolist())
    return sorted(found) if 2 * len(found) <= len(fitted.errors) else []


def helped(fitted: Fitted, less: Fitted) -> NDArray[np.bool_]:
    """Return which folds (F,) a hypothesis predicts clearly better than one with less."""
    better: NDArray[np.bool_] = fitted.errors < 0.5 * (1.0 + fitted.ground.settings.halved) * less.errors
    return better


def credible(pool: Sequence[Fitted], null: Fitted) -> list[Fitted]:
    """Return the hypotheses whose values are possible and whose effects are no stand-ins.

    What has a place or a clock bends to whatever is left: beside the hypothesis without it, it has to halve the error
    beyond the noise, or to reach the noise; a picture that is bent has to come near it, too. What acts at one place
    must help two runs, or bring one to the noise, else a run is unlike the others.
    """
    settings = null.ground.settings
    counts = null.ground.counts
    known = {f.hypothesis.key: f for f in pool}
    found = []
    for f in pool:
        if not f.hypothesis.possible(f.values, settings):
            continue
        for part in f.hypothesis.parts:
            without = f.hypothesis.key - {(part.candidate.name, part.variant.label)}
            less = known.get(without, null)
            reached = f.error < 1.0 + 2.0 * settings.noise_error  # two standard errors of the noise itself
            if part.stands_in and not reached and share_left(less.error, f.error) > settings.halved:
                break
            if part.bends and f.error > settings.near_noise:
                break
            by_fold = helped(f, less)
            alone = by_fold.sum() < 2 and np.all(f.errors[by_fold] > settings.near_noise)
            if part.candidate.local and len(counts) == len(f.errors) >= settings.fewest_runs and alone:
                break
        else:
            found.append(f)
    return found
