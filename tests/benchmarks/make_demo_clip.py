"""Make the clip that `atw-mcp demo` runs on: simulated and rendered by MuJoCo, independent of this project.

    MUJOCO_GL=egl uv run --group bench python -m tests.benchmarks.make_demo_clip [--output atw_mcp/demo]

Four flat-bottomed bodies slide on a table. The red cylinder heads for the yellow one, but the blue cube knocks it
off its way and it never gets there; without the blue cube it does. The file plays at 25 frames per second while the
frames lie 0.0125 s apart, as in a slow-motion recording. Written: collision.mp4 and collision.json, the ground truth,
with the counterfactual run of the same scene without the blue cube.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import cv2
import mujoco
import numpy as np
from numpy.typing import NDArray

WIDTH, HEIGHT = 480, 320
FRAMES = 72
SECONDS_PER_FRAME = 0.0125
FILE_RATE = 25.0
TIMESTEP = 0.0005
FRICTION = 0.20
FIELD_OF_VIEW = 29.0  # vertical [deg]
EYE, TARGET = np.array([0.0, -1.35, 1.15]), np.array([0.0, 0.03, 0.0])
MARKS = ((-0.5, -0.3), (0.5, -0.3), (0.5, 0.35), (-0.5, 0.35))  # dots on the table, x, y [m]
REMOVED = "blue_cube"

BODIES: dict[str, dict[str, Any]] = {
    "red_cylinder": {
        "shape": {"kind": "cylinder", "radius": 0.06, "half_height": 0.045},
        "color": "red",
        "rgb": (0.75, 0.10, 0.10),
        "mass": 0.40,
        "position": (-0.52, 0.02, 0.045),
        "yaw": 0.0,
        "velocity": (1.85, 0.05, 0.0),
    },
    "blue_cube": {
        "shape": {"kind": "box", "half_extents": (0.05, 0.05, 0.05)},
        "color": "blue",
        "rgb": (0.12, 0.22, 0.80),
        "mass": 0.50,
        "position": (0.02, -0.36, 0.05),
        "yaw": 0.35,
        "velocity": (-0.10, 1.30, 0.0),
    },
    "yellow_cylinder": {
        "shape": {"kind": "cylinder", "radius": 0.055, "half_height": 0.06},
        "color": "yellow",
        "rgb": (0.90, 0.78, 0.08),
        "mass": 0.45,
        "position": (0.30, 0.06, 0.06),
        "yaw": 0.0,
        "velocity": (0.0, 0.0, 0.0),
    },
    "green_cube": {
        "shape": {"kind": "box", "half_extents": (0.045, 0.045, 0.045)},
        "color": "green",
        "rgb": (0.10, 0.55, 0.18),
        "mass": 0.35,
        "position": (0.10, 0.30, 0.045),
        "yaw": -0.5,
        "velocity": (0.0, 0.0, 0.0),
    },
}


def scene(names: list[str]) -> str:
    """Return the MuJoCo description of the table with some of the bodies."""
    bodies = "".join(_body(name, BODIES[name]) for name in names)
    marks = "".join(
        f'<geom type="cylinder" pos="{x} {y} 0.0001" size="0.008 0.0002" rgba="0.12 0.12 0.12 1" '
        'contype="0" conaffinity="0"/>'
        for x, y in MARKS
    )
    right, down, _forward = view_axes()
    axes = " ".join(f"{v:.9f}" for v in (*right, *-down))
    return f"""
