"""Fits over growing stretches, against bodies whose motion is known in closed form."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from polyworld.estimation.world_fit import FitProblem, PrefixSettings, Unknown, fit_by_prefixes, refine
from tests.polyworld.estimation.world_fit.closed_form import ClosedForm, observe, thrown_ball

SPIN = 9.0  # [rad/s]: more than a turn within the clip of 0.96 s
SIGMA = 0.01  # [m]
GYRATION = 0.1 * np.sqrt(0.4)  # [m] of the ball: rotations are compared as displacements of its substance


def spinning(start: float, *, frames: int = 25) -> FitProblem:
    """A ball that turns at SPIN, its spin searched from `start`, with its damping known."""
    world = thrown_ball(angular_velocity=(0.0, 0.0, SPIN))
    spin = Unknown("spin", ("objects.ball.angular_velocity.z",), "rad/s", start, -20.0, 20.0, 5.0)
    drag = Unknown("drag", ("objects.ball.linear_damping",), "1/s", 0.2, 0.0, 2.0, 0.5)
    tracks = observe(world, frames=frames, sigma=SIGMA, turn_sigma=SIGMA / GYRATION)
    return FitProblem(world, tracks, [spin, drag], make_simulator=ClosedForm)


@pytest.mark.parametrize("start", [SPIN - 6.0, SPIN + 6.0])
def test_a_spin_that_wraps_around_is_found_where_the_whole_clip_has_other_minima(start: float) -> None:
    """Off by 6 rad/s the last rotation is off by most of a turn, the first third of the clip by a third of one."""
    assert refine(spinning(start)).loss > 10.0
    (found,) = fit_by_prefixes(spinning(start), PrefixSettings(starts=1))
    assert found.best.by_name["spin"] == pytest.approx(SPIN, abs=0.2)
    assert found.best.by_name["drag"] == pytest.approx(0.5, abs=0.05)
    assert found.best.loss == pytest.approx(1.0, abs=0.3)


def test_stretches_grow_to_the_whole() -> None:
    (found,) = fit_by_prefixes(spinning(SPIN), PrefixSettings(starts=1))
    lengths = [point.samples for point in found.searched.history]
    assert lengths == sorted(lengths)
    assert lengths[0] < 12
    assert lengths[-1] == 25


def test_no_further_start_is_drawn_where_only_noise_is_left() -> None:
    assert len(fit_by_prefixes(spinning(SPIN), PrefixSettings(starts=5))) == 1


def test_further_starts_are_drawn_where_the_first_stays_above_the_noise_and_the_deepest_is_first() -> None:
    """Off by 14 rad/s even the first stretch is off by more than half a turn; some of the further starts are not."""
    starts = fit_by_prefixes(spinning(SPIN - 14.0), PrefixSettings(starts=12, seed=1))
    losses = [start.best.loss for start in starts]
    assert len(losses) > 1
    assert losses == sorted(losses)
    assert starts[0].best.by_name["spin"] == pytest.approx(SPIN, abs=0.2)


def test_equal_seeds_give_equal_fits() -> None:
    first, second = (fit_by_prefixes(spinning(SPIN - 14.0), PrefixSettings(3, seed=4)) for _ in range(2))
    assert [s.best.by_name for s in first] == [s.best.by_name for s in second]


def test_a_cancelled_fit_returns_what_it_reached() -> None:
    asked: list[int] = []

    def cancelled() -> bool:
        asked.append(1)
        return len(asked) > 4

    (found,) = fit_by_prefixes(spinning(SPIN), PrefixSettings(starts=3), cancelled=cancelled)
    assert found.best.status == "cancelled"
    assert np.isfinite(found.best.loss)


def test_a_clip_of_few_frames_is_fitted_as_a_whole() -> None:
    (found,) = fit_by_prefixes(spinning(SPIN - 1.0, frames=6), PrefixSettings(starts=1))
    assert {point.samples for point in found.searched.history} == {6}
    assert found.best.by_name["spin"] == pytest.approx(SPIN, abs=1.0)


def test_progress_counts_starts() -> None:
    seen: list[tuple[int, int]] = []
    fit_by_prefixes(
        spinning(SPIN - 14.0), PrefixSettings(2, seed=9), progress=lambda start, of, *_: seen.append((start, of))
    )
    assert set(seen) <= {(1, 2), (2, 2)}
    assert seen == sorted(seen)


@pytest.mark.parametrize(
    ("wrong", "named"),
    [
        ({"starts": 0}, "starts"),
        ({"stages": (0.5, 1.0)}, "equally many"),
        ({"stages": (0.7, 0.35, 1.0)}, "increase"),
        ({"stages": (0.3, 0.6, 0.9)}, "end at 1"),
        ({"behind": 0.9}, "behind"),
    ],
)
def test_settings_that_make_no_schedule_are_refused(wrong: dict[str, Any], named: str) -> None:
    with pytest.raises(ValueError, match=named):
        PrefixSettings(**wrong)
