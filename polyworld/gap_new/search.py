"""Search: the base, plain laws alone and in pairs, then forward steps over the whole library."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from polyworld.estimation.candidate import Candidate
from polyworld.gap_new.choose import score
from polyworld.gap_new.fitting import Fitted, fit
from polyworld.gap_new.ground import Ground
from polyworld.gap_new.held_out import Fold, fold_counts, folds_of, predict_left_out
from polyworld.gap_new.hypothesis import Hypothesis
from polyworld.gap_new.propose import Start, proposals

Array = NDArray[np.float64]

TRAPPED = 2.0  # ratio of a hypothesis' scale to the best of its order beyond which its fit is tried once more


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
    pool: list[Fitted] = field(default_factory=list)
    share: float = 1.0
    limited: bool = False
    began: float = field(default_factory=time.process_time)

    def __post_init__(self) -> None:
        self.folds: tuple[Fold, ...] = folds_of(self.ground, self.ground.settings)
        self.counts = fold_counts(self.ground, self.folds)
        self._seen: set[frozenset[tuple[str, str]]] = set()

    def run(self) -> None:
        """Fill the pool."""
        self.null = fit(self.ground, self.base, growing=True, scale=1.0)
        self._add([self.null])
        plain = [c for c in self.library if c.plain or c.name == "magnus_lift"]
        singles = self._level([self.null], plain, starts=1)
        self._add(singles)
        self.report("plain laws", {"tried": [f.hypothesis.title for f in singles]})
        pairs = []
        for a, b in combinations(plain, 2):
            for parent in [f for f in singles if f.hypothesis.names == {a.name}][:1]:
                pairs += self._brief(proposals(parent, [b], 1))
        self._add(self._finished(pairs))
        self._forward()

    def _forward(self) -> None:
        settings = self.ground.settings
        level = [self.null]
        for depth in range(1, settings.depth + 1):
            if self.stopped():
                self.limited = True
                return
            before = self.pool[0].total
            new = self._level(level, self.library, settings.starts if depth == 1 else 1)
            self._add(new)
            self.report(f"{depth} effects", {"best": self.pool[0].hypothesis.title})
            known = [f for f in self.pool if len(f.hypothesis.parts) == depth]
            if not known:
                return
            least = min(f.total for f in self.pool if len(f.hypothesis.parts) < depth)
            known.sort(key=lambda f: f.total)
            if known[0].total > least - settings.nats and depth > 1:
                return
            level = [f for f in known[: settings.branches] if f.total < known[0].total + 0.5 * max(least - known[0].total, 0.0) + 1e-9]
            level = level or known[:1]
            del before

    def _level(self, parents: Sequence[Fitted], candidates: Sequence[Candidate], starts: int) -> list[Fitted]:
        """Fit the hypotheses of one more effect: briefly from their best starts, the better ones to the end."""
        briefs = []
        for parent in parents:
            for candidate in candidates:
                if self.stopped():
                    self.limited = True
                    break
                t0=time.process_time(); pp=proposals(parent, [candidate], starts); t1=time.process_time(); bb=self._brief(pp); briefs+=bb
                print('     ',candidate.name,len(pp),'propose %.2f fit %.2f'%(t1-t0,time.process_time()-t1),[(round(q.gain,1)) for q in pp],[round(q.objective,1) for q in bb],flush=True)
        return self._finished(briefs)

    def _brief(self, starts: Sequence[Start]) -> list[Fitted]:
        settings = self.ground.settings
        found: dict[frozenset[tuple[str, str]], Fitted] = {}
        for start in starts:
            if start.hypothesis.key in self._seen:
                continue
            scale = self.pool[0].scale if self.pool else 1.0
            one = fit(self.ground, start.hypothesis, start.point, start.growing, settings.brief, max(scale, 1.0))
            key = start.hypothesis.key
            if key not in found or one.objective < found[key].objective:
                found[key] = one
        return list(found.values())

    def _finished(self, briefs: Sequence[Fitted]) -> list[Fitted]:
        settings = self.ground.settings
        by: dict[frozenset[tuple[str, str]], Fitted] = {}
        for one in briefs:
            key = one.hypothesis.key
            if key not in by or one.objective < by[key].objective:
                by[key] = one
        order = sorted(by.values(), key=lambda f: f.objective)[: settings.tried]
        return [fit(self.ground, f.hypothesis, f.point, False, settings.full, f.scale) for f in order]

    def _add(self, new: Sequence[Fitted]) -> None:
        for one in new:
            one.early = one.early if one.early is not one.point else one.point
            predict_left_out(one, self.folds)
            self._seen.add(one.hypothesis.key)
        self.pool += list(new)
        self.share = score(self.pool, self.counts)
        self.pool.sort(key=lambda f: f.total)
