"""Graded verdicts: names that are stable although something is left over, and checks that lower them."""

import time
from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.gap import GapReport, GapSettings, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.checks import Check, lowered
from polyworld.gap.clock import Clock, TimeLimitReached
from polyworld.gap.settings import DecisionSettings
from tests.polyworld.gap_scenes import MASS, Bouncing, ball_recording, ball_world, launches

QUIET = GapSettings(null_control=False, experiment=False, residual_force=False)


def recorded(ball: Bouncing, seed: int, count: int = 8, sigma: float = 0.0005) -> Recording:
    rng = np.random.default_rng(seed)
    return ball_recording(ball, launches(rng, count), rng, sigma, duration=1.2, rate=80.0)


def power_drag(exponent: float) -> Bouncing:
    """Drag k |v|^n, a form between those of the catalogue."""
    return Bouncing(acceleration=lambda _t, _x, v, _w: -0.06 / MASS * np.linalg.norm(v) ** (exponent - 1.0) * v)


def judged(recording: Recording, *effects: str, **more: Recording) -> GapReport:
    return find_gap(ball_world(), recording, candidates=named(effects), settings=QUIET, **more)


def judged_power_drag() -> GapReport:
    return judged(recorded(power_drag(1.75), 2, count=5), "quadratic_drag", "tilt", "gravity_error")


@pytest.fixture(scope="module")
def between_exponents() -> GapReport:
    """The report on drag of an exponent between those of the catalogue."""
    return judged_power_drag()


def test_drag_of_another_exponent_is_named_with_a_remainder_and_wider_intervals(between_exponents: GapReport) -> None:
    report = between_exponents
    assert report.verdict.kind == "identified_with_remainder"
    assert "quadratic_drag" in report.names
    assert report.verdict.stability is not None
    assert report.verdict.stability.support["quadratic_drag"] >= 0.9
    remainder = report.remainder
    assert remainder is not None
    assert remainder.beyond_noise > 0.2 * remainder.noise
    assert remainder.rms < 0.5 * remainder.before
    data = report.to_dict()
    assert data["remainder"]["summary"].startswith("What remains is")
    assert any(law["name"] == "quadratic_drag" for law in data["plain_laws"])


def test_a_law_of_the_catalogue_is_identified_without_remainder() -> None:
    report = judged(recorded(power_drag(2.0), 2, count=5), "quadratic_drag", "linear_drag", "tilt")
    assert report.verdict.kind == "identified"
    assert report.names == ("quadratic_drag",)
    assert report.remainder is None


def test_no_name_is_given_where_held_out_data_get_worse() -> None:
    dragged, still = recorded(power_drag(2.0), 4, count=4), recorded(Bouncing(), 5, count=2)
    report = judged(dragged, "quadratic_drag", held_out=still)
    assert report.verdict.kind == "unexplained"
    assert "held_out" in [c.name for c in report.checks]


@pytest.mark.parametrize("kind", ["identified", "identified_with_remainder"])
@pytest.mark.parametrize("check", ["held_out", "null_control", "runner_up", "nothing_held_out", "time_limit"])
def test_each_check_lowers_a_name_by_itself(kind: str, check: str) -> None:
    assert lowered(kind, [Check(check, "")]) not in ("identified", "identified_with_remainder")  # type: ignore[arg-type]


def test_checks_leave_what_names_nothing() -> None:
    assert lowered("nothing_missing", [Check("null_control", "")]) == "nothing_missing"
    assert lowered("unexplained", [Check("runner_up", "")]) == "unexplained"


@pytest.mark.benchmark
def test_the_same_data_and_seed_give_the_same_answer(between_exponents: GapReport) -> None:
    assert judged_power_drag().to_dict() == between_exponents.to_dict()


def test_a_search_ends_at_its_time_limit_with_a_verdict() -> None:
    recording = recorded(power_drag(1.75), 7)
    settings = GapSettings(null_control=False, experiment=False, time_limit=3.0)
    begin = time.monotonic()
    report = find_gap(ball_world(), recording, settings=settings)
    assert time.monotonic() - begin < 30.0  # the whole catalogue with pairs takes longer
    assert report.limited == 3.0
    assert report.to_dict()["time_limit"] == 3.0
    assert report.verdict.kind in ("identified", "identified_with_remainder", "ambiguous", "unexplained")


def test_a_search_whose_time_is_over_at_once_reports_the_world_as_it_is() -> None:
    recording = recorded(power_drag(1.75), 7)
    report = find_gap(ball_world(), recording, settings=GapSettings(experiment=False, time_limit=1e-3))
    payload = report.to_dict()
    assert payload["verdict"] == "unexplained"
    assert payload["time_limit"] == 1e-3
    assert payload["effects"] == []
    assert payload["goodness"]["passes"] is False


def test_a_clock_distinguishes_cancelling_from_the_end_of_time() -> None:
    assert not Clock()()
    assert Clock(cancelled=lambda: True)()
    clock = Clock(1e-6)
    time.sleep(0.001)
    with pytest.raises(TimeLimitReached):
        clock()
    clock.lift()
    assert not clock()
    with pytest.raises(ValueError, match="positive"):
        Clock(0.0)


def test_settings_must_be_positive_and_shares_at_most_one() -> None:
    with pytest.raises(ValueError, match="decisive must be positive"):
        DecisionSettings(decisive=0.0)
    with pytest.raises(ValueError, match="stable is a share"):
        DecisionSettings(stable=1.1)


def test_a_wind_that_imitates_two_plain_laws_is_not_named_alone() -> None:
    """Linear and quadratic drag together: wind takes up most of what either leaves."""
    mixed = Bouncing(acceleration=lambda _t, _x, v, _w: -(0.04 + 0.05 * np.linalg.norm(v)) / MASS * v)
    report = judged(recorded(mixed, 3, count=5, sigma=0.002), "quadratic_drag", "linear_drag", "wind", "tilt")
    named = {frozenset(t.hypothesis.names) for t in report.verdict.credible}
    assert report.verdict.kind in ("identified", "identified_with_remainder", "ambiguous")
    assert named & {frozenset({"quadratic_drag"}), frozenset({"quadratic_drag", "linear_drag"})}


def test_a_wind_that_blows_is_named() -> None:
    air = np.array([-4.0, 1.0, 0.0])
    blown = Bouncing(acceleration=lambda _t, _x, v, _w: -0.05 / MASS * np.linalg.norm(v - air) * (v - air))
    report = judged(recorded(blown, 4, count=5, sigma=0.001), "quadratic_drag", "linear_drag", "wind", "tilt")
    assert report.verdict.kind == "identified"
    assert report.names == ("wind",)


def test_values_that_physics_makes_ordinary_cost_their_squared_departure() -> None:
    report = judged(recorded(power_drag(2.0), 6, count=4), "quadratic_drag")
    fitted = report.verdict.best
    assert fitted is not None
    (part,) = fitted.hypothesis.parts
    (unknown,) = part.variant.unknowns
    away = float(fitted.values[0]) - unknown.start
    strict = replace(part.variant, unknowns=(replace(unknown, plausible=away / 3.0),))
    loose = replace(part.variant, unknowns=(replace(unknown, plausible=None),))
    priced = [
        replace(fitted, hypothesis=replace(fitted.hypothesis, parts=(replace(part, variant=v),)))
        for v in (strict, loose)
    ]
    assert priced[0].ebic - priced[1].ebic == pytest.approx(9.0)
