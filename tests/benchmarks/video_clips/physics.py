"""Simulate a scene and record poses, velocities and touches."""

from dataclasses import dataclass, field
from typing import Any

import mujoco
import numpy as np

from .bodies import DT, HORIZON, Array, Cloth, Scene
from .mjcf import build

WATCH = 4  # steps between changes of the wind's force; frames fall on these steps
GAP = round(0.02 / DT)  # touches closer in time than this many steps count as one


@dataclass
class Run:
    """A simulated run. poses: (time, body, 7) position in m and quaternion w x y z; velocities: (time, body, 6)."""

    names: list[str]
    frame_poses: Array
    frame_velocities: Array
    touches: list[tuple[str, str, float, float]]  # names, start, end in s, also in the HORIZON beyond the last frame
    frame_points: Array | None = None  # (time, n, 3) of a rope's joints or a cloth's vertices
    states: list[Array] = field(default_factory=list)  # positions of all joints at each step of the clip


def track_names(scene: Scene) -> list[str]:
    """Return what is recorded: the bodies, and the free end of a bare rope or a lower corner of a cloth."""
    names = [b.name for b in scene.bodies]
    if scene.rope and not any(b.joint == "rope" for b in scene.bodies):
        names.append("rope")
    if scene.cloth:
        names.append("cloth")
    return names


def _start(scene: Scene, model: mujoco.MjModel, data: mujoco.MjData) -> None:
    for b in scene.bodies:
        geom = model.geom(b.name)
        joint = int(model.body_jntadr[geom.bodyid[0]])
        if joint < 0 or b.joint == "rope":
            continue
        q, v = int(model.jnt_qposadr[joint]), int(model.jnt_dofadr[joint])
        if b.joint == "free":
            back = np.zeros(3)
            inverse = np.array(b.quat) * [1, -1, -1, -1]
            mujoco.mju_rotVecQuat(back, np.array(b.spin), inverse)
            data.qvel[v : v + 3], data.qvel[v + 3 : v + 6] = b.vel, back
        elif b.joint == "track":
            data.qvel[v] = b.vel[0]
        elif b.joint == "arm":
            data.qpos[q], data.qvel[v] = b.angle, b.rate
    if scene.rope:
        v = int(model.jnt_dofadr[model.body_jntadr[model.geom("rope_0").bodyid[0]]])
        data.qvel[v + 1] = -scene.rope.rate


def _faces(model: mujoco.MjModel) -> tuple[np.ndarray, np.ndarray]:
    return np.asarray(model.flex_elem).reshape(-1, 3), np.asarray(model.flex_vertbodyid)


def _blow(model: mujoco.MjModel, data: mujoco.MjData, cloth: Cloth, faces: np.ndarray, owner: np.ndarray) -> None:
    """Push each face of the cloth along its normal by the air that moves against it."""
    x = data.flexvert_xpos
    v = data.cvel[owner, 3:] + np.cross(data.cvel[owner, :3], x - data.subtree_com[model.body_rootid[owner]])
    a, b, c = x[faces[:, 0]], x[faces[:, 1]], x[faces[:, 2]]
    cross = np.cross(b - a, c - a)
    double = np.linalg.norm(cross, axis=1, keepdims=True) + 1e-12
    normal = cross / double
    relative = np.asarray(cloth.wind) - v[faces].mean(axis=1)
    along = np.sum(relative * normal, axis=1, keepdims=True)
    force = np.clip(cloth.drag * 0.5 * double * np.abs(along) * along, -0.2, 0.2) * normal / 3
    data.xfrc_applied[:, :3] = 0
    for k in range(3):
        np.add.at(data.xfrc_applied, (owner[faces[:, k]][:, None], np.arange(3)[None, :]), force)
    data.xfrc_applied[0] = 0


