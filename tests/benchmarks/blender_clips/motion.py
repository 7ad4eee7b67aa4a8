"""Read from the simulator where every visible part is at the frames and at the ends of the shutter's opening."""

from dataclasses import dataclass

import mujoco
import numpy as np

from tests.benchmarks.video_clips.bodies import DT, Array, Scene
from tests.benchmarks.video_clips.looks import Look
from tests.benchmarks.video_clips.mjcf import build
from tests.benchmarks.video_clips.physics import Run

SHAPES = {
    int(mujoco.mjtGeom.mjGEOM_SPHERE): "sphere",
    int(mujoco.mjtGeom.mjGEOM_BOX): "box",
    int(mujoco.mjtGeom.mjGEOM_CYLINDER): "cylinder",
    int(mujoco.mjtGeom.mjGEOM_CAPSULE): "capsule",
}


@dataclass(frozen=True)
class Part:
    """A rigid part that moves. size: full extents in m (capsule: d, d, length of the straight part).

    label: 1 + index among the bodies, 0 where the part belongs to none. poses: (sample, 7), quaternions w x y z.
    """

    name: str
    shape: str
    size: tuple[float, float, float]
    label: int
    poses: Array


@dataclass(frozen=True)
class Motion:
    """Poses of all moving parts. times: of the samples in frames; names: bodies in the order of their labels."""

    names: list[str]
    times: Array
    parts: list[Part]


def label_names(scene: Scene) -> list[str]:
    """Return what has a mask, in the order of the labels."""
    return [b.name for b in scene.bodies] + (["rope"] if scene.rope else []) + (["cloth"] if scene.cloth else [])


def _full(shape: str, half: Array) -> tuple[float, float, float]:
    if shape == "box":
        return (2 * float(half[0]), 2 * float(half[1]), 2 * float(half[2]))
    d = 2 * float(half[0])
    return (d, d, d if shape == "sphere" else 2 * float(half[1]))


def read_motion(scene: Scene, look: Look, run: Run) -> Motion:
    """Place the simulator in the states of the samples and read its geoms; a rope's links are left out."""
    model = build(scene)
    data = mujoco.MjData(model)
    names = label_names(scene)
    label = {model.geom(b.name).id: i + 1 for i, b in enumerate(scene.bodies)}
    wheels = {int(model.geom(b.name).bodyid[0]): i + 1 for i, b in enumerate(scene.bodies) if b.joint == "track"}
    moving = [
        g
        for g in range(model.ngeom)
        if model.geom_bodyid[g] > 0 and int(model.geom_type[g]) in SHAPES and not model.geom(g).name.startswith("rope_")
    ]
    shifts = [0.0] if look.shutter == 0 else [-look.shutter / 2, 0.0, look.shutter / 2]
    times = np.array([n + s for n in range(look.frames) for s in shifts])
    poses = np.zeros((len(moving), len(times), 7))
    quat = np.zeros(4)
    for k, time in enumerate(times):
        step = round(time / (look.fps * DT))
        data.qpos[:] = run.states[int(np.clip(step, 0, len(run.states) - 1))]
        mujoco.mj_kinematics(model, data)
        for i, g in enumerate(moving):
            mujoco.mju_mat2Quat(quat, data.geom_xmat[g])
            sign = -1.0 if k and quat @ poses[i, k - 1, 3:] < 0 else 1.0
            poses[i, k, :3], poses[i, k, 3:] = data.geom_xpos[g], sign * quat
    parts = []
    for i, g in enumerate(moving):
        shape = SHAPES[int(model.geom_type[g])]
        owner = label.get(g, wheels.get(int(model.geom_bodyid[g]), 0))
        parts.append(Part(model.geom(g).name, shape, _full(shape, model.geom_size[g]), owner, poses[i]))
    return Motion(names, times, parts)
