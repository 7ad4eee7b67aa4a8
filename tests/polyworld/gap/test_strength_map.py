"""Where a patch of the floor lies, shown by how much more friction short windows of the paths ask for."""

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.recording import Recording
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FitContext, FittedHypothesis
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.score_test import ScoreTestStart
from polyworld.estimation.unknown import Unknown
from polyworld.gap.catalogue import catalogue
from polyworld.gap.contest import Contest
from polyworld.gap.segment_context import SegmentContext, segment_context
from polyworld.gap.settings import MapSettings, SearchSettings
from polyworld.gap.strength_map import mapped
from tests.polyworld.gap_scenes import G, puck_recording, puck_world

SMOOTH, SIGMA = 0.1, 0.001
CENTRE, RADIUS = np.array([0.25, -0.2]), 0.3
DAMPED = MapSettings().damped


def data(inside: float, duration: float = 0.8, elsewhere: float = SMOOTH) -> Recording:
    def deceleration(place: np.ndarray, _speed: float) -> float:
        return G * (inside if np.hypot(*(place - CENTRE)) < RADIUS else elsewhere)

    return puck_recording(deceleration, np.random.default_rng(5), SIGMA, runs=12, duration=duration)


def on_windows(
    recording: Recording, base: tuple[Unknown, ...] = (), pieces: int = 4
) -> tuple[SegmentContext, FittedHypothesis]:
    plan = design(puck_world(SMOOTH), recording)
    cut = segment_context(FitContext(plan, measured_noise(plan), 1), pieces)
    assert cut is not None
    return cut, cut.fit_base(Hypothesis(plan.world, base), np.array([u.start for u in base]))


def with_patch(ground: FittedHypothesis) -> Hypothesis:
    (patch,) = extended(ground.hypothesis, catalogue()["friction_patch"], ground.context.design.recording)
    return patch


def values_of(tested: ScoreTestStart) -> dict[str, float]:
    return dict(zip([u.name for u in tested.hypothesis.unknowns], tested.values.tolist(), strict=True))


def is_there(tested: ScoreTestStart) -> bool:
    found = values_of(tested)
    return (found["x"], found["y"], found["radius"]) == pytest.approx((*CENTRE, RADIUS), abs=0.3 * RADIUS)


def leads_there(ground: FittedHypothesis, found: list[ScoreTestStart]) -> bool:
    context = ground.context
    fits = [context.fit(tested.hypothesis, tested.values, ground.fit.states, iterations=6) for tested in found]
    best = min(fits, key=lambda f: f.chi2)
    right = is_there(replace(found[0], values=best.values))
    return right and best.chi2 < 1.1 * context.observations


@pytest.mark.parametrize("inside", [pytest.param(0.02, marks=pytest.mark.benchmark), 0.3])
def test_a_patch_smoother_or_rougher_is_where_windows_ask_for_it(inside: float) -> None:
    _, ground = on_windows(data(inside))
    patch = with_patch(ground)
    found = mapped(ground, patch)
    assert is_there(found[0])
    assert values_of(found[0])["friction"] == pytest.approx(DAMPED * (inside - SMOOTH), rel=0.4)
    assert leads_there(ground, found)


def test_a_patch_is_found_on_a_floor_whose_own_friction_is_not_known() -> None:
    path = "environment.motion_plane.friction"
    friction = Unknown("mu", (path,), "1", SMOOTH, 0.0, 2.0, 0.1)
    _, ground = on_windows(data(0.3, elsewhere=0.13), (friction,))
    (best, *_) = mapped(ground, with_patch(ground))
    assert is_there(best)
    # Elsewhere asks for less, as the floor's friction fits both a little; the difference is what the patch adds.
    assert values_of(best)["mu"] > 0.2
    assert values_of(best)["friction"] == pytest.approx(DAMPED * (0.3 - 0.13), rel=0.1)


def test_long_windows_are_cut_into_short_ones() -> None:
    _, ground = on_windows(data(0.3), pieces=1)
    assert is_there(mapped(ground, with_patch(ground))[0])


def test_what_windows_do_not_ask_for_is_not_mapped() -> None:
    _, ground = on_windows(data(SMOOTH))
    assert mapped(ground, with_patch(ground)) == []


def test_runs_of_unequal_length_and_with_gaps_are_mapped_too() -> None:
    long, short = data(0.3), data(0.3, duration=0.7)
    holed = long.runs[0].positions.copy()
    holed[30:33] = np.nan
    runs = (replace(long.runs[0], positions=holed), *long.runs[1:6])
    mixed = Recording((*runs, *(replace(r, name=f"short {r.name}") for r in short.runs[6:])))
    _, ground = on_windows(mixed)
    assert len({len(r.times) for r in ground.context.design.runs}) > 1
    assert leads_there(ground, mapped(ground, with_patch(ground)))


def test_an_effect_without_a_place_has_no_map() -> None:
    _, ground = on_windows(data(0.3))
    drag = extended(ground.hypothesis, catalogue()["linear_drag"], ground.context.design.recording)[0]
    assert mapped(ground, drag) == []


def test_a_patch_is_looked_for_beside_another_effect_in_whichever_order_they_came() -> None:
    def deceleration(place: np.ndarray, speed: float) -> float:
        return 0.3 * speed + G * (0.3 if np.hypot(*(place - CENTRE)) < RADIUS else SMOOTH)

    recording = puck_recording(deceleration, np.random.default_rng(5), SIGMA, runs=12, duration=0.8)
    cut, ground = on_windows(recording)
    contest = Contest(cut.context, cut, SearchSettings(), lambda _step, _figures: None)
    parents = []
    for first, iterations in (("friction_patch", 0), ("linear_drag", 6)):
        (one, *_) = extended(ground.hypothesis, catalogue()[first], recording)
        start = np.array(one.starts(np.zeros(0))[0])
        parents.append(cut.context.fit(one, start, ground.fit.states, iterations=iterations))
    both = {"friction_patch": "linear_drag", "linear_drag": "friction_patch"}

    def other(parent: FittedHypothesis) -> list[Hypothesis]:
        (name,) = parent.hypothesis.names
        return list(extended(parent.hypothesis, catalogue()[both[name]], recording))

    predictions = contest.predict(parents, other)
    (best, *_) = contest.fit(predictions, 4, min(p.chi2 for p in parents))
    assert sorted(best.hypothesis.names) == ["friction_patch", "linear_drag"]
    assert best.chi2 < 1.1 * cut.context.observations
