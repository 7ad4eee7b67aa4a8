"""Scenes of CLEVRER's kind: cubes, cylinders and balls of half size 0.2 m on a plane, simulated by MuJoCo."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import mujoco
import numpy as np
from numpy.random import Generator
from numpy.typing import NDArray

from .camera import in_view

Floats = NDArray[np.float64]

FRAME = 0.028  # s between frames, as in CLEVRER
STEPS = 14  # of 2 ms
HALF = 0.2  # m
APART = 10  # frames: touches of a pair closer together are one collision, as in CLEVRER's annotations
RGB = {
    "gray": (0.3, 0.3, 0.3),
    "red": (0.68, 0.12, 0.12),
    "blue": (0.13, 0.26, 0.84),
    "green": (0.1, 0.45, 0.1),
    "brown": (0.5, 0.28, 0.1),
    "purple": (0.5, 0.15, 0.7),
    "cyan": (0.14, 0.8, 0.8),
    "yellow": (0.9, 0.85, 0.15),
}


@dataclass(frozen=True)
class Solid:
    """One object; mass [kg], friction on the floor (of a ball: rolling resistance [m]), state at frame 0 [m, m/s]."""

    color: str
    material: str
    shape: str
    mass: float
    friction: float
    place: tuple[float, float]
    velocity: tuple[float, float]
    angle: float

    @property
    def name(self) -> str:
        """Colour, material and shape, as questions name it."""
        return f"{self.color} {self.material} {self.shape}"


@dataclass(frozen=True)
class Collision:
    """Indices of a pair in ascending order and the frame at which the first touch falls."""

    pair: tuple[int, int]
    frame: int


@dataclass(frozen=True)
class Run:
    """States by frame and object: places (T, n, 3) [m], quaternions wxyz, velocities and spins; visible (T, n)."""

    places: Floats
    quaternions: Floats
    velocities: Floats
    spins: Floats
    visible: NDArray[np.bool_]
    collisions: tuple[Collision, ...]
    states: Floats


def draw(rng: Generator) -> tuple[list[Solid], float]:
    """Draw four or five objects of different colours, two of which or more move, and the restitution among them."""
    count = int(rng.integers(4, 6))
    kinds: list[tuple[str, str, str]] = []
    while len(kinds) < count:
        kind = (
            str(rng.choice(list(RGB))),
            str(rng.choice(["metal", "rubber"])),
            str(rng.choice(["cube", "cylinder", "sphere"])),
        )
        if kind[0] not in {k[0] for k in kinds}:
            kinds.append(kind)
    places: list[Floats] = []
    entering = rng.random(count) < 0.35
    while len(places) < count:
        k = len(places)
        if entering[k]:  # from the left or right, out of view
            place = np.array([rng.uniform(-2.5, 1.5), rng.choice([-1, 1]) * rng.uniform(3.6, 4.6)])
        else:
            place = np.array([rng.uniform(-2.5, 1.2), rng.uniform(-1.6, 1.6)])
        if all(np.linalg.norm(place - p) > 0.9 for p in places):
            places.append(place)
    moving = entering | (rng.random(count) < 0.5)
    moving[rng.choice(count, 2, replace=False)] = True
    solids = []
    for k, (color, material, shape) in enumerate(kinds):
        velocity = np.zeros(2)
        if moving[k]:
            goal = places[int(rng.choice([j for j in range(count) if j != k]))] + rng.normal(0, 0.15, 2)
            way = (goal - places[k]) / np.linalg.norm(goal - places[k])
            velocity = way * rng.uniform(1.3, 2.6) * (1.15 if entering[k] else 1.0)
        friction = rng.uniform(0.003, 0.008) if shape == "sphere" else rng.uniform(0.02, 0.05)
        solids.append(
            Solid(
                color,
                material,
                shape,
                float(rng.uniform(0.8, 1.25)),
                float(friction),
                (float(places[k][0]), float(places[k][1])),
                (float(velocity[0]), float(velocity[1])),
                float(rng.uniform(0, np.pi / 2)),
            )
        )
    return solids, float(rng.uniform(0.45, 0.75))


def model_text(solids: list[Solid], restitution: float, extra: str = "") -> str:
    """Return the scene's MJCF; `extra` goes before the world (looks)."""
    sizes = {"cube": f'type="box" size="{HALF} {HALF} {HALF}"', "sphere": f'type="sphere" size="{HALF}"'}
    sizes["cylinder"] = f'type="cylinder" size="{HALF} {HALF}"'
    bodies, pairs = "", ""
    for k, s in enumerate(solids):
        bodies += (
            f'<body name="{k}" pos="{s.place[0]} {s.place[1]} {HALF}" euler="0 0 {s.angle}"><freejoint/>'
            f'<geom name="{k}" {sizes[s.shape]} mass="{s.mass}" material="{s.color} {s.material}" '
            'contype="0" conaffinity="0"/></body>'
        )
        slide, roll = (0.5, s.friction) if s.shape == "sphere" else (s.friction, 1e-6)
        pairs += (
            f'<pair geom1="{k}" geom2="floor" condim="6" friction="{slide} {slide} 0.004 {roll} {roll}" '
            'solref="0.01 1"/>'
        )
    # A damped spring of ratio z returns a share exp(-pi z / sqrt(1 - z^2)) of the speed.
    log = np.log(restitution)
    ratio = float(-log / np.hypot(np.pi, log))
    for a, b in combinations(range(len(solids)), 2):
        pairs += (
            f'<pair geom1="{a}" geom2="{b}" condim="3" friction="0.1 0.1" solref="0.02 {ratio}" '
            'solimp="0.95 0.99 0.001"/>'
        )
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{FRAME / STEPS}" cone="elliptic" impratio="5" '
        f'integrator="implicitfast"/>{extra}<worldbody><geom name="floor" type="plane" size="30 30 1" '
        f'material="floor" contype="0" conaffinity="0"/>{bodies}</worldbody><contact>{pairs}</contact></mujoco>'
    )


