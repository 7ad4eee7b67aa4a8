"""Where a patch of the floor lies, told by how much more friction short windows of the paths ask for."""

from dataclasses import replace

import numpy as np
import pytest

from polyworld.discrepancy.catalogue import catalogue
from polyworld.discrepancy.design import design
from polyworld.discrepancy.hypothesis import Hypothesis, extended
from polyworld.discrepancy.noise import measured_noise
from polyworld.discrepancy.strength_map import mapped, strength_map
from polyworld.discrepancy.trial import Bench, Trial
from polyworld.discrepancy.windows import windows
from polyworld.recording import Recording
from tests.polyworld.discrepancy.scenes import G, puck_recording, puck_world

SMOOTH, SIGMA = 0.1, 0.001
CENTRE, RADIUS = np.array([0.25, -0.2]), 0.3


def data(inside: float, duration: float = 0.8) -> Recording:
    def deceleration(place: np.ndarray, _speed: float) -> float:
        return G * (inside if np.hypot(*(place - CENTRE)) < RADIUS else SMOOTH)

    return puck_recording(deceleration, np.random.default_rng(5), SIGMA, runs=12, duration=duration)


def on_windows(recording: Recording) -> tuple[Trial, Hypothesis]:
    plan = design(puck_world(SMOOTH), recording)
    cut = windows(Bench(plan, measured_noise(plan), 1), 4)
    assert cut is not None
    base = Hypothesis(plan.world, ())
    (patch,) = extended(base, catalogue()["friction_patch"], plan.recording)
    return cut.ground(base, np.zeros(0)), patch


@pytest.mark.parametrize("inside", [0.02, 0.3])
def test_a_patch_smoother_or_rougher_is_where_windows_ask_for_it(inside: float) -> None:
    ground, patch = on_windows(data(inside))
    found = mapped(ground, patch)
    told = dict(zip([u.name for u in patch.unknowns], found[0].values, strict=True))
    assert (told["x"], told["y"], told["radius"]) == pytest.approx((*CENTRE, RADIUS), abs=0.3 * RADIUS)
    assert told["friction"] == pytest.approx(inside - SMOOTH, rel=0.5)
    assert dict(zip([u.name for u in patch.unknowns], found[0].before, strict=True))["friction"] == 0.0
    bench = ground.bench
    fits = [bench.fit(patch, lead.values, ground.fit.states, iterations=6) for lead in found]
    assert min(f.chi2 for f in fits) < 1.1 * bench.observations


def test_what_windows_do_not_ask_for_is_not_mapped() -> None:
    ground, patch = on_windows(data(SMOOTH))
    assert strength_map(ground, patch) is None
    assert mapped(ground, patch) == []


def test_runs_of_unequal_length_are_mapped_too() -> None:
    long, short = data(0.3), data(0.3, duration=0.6)
    mixed = Recording((*long.runs[:6], *(replace(r, name=f"short {r.name}") for r in short.runs[6:])))
    ground, patch = on_windows(mixed)
    told = dict(zip([u.name for u in patch.unknowns], mapped(ground, patch)[0].values, strict=True))
    assert (told["x"], told["y"], told["radius"]) == pytest.approx((*CENTRE, RADIUS), abs=0.3 * RADIUS)


def test_an_effect_without_a_place_has_no_map() -> None:
    ground, _ = on_windows(data(0.3))
    base = Hypothesis(ground.hypothesis.world, ())
    drag = extended(base, catalogue()["linear_drag"], ground.bench.design.recording)[0]
    assert mapped(ground, drag) == []
