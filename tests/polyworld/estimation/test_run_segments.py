"""Long runs in parts: where they are cut, when they are not, and that the law found in the parts is the run's."""

from dataclasses import replace

import numpy as np

from polyworld.data.recording import Recording, Run
from polyworld.estimation.design import design
from polyworld.estimation.run_segments import MOST, in_segments
from polyworld.gap import GapSettings, find_gap
from polyworld.gap.catalogue import named
from polyworld.gap.cautions import cautions
from polyworld.gap.single_coordinate import is_single_coordinate
from polyworld.solver.rollout import simulator
from polyworld.world import Environment, World
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Sphere
from tests.polyworld.gap_scenes import RADIUS, Bouncing, G, Launch, ball_recording, ball_world, puck_world

DRAG = 0.12  # [1/s]
SIGMA = 0.001
TABLE = puck_world(friction=0.0)
DRAGGED = {"name": "drag", "kind": "linear_drag", "parameters": {"coefficient": TABLE.objects[0].mass * DRAG}}


def slide(count: int, axes: int = 2, seed: int = 2) -> Recording:
    """One run of a puck that air slows in proportion to its speed: x = x0 + v0 (1 - exp(-c t)) / c."""
    times = np.arange(count) / 200.0
    way = np.array([[1.0, 2.0], [1.5, -0.7]])
    places = np.full((count, 1, 3), np.nan)
    clear = way[0] + way[1] * ((1.0 - np.exp(-DRAG * times)) / DRAG)[:, None]
    places[:, 0, :axes] = (clear + np.random.default_rng(seed).normal(0.0, SIGMA, clear.shape))[:, :axes]
    return Recording((Run("slide", ("puck",), times, places, np.full((count, 1, 4), np.nan)),))


def test_parts_follow_each_other_and_do_not_begin_at_an_impact() -> None:
    rng = np.random.default_rng(5)
    fall = 9.012 / 17.0  # [s]: the ninth impact comes just behind the middle of the run, where a part would begin
    height = RADIUS + 0.5 * G * fall**2
    launch = Launch(np.array([0.0, 0.0, height]), np.array([0.4, 0.2, 0.0]))
    elastic = Bouncing(after=lambda speed, along: (speed, along))
    recording = ball_recording(elastic, [launch], rng, 1e-6, duration=18.0, rate=120.0)
    (run,), parts = recording.runs, in_segments(recording, ball_world()).runs
    assert len(parts) > 3
    assert max(len(p.times) for p in parts) < MOST
    np.testing.assert_array_equal(np.concatenate([p.times for p in parts]), run.times)
    np.testing.assert_array_equal(np.concatenate([p.positions for p in parts]), run.positions)
    assert {p.part_of for p in parts} == {run.name}
    for part in parts[1:]:
        rising = np.diff(part.positions[:4, 0, 2]) / np.diff(part.times[:4])
        assert np.all(np.diff(rising) < 1.0)  # a rebound would add at least its own speed


def test_parts_have_names_of_their_own_whatever_the_clock_reads() -> None:
    (run,) = slide(2 * MOST).runs
    parts = in_segments(Recording((replace(run, times=run.times + 1.7e9),)), TABLE).runs
    assert len({part.name for part in parts}) == 4


def test_a_run_that_is_not_long_or_cannot_begin_anywhere_stays_whole() -> None:
    assert in_segments(slide(MOST), TABLE).runs[0].part_of is None
    long = slide(2 * MOST)
    assert len(in_segments(long, TABLE).runs) == 4
    document = TABLE.model_dump()
    other = {**document["objects"][0], "name": "other", "position": [5.0, 5.0, 0.01]}
    unobserved = World.model_validate({**document, "objects": [document["objects"][0], other]})
    assert in_segments(long, unobserved) is long  # where the other is in the middle of the run, nobody knows
    assert in_segments(long, TABLE, unobserved) is long  # both are asked of the same runs, or of none
    slipped = World.model_validate({**document, "observer": {"shift": 0.1, "shift_time": 3.0}})
    assert in_segments(long, slipped) is long
    led = Recording((replace(long.runs[0], lead=0.5),))
    assert in_segments(led, TABLE) is led