PLAIN = "<asset>{}</asset>".format(
    "".join(f'<material name="{c} {m}"/>' for c in RGB for m in ("metal", "rubber")) + '<material name="floor"/>'
)


def simulate(solids: list[Solid], restitution: float, frames: int) -> Run:
    """Simulate; collisions are first touches of pairs, repetitions within `APART` frames counted once."""
    model = mujoco.MjModel.from_xml_string(model_text(solids, restitution, PLAIN))
    data = mujoco.MjData(model)
    for k, s in enumerate(solids):
        data.qvel[6 * k : 6 * k + 2] = s.velocity
        if s.shape == "sphere":  # rolls from the start
            data.qvel[6 * k + 3 : 6 * k + 6] = _in_body(data.qpos[7 * k + 3 : 7 * k + 7], s.velocity)
    floor = int(model.geom("floor").id)  # the first geom; those of the objects follow in order
    latest: dict[tuple[int, int], float] = {}
    collisions: list[Collision] = []
    states = np.zeros((frames, model.nq))
    speeds = np.zeros((frames, model.nv))
    for frame in range(frames):
        states[frame], speeds[frame] = data.qpos, data.qvel
        for step in range(STEPS):
            mujoco.mj_step(model, data)
            now = frame + (step + 1) / STEPS
            touching = data.contact.geom[(data.contact.dist < 0) & (data.contact.geom > floor).all(axis=1)]
            for first, second in {(min(a, b) - floor - 1, max(a, b) - floor - 1) for a, b in touching.tolist()}:
                if now - latest.get((first, second), -1e9) > APART:
                    collisions.append(Collision((first, second), round(now)))
                latest[(first, second)] = now
    places = states.reshape(frames, -1, 7)[:, :, :3]
    both = speeds.reshape(frames, -1, 6)
    return Run(
        places,
        states.reshape(frames, -1, 7)[:, :, 3:],
        both[:, :, :3],
        both[:, :, 3:],
        in_view(places),
        tuple(collisions),
        states,
    )


def _in_body(quaternion: Floats, velocity: tuple[float, float]) -> Floats:
    """Spin of a ball that rolls without slipping, in its own axes."""
    spin, inverse = np.zeros(3), np.zeros(4)
    mujoco.mju_negQuat(inverse, quaternion)
    mujoco.mju_rotVecQuat(spin, np.array([-velocity[1], velocity[0], 0.0]) / HALF, inverse)
    return spin
