"""MuJoCo by `mujoco.rollout` and by `mujoco.batch`.

Default solver, elliptic friction cones, float64. It has no coefficient of restitution: where a scene has one, contacts
are damped oscillators of the damping ratio that returns it after half a period (direct `solref`).
"""

from __future__ import annotations

import math

import mujoco
import mujoco.batch
import mujoco.rollout
import numpy as np

from tests.benchmarks.peers.engine import Prepared
from tests.benchmarks.peers.scenes import Array, Body, Motion, Scene

STIFFNESS = 1e5  # of contacts that rebound [1/s^2]: half a period of 10 ms, five steps of 2 ms
STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS


def mjcf(scene: Scene, *, planar: bool) -> str:
    """Return a scene as MJCF. planar: bodies move in the plane y = 0 by three joints, where the scene is upright."""
    solref = ""
    if scene.restitution > 0:
        log = math.log(scene.restitution)
        damping = -2 * log / math.hypot(math.pi, log) * math.sqrt(STIFFNESS)
        solref = f'solref="{-STIFFNESS:g} {-damping:.6g}"'
    surface = f'friction="{scene.friction} 0 0" {solref}'
    asset, ground = _ground(scene, surface)
    return (
        f'<mujoco><compiler angle="radian"/><option timestep="{scene.substep}" gravity="{_text(scene.gravity)}" '
        f'cone="elliptic"/><size memory="256M"/><asset>{asset}</asset>'
        f"<worldbody>{ground}{_bodies(scene, planar, surface)}</worldbody></mujoco>"
    )


def _text(values: tuple[float, ...] | Array) -> str:
    return " ".join(f"{x:.17g}" for x in values)


def _ground(scene: Scene, surface: str) -> tuple[str, str]:
    planes = [("0 0 0", "0 0 1")] if scene.floor else []
    for axis in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0)) if scene.walls else ():
        planes.append((_text(tuple(-a * (scene.walls or 0.0) for a in axis)), _text(axis)))
    geoms = "".join(f'<geom type="plane" size="9 9 1" pos="{p}" zaxis="{z}" {surface}/>' for p, z in planes)
    if scene.terrain is None:
        return "", geoms
    n, top = len(scene.terrain.heights), float(scene.terrain.heights.max())
    low = float(scene.terrain.heights.min())
    asset = (
        f'<hfield name="hills" nrow="{n}" ncol="{n}" '
        f'size="{scene.terrain.reach} {scene.terrain.reach} {top - low} 0.5" '
        f'elevation="{_text(scene.terrain.heights[::-1].ravel() - low)}"/>'
    )
    return asset, geoms + f'<geom type="hfield" hfield="hills" pos="0 0 {low}" {surface}/>'


def _bodies(scene: Scene, planar: bool, surface: str) -> str:
    if scene.chain:
        text, closing = "", ""
        for k, (body, point) in enumerate(zip(scene.bodies, scene.chain, strict=True)):
            # A nested body is placed in its parent's axes, which are turned as its own are.
            place = _text(body.position) if k == 0 else f"{2 * body.size[0]} 0 0"
            turn = f'euler="0 {body.tilt:.17g} 0"' if k == 0 else ""
            offset = f"{-body.size[0]} 0 0"
            text += (
                f'<body pos="{place}" {turn}><joint type="hinge" axis="0 1 0" pos="{offset}"/>'
                f'<geom type="box" size="{_text(body.size)}" mass="1" contype="0" conaffinity="0"/>'
            )
            closing += "</body>"
            assert len(point) == 3
        return text + closing
    joints = "<freejoint/>"
    if planar and scene.upright:
        joints = '<joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/><joint axis="0 1 0"/>'
    return "".join(_body(body, joints, surface) for body in scene.bodies)


def _body(body: Body, joints: str, surface: str) -> str:
    shape = f'<geom type="{body.kind}" size="{_text(body.size)}" mass="1" condim="3" {surface}/>'
    return f'<body pos="{_text(body.position)}">{joints}{shape}</body>'


def _initial(scene: Scene, model: mujoco.MjModel) -> mujoco.MjData:
    data = mujoco.MjData(model)
    if model.nv == 6 * len(scene.bodies) and not scene.chain:
        for k, body in enumerate(scene.bodies):
            data.qvel[6 * k : 6 * k + 6] = (*body.velocity, *body.spin)
    mujoco.mj_forward(model, data)
    return data


