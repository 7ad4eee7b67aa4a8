"""Candidates of the observer's faults on thrown balls whose paths are closed formulas."""

from __future__ import annotations

import numpy as np
import pytest

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.fit_context import FitContext
from polyworld.estimation.forward import Forward, Settings
from polyworld.estimation.hypothesis import Hypothesis, extended
from polyworld.estimation.noise import measured_noise
from polyworld.estimation.profile import start_states
from polyworld.gap.catalogue import catalogue
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


def recording(dropped: int = 0, after: int = 30, sigma: float = 0.002) -> Recording:
    frames = np.arange(50.0)
    wrong = np.where(frames >= after, np.maximum(frames + dropped, after - 1), frames)
    speeds = ((2.0, 0.5, 3.0), (-1.0, 2.0, 2.0), (3.0, 0.0, 1.0))
    runs = [flown(f"r{k}", (wrong if k == 1 else frames) / RATE, v, sigma, k) for k, v in enumerate(speeds)]
    return Recording(tuple(runs))


@pytest.mark.parametrize("name", BY_NAME)
def test_a_fault_does_nothing_at_its_start(name: str) -> None:
    floor = StaticObject(name="wall", shape=Wall(start=(9.0, -1.0, 0.0), end=(9.0, 1.0, 0.0)))
    world, data = thrown(floor).model_copy(update={"observer": Observer(view=(0.0, 1.0, 0.0))}), recording()
    data = Recording(tuple(Run(r.name, r.names, r.times, r.positions, r.orientations, lead=0.1) for r in data.runs))
    variants = BY_NAME[name].variants(world, data)
    assert variants
    plan = design(world, data)
    states = start_states(plan)
    for variant in variants:
        assert all(u.lower <= u.start <= u.upper and u.typical > 0.0 for u in variant.unknowns)
        assert {p for u in variant.unknowns for p in u.paths} <= set(parameter_paths(variant.world))
        starts = np.array([[u.start for u in variant.unknowns]])
        for run in range(len(data.runs)):
            before = Forward(plan, world, ()).residuals([Settings(run, np.zeros((1, 0)), states[run][None])])
            after = Forward(plan, variant.world, variant.unknowns).residuals([Settings(run, starts, states[run][None])])
            assert np.abs(before[0] - after[0]).max() < 1e-12


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


@pytest.mark.parametrize(("dropped", "sigma"), [(3, 0.002), (-2, 0.002), (4, 0.02)])
def test_dropped_and_repeated_frames_are_found_to_the_frame(dropped: int, sigma: float) -> None:
    world, data = thrown(), recording(dropped, 30, sigma)
    candidate = BY_NAME["dropped_frames"]
    plan = design(world, data)
    context = FitContext(plan, measured_noise(plan), 1)
    base = Hypothesis(world, ())
    ground = context.fit(base, np.zeros(0), start_states(plan))
    ways = extended(base, candidate, data)
    assert [h.parts[-1].variant.label for h in ways] == ["in run r0", "in run r1", "in run r2"]
    assert candidate.score_test is not None
    found = candidate.score_test(context, ground, ways, 2)
    assert found[0].hypothesis is ways[1]
    assert abs(found[0].values[1] - 29.5 / RATE) <= 1.5 / RATE
    trial = context.fit(ways[1], found[0].values, ground.fit.states)
    assert trial.chi2 < 0.5 * ground.chi2
    sd = np.sqrt(np.diag(trial.fit.covariance))
    assert abs(trial.values[0] - dropped / RATE) < max(4.0 * sd[0], 1e-4)
    assert abs(trial.values[1] - 29.5 / RATE) < 1.0 / RATE


def test_scale_and_clock_are_recovered_from_free_flight() -> None:
    data = recording(0, 30, 0.001)
    slow = Recording(tuple(Run(r.name, r.names, 1.05 * r.times, r.positions, r.orientations) for r in data.runs))
    large = Recording(tuple(Run(r.name, r.names, r.times, 1.05 * r.positions, r.orientations) for r in data.runs))
    for name, seen in (("observer_clock", slow), ("observer_scale", large)):
        plan = design(thrown(), seen)
        context = FitContext(plan, measured_noise(plan), 1)
        (way,) = extended(Hypothesis(thrown(), ()), BY_NAME[name], seen)
        trial = context.fit(way, np.array([1.0]), start_states(plan))
        assert trial.values[0] == pytest.approx(1.05, abs=4.0 * float(np.sqrt(trial.fit.covariance[0, 0])))
        assert way.parts[0].variant.same_as  # in free flight either is as good as the other, and as wrong gravity


def test_a_slanted_camera_is_distinguished_from_wrong_gravity_and_needs_a_plane_of_motion() -> None:
    world, data = thrown(), recording(0, 30, 0.0)
    candidate = BY_NAME["observer_keystone"]
    assert candidate.variants(world, data) == ()  # depth was measured
    slant = 0.03
    low, high = (f([run.positions[:, 0, [0, 2]] for run in data.runs]) for f in (_least, _most))
    middle = 0.5 * (low + high)
    rng = np.random.default_rng(5)
    runs = []
    for run in data.runs:
        about = run.positions[..., [0, 2]] - middle
        flat = middle + about / (1.0 + slant * about[..., 1:]) + rng.normal(0.0, 1e-3, about.shape)
        places = np.insert(flat, 1, np.nan, axis=-1)
        runs.append(Run(run.name, run.names, run.times, places, run.orientations))
    seen = Recording(tuple(runs))
    plan = design(world, seen)
    context = FitContext(plan, measured_noise(plan), 1)
    (way,) = extended(Hypothesis(world, ()), candidate, seen)
    trial = context.fit(way, np.zeros(2), start_states(plan))
    assert [u.name for u in way.unknowns] == ["keystone_x", "keystone_z"]
    sd = np.sqrt(np.diag(trial.fit.covariance))
    # The middle of what was seen is not quite that of what was there, and the scale right at another height.
    assert trial.values[1] == pytest.approx(slant, abs=4.0 * sd[1] + 0.05 * slant)
    assert abs(trial.values[0]) < 4.0 * sd[0] + 0.05 * slant
    (scaled,) = extended(Hypothesis(world, ()), BY_NAME["observer_scale"], seen)
    assert trial.chi2 < 0.2 * context.fit(scaled, np.ones(1), start_states(plan)).chi2


def _least(places: list[np.ndarray]) -> np.ndarray:
    return np.min([p.min(axis=0) for p in places], axis=0)


def _most(places: list[np.ndarray]) -> np.ndarray:
    return np.max([p.max(axis=0) for p in places], axis=0)
