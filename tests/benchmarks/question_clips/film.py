"""Render scenes of solids by MuJoCo, offscreen, and write videos."""

from __future__ import annotations

from pathlib import Path

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

from .camera import FORWARD, FOVY, POSITION, SIZE, UP
from .solids import RGB, Run, Solid, model_text

RATE = 25.0  # frames per second of the file, as in CLEVRER


def looks() -> str:
    """Light and surfaces: metal shines and mirrors a little, rubber is dull."""
    assets = ""
    for color, (r, g, b) in RGB.items():
        assets += (
            f'<material name="{color} metal" rgba="{r} {g} {b} 1" specular="1" shininess="0.6" reflectance="0.1"/>'
        )
        assets += f'<material name="{color} rubber" rgba="{r} {g} {b} 1" specular="0.05" shininess="0.1"/>'
    assets += (
        '<material name="floor" rgba=".7 .7 .69 1" specular="0" shininess="0"/>'
        '<texture name="sky" type="skybox" builtin="flat" rgb1=".72 .72 .71" width="16" height="96"/>'
    )
    width, height = SIZE
    return (
        f'<visual><global offwidth="{width}" offheight="{height}"/><quality shadowsize="2048" offsamples="4"/>'
        '<map znear="0.01" zfar="60" shadowclip="6"/>'
        '<headlight ambient=".35 .35 .35" diffuse=".25 .25 .25" specular="0.15 0.15 0.15"/></visual>'
        f'<statistic extent="3" center="-0.5 0 0"/><asset>{assets}</asset>'
    )


def render(solids: list[Solid], restitution: float, run: Run, frames: int) -> list[NDArray[np.uint8]]:
    """Return the first frames (H, W, 3), BGR."""
    side = np.cross(FORWARD, UP)
    view = (
        f'<camera name="view" pos="{" ".join(map(str, POSITION))}" fovy="{FOVY}" '
        f'xyaxes="{" ".join(map(str, [*side, *UP]))}"/>'
        '<light directional="true" pos="2 -3 6" dir="-0.35 0.45 -0.82" diffuse=".55 .55 .55" specular=".6 .6 .6"/>'
    )
    text = model_text(solids, restitution, looks()).replace("<worldbody>", f"<worldbody>{view}")
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    width, height = SIZE
    pictures = []
    with mujoco.Renderer(model, height, width) as renderer:
        for state in run.states[:frames]:
            data.qpos[:] = state
            mujoco.mj_forward(model, data)
            renderer.update_scene(data, "view")
            pictures.append(np.ascontiguousarray(renderer.render()[:, :, ::-1]))
    return pictures


def write_video(path: Path, pictures: list[NDArray[np.uint8]], rate: float = RATE) -> None:
    """Write frames (H, W, 3), BGR, as MPEG-4; raises OSError where no encoder opens."""
    path.parent.mkdir(parents=True, exist_ok=True)
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), rate, (width, height))
    if not writer.isOpened():
        raise OSError(f"OpenCV cannot write {path}")
    for picture in pictures:
        writer.write(picture)
    writer.release()