class _Samples:
    """Positions and velocities (T, nq), (T, nv) of one world as motion of its bodies."""

    def __init__(self, scene: Scene, model: mujoco.MjModel, interval: float) -> None:
        self.scene, self.model, self.interval = scene, model, interval
        self.count = round(scene.duration / interval)
        self.inner = round(interval / scene.substep)
        self.initial = _initial(scene, model)

    def motion(self, qpos: Array, qvel: Array) -> Motion:
        model, data, bodies = self.model, mujoco.MjData(self.model), range(1, self.model.nbody)
        positions, twists, rotations = [], [], []
        for q, v in zip(qpos, qvel, strict=True):
            data.qpos[:], data.qvel[:] = q, v
            mujoco.mj_fwdPosition(model, data)
            mujoco.mj_fwdVelocity(model, data)
            row = np.zeros((model.nbody, 6))
            for k in bodies:
                mujoco.mj_objectVelocity(model, data, mujoco.mjtObj.mjOBJ_BODY, k, row[k], 0)
            positions.append(data.xipos[1:].copy())
            rotations.append(data.ximat[1:].reshape(-1, 3, 3).copy())
            twists.append(row[1:])
        both = np.array(twists)
        times = self.interval * np.arange(len(qpos), dtype=float)
        return Motion(times, np.array(positions), both[..., 3:], both[..., :3], np.array(rotations))


class _RolloutRun:
    def __init__(self, samples: _Samples, worlds: int, threads: int) -> None:
        self._samples, model = samples, samples.model
        state = np.zeros(mujoco.mj_stateSize(model, STATE))
        mujoco.mj_getState(model, samples.initial, state, STATE)
        self._start = np.tile(state, (worlds, 1))
        self._workers = [mujoco.MjData(model) for _ in range(min(threads, worlds))]
        self._pool = mujoco.rollout.Rollout(nthread=len(self._workers) if worlds > 1 else 0)
        self._sensors = np.zeros((worlds, samples.scene.steps, 0))
        self._states = np.zeros((worlds, samples.scene.steps, len(state)))

    def run(self) -> None:
        self._pool.rollout(
            self._samples.model,
            self._workers,
            self._start,
            nstep=self._samples.scene.steps,
            state=self._states,
        )

    def motion(self) -> Motion:
        inner, nq, nv = self._samples.inner, self._samples.model.nq, self._samples.model.nv
        rows = np.concatenate([self._start[:1], self._states[0, inner - 1 :: inner]])
        return self._samples.motion(rows[:, 1 : 1 + nq], rows[:, 1 + nq : 1 + nq + nv])


class _BatchRun:
    def __init__(self, samples: _Samples, worlds: int, threads: int) -> None:
        self._samples, model = samples, samples.model
        self._batch = mujoco.batch.Batch(model, worlds, nthread=min(threads, worlds))
        self._batch.qvel[:] = samples.initial.qvel
        self._start = self._batch.state.copy()
        self._qpos = np.zeros((samples.count + 1, worlds, model.nq))
        self._qvel = np.zeros((samples.count + 1, worlds, model.nv))

    def run(self) -> None:
        batch, inner = self._batch, self._samples.inner
        qpos, qvel = batch.bind("qpos"), batch.bind("qvel")
        batch.state[:] = self._start
        self._qpos[0], self._qvel[0] = qpos, qvel
        for k in range(1, self._samples.count + 1):
            batch.step(nstep=inner)
            self._qpos[k], self._qvel[k] = qpos, qvel

    def motion(self) -> Motion:
        return self._samples.motion(self._qpos[:, 0], self._qvel[:, 0])


class MuJoCo:
    """MuJoCo by one of its two ways to run many worlds."""

    def __init__(self, way: str, planar: bool = False) -> None:
        """way: rollout or batch. planar: bodies of upright scenes have three joints each, not six freedoms."""
        self.name = f"mujoco.{way}"
        self._run: type[_RolloutRun] | type[_BatchRun] = _RolloutRun if way == "rollout" else _BatchRun
        self._planar = planar

    def prepare(self, scene: Scene, worlds: int, interval: float, threads: int) -> Prepared:
        """Return a scene as a model with its states."""
        model = mujoco.MjModel.from_xml_string(mjcf(scene, planar=self._planar))
        return self._run(_Samples(scene, model, interval), worlds, threads)
