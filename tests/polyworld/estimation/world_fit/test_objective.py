"""The loss against values worked out by hand, and what must not count in it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from polyworld.data.tracks import ObservedTracks
from polyworld.estimation.world_fit import (
    FitProblem,
    Objective,
    ObjectiveSettings,
    Unknown,
    accuracy,
    refine,
)
from polyworld.estimation.world_fit.objective import DIVERGED, gyration_radius, huber
from polyworld.trajectory import Truncation
from polyworld.world import TimeBase, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Cylinder, Sphere
from tests.polyworld.estimation.world_fit.closed_form import ClosedForm, observe, thrown_ball

EXACT = {"sigma": 0.0, "turn_sigma": 0.0}


def stated(tracks: ObservedTracks, sigma: float) -> ObservedTracks:
    return replace(tracks, position_sigma=np.full(tracks.confidence.shape, sigma))


def one_loss(world: World, tracks: ObservedTracks, **settings: float) -> float:
    objective = Objective(world, tracks, ObjectiveSettings(**settings))
    batch = ClosedForm(world, objective.sample_times, n_worlds=1).run()
    return float(objective.losses(batch)[0])


def shifted(tracks: ObservedTracks, row: int, by: tuple[float, float, float]) -> ObservedTracks:
    positions = tracks.positions.copy()
    positions[row, 0] += by
    return replace(tracks, positions=positions)


def test_one_displaced_sample_costs_its_squared_standardised_distance() -> None:
    world = thrown_ball()
    tracks = shifted(stated(observe(world, **EXACT), 0.1), 5, (0.03, 0.04, 0.0))
    tracks = replace(tracks, orientation_confidence=np.zeros((25, 1)))
    # (0.05 / 0.1)^2 over 25 samples of 3 components
    assert one_loss(world, tracks) == pytest.approx(0.25 / 75.0, rel=1e-12)


def test_noise_as_stated_gives_a_loss_near_one() -> None:
    world = thrown_ball()
    tracks = observe(world, frames=400, sigma=0.01, turn_sigma=0.0)
    tracks = replace(tracks, orientation_confidence=np.zeros((400, 1)))
    # mean of 1200 squared standard normals: 1 within 5 standard deviations of sqrt(2 / 1200)
    assert one_loss(world, tracks, huber=np.inf) == pytest.approx(1.0, abs=0.21)


def test_an_outlier_costs_linearly_and_a_doubtful_one_in_proportion() -> None:
    world = thrown_ball()
    clean = replace(stated(observe(world, **EXACT), 0.01), orientation_confidence=np.zeros((25, 1)))
    once, twice = shifted(clean, 3, (1.0, 0.0, 0.0)), shifted(clean, 3, (2.0, 0.0, 0.0))
    # 2 k r - k^2 with k = 5 and r = 100, 200
    assert one_loss(world, once) == pytest.approx(975.0 / 75.0)
    assert one_loss(world, twice) == pytest.approx(1975.0 / 75.0)
    confidence = once.confidence.copy()
    confidence[3] = 0.2
    assert one_loss(world, replace(once, confidence=confidence)) == pytest.approx(0.2 * 975.0 / (24.2 * 3.0))


def test_unobserved_samples_do_not_count() -> None:
    world = thrown_ball()
    tracks = stated(observe(world, **EXACT), 0.01)
    confidence, turned = tracks.confidence.copy(), tracks.orientation_confidence.copy()
    confidence[7], turned[7] = 0.0, 0.0
    tracks = shifted(replace(tracks, confidence=confidence, orientation_confidence=turned), 7, (np.nan, 0.0, 0.0))
    assert one_loss(world, tracks) == pytest.approx(0.0, abs=1e-12)


def test_samples_before_the_start_do_not_count() -> None:
    late = thrown_ball(start_time=0.4)
    tracks = stated(observe(late, **EXACT), 0.01)
    seen = replace(tracks, confidence=np.ones((25, 1)), orientation_confidence=np.ones((25, 1)))
    assert one_loss(late, shifted(seen, 9, (5.0, 0.0, 0.0))) == pytest.approx(0.0, abs=1e-12)
    assert one_loss(late, shifted(seen, 10, (5.0, 0.0, 0.0))) > 1.0


def test_a_shorter_horizon_sees_only_its_samples() -> None:
    world = thrown_ball()
    tracks = shifted(stated(observe(world, **EXACT), 0.01), 20, (0.5, 0.0, 0.0))
    objective = Objective(world, tracks)
    simulator = ClosedForm(world, objective.sample_times, n_worlds=2)
    assert objective.losses(simulator.run(samples=20)) == pytest.approx(0.0, abs=1e-12)
    assert objective.losses(simulator.run(samples=21))[0] > 1.0


@pytest.mark.parametrize("order", [1, 2, 4])
def test_rotation_is_compared_up_to_the_symmetry(order: int) -> None:
    world = thrown_ball()
    tracks = replace(stated(observe(world, **EXACT, symmetry=order), 0.01), confidence=np.zeros((25, 1)))
    alike = geometry.rotation_quaternion(np.array([0.0, 0.0, 2.0 * np.pi / order]))
    turned = replace(tracks, orientations=geometry.quaternion_product(tracks.orientations, alike))
    assert one_loss(world, turned) == pytest.approx(0.0, abs=1e-12)
    off = geometry.rotation_quaternion(np.array([0.0, 0.0, 2.0 * np.pi / order + 0.1]))
    turned = replace(tracks, orientations=geometry.quaternion_product(tracks.orientations, off))
    # three components, of which one is off by 0.1 rad
    assert one_loss(world, turned, rotation_sigma=0.05) == pytest.approx(4.0 / 3.0)


def test_planar_rotation_counts_about_the_normal_by_the_radius_of_gyration() -> None:
    box = RigidObject(
        name="box", representation="rigid_planar", shape=Box(half_extents=(0.2, 0.2, 0.2)), position=(0, 0, 0.2)
    )
    world = World(objects=(box,), time=TimeBase(seconds_per_frame=0.1))
    tracks = replace(stated(observe(world, frames=4, **EXACT, symmetry=4), 0.01), confidence=np.zeros((4, 1)))
    turn = geometry.rotation_quaternion(np.array([0.0, 0.0, np.pi / 2 - 0.03]))
    turned = replace(tracks, orientations=geometry.quaternion_product(turn, tracks.orientations))
    # gyration of a square of side 0.4 about its middle: 0.4 / sqrt(6)
    length = 0.4 / np.sqrt(6.0)
    assert gyration_radius(world, "box", np.array([0.0, 0.0, 1.0])) == pytest.approx(length)
    assert one_loss(world, turned) == pytest.approx((0.03 * length / 0.01) ** 2)


def test_spin_of_a_round_object_is_not_compared_but_its_tilt_is() -> None:
    can = RigidObject(name="can", shape=Cylinder(radius=0.1, half_height=0.1), position=(0, 0, 0))
    world = World(objects=(can,), time=TimeBase(seconds_per_frame=0.1))
    tracks = replace(stated(observe(world, frames=4, **EXACT, symmetry=0), 0.01), confidence=np.zeros((4, 1)))
    spun = geometry.rotation_quaternion(np.array([0.0, 0.0, 1.3]))
    tilted = geometry.rotation_quaternion(np.array([0.1, 0.0, 0.0]))
    same = replace(tracks, orientations=geometry.quaternion_product(tracks.orientations, spun))
    assert one_loss(world, same, rotation_sigma=0.05) == pytest.approx(0.0, abs=1e-12)
    other = replace(tracks, orientations=geometry.quaternion_product(tilted, same.orientations))
    assert one_loss(world, other, rotation_sigma=0.05) == pytest.approx(4.0 / 3.0)


def test_a_diverged_world_is_worse_than_any_other_and_an_early_one_worse_than_a_late_one() -> None:
    world = thrown_ball()
    objective = Objective(world, stated(observe(world, **EXACT), 1e-4))
    batch = ClosedForm(world, objective.sample_times, n_worlds=3).run()
    positions = batch.positions.copy()
    positions[0, 5:], positions[1, 20:], positions[2] = np.nan, np.nan, positions[2] + 1e3
    batch = replace(
        batch,
        positions=positions,
        diverged=np.array([True, True, False]),
        diverged_time=np.array([0.2, 0.8, np.nan]),
    )
    early, late, far = objective.losses(batch)
    assert np.isfinite(early)
    assert early > late > DIVERGED > far


def test_a_truncated_world_is_a_bad_candidate_like_a_diverged_one() -> None:
    world = thrown_ball()
    objective = Objective(world, stated(observe(world, **EXACT), 1e-4))
    batch = ClosedForm(world, objective.sample_times, n_worlds=2).run()
    positions = batch.positions.copy()
    positions[1, 5:] = np.nan
    ended = replace(batch, positions=positions, truncated={1: Truncation(0.2, "no room")})
    diverged = replace(ended, truncated={}, diverged=np.array([False, True]), diverged_time=np.array([np.nan, 0.2]))
    assert objective.losses(ended).tolist() == objective.losses(diverged).tolist()
    assert objective.losses(ended)[1] > DIVERGED
    assert np.isnan(objective.residuals(ended)[1]).all()


def test_rmse_is_the_root_of_the_mean_squared_distance() -> None:
    world = thrown_ball()
    tracks = shifted(shifted(stated(observe(world, **EXACT), 0.01), 2, (0.3, 0.0, 0.0)), 9, (0.0, 0.0, 0.4))
    trajectory = ClosedForm(world, tracks.times, n_worlds=1).run().world(0)
    assert accuracy(world, tracks, trajectory).position == pytest.approx(np.sqrt((0.09 + 0.16) / 25.0))
    report = accuracy(world, tracks, trajectory)
    assert report.worst_position == pytest.approx(0.4)
    assert report.position_by_object == pytest.approx({"ball": 0.1})
    assert report.rotation == pytest.approx(0.0, abs=1e-7)


def test_rmse_of_samples_at_other_times_is_refused() -> None:
    world = thrown_ball()
    trajectory = ClosedForm(world, np.arange(25) * 0.05, n_worlds=1).run().world(0)
    with pytest.raises(ValueError, match="sample it at the tracks' frames"):
        accuracy(world, observe(world), trajectory)


def test_tracks_of_other_objects_are_named() -> None:
    world = thrown_ball()
    with pytest.raises(ValueError, match="'cup'"):
        Objective(world, replace(observe(world), names=("cup",)))
    two = World(objects=(*world.objects, RigidObject(name="cup", shape=Sphere(radius=0.1), position=(5, 0, 0))))
    spin = Unknown("spin", ("objects.ball.angular_velocity.z",), "rad/s", 0.0, -9.0, 9.0, 1.0)
    found = refine(FitProblem(two, observe(world), [spin], make_simulator=ClosedForm), iterations=1)
    assert (found.unobserved, found.unmodelled) == (("cup",), ())


@pytest.mark.parametrize("size", [0.0, 0.5, 3.0, 7.0])
def test_huber_is_the_integral_of_its_bounded_influence(size: float) -> None:
    grid = np.linspace(0.0, size, 200_001)
    influence = 2.0 * np.minimum(grid, 3.0)
    assert float(huber(np.array(size), 3.0)) == pytest.approx(np.trapezoid(influence, grid), abs=1e-8)


@pytest.mark.parametrize("wrong", [{"rotation_sigma": 0.0}, {"position_tolerance": -1.0}, {"huber": 0.0}])
def test_impossible_weights_are_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        ObjectiveSettings(**wrong)
