"""Verdicts on fits made up for the purpose, and criteria against least squares done again."""

from dataclasses import dataclass, field
from typing import Any, cast

import numpy as np
import pytest

from polyworld.estimation.criteria import extended_bic, held_out, held_out_gain
from polyworld.estimation.fit_context import FittedHypothesis
from polyworld.estimation.normal_equations import Linearised
from polyworld.estimation.profile import Fit
from polyworld.estimation.unknown import Unknown
from polyworld.gap.decide import Verdict, beside_fewer, leave_noise


@dataclass
class _Bench:
    observations: float = 1000.0


@dataclass
class _Hypothesis:
    names: tuple[str, ...]
    extra: int

    @property
    def title(self) -> str:
        return " + ".join(self.names)


@dataclass
class _Linear:
    r: tuple[np.ndarray, ...]


@dataclass
class _Fit:
    linear: _Linear


@dataclass
class _Trial:
    """A trial as `leave_noise` uses it."""

    hypothesis: _Hypothesis
    chi2: float
    passes: bool
    fit: _Fit
    context: _Bench = field(default_factory=_Bench)
    implausibility: float = 0.0
    held_out: np.ndarray = field(default_factory=lambda: np.array([1.0, 2.0]))

    @property
    def ebic(self) -> float:
        return self.implausibility + extended_bic(
            self.chi2, self.hypothesis.extra, self.context.observations, len(self.hypothesis.names), 20
        )


def trial(name: str, chi2: float, *, passes: bool = True, extra: int = 1, separation: float = 100.0) -> _Trial:
    """A made-up trial; `separation`: how far its residuals are from those of the others, in a direction of its own."""
    direction = np.zeros(32)
    direction[sum(map(ord, name)) % 32] = separation
    return _Trial(_Hypothesis((name,), extra), chi2, passes, _Fit(_Linear((direction,))))


def verdict(*trials: _Trial) -> Verdict:
    return leave_noise(cast(list[FittedHypothesis], list(trials)), 10.0)


def names(result: Verdict) -> list[Any]:
    return [t.hypothesis.names for t in result.credible]


def test_one_hypothesis_far_ahead_is_identified_with_its_runner_up() -> None:
    result = verdict(trial("drag", 1000.0), trial("tilt", 1100.0, passes=False))
    assert result.kind == "identified"
    assert names(result) == [("drag",)]
    assert result.runner_up is not None
    assert result.runner_up.ebic_behind == pytest.approx(100.0)


def test_two_within_ten_are_ambiguous_best_first() -> None:
    result = verdict(trial("tilt", 1006.0), trial("drag", 1000.0))
    assert result.kind == "ambiguous"
    assert names(result) == [("drag",), ("tilt",)]


def test_another_form_of_the_same_effect_is_reported_beside_the_best() -> None:
    linear, square = trial("spin_damping", 1000.0), trial("spin_damping", 1004.0)
    square.fit.linear.r[0][0] = 50.0  # it moves otherwise
    far = trial("spin_damping", 1100.0)
    result = verdict(linear, square, far)
    assert result.kind == "identified"
    assert [t.chi2 for t in result.forms] == [1004.0]
    assert verdict(linear, far).forms == ()


def test_none_passing_the_gate_is_unexplained() -> None:
    assert verdict(trial("drag", 5000.0, passes=False)).kind == "unexplained"
    assert verdict().kind == "unexplained"


def test_a_richer_law_that_predicts_the_same_is_not_a_competitor() -> None:
    simple, rich = trial("drag", 1000.0, separation=0.0), trial("wind", 998.0, extra=2, separation=1.0)
    assert names(verdict(simple, rich)) == [("drag",)]


def test_a_richer_law_that_fits_far_better_stands_beside_what_occam_prefers() -> None:
    # 3 further unknowns cost 20.7 in EBIC, yet 18 less in chi2 is 1 in 2000 by chance.
    result = verdict(trial("drag", 1000.0), trial("wind", 982.0, extra=4))
    assert names(result) == [("drag",), ("wind",)]


