"""Search: the base, plain laws alone and in pairs, then forward steps over the whole library."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from polyworld.gap.candidate import Candidate
from polyworld.gap.choose import credible, equivalent, score
from polyworld.gap.cross_validation import Fold, fold_counts, folds_of, predict_left_out
from polyworld.gap.fitting import Fitted, fit
from polyworld.gap.ground import Ground
from polyworld.gap.hypothesis import Hypothesis
from polyworld.gap.propose import Start, proposals

Array = NDArray[np.float64]


@dataclass
class Search:
    """A search on one ground. pool: all hypotheses fitted to the end, scored alike, best first. null: the base.

    limited: whether the time ended it.
    """

    ground: Ground
    library: Sequence[Candidate]
    base: Hypothesis
    report: Callable[[str, dict[str, object]], None]
    stopped: Callable[[], bool]
    fitted: Callable[[Fitted], None] | None = None
    pool: list[Fitted] = field(default_factory=list)
    share: float = 1.0
    limited: bool = False

    def __post_init__(self) -> None:
        self.folds: tuple[Fold, ...] = folds_of(self.ground, self.ground.settings)
        self.counts = fold_counts(self.ground, self.folds)
        self._seen: set[frozenset[tuple[str, str]]] = set()
        self._same: set[str] = set()
        self._known = frozenset({"gravity_error"} & {c.name for c in self.library})
        lengths = [c for c in self.library if c.name == "length_error"]
        if any(c.variants(self.base.world, self.ground.recording) for c in lengths):
            # Gravity over length is one number.
            self.library = [c for c in self.library if c.name != "gravity_error"]

    def plain(self) -> None:
        """Fit the base, and plain laws alone and in pairs: these are always tried and always reported."""
        self.null = fit(self.ground, self.base, growing=True, scale=1.0)
        self._add([self.null])
        plain = [c for c in self.library if c.plain]
        singles = self._level([self.null], plain, starts=1)
        self._add(singles)
        self._same_laws(singles)
        pairs = []
        for a, b in combinations([c for c in plain if c.name not in self._same], 2):
            for parent in [f for f in singles if f.hypothesis.names == {a.name}][:1]:
                pairs += self._brief(proposals(parent, [b], 1, 1.0, self._known))
        self._add(self._finished(pairs))
        self.report("plain laws", {"best": self.pool[0].hypothesis.title})

    def _same_laws(self, singles: Sequence[Fitted]) -> None:
        """Note laws that predict what another does: beside further laws the other stands for them.

        Laws that a bound keeps at nothing are alike only as long as they are alone.
        """
        acting = [f for f in singles if any(v != u.start for u, v in zip(f.hypothesis.unknowns, f.values, strict=True))]
        for k, f in enumerate(acting):
            for g in acting[:k]:
                (one,), (other,) = f.hypothesis.names, g.hypothesis.names
                if one != other and other not in self._same and equivalent(f, g, self.null):
                    self._same.add(one)

    def places(self) -> None:
        """Try what acts at one place or in one run on top of the best plain laws: it may be what makes a run unlike the
        others."""
        local = [c for c in self.library if c.local]
        self._add(self._level([self.pool[0]], local, self.ground.settings.starts))
        self.report("places", {"best": self.pool[0].hypothesis.title})

    def forward(self) -> None:
        """Add effects of the whole library one by one, while prediction gains by it."""
        settings = self.ground.settings
        level = [self.null]
        for depth in range(1, settings.depth + 1):
            if self.stopped():
                self.limited = True
                return
            self._add(self._level(level, self.library, settings.starts if depth == 1 else 1))
            self.report(f"{depth} effects", {"best": self.pool[0].hypothesis.title})
            trusted = credible(self.pool, self.null)
            nearest = min(trusted, key=lambda f: f.total, default=self.null)
            left = float((nearest.scores - self.share * self.counts * np.log1p(settings.noise_error)).sum())
            if left < settings.nats or _remains(nearest, self.null) < settings.remainder:
                return  # no further law has anything to gain, or what is left is less than laws are known to
            known = [f for f in trusted if len(f.hypothesis.parts) == depth]
            least = min((f.total for f in trusted if len(f.hypothesis.parts) < depth), default=np.inf)
            if not known or (known[0].total > least - settings.nats and depth > 1):
                return
            gain = max(least - known[0].total, 0.0)
            level = [f for f in known[: settings.branches] if f.total <= known[0].total + 0.5 * gain]
            closest = min(known, key=lambda f: f.objective)  # what is a run's own costs much until all is explained
            level = level if any(closest is f for f in level) else [*level[: settings.branches - 1], closest]

    def _level(self, parents: Sequence[Fitted], candidates: Sequence[Candidate], starts: int) -> list[Fitted]:
        """Fit the hypotheses of one more effect: briefly from their best starts, the better ones to the end."""
        settings = self.ground.settings
        found: list[Start] = []
        for parent in parents:
            for candidate in candidates:
                if parent.hypothesis.parts and candidate.name in self._same:
                    continue
                if self.stopped():
                    self.limited = True
                    break
                found += proposals(parent, [candidate], starts, self.share, self._known)
        found = [s for s in found if s.hypothesis.key not in self._seen]
        found.sort(key=lambda s: -s.gain)
        sure = [s for s in found if s.growing or s.hypothesis.parts[-1].candidate.plain]
        briefs = self._brief([*sure, *[s for s in found if not any(s is t for t in sure)][: settings.tried]])
        return self._finished(briefs)

    def _brief(self, starts: Sequence[Start]) -> list[Fitted]:
        settings = self.ground.settings
        found: dict[frozenset[tuple[str, str]], Fitted] = {}
        for start in starts:
            if start.hypothesis.key in self._seen:
                continue
            self.stopped()
            scale = self.pool[0].scale if self.pool else 1.0
            one = fit(self.ground, start.hypothesis, start.point, start.growing, settings.brief, max(scale, 1.0))
            key = start.hypothesis.key
            if key not in found or one.objective < found[key].objective:
                found[key] = one
        return list(found.values())

    def _finished(self, briefs: Sequence[Fitted]) -> list[Fitted]:
        settings = self.ground.settings
        order = sorted(briefs, key=lambda f: f.objective)
        # What gains little beside the best of its kind cannot be the one law that is missing.
        gains = [max(self.null.objective - f.objective, 0.0) for f in order]
        least = settings.worth * max(gains, default=0.0)
        order = [f for f, g in zip(order, gains, strict=True) if g >= least or _expected(f.hypothesis)]
        order = [*order[: settings.tried], *(f for f in order[settings.tried :] if _expected(f.hypothesis))]
        found = []
        for first in order:
            self.stopped()
            last = fit(self.ground, first.hypothesis, first.point, False, settings.full, first.scale)
            last.early = first.early
            found.append(last)
        return found

    def _add(self, new: Sequence[Fitted]) -> None:
        for one in new:
            predict_left_out(one, self.folds)
            self._seen.add(one.hypothesis.key)
            if self.fitted is not None:
                self.fitted(one)
        self.pool += list(new)
        self.share = score(self.pool, self.counts)
        self.pool.sort(key=lambda f: f.total)


def _remains(fitted: Fitted, null: Fitted) -> float:
    """Return the share of the base's held-out variance beyond the noise that is left; 1 where much of it is."""
    after, before = fitted.error, null.error
    if after > null.ground.settings.near_noise or before <= 1.0:
        return 1.0
    return max(after**2 - 1.0, 0.0) / (before**2 - 1.0)


def _expected(hypothesis: Hypothesis) -> bool:
    """Return whether it holds one or two plain laws and nothing else."""
    return len(hypothesis.parts) <= 2 and all(p.candidate.plain for p in hypothesis.parts)
