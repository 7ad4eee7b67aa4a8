"""Candidates of the observer's faults on thrown balls whose paths are closed formulas."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation.least_squares import Point
from polyworld.estimation.noise import run_noise
from polyworld.gap import GapReport, find_gap
from polyworld.gap.catalogue import catalogue, named
from polyworld.gap.ground import Ground
from polyworld.gap.hypothesis import Hypothesis, Part
from polyworld.gap.report import effects_of
from polyworld.gap.settings import GapSettings
from polyworld.world import StaticObject, TimeBase, World
from polyworld.world.observer import Observer
from polyworld.world.parameters import parameter_paths
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Plane, Sphere, Wall

BY_NAME = {name: c for name, c in catalogue().items() if c.group == "observer"}
RATE = 60.0


def thrown(*statics: StaticObject) -> World:
    ball = RigidObject(name="ball", shape=Sphere(radius=0.05), position=(0.0, 0.0, 2.0))
    return World(objects=(ball,), statics=statics, time=TimeBase(seconds_per_frame=1 / RATE, substep=1 / 240))


def flown(name: str, instants: np.ndarray, speed: tuple[float, float, float], sigma: float, seed: int) -> Run:
    """Return what was seen at stamps of 60 Hz of a ball thrown from (0, 0, 2), at the true instants given."""
    t = instants[:, None]
    place = np.array([0.0, 0.0, 2.0]) + np.array(speed) * t + np.array([0.0, 0.0, -4.905]) * t**2
    place = place + np.random.default_rng(seed).normal(0.0, sigma, place.shape)
    stamps = np.arange(len(instants)) / RATE
    return Run(name, ("ball",), stamps, place[:, None], np.full((len(stamps), 1, 4), np.nan))


def recording(sigma: float = 0.002) -> Recording:
    speeds = ((2.0, 0.5, 3.0), (-1.0, 2.0, 2.0), (3.0, 0.0, 1.0), (1.0, -1.0, 4.0))
    return Recording(tuple(flown(f"r{k}", np.arange(50.0) / RATE, v, sigma, k) for k, v in enumerate(speeds)))


@pytest.mark.parametrize("name", BY_NAME)
def test_a_fault_does_nothing_at_its_start(name: str) -> None:
    floor = StaticObject(name="wall", shape=Wall(start=(9.0, -1.0, 0.0), end=(9.0, 1.0, 0.0)))
    world, data = thrown(floor).model_copy(update={"observer": Observer(view=(0.0, 1.0, 0.0))}), recording()
    data = Recording(tuple(Run(r.name, r.names, r.times, r.positions, r.orientations, lead=0.1) for r in data.runs))
    variants = BY_NAME[name].variants(world, data)
    assert variants
    ground = Ground(world, data, GapSettings(), run_noise(data.runs))
    before = ground.problem(Hypothesis(world))
    for variant in variants:
        assert all(u.lower <= u.start <= u.upper and u.typical > 0.0 for u in variant.unknowns)
        assert {p for u in variant.unknowns for p in u.paths} <= set(parameter_paths(variant.world))
        after = ground.problem(Hypothesis(variant.world, (), (Part(BY_NAME[name], variant),)))
        start = Point(after.start().shared, before.start().states)
        for one, other in zip(before.linearised(before.start(), 1.0), after.linearised(start, 1.0), strict=True):
            np.testing.assert_allclose(one.residuals, other.residuals, atol=1e-9)


def test_tilt_is_offered_about_the_axes_that_show_it() -> None:
    tilt = BY_NAME["observer_tilt"].variants
    floor = StaticObject(name="floor", shape=Plane())
    wall = StaticObject(name="wall", shape=Wall(start=(9.0, -1.0, 0.0), end=(9.0, 1.0, 0.0)))
    data = recording()
    side = Recording(
        tuple(Run(r.name, r.names, r.times, r.positions * [1.0, np.nan, 1.0], r.orientations) for r in data.runs)
    )
    heights = Recording(
        tuple(Run(r.name, r.names, r.times, r.positions * [np.nan, np.nan, 1.0], r.orientations) for r in data.runs)
    )

    def names(world: World, seen: Recording) -> list[list[str]]:
        return [[u.name for u in v.unknowns] for v in tilt(world, seen)]

    assert names(thrown(floor), data) == [["tilt_x", "tilt_y"]]  # about gravity nothing changes
    assert names(thrown(floor, wall), data) == [["tilt_x", "tilt_y", "tilt_z"]]
    assert names(thrown(floor), side) == [["tilt_y"]]
    assert names(thrown(floor), heights) == []
    assert tilt(thrown(), data)[0].same_as == ("tilt",)  # nothing but gravity shows the axes
    assert tilt(thrown(floor), data)[0].same_as == ()


def test_a_time_offset_is_offered_only_where_something_shows_the_beginning() -> None:
    offset = BY_NAME["observer_time_offset"].variants
    data = recording()
    assert offset(thrown(), data) == ()
    later = Recording(tuple(Run(r.name, r.names, r.times, r.positions, r.orientations, lead=0.5) for r in data.runs))
    assert len(offset(thrown(), later)) == 1


def found(data: Recording, *offered: str) -> GapReport:
    return find_gap(thrown(), data, candidates=named(offered))


def test_a_fast_clock_and_a_large_scale_are_recovered_and_reported_with_what_does_the_same() -> None:
    """In free flight either is as good as the other, and as wrong gravity."""
    data = recording(sigma=0.001)
    slow = Recording(tuple(Run(r.name, r.names, 1.05 * r.times, r.positions, r.orientations) for r in data.runs))
    large = Recording(tuple(Run(r.name, r.names, r.times, 1.05 * r.positions, r.orientations) for r in data.runs))
    for name, seen in (("observer_clock", slow), ("observer_scale", large)):
        (effect,) = effects_of(found(seen, name, "gravity_error").verdict.best)
        assert effect["name"] == "gravity_error"
        assert name in effect["same_as"]
        (effect,) = effects_of(found(seen, name, "tilt").verdict.best)
        assert effect["name"] == name
        (unknown,) = effect["unknowns"].values()
        low, high = unknown["interval95"]
        assert low < 1.05 < high < 1.01 * low


def test_a_slanted_camera_is_distinguished_from_wrong_gravity_and_needs_a_plane_of_motion() -> None:
    data = recording(sigma=0.0)
    assert BY_NAME["observer_keystone"].variants(thrown(), data) == ()  # depth was measured
    slant, rng = 0.03, np.random.default_rng(5)
    flat = np.concatenate([run.positions[:, 0, [0, 2]] for run in data.runs])
    middle = flat.mean(axis=0)
    for _ in range(20):  # until the picture slants about its own middle
        seen = slanted(flat, middle, slant)
        middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    runs = []
    for run in data.runs:
        seen = slanted(run.positions[..., [0, 2]], middle, slant) + rng.normal(0.0, 1e-3, (50, 1, 2))
        runs.append(Run(run.name, run.names, run.times, np.insert(seen, 1, np.nan, axis=-1), run.orientations))
    report = found(Recording(tuple(runs)), "observer_keystone", "observer_distortion", "gravity_error", "tilt")
    assert (report.verdict.kind, report.names) == ("identified", ("observer_keystone",))
    values = effects_of(report.verdict.best)[0]["unknowns"]
    assert values["keystone_z"]["value"] == pytest.approx(slant, rel=0.05)
    assert abs(values["keystone_x"]["value"]) < 0.05 * slant


def slanted(places: np.ndarray, middle: np.ndarray, slant: float) -> np.ndarray:
    """Places (..., 2) as a camera shows them that leans by `slant` [1/m] upwards."""
    about = places - middle
    seen: np.ndarray = middle + about / (1.0 + slant * about[..., 1:])
    return seen
