"""Measurements that others made, each as (base world, recording). Tests that need them skip where they are absent.

Sources: ball drops, de Silva, Higdon, Brunton & Kutz, Frontiers in AI 3 (2020) 25, MIT; cube tosses, Pfrommer, Halm &
Posa, ContactNets, CoRL 2020, BSD-3; pendulum, the MultiArm-Pendulum data of the University of Washington (2022), MIT;
CLEVRER annotations, Yi et al., ICLR 2020, CC0.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ellipk

from polyworld.data.recording import Array, Recording, Run
from polyworld.world import StaticObject, TimeBase, World
from polyworld.world.representations.joint import Hinge
from polyworld.world.representations.rigid import RigidObject
from polyworld.world.shapes import Box, Plane, Sphere
from tests.scenes.clevrer_data import HALF_SIZE, SHAPES, Scene, default_world, read_scene

FOLDER = Path(__file__).resolve().parents[1].parent / "shared" / "data"
GRAVITY = 9.81

OUNCE = 0.028349523  # [kg]
# Mass [kg] and circumference [m], as weighed and measured with the drops; of the volleyball, which was not, the middle
# of what the rules of the game allow (FIVB: 260 to 280 g, 0.65 to 0.67 m).
BALLS = {
    "baseball": (5.0 * OUNCE, 0.2225),
    "golf_ball": (1.62 * OUNCE, 0.138),
    "volleyball": (0.270, 0.66),
    "whiffle_ball_1": (1.0 * OUNCE, 0.228),
}
CUBE_UNIT = 0.0524  # [m] half an edge
MOVING = 0.05  # [m/s] below which annotated objects are taken for at rest
STRAIGHT = 1.5e-4  # [m] by which a straight path may seem to bend: annotations are rounded to 1e-4 m
PENDULUM_TOLD = 10.0  # [s] from which the pendulum's length is taken


def needs(name: str) -> pytest.MarkDecorator:
    """Skip a test, with the reason, where `../shared/data/NAME` is absent."""
    return pytest.mark.skipif(not (FOLDER / name).exists(), reason=f"../shared/data/{name} is absent")


def ball_drop(balls: Sequence[str] = tuple(BALLS), *, falling: float = 2.0) -> tuple[World, Recording]:
    """Balls dropped from a bridge, a run for each of two drops `BALL-1`, `BALL-2`: heights alone were measured.

    A world of balls in nothing but gravity. The first samples show the ball in the hand, the last its landing: a run
    begins where the velocity told with the data has reached `falling` [m/s] for good, and ends a sample before the
    last. About 15 Hz; heights are wrong by some 0.1 m, and not at random.
    """
    objects, runs = [], []
    for ball in balls:
        mass, circumference = BALLS[ball]
        shape = Sphere(radius=circumference / (2.0 * np.pi))
        objects.append(RigidObject(name=ball, shape=shape, mass=mass, position=(0.0, 0.0, 50.0)))
        data = np.genfromtxt(FOLDER / "ball_drop" / f"{ball}.csv", delimiter=",", names=True)
        for drop in (1, 2):
            rows = data[data["drop"] == drop]
            first = int(np.flatnonzero(rows["velocity_m_s"] > -falling)[:12].max()) + 1
            rows = rows[first:-1]
            positions = np.full((len(rows), 1, 3), np.nan)
            positions[:, 0, 2] = rows["height_m"]
            runs.append(_run(f"{ball}-{drop}", (ball,), rows["time_s"], positions))
    # Side by side, so that balls that are rolled out together never meet.
    apart = tuple(o.model_copy(update={"position": (2.0 * k, 0.0, 50.0)}) for k, o in enumerate(objects))
    return World(objects=apart, time=TimeBase(seconds_per_frame=1.0 / 15.0, substep=0.005)), Recording(tuple(runs))


def pendulum(*, until: float = 55.0, every: int = 1) -> tuple[World, Recording]:
    """A physical pendulum that swings down freely: one run `swing` of an encoder at 100 Hz, every `every`-th sample.

    The bob is a small ball whose distance from the hinge, along y through the origin, gives the small-amplitude period
    2 pi sqrt(L / g) that the first 10 s tell (of each swing the exact period, with the complete elliptic integral of
    its amplitude: Landau & Lifshitz, Mechanics, par. 11). Its mass, 1 kg, is arbitrary, so that torques are per that
    mass. theta is pi where it hangs. Positions in the plane x, z of the swing; y was not measured.
    """
    with np.load(FOLDER / "pendulum" / "single_freeswing_100Hz.npz") as file:
        times, angle = file["t"].astype(float), file["theta"].astype(float) - np.pi
    length = pendulum_length(times[times <= PENDULUM_TOLD], angle[times <= PENDULUM_TOLD])
    radius = 0.01
    arm = 0.5 * (length + np.sqrt(length**2 - 1.6 * radius**2))  # arm + 0.4 radius^2 / arm = length
    keep = np.flatnonzero(times <= until)[::every]
    place = -arm * np.stack([np.sin(angle[keep]), np.full(len(keep), np.nan), np.cos(angle[keep])], axis=-1)
    start = float(angle[0])
    bob = RigidObject(
        name="bob",
        shape=Sphere(radius=radius),
        mass=1.0,
        position=(-arm * np.sin(start), 0.0, -arm * np.cos(start)),
        orientation=(np.cos(start / 2), 0.0, np.sin(start / 2), 0.0),
    )
    hinge = Hinge(name="hinge", object="bob", anchor=(0.0, 0.0, 0.0), axis=(0.0, 1.0, 0.0))
    world = World(objects=(bob,), joints=(hinge,), time=TimeBase(seconds_per_frame=0.01 * every, substep=0.002))
    return world, Recording((_run("swing", ("bob",), times[keep], place[:, None]),))


def pendulum_swings(begins: Sequence[float], seconds: float, *, every: int = 1) -> tuple[World, Recording]:
    """Stretches of the same swing, each a run `swing_from_B` of its own that begins at B [s] and has its own state.

    Large and small swings side by side, each short enough that no phase is lost.
    """
    world, recording = pendulum(every=every)
    whole = recording.runs[0]
    runs = []
    for begin in begins:
        keep = (whole.times >= begin - 1e-9) & (whole.times <= begin + seconds + 1e-9)
        runs.append(replace(whole.rows(keep), name=f"swing_from_{begin:g}", times=np.arange(keep.sum()) * 0.01 * every))
    return world, Recording(tuple(runs))


def pendulum_length(times: Array, angle: Array) -> float:
    """Length g (T / 4 K(sin A/2))^2 [m] of the equivalent mathematical pendulum: median over swings of period T."""
    up = np.flatnonzero((angle[:-1] < 0.0) & (angle[1:] >= 0.0))
    crossing = times[up] - angle[up] * (times[up + 1] - times[up]) / (angle[up + 1] - angle[up])
    lengths = []
    for k, period in enumerate(np.diff(crossing)):
        swing = angle[up[k] : up[k + 1]]
        amplitude = 0.5 * (swing.max() - swing.min())
        lengths.append(GRAVITY * (period / (4.0 * ellipk(np.sin(0.5 * amplitude) ** 2))) ** 2)
    return float(np.median(lengths))


def cube_toss(tosses: Sequence[int] = tuple(range(8))) -> tuple[World, Recording]:
    """Tosses of an acrylic cube on a table by motion capture at 148 Hz: runs `toss_NNN` with position and orientation.

    Published mass, friction and restitution. The table stands where the lowest corner comes to rest in the median of
    all tosses, some 1.9 mm below the zero of the capture. The published moment of inertia is 1.2 times that of a
    uniform cube, which is the one that the world's cube has.
    """
    told = json.loads((FOLDER / "cube_toss" / "experiment.json").read_text())
    runs, lowest = [], []
    corners = np.array(told["vertices"], dtype=float)
    with np.load(FOLDER / "cube_toss" / "cube_tosses.npz") as file:
        for name in file.files:
            last = file[name][-1].astype(float)
            lowest.append(CUBE_UNIT * float((last[2] + corners @ _third_row(last[3:7])).min()))
        for k in tosses:
            rows = file[f"toss_{k:03d}"].astype(float)
            turn = rows[:, 3:7] / np.linalg.norm(rows[:, 3:7], axis=1, keepdims=True)
            times = np.arange(len(rows)) * told["dt"]
            runs.append(_run(f"toss_{k:03d}", ("cube",), times, CUBE_UNIT * rows[:, None, :3], turn[:, None]))
    cube = RigidObject(
        name="cube",
        shape=Box(half_extents=(CUBE_UNIT,) * 3),
        mass=told["mass"],
        friction=told["mu"],
        restitution=told["restitution"],
        position=(0.0, 0.0, 1.0),
    )
    table = StaticObject(name="table", shape=Plane(), position=(0.0, 0.0, float(np.median(lowest))))
    world = World(
        objects=(cube,), statics=(table,), time=TimeBase(seconds_per_frame=told["dt"], substep=told["dt"] / 4)
    )
    return world, Recording(tuple(runs))


def cube_flight(tosses: Sequence[int] = tuple(range(12))) -> tuple[World, Recording]:
    """The same tosses before the cube first touches the table, which this world has not: 12 to 22 samples each.

    A run ends two samples before the lowest corner first comes within 4 mm of the table.
    """
    world, recording = cube_toss(tosses)
    corners = np.array(json.loads((FOLDER / "cube_toss" / "experiment.json").read_text())["vertices"], dtype=float)
    runs = []
    for run in recording.runs:
        turned = np.array([(corners @ _third_row(q)).min() for q in run.orientations[:, 0]])
        gap = run.positions[:, 0, 2] + CUBE_UNIT * turned - world.statics[0].position[2]
        first = int(np.flatnonzero(gap < 0.004)[0])
        runs.append(run.rows(np.arange(len(run.times)) < first - 1))
    return world.model_copy(update={"statics": ()}), Recording(tuple(runs))


def _third_row(quaternion: Array) -> Array:
    """What of body coordinates adds to the height."""
    w, x, y, z = quaternion / np.linalg.norm(quaternion)
    return np.array([2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)])


def clevrer(numbers: Sequence[str] = ("00000",)) -> tuple[World, Recording]:
    """Annotated CLEVRER scenes, a run `scene_NNNNN` each, 128 frames of 0.028 s: positions, and orientations of cubes.

    A planar world of all objects, in which each keeps the velocity and spin annotated at frame 0 and Coulomb friction
    is the only resistance. Objects are called after colour, material and shape; where two scenes have one of the same
    name it is taken for the same object. Annotations are rounded to 1e-4 m.
    """
    folder = FOLDER / "clevrer"
    scenes = [read_scene(folder, number) for number in numbers]
    objects: dict[str, RigidObject] = {}
    runs = []
    for scene in scenes:
        for item in default_world(scene.tracks, scene.kinds, air=False).objects:
            objects.setdefault(item.name, _started(item, scene, folder))
        runs.append(Run.of_tracks(f"scene_{scene.number}", scene.tracks))
    time = TimeBase(seconds_per_frame=0.028, frame_count=len(scenes[0].tracks.frames), substep=0.007)
    return World(objects=tuple(objects.values()), time=time), Recording(tuple(runs))


def clevrer_slides(numbers: Sequence[str], *, least: int = 16, speed: float = 0.3) -> tuple[World, Recording]:
    """Annotated objects between their collisions: a run `SCENE_OBJECT_FRAME` for every such stretch of `least` frames
    that begins with at least `speed` [m/s] and whose path bends by no more than 0.15 mm. What bends spins, or touches
    something still: of both this world knows nothing.

    All cubes are called cube, all cylinders cylinder, all balls sphere: one law each. Coulomb friction, of the same
    unknown coefficient, is all that slows cubes and cylinders down; balls roll.
    """
    folder = FOLDER / "clevrer"
    runs = []
    for number in numbers:
        scene = read_scene(folder, number)
        tracks = scene.tracks
        for column, name in enumerate(tracks.names):
            met = sorted(c.frame for c in scene.collisions if name in c.pair)
            for begin, end in pairwise([-3, *met, int(tracks.frames[-1]) + 4]):
                keep = (tracks.frames > begin + 2) & (tracks.frames < end - 2)
                keep &= np.hypot(*(np.gradient(tracks.positions[:, column, :2], 0.028, axis=0).T)) > MOVING
                if keep.sum() < least:
                    continue
                places = tracks.positions[keep, column].copy()
                if np.linalg.norm(places[4, :2] - places[0, :2]) < 4 * 0.028 * speed or _bend(places) > STRAIGHT:
                    continue
                times = (tracks.frames[keep] - tracks.frames[keep][0]) * 0.028
                kind = scene.kinds[name][2]
                turned = tracks.orientations[keep, column] if kind == "cube" else None  # of round things it is not seen
                turns = None if turned is None else turned[:, None]
                runs.append(_run(f"{number}_{name}_{max(begin, 0)}", (kind,), times, places[:, None], turns))
    kinds = [k for k in SHAPES if any(k in r.names for r in runs)]
    objects = tuple(
        RigidObject(
            name=kind,
            representation="rigid_planar",
            shape=SHAPES[kind],
            mass=1.0,
            friction=0.0 if kind == "sphere" else 0.03,
            position=(2.0 * k, 0.0, HALF_SIZE),
        )
        for k, kind in enumerate(kinds)
    )
    return World(objects=objects, time=TimeBase(seconds_per_frame=0.028, substep=0.007)), Recording(tuple(runs))


def _bend(places: Array) -> float:
    """Largest distance [m] on the plane of places (T, 3) from the line between the first and the last."""
    along = places[-1, :2] - places[0, :2]
    across = np.array([-along[1], along[0]]) / np.linalg.norm(along)
    return float(np.abs((places[:, :2] - places[0, :2]) @ across).max())


def _started(item: RigidObject, scene: Scene, folder: Path) -> RigidObject:
    """The object as annotated at the scene's first frame."""
    data = json.loads((folder / f"annotation_{scene.number}.json").read_text())
    column = scene.tracks.index(item.name)
    first = min(data["motion_trajectory"], key=lambda frame: frame["frame_id"])
    identifier = sorted(o["object_id"] for o in data["object_property"])[column]
    state = next(o for o in first["objects"] if o["object_id"] == identifier)
    place = scene.tracks.positions[0, column]
    return item.model_copy(
        update={
            "position": (float(place[0]), float(place[1]), item.position[2]),
            "orientation": tuple(float(q) for q in scene.tracks.orientations[0, column]),
            "velocity": (float(state["velocity"][0]), float(state["velocity"][1]), 0.0),
            "angular_velocity": (0.0, 0.0, float(state["angular_velocity"][2])),
        }
    )


def _run(name: str, names: tuple[str, ...], times: Array, places: Array, turns: Array | None = None) -> Run:
    unknown = np.full((*places.shape[:2], 4), np.nan)
    return Run(name, names, np.asarray(times, dtype=float), places, unknown if turns is None else turns)
