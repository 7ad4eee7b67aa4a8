"""Residuals and errors against values worked out by hand, and what must not count in them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from polyworld.data.shape_series import ShapeSeries
from polyworld.data.tracks import ObservedTracks, shapes_only
from polyworld.estimation.accuracy import accuracy
from polyworld.estimation.readout import gyration_radius, sample_times, tracks_readout
from polyworld.probing.readouts import Centreline, Curve, ImageOccupancy, Readout, Tension, read
from polyworld.trajectory import BatchTrajectory
from polyworld.world import Environment, MotionPlane, TimeBase, World, geometry
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.representations.rope import Rope
from polyworld.world.shapes import Cylinder, Sphere
from tests.polyworld.estimation.closed_form import ClosedForm, observe, thrown_ball
from tests.polyworld.synthetic import rollout_of

Array = NDArray[np.float64]
EXACT = {"sigma": 0.0, "turn_sigma": 0.0}
GYRATION = 0.1 * np.sqrt(0.4)  # [m] of the ball


def squares(world: World, tracks: ObservedTracks, sigma: float = 0.01, samples: int | None = None) -> float:
    """Sum of squared standardised residuals of the world's own motion."""
    batch = ClosedForm(world, sample_times(world, tracks), n_worlds=1).run()
    readout = tracks_readout(world, tracks, np.array([sigma]))
    return float((readout.residuals(batch, samples or len(tracks.frames)) ** 2).sum())


def shifted(tracks: ObservedTracks, row: int, by: tuple[float, float, float]) -> ObservedTracks:
    positions = tracks.positions.copy()
    positions[row, 0] += by
    return replace(tracks, positions=positions)


def unturned(tracks: ObservedTracks) -> ObservedTracks:
    return replace(tracks, orientation_confidence=np.zeros_like(tracks.orientation_confidence))


def test_one_displaced_sample_costs_its_squared_standardised_distance_by_its_confidence() -> None:
    world = thrown_ball()
    tracks = shifted(observe(world, **EXACT), 5, (0.03, 0.04, 0.0))
    assert squares(world, tracks, 0.1) == pytest.approx(0.25)
    doubtful = tracks.confidence.copy()
    doubtful[5] = 0.2
    assert squares(world, replace(tracks, confidence=doubtful), 0.1) == pytest.approx(0.05)
    doubtful[5] = 0.0
    assert squares(world, replace(tracks, confidence=doubtful), 0.1) == pytest.approx(0.0, abs=1e-12)


def test_noise_as_stated_gives_one_a_component() -> None:
    world = thrown_ball()
    tracks = observe(world, frames=400, sigma=0.01, turn_sigma=0.0)
    # 1200 squared standard normals: within 5 standard deviations of the mean, sqrt(2 / 1200)
    assert squares(world, unturned(tracks)) / 1200.0 == pytest.approx(1.0, abs=0.21)
    tracks = observe(world, frames=400, sigma=0.0, turn_sigma=0.01 / GYRATION)
    assert squares(world, tracks) / 1200.0 == pytest.approx(1.0, abs=0.21)


def test_noise_along_a_line_of_sight_counts_less_the_more_it_spreads() -> None:
    """A standard deviation of hypot(0.01, 0.04) m along x, of 0.01 m across."""
    world = thrown_ball()
    tracks = unturned(observe(world, **EXACT))
    spread = np.zeros((25, 1, 3))
    spread[..., 0] = 0.04
    tracks = replace(tracks, position_spread=spread)
    assert squares(world, shifted(tracks, 3, (0.05, 0.0, 0.0))) == pytest.approx(25e-4 / (1e-4 + 16e-4), rel=1e-6)
    assert squares(world, shifted(tracks, 3, (0.0, 0.05, 0.0))) == pytest.approx(25.0, rel=1e-6)


def test_samples_before_the_start_and_beyond_the_horizon_do_not_count() -> None:
    late = thrown_ball(start_time=0.4)
    tracks = observe(late, **EXACT)
    tracks = replace(tracks, confidence=np.ones((25, 1)), orientation_confidence=np.ones((25, 1)))
    assert squares(late, shifted(tracks, 9, (5.0, 0.0, 0.0))) == pytest.approx(0.0, abs=1e-9)
    assert squares(late, shifted(tracks, 10, (5.0, 0.0, 0.0))) > 1.0
    tracks = shifted(observe(thrown_ball(), **EXACT), 20, (0.5, 0.0, 0.0))
    assert squares(thrown_ball(), tracks, samples=20) == pytest.approx(0.0, abs=1e-9)
    assert squares(thrown_ball(), tracks, samples=21) > 1.0


@pytest.mark.parametrize("order", [1, 2, 4])
def test_rotation_is_compared_up_to_the_symmetry(order: int) -> None:
    world = thrown_ball()
    tracks = observe(world, **EXACT, symmetry=order)

    def turned(angle: float) -> float:
        turn = geometry.rotation_quaternion(np.array([0.0, 0.0, angle]))
        return squares(world, replace(tracks, orientations=geometry.quaternion_product(tracks.orientations, turn)))

    assert turned(2.0 * np.pi / order) == pytest.approx(0.0, abs=1e-9)
    assert turned(2.0 * np.pi / order + 0.1) == pytest.approx(25.0 * (0.1 * GYRATION / 0.01) ** 2)


