"""Film a clip: expose, render every frame and its mask."""

import numpy as np
from numpy.random import Generator

from tests.benchmarks.video_clips.clip import Clip
from tests.benchmarks.video_clips.render import Film, light_gain

from .engine import Stage
from .motion import read_motion
from .optics import blender_camera
from .place import find_room, path_points
from .setting import Setting
from .shaders import to_linear
from .stage import HAND_LABEL, Built, build

SAMPLES, BOUNCES = 4, 3
TRIAL_SAMPLES = 6


def exposure(stage: Stage, size: tuple[int, int], wanted: float) -> float:
    """Return the exposure in stops at which a small picture of the first frame has the wanted mean (0 to 1)."""
    stage.set_size((size[0] // 4, size[1] // 4))
    stage.set_quality(TRIAL_SAMPLES, 2, False)
    stops = 0.0
    for _ in range(4):  # a bright picture is clipped, so one step is not enough
        stage.set_film("Standard", "None", stops)
        mean = float(to_linear(stage.picture(0) / 255.0).mean())
        stops += float(np.clip(np.log2(float(to_linear(np.array(wanted))) / max(mean, 1e-3)), -3, 3))
    stage.set_size(size)
    return stops


def film(rng: Generator, clip: Clip, setting: Setting, threads: int) -> tuple[Film, np.ndarray, Built]:
    """Render the clip; return frames and labels, the mask of the hand (frame, row, column) and what was built."""
    motion = read_motion(clip.scene, clip.look, clip.run)
    stage = Stage(clip.look.size, threads)
    room = find_room(clip, setting)
    built = build(stage, rng, clip, setting, motion, room)
    focus = float(clip.cameras[0].project(path_points(clip).mean(axis=0))[0, 2])
    gains = light_gain(rng, clip.look)
    stage.set_camera(blender_camera(clip.cameras[0]), focus, 0.0)
    stops = exposure(stage, clip.look.size, setting.brightness)
    stage.set_quality(SAMPLES, BOUNCES, True)
    stage.set_shutter(clip.look.shutter)
    frames, labels = [], []
    for n, camera in enumerate(clip.cameras):
        for update in built.updates:
            update(n)
        stage.set_camera(blender_camera(camera), focus, setting.fstop)
        stage.set_film(setting.transform, setting.contrast, stops + float(np.log2(gains[n])))
        frames.append(stage.picture(n, n))
    stage.label_layer()
    for n, camera in enumerate(clip.cameras):
        for update in built.updates:
            update(n)
        stage.set_camera(blender_camera(camera), focus, 0.0)
        labels.append(stage.picture(n)[..., 0])
    stage.close()
    seen = np.array(labels)
    hand = seen == HAND_LABEL
    seen[hand] = 0
    return Film(frames, seen, motion.names, gains), hand, built