def test_a_long_run_gets_the_law_of_its_drag_and_is_reported_to_be_in_segments() -> None:
    report = find_gap(
        TABLE,
        slide(1600),
        held_out=slide(2400, seed=3),
        candidates=named(["linear_drag", "quadratic_drag", "tilt"]),
        settings=GapSettings(null_control=False),
    )
    summary = report.to_dict()
    assert summary["verdict"] == "identified"
    (effect,) = summary["effects"]
    assert effect["name"] == "linear_drag"
    true = TABLE.objects[0].mass * DRAG
    low, high = effect["unknowns"]["coefficient"]["interval95"]
    assert low < true < high
    assert high - low < 0.1 * true
    assert summary["sealed"]["closed"] > 0.95
    (said,) = [c for c in summary["cautions"] if "parts" in c]
    assert said.startswith("run slide is long: it was fitted in 3 parts of")


def test_parts_of_one_coordinate_are_still_one_course() -> None:
    one, two = (in_segments(slide(2 * MOST, axes), TABLE) for axes in (1, 2))
    assert is_single_coordinate(design(TABLE, one))
    assert not is_single_coordinate(design(TABLE, two))


def test_frames_dropped_in_a_long_run_are_reported_by_the_run_and_its_clock() -> None:
    (run,) = slide(2 * MOST).runs
    keep = np.arange(len(run.times))
    keep = keep[(keep < 1400) | (keep >= 1408)]  # 8 frames are gone, unnoticed: later stamps are too early
    gone = replace(run.rows(np.isin(np.arange(len(run.times)), keep)), times=run.times[: len(keep)])
    report = find_gap(
        World.model_validate({**TABLE.model_dump(), "effects": [DRAGGED]}),
        Recording((gone,)),
        candidates=named(["dropped_frames", "linear_drag", "tilt"]),
        settings=GapSettings(null_control=False),
    )
    assert report.names == ("dropped_frames",)
    assert report.world is not None
    seen = report.world.observer
    assert seen is not None
    assert seen.shift_run == "slide"
    assert abs(seen.shift - 8 / 200.0) < 0.005
    assert abs(seen.shift_time - 1400 / 200.0) < 0.05


def test_swings_on_each_other_are_cut_where_they_are_chaotic() -> None:
    """Two bobs, 3 s: from 0.1 rad they swing in two modes, from 2 rad each tumbles over."""
    arm = 0.2

    def swung(first: float, second: float, count: int = 300, rate: float = 100.0) -> Recording:
        elbow = arm * np.array([np.sin(first), 0.0, -np.cos(first)])
        tip = elbow + arm * np.array([np.sin(second), 0.0, -np.cos(second)])
        times = np.arange(count) / rate
        places = simulator(hung(elbow, tip), times).run().positions[0]
        return Recording((Run("swing", ("a", "b"), times, places, np.full((count, 2, 4), np.nan)),))

    def hung(elbow: np.ndarray, tip: np.ndarray) -> World:
        return World(
            objects=tuple(
                RigidObject(name=name, shape=Sphere(radius=0.01), mass=0.2, position=tuple(map(float, place)))
                for name, place in (("a", elbow), ("b", tip))
            ),
            joints=(
                Hinge(name="top", object="a", anchor=(0, 0, 0), axis=(0, 1, 0)),
                Hinge(name="elbow", object="b", other="a", anchor=tuple(map(float, elbow)), axis=(0, 1, 0)),
            ),
            environment=Environment(gravity=(0, 0, -G)),
        )

    world = hung(np.array([0, 0, -arm]), np.array([0, 0, -2 * arm]))
    assert len(in_segments(swung(0.1, 0.05), world).runs) == 1
    wild = in_segments(swung(2.0, 2.5), world)
    assert len(wild.runs) >= 3
    np.testing.assert_array_equal(np.concatenate([r.times for r in wild.runs]), np.arange(300) / 100.0)
    assert any("too chaotic" in c for c in cautions(design(world, wild)))
    (run,) = swung(2.0, 2.5, count=201, rate=20.0).runs
    for seen in (25, 28, 30):  # out of view before the first cut
        places = np.where(np.arange(201)[:, None, None] < seen, run.positions, np.nan)
        assert len(in_segments(Recording((replace(run, positions=places),)), world).runs) == 1