def test_spin_of_a_round_object_is_not_compared_but_its_tilt_is() -> None:
    can = RigidObject(name="can", shape=Cylinder(radius=0.1, half_height=0.1), position=(0, 0, 0))
    world = World(objects=(can,), time=TimeBase(seconds_per_frame=0.1))
    tracks = observe(world, frames=4, **EXACT, symmetry=0)
    spun, tilted = (geometry.rotation_quaternion(np.array(v)) for v in ([0.0, 0.0, 1.3], [0.1, 0.0, 0.0]))
    same = replace(tracks, orientations=geometry.quaternion_product(tracks.orientations, spun))
    assert squares(world, same) == pytest.approx(0.0, abs=1e-9)
    other = replace(tracks, orientations=geometry.quaternion_product(tilted, same.orientations))
    assert squares(world, other) == pytest.approx(4.0 * (0.1 * gyration_radius(world, "can", None) / 0.01) ** 2)


def test_errors_are_roots_of_mean_squared_distances_at_the_tracks_frames() -> None:
    world = thrown_ball()
    tracks = shifted(shifted(observe(world, **EXACT), 2, (0.3, 0.0, 0.0)), 9, (0.0, 0.0, 0.4))
    report = accuracy(world, tracks, ClosedForm(world, tracks.times, n_worlds=1).run().world(0))
    assert report.position == pytest.approx(np.sqrt((0.09 + 0.16) / 25.0))
    assert report.worst_position == pytest.approx(0.4)
    assert report.rotation == pytest.approx(0.0, abs=1e-7)
    with pytest.raises(ValueError, match="sample it at the tracks' frames"):
        accuracy(world, tracks, ClosedForm(world, np.arange(25) * 0.05, n_worlds=1).run().world(0))


# --- shapes -----------------------------------------------------------------------------------------

TIMES = np.arange(12) * 0.02


def string() -> World:
    rope = Rope(name="string", points=((0.0, 0.0, 0.0), (2.0, 0.0, 0.0)), segments=20, radius=0.02)
    return World(deformables=(rope,), time=TimeBase(seconds_per_frame=0.02))


def swinging(height: float, tension: float = 5.0) -> BatchTrajectory:
    """A string whose middle rises by `height` a second."""
    s = np.linspace(0.0, 1.0, 21)
    points = np.zeros((len(TIMES), 21, 3))
    points[..., 0] = 2.0 * s
    points[..., 2] = height * np.outer(TIMES, np.sin(np.pi * s) + 0.5 * np.sin(2.0 * np.pi * s))
    pull = {"string": {"tension": np.full((len(TIMES), 20), tension)}}
    one = rollout_of(string(), TIMES, {"string": points}, quantities=pull).trajectory
    return BatchTrajectory(
        names=one.names, times=one.times[None], positions=one.positions[None], orientations=one.orientations[None],
        velocities=one.velocities[None], angular_velocities=one.angular_velocities[None], active=one.active,
        diverged=np.zeros(1, dtype=bool), diverged_time=np.full(1, np.nan), diverged_object=np.full(1, -1),
        events=((),), deformables={n: replace(m, points=m.points[None], velocities=m.velocities[None],
                                              quantities={k: q[None] for k, q in m.quantities.items()})
                                   for n, m in one.deformables.items()},
    )  # fmt: skip


def shape_squares(readout: Readout, values: Array, batch: BatchTrajectory, sigma: float = 0.01) -> float:
    shape = values.shape[:2]
    series = ShapeSeries(readout, values, np.full(shape, sigma), np.ones(shape))
    own = tracks_readout(string(), shapes_only((series,), np.arange(len(TIMES)), 0.02), np.zeros(0))
    return float((own.residuals(batch, len(TIMES)) ** 2).sum())


def test_a_centreline_without_direction_may_be_observed_from_either_end() -> None:
    line = Centreline(object="string", count=5)
    values = read(line, string(), swinging(1.0))[0]
    turned = values.copy()
    turned[::2] = turned[::2, ::-1]  # and not even the same one in every frame
    free = line.model_copy(update={"directed": False})
    assert shape_squares(free, turned, swinging(1.0)) == pytest.approx(0.0, abs=1e-9)
    assert shape_squares(line, turned, swinging(1.0)) > 100.0


def test_a_part_of_a_curve_is_compared_by_nearest_points() -> None:
    part = read(Centreline(object="string", count=21), string(), swinging(1.0))[0][:, 4:9]  # a fifth of it was seen
    curve = Curve(object="string", count=5)
    assert shape_squares(curve, part, swinging(1.0)) < 1.0
    assert shape_squares(curve, part, swinging(2.0)) > 100.0


def test_readouts_that_do_not_fit_the_world_are_refused_with_what_does() -> None:
    values = np.zeros((len(TIMES), 1, 1))
    ball = World(objects=(RigidObject(name="string", shape=Sphere(radius=0.1), position=(0.0, 0.0, 0.0)),),
                 environment=Environment(motion_plane=MotionPlane()))  # fmt: skip
    series = ShapeSeries(Tension(object="string"), values, np.ones(values.shape[:2]), np.ones(values.shape[:2]))
    with pytest.raises(KeyError, match="unknown deformable object"):
        tracks_readout(ball, shapes_only((series,), np.arange(len(TIMES)), 0.02), np.zeros(0))
    with pytest.raises(ValueError, match="no camera"):
        shape_squares(ImageOccupancy(object="string", columns=1, rows=1), values, swinging(1.0))
