"""Lift by spins that nobody measured: throws of a table tennis ball from SciPy, each with a spin of its own."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from polyworld.data.recording import Array, Recording, Run
from polyworld.estimation.design import design
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import catalogue, named
from polyworld.gap.examine import fitted_base
from polyworld.world import TimeBase, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere

G = 9.81
MASS = 0.0027  # [kg]
LIFT = 3e-5  # [kg]: lift per spin and speed
SIGMA = 0.002
BALL = RigidObject(name="ball", shape=Sphere(radius=0.02), mass=MASS, position=(0.0, 0.0, 1.0))
WORLD = World(objects=(BALL,), time=TimeBase(seconds_per_frame=0.01, substep=0.002))


def throw(seed: int, drag: float = 0.0, lift: float = LIFT) -> tuple[Run, Array]:
    """A throw at 100 Hz with noise, and its rate b = s omega / m [1/s]. drag [kg/m]."""
    rng = np.random.default_rng(seed)
    place, speed = rng.uniform([-0.3, -0.3, 0.7], [0.3, 0.3, 1.3]), rng.uniform([4.0, -1.0, 1.0], [8.0, 1.0, 3.0])
    start = np.concatenate([place, speed])
    rate = lift * rng.normal(size=3) * 80.0 / MASS
    times = np.arange(70) / 100.0

    def slopes(_: float, y: Array) -> Array:
        v = y[3:]
        pull = np.array([0.0, 0.0, -G]) + np.cross(rate, v) - drag / MASS * np.linalg.norm(v) * v
        return np.concatenate([v, pull])

    path = solve_ivp(slopes, (0.0, times[-1]), start, t_eval=times, rtol=1e-10, atol=1e-12).y[:3].T
    seen = (path + rng.normal(0.0, SIGMA, path.shape))[:, None]
    return Run(f"throw{seed}", ("ball",), times, seen, np.full((70, 1, 4), np.nan)), rate


def test_each_throw_gets_a_rate_of_its_own_and_so_does_the_held_out_one() -> None:
    throws = [throw(seed) for seed in range(3)]
    report = find_gap(
        WORLD,
        Recording(tuple(run for run, _ in throws)),
        held_out=Recording((throw(9)[0],)),
        settings=GapSettings(null_control=False),
    )
    summary = report.to_dict()
    assert summary["verdict"] == "identified"
    (effect,) = summary["effects"]
    assert effect["name"] == "magnus_lift"
    inside = 0
    for run, rate in throws:
        for axis in range(3):
            number = effect["unknowns"][f"rate_{'xyz'[axis]} in {run.name}"]
            inside += number["interval95"][0] < rate[axis] < number["interval95"][1]
            assert number["value"] == pytest.approx(rate[axis], abs=0.1)
    assert inside >= 7  # of 9
    assert summary["sealed"]["closed"] > 0.95
    assert summary["sealed"]["gap_before"] > 0.02


def test_one_throw_alone_may_as_well_be_seen_in_axes_that_turn() -> None:
    report = find_gap(WORLD, Recording((throw(0)[0],)), settings=GapSettings(null_control=False))
    assert report.verdict.kind == "ambiguous"
    assert report.experiment is None  # how the next throw will spin, nobody knows
    assert {t.hypothesis.names for t in report.verdict.credible} == {("coriolis",), ("magnus_lift",)}


def test_drag_beside_lift_is_found_though_a_wrong_effect_comes_nearer_by_itself() -> None:
    report = find_gap(
        WORLD,
        Recording((throw(0, drag=3e-4)[0],)),
        candidates=named(["magnus_lift", "quadratic_drag", "central_force", "spring"]),
        settings=GapSettings(null_control=False),
    )
    assert report.verdict.kind == "identified"
    assert sorted(report.names) == ["magnus_lift", "quadratic_drag"]
    lift, drag = sorted(report.to_dict()["effects"], key=lambda e: str(e["name"]))
    assert lift["same_as"] == ["coriolis"]
    low, high = drag["unknowns"]["coefficient"]["interval95"]
    assert low < 3e-4 < high


def test_throws_without_lift_miss_nothing() -> None:
    recording = Recording(tuple(throw(seed, lift=0.0)[0] for seed in range(4)))
    assert find_gap(WORLD, recording, settings=GapSettings(null_control=False)).verdict.kind == "nothing_missing"


def test_it_is_not_offered_where_spins_are_known() -> None:
    (variants, recording) = (catalogue()["magnus_lift"].variants, Recording((throw(0)[0],)))
    (unobserved,) = variants(WORLD, recording)
    assert [u.run for u in unobserved.unknowns] == ["throw0"] * 3
    spinning = WORLD.model_copy(update={"objects": (BALL.model_copy(update={"angular_velocity": (0.0, 50.0, 0.0)}),)})
    (known,) = variants(spinning, recording)
    assert [u.name for u in known.unknowns] == ["coefficient"]


def test_a_model_that_is_far_off_does_not_pass_for_noise_of_long_correlation() -> None:
    """Short series leave the correlation of noise open by 0.2; what lift bends the paths by is 30 times the noise."""
    plan = design(WORLD, Recording(tuple(throw(seed)[0] for seed in range(4))))
    noise = fitted_base(plan, ()).context.noise
    assert noise.correlation["position"].phi < 0.7
    assert noise.levels[0].sigma == pytest.approx(SIGMA, rel=0.3)
