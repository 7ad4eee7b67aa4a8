"""Tracks themselves: pixels, frames that are shown twice, stuck trackers, bodies inside a floor."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from polyworld.data.noise import noise_levels
from polyworld.data.recording import Recording, Run
from polyworld.screening import Screening, screen
from polyworld.screening.grid import grid_step
from polyworld.screening.time_stamps import repeated_rows
from polyworld.screening.tracks import subject
from polyworld.world import StaticObject, World
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Sphere
from tests.polyworld.screening import cases

WORLD = cases.ball_world()


@cache
def launches() -> Recording:
    times = cases.sampling()
    return cases.recorded(times, cases.bounces(times))


def kinds(screening: Screening) -> list[str]:
    return [f.kind for f in screening.findings]


def steps_of(recording: Recording) -> dict[tuple[str, int], float]:
    tracks = subject(WORLD, recording).tracks
    return {(t.object, axis): float(q) for t in tracks for axis, q in enumerate(t.quantum) if q > 0.0}


def on_pixels(recording: Recording, step: float) -> Recording:
    return cases.altered(recording, lambda r: replace(r, positions=np.round(r.positions / step) * step))


@pytest.mark.parametrize("step", [0.00371, 0.004, 0.01])
def test_pixels_are_measured_and_harmless_where_the_object_crosses_them_in_every_frame(step: float) -> None:
    found = on_pixels(launches(), step)
    assert steps_of(found) == pytest.approx({("ball", axis): step for axis in range(3)}, rel=1e-3)
    assert kinds(screen(WORLD, found)) == []


def test_decimals_below_the_noise_are_no_grid() -> None:
    assert steps_of(on_pixels(launches(), 1e-4)) == {}


@pytest.mark.parametrize("decimals", [4, 12])
def test_slow_motion_from_pixel_to_pixel_is_a_caution(decimals: int) -> None:
    world, swing = cases.swinging(cases.sampling(60.0, 6.0))
    coarse = on_pixels(swing, 0.0237)
    rounded = cases.altered(coarse, lambda r: replace(r, positions=np.round(r.positions, decimals)))
    found = screen(world, rounded)
    assert "quantised" in kinds(found)
    assert "repeated_rows" not in kinds(found)
    assert steps_of(rounded)["ball", 0] == pytest.approx(0.0237, rel=0.01)


@pytest.mark.parametrize("seed", range(20))
def test_grid_is_found_whatever_its_origin_and_never_in_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    path = 0.3 + np.cumsum(rng.uniform(0.0, 0.05, 60))
    noisy = path + 1e-3 * rng.standard_normal(60)
    assert grid_step(noisy, np.diff(noisy)) == 0.0
    step = rng.uniform(0.003, 0.02)
    gridded = 0.123456 + step * np.round(path / step)
    assert grid_step(gridded, np.diff(gridded)) == pytest.approx(step, rel=1e-6)


def test_constant_velocity_rounded_to_decimals_is_no_grid_of_its_steps() -> None:
    slide = np.concatenate([np.zeros(40), np.round(0.00495 * np.arange(60), 4)])
    assert grid_step(slide, np.diff(slide)) == pytest.approx(1e-4)


def test_noise_is_measured_on_smooth_motion_and_on_fast_oscillations() -> None:
    rng = np.random.default_rng(4)
    times = np.arange(300) / 60.0
    values = np.stack([times**2, np.sin(2.0 * np.pi * 6.0 * times)], axis=1)
    found = noise_levels(times, values + 1e-3 * rng.standard_normal(values.shape))
    assert found[0] == pytest.approx(1e-3, rel=0.2)
    assert found[1] == pytest.approx(1e-3, rel=1.5)


def test_turning_points_of_a_pendulum_seen_in_whole_pixels_are_no_repeated_rows() -> None:
    times = cases.sampling(60.0, 20.0)
    _, swing = cases.swinging(times)
    pixel = 0.02
    values = np.round(swing.runs[0].positions[:, 0, [0, 2]] / pixel) * pixel
    assert np.all(values[1:] == values[:-1], axis=1).sum() > 100
    assert repeated_rows(times, values, pixel).sum() == 0


def test_pixels_mapped_to_a_plane_at_an_angle_are_no_repeated_rows() -> None:
    times = cases.sampling(60.0, 6.0)
    u = np.round(300.0 + 60.0 * np.sin(1.3 * times) * np.exp(-0.2 * times))
    values = (0.01 * u / (1.0 + 0.0005 * u))[:, None]
    assert np.sum(values[1:] == values[:-1]) > 50
    assert repeated_rows(times, values).sum() == 0


def test_every_second_row_of_a_slower_source_is_a_repeat() -> None:
    times = cases.sampling(60.0, 1.0)
    rng = np.random.default_rng(2)
    fall = np.stack([1.5 * times, 2.0 - 0.5 * cases.G * times**2], axis=1) + 1e-4 * rng.standard_normal((60, 2))
    shown = fall[np.arange(60) // 2 * 2]
    again = np.flatnonzero(repeated_rows(times, shown))
    assert np.array_equal(again, np.arange(3, 59, 2))  # the first and the last pair have motion on one side only
    assert repeated_rows(times, fall).sum() == 0


def test_single_repeats_are_found_on_a_grid_that_the_motion_crosses() -> None:
    times = cases.sampling(60.0, 1.0)
    values = np.round((2.0 - 0.5 * cases.G * times**2) / 0.01)[:, None] * 0.01
    shown = values.copy()
    shown[[30, 45]] = shown[[29, 44]]
    assert np.array_equal(np.flatnonzero(repeated_rows(times, shown, 0.01)), [30, 45])


def test_rest_before_and_after_a_motion_is_no_repeat() -> None:
    times = cases.sampling(60.0, 2.0)
    values = np.clip(times - 0.5, 0.0, 1.0)[:, None]
    assert repeated_rows(times, values).sum() == 0


def test_clips_that_show_frames_twice_are_a_caution() -> None:
    twice = cases.altered(launches(), lambda r: replace(r, positions=r.positions[np.arange(len(r.times)) // 2 * 2]))
    (found,) = screen(WORLD, twice).findings
    assert (found.kind, found.severity) == ("repeated_rows", "caution")
    repeated, rows = cases.numbers(found)[-2:]
    assert repeated / rows == pytest.approx(0.5, abs=0.02)


def test_a_track_that_is_stuck_in_one_run_is_a_caution() -> None:
    recording = launches()
    first = recording.runs[0]
    stuck = replace(first, positions=np.tile(first.positions[:1], (len(first.times), 1, 1)))
    (found,) = screen(WORLD, Recording((stuck, *recording.runs[1:]))).findings
    assert (found.kind, found.severity, "run run_0," in found.message) == ("constant", "caution", True)


def test_an_object_that_rests_with_noise_beside_a_moving_one_is_no_finding() -> None:
    rng = np.random.default_rng(6)

    def with_stone(run: Run, noise: float) -> Run:
        stone = [1.0, 1.0, cases.RADIUS] + noise * rng.standard_normal((len(run.times), 3))
        return cases.run(run.name, run.times, np.stack([run.positions[:, 0], stone], axis=1), ("ball", "stone"))

    stone = RigidObject(name="stone", shape=Sphere(radius=cases.RADIUS), mass=1.0, position=(1.0, 1.0, cases.RADIUS))
    world = WORLD.model_copy(update={"objects": (*WORLD.objects, stone)})
    assert kinds(screen(world, cases.altered(launches(), lambda r: with_stone(r, 1e-3)))) == []
    (found,) = screen(world, cases.altered(launches(), lambda r: with_stone(r, 0.0))).findings
    assert found.kind == "constant"
    assert "stone" in found.message
    exact = cases.recorded(cases.sampling(), cases.bounces(cases.sampling()), 0.0)
    assert kinds(screen(world, cases.altered(exact, lambda r: with_stone(r, 0.0)))) == []
    assert "all runs" in found.message


def test_recordings_without_motion_are_refused_where_constant_and_a_caution_where_noisy() -> None:
    times = cases.sampling(60.0, 1.0)
    still = np.tile([[[0.0, 0.0, cases.RADIUS]], [[0.5, 0.0, cases.RADIUS]]], (1, len(times), 1))
    assert screen(WORLD, cases.recorded(times, still, 0.0)).refused
    noisy = screen(WORLD, cases.recorded(times, still, 1e-3))
    assert not noisy.refused
    assert "at_rest" in kinds(noisy)


def test_a_floor_that_is_too_high_and_a_radius_that_is_too_large_are_cautions() -> None:
    (found,) = screen(cases.ball_world(floor=0.1), launches()).findings
    assert (found.kind, found.severity) == ("penetration", "caution")
    assert "floor" in found.message
    assert 0.0 < cases.numbers(found)[0] < 100.0  # mm
    (found,) = screen(cases.ball_world(radius=1.6 * cases.RADIUS), launches()).findings
    assert found.kind == "penetration"
    assert kinds(screen(cases.ball_world(radius=1.03 * cases.RADIUS), launches())) == []


def test_a_tilted_box_may_reach_deeper_than_half_its_edge_only_as_far_as_its_corners_do() -> None:
    """Boxes that stand on a corner: their centre is higher than half an edge, as orientations show."""
    half = 0.05
    times = cases.sampling(60.0, 1.0)
    box = RigidObject(name="ball", shape=Box(half_extents=(half,) * 3), mass=1.0, position=(0.0, 0.0, 1.0))
    wall = StaticObject(name="block", shape=Box(half_extents=(0.2, 0.2, 0.2)), position=(0.0, 0.0, -0.2))
    world = World(objects=(box,), statics=(*WORLD.statics, wall))
    rng = np.random.default_rng(7)
    x = np.stack([0.5 * times - 0.2, 0.8 * times - 0.4])
    corner = np.array([np.cos(np.pi / 8), np.sin(np.pi / 8), 0.0, 0.0])  # turned by 45 degrees about x
    for height, inside in ((half * np.sqrt(2.0), False), (half, True)):
        paths = np.stack([x, 0.0 * x, np.full_like(x, height)], axis=-1) + 1e-4 * rng.standard_normal((2, 60, 3))
        runs = cases.recorded(times, paths, 0.0)
        turned = cases.altered(runs, lambda r: replace(r, orientations=np.tile(corner, (60, 1, 1))))
        found = [f for f in screen(world, turned).findings if f.kind == "penetration"]
        assert bool(found) is inside
        if inside:
            assert cases.numbers(found[0])[0] == pytest.approx(1e3 * half * (np.sqrt(2.0) - 1.0), rel=0.05)


def test_a_disc_inside_a_wall_of_a_planar_world_is_a_caution_although_its_height_was_not_measured() -> None:
    times = cases.sampling(60.0, 1.0)
    starts = [((0.0, 0.0, 0.0), (1.0 + 0.1 * k, 0.0, 0.0)) for k in range(3)]
    recording = cases.recorded(times, cases.bounces(times, starts, floor=False, gravity=0.0))
    flat = cases.altered(recording, lambda r: replace(r, positions=r.positions * [1.0, 1.0, np.nan]))
    block = StaticObject(name="block", shape=Box(half_extents=(0.1, 0.5, 0.1)), position=(0.6, 0.0, 0.0))
    world = cases.table_world()
    assert "penetration" not in kinds(screen(world, flat))
    found = screen(world.model_copy(update={"statics": (block,)}), flat)
    assert "penetration" in kinds(found)
