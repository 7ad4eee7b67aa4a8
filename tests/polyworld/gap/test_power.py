"""Effects that could have been noticed, against the closed form for a constant push, and by planting it."""

import json

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import ncx2

from polyworld.data.recording import Recording, Run
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue import catalogue, named
from polyworld.gap.cross_validation import examined
from polyworld.gap.fitting import Fitted
from polyworld.gap.power import power_check
from polyworld.gap.settings import GapSettings
from polyworld.world import World

Array = NDArray[np.float64]

RUNS, COUNT, RATE, SIGMA, G = 4, 96, 60.0, 0.01, 9.81
SETTINGS = GapSettings()
DRAWS = 400
NEEDED = SETTINGS.nats + 2.0  # nats: a tilt has two components


def flights(seed: int, push: Array | float = 0.0) -> Recording:
    """Runs of a ball in free flight with white noise; push (3,) [m/s^2]: an acceleration that the world lacks."""
    rng, times = np.random.default_rng(seed), np.arange(COUNT) / RATE
    runs = []
    for k in range(RUNS):
        fall = np.array([0.0, 0.0, -G]) + push
        path = (
            rng.uniform(10.0, 20.0, 3) + rng.uniform(-3.0, 3.0, 3) * times[:, None] + 0.5 * fall * times[:, None] ** 2
        )
        seen = path + rng.normal(0.0, SIGMA, path.shape)
        runs.append(Run(f"run{k}", ("ball",), times, seen[:, None], np.full((COUNT, 1, 4), np.nan), SIGMA))
    return Recording(tuple(runs))


def fitted(seed: int, base: tuple[Unknown, ...] = ()) -> Fitted:
    ball = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.1}, "position": [0, 0, 1]}
    return examined(World.model_validate({"objects": [ball]}), flights(seed), base)


def least_tilt() -> float:
    """The push a leaves 0.5 a t^2 less its line: squared length a^2 n (n^2 - 1) (n^2 - 4) / 720 / rate^4 in a run of n
    even samples, exactly; half of it in variances of the noise is what it gains."""
    length = COUNT * (COUNT**2 - 1) * (COUNT**2 - 4) / 720.0 / RATE**4 * RUNS / SIGMA**2
    return float(np.sqrt(2.0 * NEEDED / length))


def test_least_tilt_is_that_of_the_closed_form() -> None:
    rows = power_check(fitted(0), named(["tilt"]))
    assert [r.unknown for r in rows if r.seen] in (["x", "y"], ["y", "x"])
    for row in rows:
        assert row.strength == pytest.approx(least_tilt(), rel=0.05)
        assert row.unit == "m/s^2"


@pytest.mark.parametrize("times", [0.5, 1.0, 1.5])
def test_planted_pushes_are_noticed_as_often_as_the_strength_reported_says(times: float) -> None:
    """Least squares in closed form: the gain of a parabola along x and y that runs have in common, over lines. Twice it
    is a noncentral chi-square variable, which exceeds what is asked as often as not where its mean does."""
    least = min(row.strength for row in power_check(fitted(1), named(["tilt"])))
    clock = np.arange(COUNT) / RATE
    lines = np.linalg.qr(np.stack([np.ones(COUNT), clock], axis=1))[0]
    bow = 0.5 * clock**2
    bow = bow - lines @ (lines.T @ bow)
    push, noticed = np.array([times * least, 0.0, 0.0]), []
    for seed in range(DRAWS):
        level = np.array([run.positions[:, 0, :2] for run in flights(seed, push).runs])  # (R, T, 2)
        along = np.einsum("rta,t->a", level, bow)
        gain = 0.5 * float((along**2).sum()) / (RUNS * float(bow @ bow)) / SIGMA**2
        noticed.append(gain > NEEDED)
    expected = ncx2.sf(2.0 * NEEDED, 2, 2.0 * NEEDED * times**2)
    assert np.mean(noticed) == pytest.approx(expected, abs=4.0 * np.sqrt(expected * (1.0 - expected) / DRAWS))
    assert times != 1.0 or 0.45 < expected < 0.65


def test_a_stricter_verdict_takes_a_stronger_effect_in_proportion_to_its_root() -> None:
    one = fitted(2)
    (first,) = power_check(one, named(["quadratic_drag"]))
    one.ground.settings = GapSettings(nats=4.0 * (SETTINGS.nats + 1.0) - 1.0)
    (second,) = power_check(one, named(["quadratic_drag"]))
    assert second.strength == pytest.approx(2.0 * first.strength)


def test_what_moves_nothing_cannot_be_seen() -> None:
    """A scale of lengths is to free flight what another gravity is: where that is fitted, nothing is left of it."""
    gravity = Unknown("gravity", ("environment.gravity.z",), "m/s^2", -G, -20.0, 0.0, 0.5)
    rows = power_check(fitted(3, (gravity,)), named(["gravity_error", "observer_scale"]))
    assert [row.effect for row in rows] == ["observer_scale"]  # gravity itself is fitted already
    summary = json.loads(json.dumps(rows[0].to_json()))
    assert summary["strength"] is None
    assert not summary["seen"]
    assert "cannot be seen" in summary["summary"]


def test_the_whole_catalogue_is_asked_weakest_first_and_sudden_effects_are_named() -> None:
    rows = power_check(fitted(4), list(catalogue().values()))
    asked = [row for row in rows if row.unknown]
    ratios = [row.typical / row.strength for row in asked]
    assert ratios == sorted(ratios)
    assert {row.effect for row in rows[len(asked) :]} == {"hidden_wall", "dropped_frames"}
    assert all("not asked" in row.summary() and not row.to_json()["asked"] for row in rows[len(asked) :])
    assert {"tilt", "quadratic_drag", "wind", "periodic_forcing"} <= {row.effect for row in asked}
    assert not any(row.unknown.startswith("centre") for row in asked)