<mujoco>
  <option timestep="{TIMESTEP}" cone="elliptic" impratio="20" integrator="implicitfast" iterations="100"
          tolerance="1e-12"/>
  <visual>
    <global offwidth="{WIDTH * 2}" offheight="{HEIGHT * 2}"/>
    <headlight ambient="0.42 0.42 0.42" diffuse="0.25 0.25 0.25" specular="0 0 0"/>
    <quality shadowsize="4096" offsamples="8"/>
    <map znear="0.05" zfar="20" shadowclip="1.5"/>
  </visual>
  <default>
    <geom friction="{FRICTION} 0 0" condim="3" solref="-20000 -60" solimp="0.98 0.99 0.0005"/>
  </default>
  <worldbody>
    <light directional="true" pos="-0.5 -0.6 3" dir="0.15 0.18 -1" diffuse="0.35 0.35 0.35" specular="0.1 0.1 0.1"/>
    <camera name="view" fovy="{FIELD_OF_VIEW}" pos="{EYE[0]} {EYE[1]} {EYE[2]}" xyaxes="{axes}"/>
    <geom name="floor" type="plane" size="3 3 1" rgba="0.62 0.62 0.60 1" solref="0.004 1"/>
    {marks}{bodies}
  </worldbody>
</mujoco>"""


def _body(name: str, body: dict[str, Any]) -> str:
    shape = body["shape"]
    size = shape["half_extents"] if shape["kind"] == "box" else (shape["radius"], shape["half_height"])
    rgba = " ".join(f"{c}" for c in (*body["rgb"], 1.0))
    return (
        f'<body name="{name}" pos="{" ".join(map(str, body["position"]))}" '
        f'euler="0 0 {np.degrees(body["yaw"])}"><freejoint/>'
        f'<geom name="{name}" type="{shape["kind"]}" size="{" ".join(map(str, size))}" mass="{body["mass"]}" '
        f'rgba="{rgba}"/></body>'
    )


def view_axes() -> NDArray[np.float64]:
    """Return rows right, down, forward of the camera in world axes."""
    forward = (TARGET - EYE) / np.linalg.norm(TARGET - EYE)
    right = np.cross(forward, [0.0, 0.0, 1.0])
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(forward, right), forward])


def camera() -> dict[str, Any]:
    """Return the pinhole camera of the pictures; pixel (0, 0) is the centre of the first pixel."""
    rotation = view_axes()
    focal = HEIGHT / 2 / np.tan(np.radians(FIELD_OF_VIEW / 2))
    return {
        "width": WIDTH,
        "height": HEIGHT,
        "intrinsics": [[focal, 0.0, (WIDTH - 1) / 2], [0.0, focal, (HEIGHT - 1) / 2], [0.0, 0.0, 1.0]],
        "rotation": rotation.tolist(),
        "translation": (-rotation @ EYE).tolist(),
    }


def project(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Pixels (n, 2) of world points (n, 3)."""
    view = camera()
    image = (points @ np.asarray(view["rotation"]).T + view["translation"]) @ np.asarray(view["intrinsics"]).T
    return np.asarray(image[:, :2] / image[:, 2:])


def simulate(names: list[str], pictures: bool) -> tuple[dict[str, Any], list[NDArray[np.uint8]]]:
    """Run the scene; returns the truth of its motion, and the frames (BGR) when asked for."""
    model = mujoco.MjModel.from_xml_string(scene(names))
    data = mujoco.MjData(model)
    for index, name in enumerate(names):
        data.qvel[6 * index : 6 * index + 3] = BODIES[name]["velocity"]
    mujoco.mj_forward(model, data)
    truth: dict[str, Any] = {"names": names, "positions": [], "orientations": [], "collisions": [], "masks": []}
    frames: list[NDArray[np.uint8]] = []
    renderer = mujoco.Renderer(model, HEIGHT * 2, WIDTH * 2) if pictures else None
    labeller = mujoco.Renderer(model, HEIGHT, WIDTH) if pictures else None
    geoms = {int(model.geom(name).id): name for name in names}
    last_touch: dict[tuple[str, str], float] = {}
    steps = round(SECONDS_PER_FRAME / TIMESTEP)
    for frame in range(FRAMES):
        truth["positions"].append(np.round(data.qpos.reshape(-1, 7)[:, :3], 6).tolist())
        truth["orientations"].append(np.round(data.qpos.reshape(-1, 7)[:, 3:], 6).tolist())
        if renderer is not None and labeller is not None:
            frames.append(photograph(renderer, data))
            truth["masks"].append(_measure_masks(labeller, data, geoms))
        for step in range(steps):
            mujoco.mj_step(model, data)
            now = frame * SECONDS_PER_FRAME + (step + 1) * TIMESTEP
            for contact in data.contact:
                pair = sorted(geoms[int(g)] for g in contact.geom if int(g) in geoms)
                if len(pair) == 2:
                    key = (pair[0], pair[1])
                    # One blow of a cube is several touches of its edges, some milliseconds apart.
                    if now - last_touch.get(key, -1.0) > 0.06:
                        place = np.round(contact.pos, 4).tolist()
                        truth["collisions"].append({"pair": pair, "time": round(now, 4), "position": place})
                    last_touch[key] = now
    if renderer is not None and labeller is not None:
        renderer.close()
        labeller.close()
    return truth, frames