def test_extended_bic_is_that_of_chen_and_chen() -> None:
    expected = 50.0 + 3 * np.log(400.0) + 2.0 * 2 * np.log(25.0)
    assert extended_bic(50.0, 3, 400.0, 2, 25) == pytest.approx(expected)


def test_held_out_chi2_is_that_of_fits_without_the_run() -> None:
    rng = np.random.default_rng(0)
    a = [rng.normal(size=(40, 2)) for _ in range(4)]
    b = [rng.normal(size=(40, 3)) for _ in range(4)]
    truth = np.array([2.0, -1.0])
    y = [x @ truth + s @ rng.normal(size=3) + rng.normal(size=40) for x, s in zip(a, b, strict=True)]

    def solved(runs: list[int]) -> np.ndarray:
        """Ordinary least squares of all unknowns of these runs together."""
        wide = np.zeros((40 * len(runs), 2 + 3 * len(runs)))
        for i, k in enumerate(runs):
            wide[40 * i : 40 * i + 40, :2] = a[k]
            wide[40 * i : 40 * i + 40, 2 + 3 * i : 5 + 3 * i] = b[k]
        result: np.ndarray = np.linalg.lstsq(wide, np.concatenate([y[k] for k in runs]), rcond=None)[0]
        return result

    best = solved([0, 1, 2, 3])
    residuals = tuple(a[k] @ best[:2] + b[k] @ best[2 + 3 * k : 5 + 3 * k] - y[k] for k in range(4))
    fit = Fit(
        best[:2], tuple(np.zeros(3) for _ in a), 0.0, np.eye(2), Linearised(residuals, tuple(a), tuple(b)), True, 1, 1
    )
    unknowns = tuple(Unknown(n, (n,), "1", 0.0, -9.0, 9.0, 1e3) for n in "pq")
    predicted = held_out(cast(Any, type("D", (), {"runs": [0, 1, 2, 3]})), unknowns, fit)
    for k in range(4):
        shared = solved([i for i in range(4) if i != k])[:2]
        rest = y[k] - a[k] @ shared
        rest = rest - b[k] @ np.linalg.lstsq(b[k], rest, rcond=None)[0]
        assert predicted[k] == pytest.approx(float(rest @ rest), rel=1e-4)


def test_the_gain_has_the_standard_error_of_a_mean() -> None:
    gain = held_out_gain(np.array([1.0, 2.0, 3.0]), np.array([4.0, 4.0, 7.0]))
    assert gain.gain == pytest.approx(3.0)
    assert gain.error == pytest.approx(1.0 / np.sqrt(3.0))
    assert gain.exceeds(1.0)
    assert not gain.exceeds(6.0)


def pair(chi2: float) -> _Trial:
    made = trial("drag", chi2, extra=3)
    made.hypothesis.names = ("drag", "shift")
    return made


def test_a_further_effect_that_hardly_betters_a_failing_fit_is_not_decisive() -> None:
    """Two more unknowns, and a name to choose, cost some 20: a fall of chi2 by 25 does not decide."""
    alone = trial("drag", 1000.0, passes=False)
    result = beside_fewer(verdict(pair(975.0)), cast(list[FittedHypothesis], [alone]), 10.0)
    assert result.kind == "ambiguous"
    assert names(result) == [("drag", "shift"), ("drag",)]


def test_a_further_effect_that_betters_the_fit_clearly_is_named() -> None:
    alone = trial("drag", 1000.0, passes=False)
    result = beside_fewer(verdict(pair(900.0)), cast(list[FittedHypothesis], [alone]), 10.0)
    assert result.kind == "identified"
    assert names(result) == [("drag", "shift")]


def test_an_absurd_wind_loses_to_plain_drag_that_fits_a_little_worse() -> None:
    """A wind of 50 m/s where 5 is ordinary is ten standard deviations off: 100 in minus twice the log density."""
    drag, wind = trial("drag", 1020.0), trial("wind", 985.0, extra=2)
    assert names(verdict(drag, wind))[0] == ("wind",)
    wind.implausibility = 100.0
    result = verdict(drag, wind)
    assert result.kind == "identified"
    assert names(result) == [("drag",)]
