"""Measurements that nobody here made, of `../shared/data`: its README says what each is and what is known of it."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from polyworld.data.recording import Recording
from polyworld.data.recording_csv import read_recording
from polyworld.estimation.unknown import Unknown
from polyworld.world import World
from tests import real_data
from tests.benchmarks.gaps.case import Case, Names

ANNOTATED = 1e-4  # [m] last digit of the CLEVRER annotations: what is taken for their accuracy
PHONE = {"name": "phone", "shape": {"kind": "box", "half_extents": [0.035, 0.07, 0.004]}, "mass": 0.165}
TENNIS = {"name": "ball", "shape": {"kind": "sphere", "radius": 0.02}, "mass": 0.0027, "position": [0, 0, 0.3]}
# One law of one coordinate, or of a body that slides on a level plane.
ALIKE = {"viscous_friction": "linear_drag", "joint_damping": "linear_drag"}


@dataclass(frozen=True)
class Measured:
    """Data of a set. base: unknowns that every hypothesis fits."""

    world: World
    recording: Recording
    held_out: Recording | None = None
    base: tuple[Unknown, ...] = ()


def drops(balls: Sequence[str] = tuple(real_data.BALLS)) -> Measured:
    """First drops of each ball; the second ones are held out."""
    world, recording = real_data.ball_drop(balls)
    first = tuple(r.name for r in recording.runs if r.name.endswith("-1"))
    second = tuple(r.name for r in recording.runs if r.name.endswith("-2"))
    return Measured(world, recording.select(first), recording.select(second))


def swings() -> Measured:
    """Large, middle and small swings of 1.2 s at 50 Hz; the held-out ones lie between them and after."""
    world, recording = real_data.pendulum_swings((1.0, 10.0, 24.0), 1.2, every=2)
    _, held_out = real_data.pendulum_swings((5.0, 17.0, 35.0), 1.2, every=2)
    return Measured(world, recording, held_out)


def slides() -> Measured:
    """Every third stretch between collisions in six scenes; every third other one is held out. Friction is fitted.

    Paths are right to one unit of their last digit: sliding cubes bend by as much, which no law of this world does.
    """
    numbers = ("00000", "02000", "03000", "04000", "05000", "06000")
    world, recording = real_data.clevrer_slides(numbers)
    names = [r.name for r in recording.runs]
    paths = ("objects.cube.friction", "objects.cylinder.friction")
    friction = Unknown("friction", paths, "1", 0.03, 0.0, 0.5, 0.01)
    recording = accurate_to(recording, ANNOTATED)
    return Measured(world, recording.select(tuple(names[::3])), recording.select(tuple(names[1::3])), (friction,))


def flights() -> Measured:
    """Twelve tosses of 150 up to the first touch; six others are held out."""
    world, recording = real_data.cube_flight(tuple(range(0, 60, 5)))
    _, held_out = real_data.cube_flight(tuple(range(2, 60, 10)))
    return Measured(world, recording, held_out)


def flown_heights() -> Measured:
    """Heights alone of the same flights, as accurate as forty more tosses say."""
    flown = flights()
    assert flown.held_out is not None
    accuracy = horizontal_accuracy(real_data.cube_flight(tuple(range(60, 100)))[1])
    seen, held_out = (accurate_to(heights(r), accuracy) for r in (flown.recording, flown.held_out))
    return Measured(flown.world, seen, held_out)


def table_of(file: str, body: dict[str, object] | None = None, rate: float = 1.0) -> Measured:
    """Return the runs of a table with the world beside it, or of one body that flies freely."""
    if body is None:
        stem = file.replace("oscillator", "world") if "air" in file else f"{file}_world"
        world = World.model_validate_json((real_data.FOLDER / f"{stem}.json").read_text())
    else:
        world = World.model_validate({"objects": [body], "time": {"seconds_per_frame": 1.0 / rate}})
    return Measured(world, read_recording(real_data.FOLDER / f"{file}.csv", world=world))


def accurate_to(recording: Recording, sigma: float) -> Recording:
    """Return the same recording, which states the accuracy [m] of its positions."""
    return Recording(tuple(replace(run, sigma=sigma) for run in recording.runs))


def heights(recording: Recording) -> Recording:
    """Return the same recording, had nothing but z been measured."""
    runs = []
    for run in recording.runs:
        positions = run.positions.copy()
        positions[..., :2] = np.nan
        runs.append(replace(run, positions=positions, orientations=np.full_like(run.orientations, np.nan)))
    return Recording(tuple(runs))


def horizontal_accuracy(recording: Recording) -> float:
    """Return the RMS [m] of what the horizontal components of free flights, on which no force acts, are off
    straight lines. Errors of a capture are smooth, and larger than the scatter from one sample to the next."""
    squares, count = 0.0, 0
    for run in recording.runs:
        line = np.vander(run.times - run.times.mean(), 2)
        for axis in (0, 1):
            places = run.positions[:, 0, axis]
            off = places - line @ np.linalg.lstsq(line, places)[0]
            squares, count = squares + float(off @ off), count + len(places) - 2
    return float(np.sqrt(squares / count))


DRAG, LINEAR, LIFT, WALL = "quadratic_drag", "linear_drag", "magnus_lift", "hidden_wall"
ARC = (DRAG, f"{DRAG}+{LIFT}")
BOUNCES = (f"{DRAG}+{WALL}", f"{DRAG}+{WALL}+{LIFT}")
_flight = partial(table_of, body=TENNIS, rate=143.0)
_phone = partial(table_of, body=PHONE | {"position": [0, 0, 2]}, rate=200.0)
# How each set is read, and the answers that would do; none where no law of the catalogue would.
SETS: Mapping[str, tuple[Callable[[], Measured], tuple[str, ...]]] = {
    "tt16": (partial(_flight, "flights/tt16"), BOUNCES),
    "tt16arc": (partial(_flight, "flights/tt16arc"), ARC),
    "tt8spin": (partial(_flight, "flights/tt8spin"), (*ARC, *BOUNCES)),
    "tt8spinarc": (partial(_flight, "flights/tt8spinarc"), ARC),
    "ttg8spin": (partial(_flight, "flights/ttg8spin"), ARC),
    "ttb8": (partial(_flight, "flights/ttb8"), BOUNCES),
    "balls": (drops, (DRAG,)),  # C_d of 0.3 to 0.7
    "ball_golf": (partial(drops, ("golf_ball",)), (DRAG,)),  # a single drop: too little to decide
    "air": (partial(table_of, "air_track/oscillator"), (LINEAR, f"{LINEAR}+stiffness_error")),  # 1.24 N/m is rounded
    "phone": (partial(_phone, "phone_fall/ten_falls"), (DRAG,)),
    "pendulum": (swings, (LINEAR, DRAG)),  # the authors: viscous, 0.055 1/s; windows of 1.2 s hardly tell
    # The zero of its angle is not known, and a wrong one looks like a tilt.
    "lipson": (
        partial(table_of, "pendulum/schmidt_lipson"),
        (f"length_error+{LINEAR}", f"length_error+{DRAG}", f"length_error+{LINEAR}+tilt", f"length_error+{DRAG}+tilt"),
    ),
    "cube": (flights, ()),  # flights bend sideways by 0.14 m/s^2, each its own way
    "cube_heights": (flown_heights, ("gravity_error", "observer_scale", "observer_clock")),  # 9.61 m/s^2
    "clevrer": (slides, (LINEAR, DRAG, f"{LINEAR}+{DRAG}")),  # dv/dt = -0.04 v - 0.04 |v| v beside Coulomb friction
}


def listed() -> list[str]:
    """Return the sets."""
    return list(SETS)


def drawn(index: int, level: None, seed: int) -> Case:  # noqa: ARG001  (as of sets whose noise is chosen)
    """Return a set; it has the noise that it has."""
    name, (read, answers) = list(SETS.items())[index]
    m = read()
    truths = tuple(Names(a.split("+")) for a in answers)
    outside = not truths
    return Case(name, m.world, m.recording, truths, outside, None, m.held_out, m.base, alike=ALIKE)