def photograph(renderer: mujoco.Renderer, data: mujoco.MjData) -> NDArray[np.uint8]:
    """Return the picture (BGR) of a scene, its outlines smooth as a lens gives them."""
    # Rendered at twice the size and reduced.
    renderer.update_scene(data, camera="view")
    large = cv2.cvtColor(renderer.render(), cv2.COLOR_RGB2BGR)
    return np.asarray(cv2.resize(large, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA), dtype=np.uint8)


def _measure_masks(
    labeller: mujoco.Renderer, data: mujoco.MjData, geoms: dict[int, str]
) -> dict[str, tuple[int, float, float]]:
    """Area [px] and centroid (u, v) of every body's visible pixels."""
    labeller.update_scene(data, camera="view")
    labeller.enable_segmentation_rendering()
    ids = labeller.render()[..., 0]
    labeller.disable_segmentation_rendering()
    measured = {}
    for geom, name in geoms.items():
        rows, columns = np.nonzero(ids == geom)
        if len(rows):
            measured[name] = (len(rows), round(float(columns.mean()), 3), round(float(rows.mean()), 3))
    return measured


def main() -> None:
    """Simulate, render, encode and write the clip and its truth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path(__file__).parents[2] / "atw_mcp" / "demo")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    names = list(BODIES)
    factual, frames = simulate(names, pictures=True)
    counterfactual, _ = simulate([n for n in names if n != REMOVED], pictures=False)
    del counterfactual["masks"]
    clip = arguments.output / "collision.mp4"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"mp4v"), FILE_RATE, (WIDTH, HEIGHT))
    for frame in frames:
        writer.write(frame)
    writer.release()
    marks = np.array([[x, y, 0.0] for x, y in MARKS])
    truth = {
        "simulator": f"MuJoCo {mujoco.__version__}, step {TIMESTEP} s",
        "seconds_per_frame": SECONDS_PER_FRAME,
        "file_frames_per_second": FILE_RATE,
        "frame_count": FRAMES,
        "camera": camera(),
        "marks": {"world": marks.tolist(), "pixels": np.round(project(marks), 3).tolist()},
        "friction": FRICTION,
        "objects": {
            n: {"shape": b["shape"], "color": b["color"], "mass": b["mass"], "velocity": b["velocity"]}
            for n, b in BODIES.items()
        },
        **factual,
        "counterfactual": {"removed": REMOVED, **counterfactual},
    }
    (arguments.output / "collision.json").write_text(json.dumps(truth, separators=(",", ":")) + "\n")
    for label, run in (("factual", factual), ("counterfactual", counterfactual)):
        print(label, *(f"{' - '.join(c['pair'])} at {c['time']:.3f} s" for c in run["collisions"]), sep="\n  ")
    print(f"{clip}: {clip.stat().st_size / 1000:.0f} kB, {FRAMES} frames")


if __name__ == "__main__":
    main()
