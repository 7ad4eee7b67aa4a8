"""Make the clip that `atw-mcp demo gap` runs on: simulated and rendered by MuJoCo, independent of this project.

    MUJOCO_GL=egl uv run --group bench python -m tests.benchmarks.make_gap_clip [--output atw_mcp/demo]

Three pucks glide without friction on an air table, and red knocks into yellow. The table is not level: everything is
pulled sideways by a steady acceleration that no single picture shows. Written: gap.mp4 and gap.json, the ground truth,
with a second run of the same pucks from other starts, which is not in the video.
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

from tests.benchmarks.make_demo_clip import (
    EYE,
    FIELD_OF_VIEW,
    HEIGHT,
    MARKS,
    WIDTH,
    camera,
    photograph,
    project,
    view_axes,
)

FRAMES = 156
SECONDS_PER_FRAME = 1.0 / 60.0
TIMESTEP = 1.0 / 9600.0
PULL = (0.12, -0.11)  # acceleration along x and y [m/s^2], as of a table that leans by 1 degree
RADIUS, HALF_HEIGHT, MASS = 0.05, 0.012, 0.1

PUCKS: dict[str, dict[str, Any]] = {
    "red_puck": {"rgb": (0.75, 0.10, 0.10), "position": (0.33, -0.13), "velocity": (-0.15, 0.21)},
    "blue_puck": {"rgb": (0.12, 0.22, 0.80), "position": (-0.27, 0.15), "velocity": (0.01, 0.11)},
    "yellow_puck": {"rgb": (0.90, 0.78, 0.08), "position": (0.06, 0.10), "velocity": (0.0, 0.0)},
}
OTHER_STARTS: dict[str, tuple[tuple[float, float], tuple[float, float]]] = {
    "red_puck": ((-0.45, 0.30), (0.30, -0.05)),
    "blue_puck": ((0.30, -0.20), (-0.40, 0.25)),
    "yellow_puck": ((-0.20, 0.00), (0.00, 0.20)),
}


def scene(starts: dict[str, tuple[tuple[float, float], tuple[float, float]]]) -> str:
    """Return the MuJoCo description of the table with the pucks at their starts."""
    pucks = "".join(
        f'<body name="{name}" pos="{x} {y} {HALF_HEIGHT}"><joint type="slide" axis="1 0 0"/>'
        f'<joint type="slide" axis="0 1 0"/><joint type="hinge" axis="0 0 1"/>'
        f'<geom name="{name}" type="cylinder" size="{RADIUS} {HALF_HEIGHT}" mass="{MASS}" '
        f'rgba="{" ".join(map(str, PUCKS[name]["rgb"]))} 1"/></body>'
        for name, ((x, y), _) in starts.items()
    )
    marks = "".join(
        f'<geom type="cylinder" pos="{x} {y} 0.0001" size="0.008 0.0002" rgba="0.12 0.12 0.12 1" '
        'contype="0" conaffinity="0"/>'
        for x, y in MARKS
    )
    right, down, _forward = view_axes()
    axes = " ".join(f"{v:.9f}" for v in (*right, *-down))
    return f"""
<mujoco>
  <option timestep="{TIMESTEP}" gravity="{PULL[0]} {PULL[1]} -9.81" integrator="implicitfast" iterations="100"
          tolerance="1e-12"/>
  <visual>
    <global offwidth="{WIDTH * 2}" offheight="{HEIGHT * 2}"/>
    <headlight ambient="0.42 0.42 0.42" diffuse="0.25 0.25 0.25" specular="0 0 0"/>
    <quality shadowsize="4096" offsamples="8"/>
    <map znear="0.05" zfar="20" shadowclip="1.5"/>
  </visual>
  <default>
    <geom condim="1" solref="-2000000 -146" solimp="0.98 0.99 0.0005"/>
  </default>
  <worldbody>
    <light directional="true" pos="-0.5 -0.6 3" dir="0.15 0.18 -1" diffuse="0.35 0.35 0.35" specular="0.1 0.1 0.1"/>
    <camera name="view" fovy="{FIELD_OF_VIEW}" pos="{EYE[0]} {EYE[1]} {EYE[2]}" xyaxes="{axes}"/>
    <geom name="table" type="plane" size="3 3 1" rgba="0.62 0.62 0.60 1" contype="0" conaffinity="0"/>
    {marks}{pucks}
  </worldbody>
