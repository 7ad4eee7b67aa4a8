"""Summarise what the members of an ensemble answer: probabilities, quantiles, and the parameter that decides."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import betaincinv, kolmogorov, stdtr

Array = NDArray[np.float64]
Bools = NDArray[np.bool_]

LEVEL = 0.9  # of every interval
CLEAR = 0.8  # least difference of the two distribution functions at the threshold
SIGNIFICANT = 0.05  # probability of such a separation by chance, over all parameters tried
RELATED = 0.5  # least rank correlation reported
SAME = 0.9  # rank correlation of two parameters above which the members do not say which of them an answer goes with


@dataclass(frozen=True)
class Probability:
    """How many of the members agree, with a Jeffreys interval for the probability (Brown, Cai & DasGupta 2001).

    true: number of members, or the sum of their probabilities where they are not certain themselves.
    """

    true: float
    members: int

    @property
    def share(self) -> float:
        """Share of the members for which it is true."""
        return self.true / self.members

    @property
    def interval(self) -> tuple[float, float]:
        """Interval of `LEVEL` from the beta distribution with 1/2 added to both counts; it contains the share.

        One-sided where all members agree; where they do so nearly, by the sum of their probabilities, it is widened.
        """
        a, b, tail = self.true + 0.5, self.members - self.true + 0.5, 0.5 * (1.0 - LEVEL)
        lower = 0.0 if self.true == 0 else float(betaincinv(a, b, tail))
        upper = 1.0 if self.true == self.members else float(betaincinv(a, b, 1.0 - tail))
        return min(lower, self.share), max(upper, self.share)


@dataclass(frozen=True)
class Split:
    """The threshold of one parameter that separates true from false members best.

    true_where: on which side it is true. agree: how many of the members lie on the side of their answer.
    """

    parameter: str
    threshold: float
    true_where: str
    agree: int
    members: int

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return asdict(self)


@dataclass(frozen=True)
class Relation:
    """A parameter that a number of the members rises (or, negative, falls) with, by Spearman's rank correlation."""

    parameter: str
    rank_correlation: float

    def to_dict(self) -> dict[str, Any]:
        """JSON-ready values."""
        return asdict(self)


def interval_of(values: Array) -> dict[str, float]:
    """Return median and the central interval of `LEVEL` of values (n,) as JSON-ready numbers."""
    tail = 50.0 * (1.0 - LEVEL)
    low, middle, high = np.percentile(values, [tail, 50.0, 100.0 - tail])
    return {"median": float(middle), "from": float(low), "to": float(high)}


def decisive_split(parameters: Mapping[str, Array], true: Bools) -> Split | None:
    """Return the parameter and threshold that separate true (n,) best, None where none does so clearly.

    The separation is the two-sample Kolmogorov-Smirnov statistic D, the largest difference of the two distribution
    functions; clear is D >= `CLEAR` at a significance of `SIGNIFICANT` over all parameters (Bonferroni).
    """
    count, positive = len(true), int(true.sum())
    if positive in (0, count):
        return None
    best: tuple[float, Split] | None = None
    for name, values in parameters.items():
        order = np.argsort(values, kind="stable")
        ranked = values[order]
        cut = np.flatnonzero(ranked[1:] > ranked[:-1])
        if not len(cut):
            continue
        below = np.cumsum(true[order])[cut] / positive - np.cumsum(~true[order])[cut] / (count - positive)
        k = int(np.argmax(np.abs(below)))
        threshold = 0.5 * float(ranked[cut[k]] + ranked[cut[k] + 1])
        true_below = bool(below[k] > 0.0)
        agree = int(((values <= threshold) == (true == true_below)).sum())
        if best is None or abs(below[k]) > best[0]:
            best = float(abs(below[k])), Split(name, threshold, "below" if true_below else "above", agree, count)
    if best is None:
        return None
    effective = np.sqrt(positive * (count - positive) / count)
    chance = float(kolmogorov((effective + 0.12 + 0.11 / effective) * best[0]))  # Stephens (1970)
    return best[1] if best[0] >= CLEAR and chance * len(parameters) <= SIGNIFICANT else None


def relations(parameters: Mapping[str, Array], values: Array, part: float = 1.0, most: int = 3) -> list[Relation]:
    """Return the parameters that an answer goes with, strongest first: Spearman's rank correlation of at least
    `RELATED`, significant over all parameters (Bonferroni), without those that go with one listed before as closely.

    values (n,): what the members say. part: of the answer's variance that the members differ by; the rest, an error of
    the model, goes with no parameter and lowers the correlation of the answer itself.
    """
    known = np.isfinite(values)
    count = int(known.sum())
    if count < 5 or np.ptp(values[known]) <= 0.0:
        return []
    found = []
    for name, own in parameters.items():
        if np.ptp(own[known]) <= 0.0:
            continue
        rho = float(np.corrcoef(_ranks(own[known]), _ranks(values[known]))[0, 1])
        t = abs(rho) * np.sqrt((count - 2) / max(1.0 - rho**2, 1e-12))
        if abs(rho) * np.sqrt(part) >= RELATED and 2.0 * float(stdtr(count - 2, -t)) * len(parameters) <= SIGNIFICANT:
            found.append(Relation(name, rho))
    listed: list[Relation] = []
    for relation in sorted(found, key=lambda r: -abs(r.rank_correlation)):
        ranks = [_ranks(parameters[r.parameter][known]) for r in (relation, *listed)]
        if all(abs(np.corrcoef(ranks[0], other)[0, 1]) < SAME for other in ranks[1:]):
            listed.append(relation)
    return listed[:most]


def _ranks(values: Array) -> Array:
    """Ranks (n,), equal values sharing their mean."""
    _, inverse, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    shared: Array = (last - 0.5 * (counts - 1))[inverse]
    return shared


def varying(parameters: Mapping[str, Array], chosen: Sequence[int] | NDArray[np.intp]) -> dict[str, Array]:
    """Return the parameters that differ among some members, at these."""
    picked = {name: np.asarray(values)[np.asarray(chosen, dtype=np.intp)] for name, values in parameters.items()}
    return {name: values for name, values in picked.items() if len(values) and np.ptp(values) > 0.0}