class _Recorder:
    """Read poses and velocities of the tracked things from the simulator's state."""

    def __init__(self, scene: Scene, model: mujoco.MjModel) -> None:
        self.scene, self.model = scene, model
        self.geoms = [model.geom(b.name).id for b in scene.bodies]
        self.names = track_names(scene)
        self.links: list[int] = []
        if scene.rope:
            self.links = [int(model.geom(f"rope_{k}").bodyid[0]) for k in range(scene.rope.links)]
            self.link = scene.rope.length / scene.rope.links

    def points(self, data: mujoco.MjData) -> Array | None:
        """Return a rope's joints and end or a cloth's vertices."""
        if self.scene.cloth:
            return np.array(data.flexvert_xpos)
        if self.links:
            last = self.links[-1]
            tip = data.xpos[last] - self.link * data.xmat[last].reshape(3, 3)[:, 2]
            return np.vstack([data.xpos[self.links], tip])
        return None

    def _end(self, data: mujoco.MjData) -> tuple[Array, Array]:
        """Return place and velocity of the free end of a rope or of a lower corner of a cloth."""
        points = self.points(data)
        assert points is not None
        point = points[0 if self.scene.cloth else -1]
        owner = int(self.model.flex_vertbodyid[0]) if self.scene.cloth else self.links[-1]
        return point, point_velocity(self.model, data, point, owner)

    def read(self, data: mujoco.MjData) -> tuple[Array, Array]:
        """Return poses (n, 7) and velocities (n, 6; linear, angular; world axes)."""
        poses, velocities = np.zeros((len(self.names), 7)), np.zeros((len(self.names), 6))
        quat, six = np.zeros(4), np.zeros(6)
        for i, g in enumerate(self.geoms):
            mujoco.mju_mat2Quat(quat, data.geom_xmat[g])
            mujoco.mj_objectVelocity(self.model, data, mujoco.mjtObj.mjOBJ_GEOM, g, six, 0)
            poses[i, :3], poses[i, 3:] = data.geom_xpos[g], quat
            velocities[i, :3], velocities[i, 3:] = six[3:], six[:3]
        if len(self.names) > len(self.geoms):
            poses[-1, :3], velocities[-1, :3] = self._end(data)
            poses[-1, 3] = 1.0
        return poses, velocities


def point_velocity(model: mujoco.MjModel, data: mujoco.MjData, point: Array, body: int) -> Array:
    """Return the velocity of a point fixed to a body in m/s."""
    arm = point - data.subtree_com[model.body_rootid[body]]
    return np.asarray(data.cvel[body, 3:] + np.cross(data.cvel[body, :3], arm))


def simulate(scene: Scene, seconds: float, fps: int, keep_states: bool = False) -> Run:
    """Simulate the clip and HORIZON s beyond it."""
    model = build(scene)
    data = mujoco.MjData(model)
    _start(scene, model, data)
    mujoco.mj_forward(model, data)
    recorder = _Recorder(scene, model)
    clip, every = round(seconds / DT), round(1 / (fps * DT))
    geom_names = [model.geom(i).name for i in range(model.ngeom)]
    frames: list[Any] = [[], [], []]
    states: list[Array] = []
    open_touch: dict[tuple[int, int], list[int]] = {}
    touches: list[tuple[int, int, int, int]] = []
    faces, owner = _faces(model) if scene.cloth else (np.zeros((0, 3), int), np.zeros(0, int))
    for n in range(clip + round(HORIZON / DT) + 1):
        if n % every == 0:
            poses, velocities = recorder.read(data)
            if not np.all(np.abs(velocities) < 1e3):
                raise FloatingPointError("the simulation diverged")
        if n <= clip:
            if keep_states:
                states.append(np.array(data.qpos))
            if n % every == 0:
                for store, value in zip(frames, (poses, velocities, recorder.points(data)), strict=True):
                    store.append(value)
        if n % WATCH == 0 and scene.cloth:
            _blow(model, data, scene.cloth, faces, owner)
        if data.ncon:
            seen = {(int(a), int(b)) for a, b in data.contact.geom[: data.ncon]}
            for key in seen:
                if key in open_touch and n - open_touch[key][1] <= GAP:
                    open_touch[key][1] = n
                else:
                    if key in open_touch:
                        touches.append((*key, open_touch[key][0], open_touch[key][1]))
                    open_touch[key] = [n, n]
        mujoco.mj_step(model, data)
        if (n + 1) % WATCH == 0:  # bring places and speeds up to the new state
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            mujoco.mj_comVel(model, data)
            if scene.cloth:
                mujoco.mj_flex(model, data)
    touches.extend((*key, value[0], value[1]) for key, value in open_touch.items())
    touches.sort(key=lambda t: (t[2], t[0], t[1]))
    named = [(geom_names[a], geom_names[b], round(s * DT, 4), round(e * DT, 4)) for a, b, s, e in touches]
    return Run(
        names=recorder.names,
        frame_poses=np.array(frames[0]),
        frame_velocities=np.array(frames[1]),
        touches=[(*sorted((a, b)), s, e) for a, b, s, e in named if a and b],  # type: ignore[misc]
        frame_points=None if frames[2][0] is None else np.array(frames[2]),
        states=states,
    )
