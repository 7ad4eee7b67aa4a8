"""Describe the force that no effect of the catalogue explains, as an expression chosen term by term.

Terms of a library are selected as effects are: by score tests, fits in the simulator together with initial states, and
prediction of what was left out. Accelerations are weighed by the motion that they change, never by differentiating
noisy positions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from polyworld.estimation.least_squares import Point
from polyworld.expressions.parse import MAX_EXPRESSION_PARAMETERS, MAX_LENGTH
from polyworld.gap.candidate import Candidate
from polyworld.gap.choose import choose, credible, rate
from polyworld.gap.cross_validation import predict_left_out
from polyworld.gap.fitting import Fitted, fit
from polyworld.gap.ground import Ground
from polyworld.gap.hypothesis import Hypothesis, extended
from polyworld.gap.propose import proposals
from polyworld.gap.residual_terms import Term, library, names_in_sum, sum_text
from polyworld.gap.search import Search
from polyworld.gap.settings import GapSettings
from polyworld.gap.verdict import intervals
from polyworld.world import World

LISTED = 5  # alternatives
TRIED = 6  # laws of one depth that are fitted: score tests rank terms of one scale well
ITERATIONS = 40  # of last fits: an exponent and a strength that trade off make long valleys


@dataclass(frozen=True)
class ResidualForce:
    """The law of the unexplained force.

    fitted: with an effect of the world for each of its terms. before: the fit without it. beside: effects of the
    catalogue that act with it. alternatives: other laws, and by how many nats they predict worse. complete: False where
    the time ended the search.
    """

    fitted: Fitted
    terms: tuple[Term, ...]
    before: Fitted
    beside: tuple[str, ...]
    alternatives: tuple[tuple[str, float], ...]
    complete: bool

    @property
    def expression(self) -> str:
        """The law as one acceleration [m/s^2]."""
        return sum_text(self.terms)

    @property
    def written(self) -> str:
        """The expression with its fitted numbers in it."""
        units = {name: "" if n["unit"] == "1" else f"[{n['unit']}]" for name, n in self.numbers.items()}
        return sum_text(self.terms, {name: f"{n['value']:.4g}{units[name]}" for name, n in self.numbers.items()})

    @cached_property
    def numbers(self) -> dict[str, dict[str, Any]]:
        """Fitted numbers of the expression by name: value, unit and interval95."""
        first = len(self.fitted.hypothesis.base)
        names = [name for own in names_in_sum(self.terms) for name in own.values()]
        units = [n.unit for t in self.terms for n in t.numbers]
        ends = intervals(self.fitted)[first:].tolist()
        rows = zip(names, units, self.fitted.values[first:].tolist(), ends, strict=True)
        return {name: {"value": value, "unit": unit, "interval95": both} for name, unit, value, both in rows}

    @property
    def explains(self) -> bool:
        """Whether with it only noise is left."""
        return self.fitted.error < self.fitted.ground.settings.near_noise

    @property
    def world(self) -> World:
        """The child world with the law, fitted."""
        return self.fitted.hypothesis.fitted_world(self.fitted.values)

    def summary(self) -> str:
        """Describe the law in one sentence."""
        so = "explains the data" if self.explains else "comes closest, but does not explain the data"
        beside = f" beside {' and '.join(self.beside)}" if self.beside else ""
        end = "" if self.complete else "; the time ended the search, other laws untried"
        return f"an acceleration {self.written}{beside} {so}{end}"

    def to_dict(self) -> dict[str, Any]:
        """Return plain data for reports; the world is left out."""
        return {
            "explains": self.explains,
            "summary": self.summary(),
            "expression": self.expression,
            "written": self.written,
            "numbers": self.numbers,
            "direction": [t.direction for t in self.terms],
            "speed_exponent": [n for name, n in self.numbers.items() if name.startswith("p")],
            "depends_on": sorted({factor for t in self.terms for factor in t.factors}),
            "chi2_before": _chi2(self.before),
            "chi2_after": _chi2(self.fitted),
            "data": int(self.fitted.ground.counts.sum()),
            "complete": self.complete,
            "beside": list(self.beside),
            "alternatives": [{"expression": e, "behind": b} for e, b in self.alternatives],
        }


def residual_force(
    ground: Ground, best: Fitted, null: Fitted, settings: GapSettings, stopped: Callable[[], bool]
) -> ResidualForce | None:
    """Seek the law of the force that is missing; None where no law lowers the held-out error by much.

    best: the nearest hypothesis. Its effects that are no force (a torque, contact, a fault of the observer) cannot be
    written as an acceleration; the law is sought on top of them, else on top of the base (`null`). stopped: whether
    the time is over; asked between fits.
    """
    ground = Ground(ground.world, ground.recording, replace(settings, tried=TRIED), ground.noise)
    base, beside = _without_forces(best, null)
    terms = {t.name: t for t in library(ground.world, ground.recording)}
    search = _TermSearch(ground, [t.candidate() for t in terms.values()], base, lambda *_: None, stopped)
    search.plain()
    search.forward()
    laws = {id(f): tuple(terms[p.candidate.name] for p in f.hypothesis.parts) for f in search.pool}
    trusted = [f for f in credible(search.pool, search.null) if _worth(f, search.null) and _writable(laws[id(f)])]
    chosen = choose([search.null, *trusted], settings, search.share).chosen
    if chosen is search.null:
        return None
    others = [(sum_text(laws[id(f)]), f.total - chosen.total) for f in trusted if f is not chosen]
    return ResidualForce(chosen, laws[id(chosen)], search.null, beside, tuple(others[:LISTED]), not search.limited)


def better_term(search: Search, best: Fitted) -> Fitted | None:
    """Fit single terms in place of the forces of a hypothesis; return the one that predicts better than all that was
    searched by `nats`, None where none does.

    A law of the catalogue near the one that is at work takes most of its effect; what shows that it is another law is
    that an expression no catalogue holds predicts better. All are fitted to the end before they are compared.
    """
    ground = search.ground
    key = frozenset((p.candidate.name, p.variant.label) for p in best.hypothesis.parts if not _is_force(p.candidate))
    parent = next((f for f in search.pool if f.hypothesis.key == key), None)
    if parent is None or ground.world.deformables:
        return None
    terms = [t.candidate() for t in library(ground.world, ground.recording)]
    starts = sorted(proposals(parent, terms, 1, search.share), key=lambda s: -s.gain)[: ground.settings.branches]
    if not starts:
        return None
    found = []
    for hypothesis, point, scale in [(best.hypothesis, best.point, best.scale),
                                     *((s.hypothesis, s.point, parent.scale) for s in starts)]:  # fmt: skip
        one = fit(ground, hypothesis, point, iterations=ITERATIONS, scale=scale)
        predict_left_out(one, search.folds)
        rate(one, search.share * search.counts)
        found.append(one)
    named, first = found[0], min(found[1:], key=lambda f: f.total)
    nearest = min(search.pool[0].total, named.total) - ground.settings.nats
    return first if first.total < nearest and _worth(first, named) else None


def _worth(fitted: Fitted, other: Fitted) -> bool:
    """Return whether a law leaves noise alone, or much less than another: what lowers a remainder by little may be a
    part of it."""
    return fitted.quiet or fitted.error < fitted.ground.settings.matters * other.error


class _TermSearch(Search):
    """Forward selection of terms, with a step back after each, by what they predict of data left out.

    Gains count in full until the last term is found: what a law leaves that lacks one is correlated, but no noise.
    """

    def forward(self) -> None:
        """Add terms while prediction gains by it."""
        settings, level = self.ground.settings, [self.null]
        for depth in range(1, settings.depth + 1):
            least = min(map(self._evidence, self.pool))
            self.share = 1.0
            self._add(self._level(level, self.library, settings.starts if depth == 1 else 1))
            for law in self._best(depth):
                self._refit(law, law.hypothesis, law.point)
            for law in self._best(depth)[:1] if depth > 1 else ():
                for k in range(depth):
                    self._refit(law, *self._without(law, k))
            level = self._best(depth)
            if self.limited or not level or self._evidence(level[0]) > least - settings.nats:
                return
            if level[0].error < 1.0 + settings.noise_error:
                return

    def _evidence(self, law: Fitted) -> float:
        return float(law.scores.sum()) / self.share + law.price

    def _best(self, depth: int) -> list[Fitted]:
        found = [f for f in self.pool if len(f.hypothesis.parts) == depth]
        return sorted(found, key=self._evidence)[: self.ground.settings.branches]

    def _refit(self, known: Fitted, hypothesis: Hypothesis, point: Point) -> None:
        """Fit a law to the end from where it, or a law with one term more, stands."""
        self.limited = self.limited or self.stopped()
        if not self.limited:
            one = fit(self.ground, hypothesis, point, iterations=ITERATIONS, scale=known.scale)
            if all(one.objective < f.objective for f in self.pool if f.hypothesis.key == hypothesis.key):
                self.pool = [f for f in self.pool if f.hypothesis.key != hypothesis.key]
                self._add([one])

    def _without(self, law: Fitted, index: int) -> tuple[Hypothesis, Point]:
        """Return a law less one of its terms, and its point."""
        found, at = self.base, law.hypothesis.of_part(index)
        for part in (*law.hypothesis.parts[:index], *law.hypothesis.parts[index + 1 :]):
            found = next(extended(found, part.candidate, self.ground.recording))
        return found, Point(np.delete(law.values, np.arange(at.start, at.stop)), law.point.states)


def _without_forces(best: Fitted, null: Fitted) -> tuple[Hypothesis, tuple[str, ...]]:
    """Return the base with the effects of a hypothesis that are no forces in its world, and their names.

    Their numbers become unknowns of the base, which begin where they were fitted.
    """
    found, free, values = null.hypothesis, list(null.hypothesis.base), null.values.tolist()
    for i, part in enumerate(best.hypothesis.parts):
        if _is_force(part.candidate) or part.own:
            continue
        ways = extended(found, part.candidate, best.ground.recording)
        names = [u.name for u in part.shared]
        last = [(h, h.parts[-1]) for h in ways]
        fits = (h for h, p in last if (p.variant.label, [u.name for u in p.shared]) == (part.variant.label, names))
        same = next(fits, None)
        if same is not None:
            own = best.values[best.hypothesis.of_part(i)].tolist()
            free += [replace(u, start=v, plausible=None) for u, v in zip(same.parts[-1].shared, own, strict=True)]
            found, values = same, values + own
    return Hypothesis(found.fitted_world(np.array(values)), tuple(free)), tuple(p.candidate.name for p in found.parts)


def _is_force(candidate: Candidate) -> bool:
    """Return whether an effect is a force on the centre of mass, which an acceleration can stand for."""
    return candidate.name == "gravity_error" or (candidate.group == "force" and not candidate.law.startswith("torque"))


def _writable(terms: tuple[Term, ...]) -> bool:
    """Return whether one expression can hold a law."""
    return sum(len(t.numbers) for t in terms) <= MAX_EXPRESSION_PARAMETERS and len(sum_text(terms)) <= MAX_LENGTH


def _chi2(fitted: Fitted) -> float:
    return float(sum((one.residuals**2).sum() for one in fitted.slopes))
