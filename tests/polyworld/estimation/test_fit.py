"""Fits of studies of pucks that other code slides and collides: what is found, how surely, and what it predicts."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from polyworld.data.tracks import ObservedTracks
from polyworld.edits.removal import without
from polyworld.estimation.fit import FitOptions, fit
from polyworld.estimation.fit_settings import FitSettings, LinkSettings, PriorSettings
from polyworld.estimation.fitted import FittedConstant, StudyFit
from polyworld.estimation.noise import track_sigma
from polyworld.estimation.readout import sample_times
from polyworld.estimation.study import Study, StudyRun
from polyworld.estimation.unknown import Unknown
from polyworld.solver.rollout import rollout, simulator
from tests.polyworld.estimation.pucks import CROSSING, FRAME, RADIUS, SIGMA, clip, discs, tracks, world
from tests.polyworld.synthetic import of_one
from tests.scenes.discs import Started, slide

WHOLE = FitOptions(share=0.0)
ALONE = Started(np.array([[0.0, 0.0]]), np.array([[1.5, 0.4]]), np.zeros(1))
WOOD, STEEL = 0.25, 0.12
SECONDS = np.arange(60) * FRAME
PRIORS = PriorSettings()


def deviations(found: FittedConstant, truth: float) -> float:
    """How many standard deviations a value is off, those of the 80% interval, of logarithms where it is positive."""
    low, high = (np.log(v) if found.unknown.scale == "log" else v for v in found.interval)
    value, true = (np.log(v) if found.unknown.scale == "log" else v for v in (found.value, truth))
    return float(abs(value - true) / ((high - low) / (2.0 * norm.ppf(0.9))))


def two(seed: int = 0, name: str = "clip", start: Started = CROSSING, frames: int = 36) -> StudyRun:
    hidden = discs([STEEL, WOOD], masses=[1.0, 1.8])
    return clip(hidden, start, frames, seed=seed, name=name, materials=["steel", "wood"])


@pytest.fixture(scope="module")
def pooled() -> StudyFit:
    """Three clips: the middle one mirrored, the last slower."""
    mirrored = replace(CROSSING, positions=CROSSING.positions * [1, -1], velocities=CROSSING.velocities * [1, -1])
    slower = replace(CROSSING, velocities=0.8 * CROSSING.velocities)
    clips = [two(0, "first"), two(1, "mirrored", mirrored), two(2, "slower", slower)]
    return fit(Study(tuple(clips)), WHOLE)


def test_friction_by_material_is_found_within_its_interval(pooled: StudyFit) -> None:
    for name, truth in (("friction of steel", STEEL), ("friction of wood", WOOD)):
        found = pooled.constant(name)
        assert deviations(found, truth) < 3.0
        assert found.informed > 0.75
        assert found.interval[1] - found.interval[0] < 0.4 * truth


def test_restitution_is_known_as_far_as_rigid_impacts_are(pooled: StudyFit) -> None:
    """Three impacts, each at a share of its velocity jump, leave an error of some 0.1."""
    found = [pooled.constant(f"restitution of {m}") for m in ("steel", "wood")]
    assert np.mean([f.value for f in found]) == pytest.approx(0.7, abs=0.15)


def test_constants_of_a_material_are_one_number_in_every_run(pooled: StudyFit) -> None:
    for item in ("a", "b"):
        assert len({r.world.object(item).friction for r in pooled.runs}) == 1
        assert len({r.world.object(item).restitution for r in pooled.runs}) == 1
    assert {r.world.object("b").mass for r in pooled.runs} == {1.8}
    assert not [c for c in pooled.constants if "mass" in c.unknown.name]


def test_one_name_may_be_of_steel_in_one_clip_and_of_wood_in_another() -> None:
    swapped = clip(discs([WOOD, STEEL], masses=[1.0, 1.8]), CROSSING, 36, seed=1, name="swapped",
                   materials=["wood", "steel"])  # fmt: skip
    found = fit(Study((two(), swapped)), WHOLE)
    for name, truth in (("friction of steel", STEEL), ("friction of wood", WOOD)):
        assert deviations(found.constant(name), truth) < 3.0
    first, second = (r.world for r in found.runs)
    assert first.object("a").friction == pytest.approx(second.object("b").friction)
    assert first.object("b").restitution == pytest.approx(second.object("a").restitution)


def test_the_minimum_is_no_worse_than_the_truth() -> None:
    """Whose cost is that of the noise and of the priors, links of a collision by the same law costing nothing."""
    run = two()
    found = fit(of_one(run.world, run.tracks), WHOLE)
    exact = slide(discs([STEEL, WOOD], masses=[1.0, 1.8]), CROSSING, np.arange(36) * FRAME)[..., :2]
    sigma = np.hypot(track_sigma(run.tracks), 0.002 * np.hypot(RADIUS, 0.05))
    noise = (run.tracks.positions[..., :2] - exact) / sigma[:, None]
    truth = {"friction of steel": STEEL, "friction of wood": WOOD, "linear_damping": 0.0, "quadratic_damping": 0.0,
             "restitution of steel": 0.7, "restitution of wood": 0.7}  # fmt: skip
    cost = float((noise**2).sum())
    for c in found.constants:
        mean, sd = c.unknown.prior or (0.0, np.inf)
        true = truth.get(c.unknown.name)
        if true is not None:
            cost += ((np.log(true) if c.unknown.scale == "log" else true) - mean) ** 2 / sd**2
    assert found.cost < cost
    assert found.cost > cost - 8.0 * len(found.constants) - 2 * 8 * 4.0  # nor far below what so many unknowns can take


def test_a_mass_that_was_not_given_follows_from_a_collision() -> None:
    run = two()
    free = replace(run, world=world(2, masses=[1.0, None], materials=["steel", "wood"]))
    found = fit(Study((free,)), WHOLE).constant("mass of b")
    assert deviations(found, 1.8) < 3.0
    assert found.informed > 0.5


def test_what_was_never_observed_keeps_its_prior() -> None:
    """A puck that meets nothing says nothing of restitution."""
    found = fit(Study((clip(discs([WOOD]), ALONE, 30),)), WHOLE).constant("restitution of a")
    assert found.informed < 0.35
    mean, sd = PRIORS.restitution
    assert found.interval == pytest.approx((mean - 1.28 * sd, mean + 1.28 * sd), abs=0.6 * sd)


def test_intervals_hold_the_truth_as_often_as_they_claim() -> None:
    """Truths drawn from the priors themselves: 80% of 80% intervals hold them, of friction and of both dampings."""
    rng, held = np.random.default_rng(8), []
    for case in range(28):
        mu = np.exp(rng.normal(*PRIORS.ln_friction))
        c, k = (max(rng.normal(0.0, sd), 0.0) for sd in (PRIORS.linear_damping, PRIORS.quadratic_damping))

        def law(_t: float, _x: np.ndarray, v: np.ndarray, _w: np.ndarray, c: float = c, k: float = k) -> np.ndarray:
            return -(c + k * np.linalg.norm(v, axis=1, keepdims=True)) * v

        start = replace(ALONE, velocities=np.array([[rng.uniform(1.0, 4.0), rng.uniform(-1.0, 1.0)]]))
        run = clip(discs([mu], forces=(law,)), start, 24, seed=case)
        found = fit(Study((run,)), WHOLE)
        for name, truth in (("friction of a", mu), ("linear_damping", c), ("quadratic_damping", k)):
            low, high = found.constant(name).interval
            held.append(low <= truth <= high)
    # 84 intervals, three of a case not independent: 0.8 within 2.5 standard errors of 28 to 84 draws
    assert 0.63 < np.mean(held) < 0.95


def test_a_film_brakes_the_lighter_puck_more() -> None:
    """Equal pucks of 1 and 8 kg on a film of 0.8 N s/m: their speeds decay at 0.8 and 0.1 per second."""
    masses = np.array([1.0, 8.0])

    def film(_t: float, _x: np.ndarray, v: np.ndarray, _w: np.ndarray) -> np.ndarray:
        return -0.8 / masses[:, None] * v

    start = Started(np.array([[0.0, -1.0], [0.0, 1.0]]), np.array([[2.5, 0.0], [2.5, 0.0]]), np.zeros(2))
    hidden = discs([0.05, 0.05], masses=list(masses), forces=(film,))
    found = fit(Study((clip(hidden, start, 60, materials=["steel", "steel"]),)), WHOLE)
    light, heavy = (found.runs[0].world.object(n).linear_damping for n in "ab")
    assert found.constant("linear_damping by area").value > 2.0 * found.constant("linear_damping").value
    assert light > 2.5 * heavy


def struck_otherwise() -> StudyRun:
    """A clip whose impact turns the struck puck by 20 degrees more and leaves it a third slower than rigid laws do."""
    hidden, times = discs([STEEL, WOOD], masses=[1.0, 1.8]), np.arange(40) * FRAME
    states = slide(hidden, CROSSING, times)
    hit = int(np.argmax(states[:, 1, 3] > 0.0))
    fine = states[hit]
    turn = np.deg2rad(20.0)
    speeds = fine[:, 3:5].copy()
    speeds[1] = 0.67 * np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]) @ speeds[1]
    after = slide(hidden, Started(fine[:, :2], speeds, fine[:, 5]), times[: len(times) - hit])
    path = np.concatenate([states[:hit], after])
    return StudyRun("struck", world(2, masses=[1.0, 1.8], materials=["steel", "wood"]), tracks(path))


@pytest.fixture(scope="module")
def struck() -> StudyFit:
    return fit(Study((struck_otherwise(),)), WHOLE)


def test_a_collision_by_another_law_does_not_bend_friction(struck: StudyFit) -> None:
    hard = FitSettings(links=LinkSettings(gain=1e9))
    rigid = fit(Study((struck_otherwise(),)), WHOLE, settings=hard)
    off = [abs(np.log(f.constant("friction of wood").value / WOOD)) for f in (struck, rigid)]
    assert deviations(struck.constant("friction of wood"), WOOD) < 3.0
    assert deviations(struck.constant("friction of steel"), STEEL) < 3.0
    assert off[1] > 3.0 * off[0]
    assert struck.runs[0].slack[0] > 0.2
    assert rigid.runs[0].slack == ()


def test_one_start_leads_through_a_collision_by_its_pulses(struck: StudyFit) -> None:
    """The fitted world follows both pucks on either side, and without the one that was struck the other goes on."""
    accuracy = struck.runs[0].accuracy
    assert accuracy is not None
    assert accuracy.position < 2.0 * SIGMA * np.sqrt(2.0)
    assert {e.objects for e in struck.runs[0].world.effects if e.kind == "collision_slack"} == {("a",), ("b",)}
    left = without(struck.runs[0].world, "b")
    assert not [e for e in left.effects if e.kind == "collision_slack"]
    start = Started(CROSSING.positions[:1], CROSSING.velocities[:1], np.zeros(1))
    expected = slide(discs([STEEL]), start, np.array([0.0, 1.2]))[-1, 0, :2]
    found = rollout(left, 1.2).trajectory.positions[-1, 0, :2]
    assert found == pytest.approx(expected, abs=0.03)


def test_a_fitted_world_is_fitted_again_as_before(struck: StudyFit) -> None:
    """The pulses of the first fit belong to it: neither do they act in the second, nor do their names collide."""
    run = replace(struck_otherwise(), world=struck.runs[0].world)
    again = fit(Study((run,)), WHOLE)
    first, second = (f.constant("friction of wood").value for f in (struck, again))
    assert second == pytest.approx(first, rel=0.02)
    assert len(again.runs[0].world.effects) == len(struck.runs[0].world.effects)


def test_frames_held_out_do_not_inform() -> None:
    run = two(frames=40)
    spoiled = run.tracks.positions.copy()
    spoiled[30:] += [100.0, 0.0, 0.0]
    options = FitOptions(holdout=30)
    fits = [fit(of_one(run.world, t), options) for t in (run.tracks, replace(run.tracks, positions=spoiled))]
    samples = [b"".join(v.tobytes() for v in f.runs[0].sample.values()) for f in fits]
    assert samples[0] == samples[1]
    assert fits[0].runs[0].world.id == fits[1].runs[0].world.id
    assert fits[0].runs[0].frames == (0, 29)
    errors = [f.runs[0].prediction.bodies[0].error for f in fits if f.runs[0].prediction is not None]
    assert errors[0] < 0.05 < 99.0 < errors[1]


def test_predictions_are_rollouts_of_the_sample() -> None:
    run = clip(discs([WOOD]), ALONE, 30)
    found = fit(Study((run,)), FitOptions(holdout=20)).runs[0]
    assert found.prediction is not None
    (body,) = found.prediction.bodies
    times = sample_times(found.start, run.tracks)[20:]
    count = len(next(iter(found.sample.values())))
    batch = simulator(found.start, times, n_worlds=count).run(found.sample)
    ends = np.median(batch.positions[:, :, 0, :2], axis=0) - run.tracks.positions[20:, 0, :2]
    error = float(np.sqrt((ends**2).sum(axis=1).mean()))
    assert body.error == pytest.approx(error, abs=0.1 * SIGMA)  # two samples of one posterior
    still = run.tracks.positions[20:, 0, :2] - run.tracks.positions[19, 0, :2]
    assert body.stays == pytest.approx(float(np.sqrt((still**2).sum(axis=1).mean())), rel=1e-9)
    exact = slide(discs([WOOD]), ALONE, SECONDS)[-1, 0, :2]
    later = simulator(found.start, SECONDS[-1:], n_worlds=count).run(found.sample).positions[:, 0, 0, :2]
    low, high = np.quantile(later, [0.02, 0.98], axis=0)
    assert np.all((exact > low - 0.01) & (exact < high + 0.01))


def test_a_last_fifth_is_left_out_then_fitted_too() -> None:
    run = clip(discs([WOOD]), ALONE, 30)
    shares = [fit(Study((run,)), FitOptions(share=s)) for s in (0.2, 0.0)]
    assert shares[0].runs[0].prediction is not None
    assert shares[0].runs[0].prediction.frame == 24
    assert shares[1].runs[0].prediction is None
    values = [f.constant("friction of a").value for f in shares]
    assert values[0] == pytest.approx(values[1], rel=0.02)


def test_the_best_fit_is_the_first_member_and_equal_fits_have_equal_bytes() -> None:
    run = clip(discs([WOOD]), ALONE, 24)
    one, same = (fit(Study((run,)), WHOLE) for _ in range(2))
    assert one.runs[0].world.id == same.runs[0].world.id
    sample = one.runs[0].sample
    assert sample["objects.a.friction"][0] == pytest.approx(one.runs[0].world.object("a").friction)
    assert {len(v) for v in sample.values()} == {64}


@pytest.mark.parametrize("seed", [0, 1])
def test_searches_see_the_same_problem_and_do_no_better(seed: int) -> None:
    run = clip(discs([WOOD]), ALONE, 20)
    options = {"generations": 12, "population": 32, "seed": seed, "share": 0.0}
    cem, random = (fit(Study((run,)), FitOptions(method=m, **options)) for m in ("cem", "random_search"))
    best = fit(Study((run,)), WHOLE)
    assert best.cost_start == pytest.approx(cem.cost_start, rel=1e-9)
    assert best.cost <= cem.cost < random.cost
    assert best.rollouts < cem.rollouts


def test_a_cancelled_fit_returns_the_best_so_far_and_progress_goes_from_0_to_1() -> None:
    run = two()
    seen: list[float] = []
    stopped = fit(Study((run,)), watch=lambda share, _step, _rms: seen.append(share), cancelled=lambda: len(seen) >= 4)
    assert stopped.cancelled
    assert stopped.cost < stopped.cost_start
    assert seen == sorted(seen)
    assert 0.0 < seen[0] < seen[-1] <= 1.0


def test_what_cannot_be_fitted_is_refused() -> None:
    run = two()
    with pytest.raises(ValueError, match="at least one run"):
        Study(())
    with pytest.raises(ValueError, match=r"repeated: \['clip'\]"):
        Study((run, run))
    other: ObservedTracks = replace(run.tracks, names=("cup", "saucer"))
    with pytest.raises(ValueError, match="'cup'"):
        fit(of_one(run.world, other))
    with pytest.raises(ValueError, match="nothing to fit"):
        fit(Study((run,)), FitOptions(states=False, edit=lambda _: []))


@pytest.mark.parametrize(
    ("scale", "value", "at"),
    [
        ("log", 0.0104, False),
        ("log", 0.00051, True),
        ("log", 1.99, True),
        ("linear", 0.01, True),
        ("linear", 0.1, False),
    ],
)
def test_bounds_are_near_on_the_scale_of_the_constant(scale: Any, value: float, at: bool) -> None:
    unknown = Unknown("rolling", ("a.b",), "m", 1e-2, 5e-4, 2.0, 1.0, scale=scale)
    assert FittedConstant(unknown, value, 0.0, (value, value), 1.0, np.zeros(0)).at_bound is at