</mujoco>"""


def simulate(
    starts: dict[str, tuple[tuple[float, float], tuple[float, float]]], pictures: bool
) -> tuple[dict[str, Any], list[NDArray[np.uint8]]]:
    """Run the scene; returns the truth of its motion, and the frames (BGR) when asked for."""
    model = mujoco.MjModel.from_xml_string(scene(starts))
    data = mujoco.MjData(model)
    for index, (_, velocity) in enumerate(starts.values()):
        data.qvel[3 * index : 3 * index + 2] = velocity
    mujoco.mj_forward(model, data)
    truth: dict[str, Any] = {"names": list(starts), "positions": [], "collisions": []}
    frames: list[NDArray[np.uint8]] = []
    renderer = mujoco.Renderer(model, HEIGHT * 2, WIDTH * 2) if pictures else None
    bodies = [model.body(name).id for name in starts]
    touching: set[tuple[str, str]] = set()
    for frame in range(FRAMES):
        truth["positions"].append(np.round(data.xpos[bodies], 6).tolist())
        if renderer is not None:
            frames.append(photograph(renderer, data))
        for step in range(round(SECONDS_PER_FRAME / TIMESTEP)):
            mujoco.mj_step(model, data)
            now = frame * SECONDS_PER_FRAME + (step + 1) * TIMESTEP
            pairs = {tuple(sorted(model.geom(int(g)).name for g in contact.geom)) for contact in data.contact}
            for pair in sorted(pairs - touching):
                truth["collisions"].append({"pair": list(pair), "time": round(now, 4)})
            touching = {(a, b) for a, b in pairs}
    if renderer is not None:
        renderer.close()
    return truth, frames


def main() -> None:
    """Simulate, render, encode and write the clip and its truth."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path(__file__).parents[2] / "atw_mcp" / "demo")
    arguments = parser.parse_args()
    arguments.output.mkdir(parents=True, exist_ok=True)
    filmed, frames = simulate({n: (p["position"], p["velocity"]) for n, p in PUCKS.items()}, pictures=True)
    unfilmed, _ = simulate(OTHER_STARTS, pictures=False)
    clip = arguments.output / "gap.mp4"
    writer = cv2.VideoWriter(str(clip), cv2.VideoWriter.fourcc(*"mp4v"), 1.0 / SECONDS_PER_FRAME, (WIDTH, HEIGHT))
    for frame in frames:
        writer.write(frame)
    writer.release()
    marks = np.array([[x, y, 0.0] for x, y in MARKS])
    truth = {
        "simulator": f"MuJoCo {mujoco.__version__}, step {TIMESTEP} s",
        "seconds_per_frame": SECONDS_PER_FRAME,
        "frame_count": FRAMES,
        "camera": camera(),
        "marks": {"world": marks.tolist(), "pixels": np.round(project(marks), 3).tolist()},
        "hidden": {"effect": "tilt", "acceleration": list(PULL)},
        "objects": {
            name: {"shape": {"kind": "cylinder", "radius": RADIUS, "half_height": HALF_HEIGHT}, "mass": MASS}
            for name in PUCKS
        },
        **filmed,
        "unfilmed": {"starts": OTHER_STARTS, **unfilmed},
    }
    (arguments.output / "gap.json").write_text(json.dumps(truth, separators=(",", ":")) + "\n")
    for label, run in (("filmed", filmed), ("unfilmed", unfilmed)):
        print(label, *(f"{' - '.join(c['pair'])} at {c['time']:.3f} s" for c in run["collisions"]), sep="\n  ")
    print(f"{clip}: {clip.stat().st_size / 1000:.0f} kB, {FRAMES} frames")


if __name__ == "__main__":
    main()
