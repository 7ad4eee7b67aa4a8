"""Render the frames of a clip and the mask of each body."""

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.random import Generator

from .bodies import DT, Array, Scene
from .camera import Camera, turned
from .looks import Look
from .mjcf import build
from .physics import Run
from .textures import floor_png

SOFT = 9  # renders averaged for a soft shadow
SUBFRAMES = 7  # renders averaged for motion blur


@dataclass
class Film:
    """Rendered frames (RGB) and labels: 0 where no body is seen, else 1 + index in names."""

    frames: list[np.ndarray]
    labels: np.ndarray
    names: list[str]
    gains: list[float]


def camera_path(rng: Generator, camera: Camera, look: Look, distance: float) -> list[Camera]:
    """Return the camera of each frame; shake turns and shifts it by a slow random motion of a few pixels."""
    if look.shake == 0:
        return [camera] * look.frames
    keys = rng.normal(0, 1, (6, look.frames + 40))
    kernel = np.exp(-0.5 * (np.arange(-20, 21) / (0.12 * look.fps)) ** 2)
    walk = np.array([np.convolve(k, kernel, "valid") for k in keys]) / np.sqrt(np.sum(kernel**2))
    angle = look.shake / camera.focal
    out = []
    for p, t, r, *shift in walk.T:
        out.append(turned(camera, angle * p, angle * t, 0.3 * angle * r, 0.3 * angle * distance * np.array(shift)))
    return out


def light_gain(rng: Generator, look: Look) -> list[float]:
    """Return the factor of the light in each frame."""
    period, phase = float(rng.uniform(1.5, 4.0)), float(rng.uniform(0, 2 * np.pi))
    times = np.arange(look.frames) / look.fps
    return [float(g) for g in 1 + look.light_swing * np.sin(2 * np.pi * times / period + phase)]


class Studio:
    """A compiled scene with a renderer that draws it in any state, from any camera, under any sun."""

    def __init__(self, scene: Scene, look: Look, texture: bytes, extent: float) -> None:
        self.model = build(scene, look, texture, extent)
        self.data = mujoco.MjData(self.model)
        self.renderer = mujoco.Renderer(self.model, look.size[1], look.size[0])
        self.lamp = np.array(self.model.light_diffuse), np.array(self.model.vis.headlight.ambient)
        self.fill = np.array(self.model.vis.headlight.diffuse)
        self.sun = np.array(self.model.light_dir[0])

    def close(self) -> None:
        """Free the renderer."""
        self.renderer.close()

    def pose(self, state: Array, camera: Camera, sun: Array | None = None, gain: float = 1.0) -> None:
        """Set joints, camera, direction of the sun's rays and strength of the light."""
        model, data = self.model, self.data
        data.qpos[:] = state
        quat = np.zeros(4)
        mujoco.mju_mat2Quat(quat, np.ascontiguousarray(camera.axes()).ravel())
        model.cam_pos[0], model.cam_quat[0], model.cam_fovy[0] = camera.pos, quat, camera.fovy
        way = self.sun if sun is None else sun
        model.light_dir[0] = way
        model.light_diffuse[:] = self.lamp[0] * gain
        model.vis.headlight.ambient[:] = self.lamp[1] * gain
        model.vis.headlight.diffuse[:] = self.fill * gain
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_camlight(model, data)
        if model.nflex:
            mujoco.mj_flex(model, data)

    def picture(self, _: Any = None) -> np.ndarray:
        """Draw the present state."""
        self.renderer.disable_segmentation_rendering()
        self.renderer.update_scene(self.data, "view")
        return self.renderer.render()

    def labels(self, scene: Scene, names: list[str]) -> np.ndarray:
        """Draw which body each pixel shows."""
        self.renderer.enable_segmentation_rendering()
        self.renderer.update_scene(self.data, "view")
        seen = self.renderer.render()
        ids, kinds = seen[..., 0], seen[..., 1]
        out = np.zeros(ids.shape, dtype=np.uint8)
        geom = kinds == int(mujoco.mjtObj.mjOBJ_GEOM)
        for i, name in enumerate(names):
            if name == "cloth":
                out[kinds == int(mujoco.mjtObj.mjOBJ_FLEX)] = i + 1
            elif name == "rope" and scene.rope:
                for k in range(scene.rope.links):
                    out[geom & (ids == self.model.geom(f"rope_{k}").id)] = i + 1
            else:
                body = scene.named(name)
                own = self.model.geom(name)
                parts = [int(own.id)]
                if body.joint == "track":
                    parts = [g for g in range(self.model.ngeom) if self.model.geom_bodyid[g] == own.bodyid[0]]
                out[geom & np.isin(ids, parts)] = i + 1
        return out


def render(rng: Generator, scene: Scene, look: Look, run: Run, cameras: list[Camera], extent: float) -> Film:
    """Render all frames with shadow, blur and changing light, and the masks at the frame times."""
    texture = floor_png(rng, look)
    gains = light_gain(rng, look)
    names = [b.name for b in scene.bodies] + (["rope"] if scene.rope else []) + (["cloth"] if scene.cloth else [])
    studio = Studio(scene, look, texture, extent)
    spread = rng.normal(0, float(rng.uniform(0.03, 0.06)), (SOFT, 3)) if look.shadow == "soft" else np.zeros((1, 3))
    shifts = np.zeros(1)
    if look.shutter:
        shifts = np.linspace(-0.5, 0.5, SUBFRAMES) * look.shutter / look.fps
    count = max(len(spread), len(shifts))
    every = round(1 / (look.fps * DT))
    frames, labels = [], []
    for n, camera in enumerate(cameras):
        total = np.zeros((look.size[1], look.size[0], 3))
        for k in range(count):
            step = n * every + round(float(shifts[k % len(shifts)]) / DT)
            way = studio.sun + spread[k % len(spread)]
            state = run.states[int(np.clip(step, 0, len(run.states) - 1))]
            studio.pose(state, camera, way / np.linalg.norm(way), gains[n])
            total += studio.picture()
        frames.append(np.clip(total / count + 0.5, 0, 255).astype(np.uint8))
        studio.pose(run.states[n * every], camera)
        labels.append(studio.labels(scene, names))
    studio.close()
    return Film(frames, np.array(labels), names, gains)
